"""LoopRunner polls descriptors outside the loop while asyncio is idle."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen.runtime import LoopRunner
from rosidl_py_gen.runtime.loop.shared_loop import SharedEventLoop

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there the loop is entered each time")


class Arrivals:
    def __init__(self, runner: LoopRunner) -> None:
        self.runner, self.loop = runner, runner.loop
        self.read_end, self.write_end = os.pipe()
        self.entered = 0
        self.early: list[tuple[bytes, bool, asyncio.AbstractEventLoop]] = []
        self.rest: list[bytes] = []
        assert isinstance(runner.loop, SharedEventLoop)
        runner.loop.add_priority_reader(self.read_end, self._take, lambda: self.rest.append(self.early[-1][0]))

    def _take(self) -> bool:
        data = os.read(self.read_end, 100)
        self.early.append((data, self.loop.is_running(), asyncio.get_running_loop()))
        self.runner.wake()
        return data == b"rest"

    def deliver(self, data: bytes) -> None:
        count = len(self.early)
        os.write(self.write_end, data)
        self.runner.wait(lambda: len(self.early) > count, timeout_s=10)
        assert self.early[-1] == (data, True, self.loop)
        assert not self.loop.is_running()
        with pytest.raises(RuntimeError):
            asyncio.get_running_loop()


@pytest.fixture
def arrivals(monkeypatch: pytest.MonkeyPatch) -> Iterator[Arrivals]:
    with LoopRunner() as runner:
        made = Arrivals(runner)
        enter = SharedEventLoop.run_forever

        def counted(loop: Any) -> None:
            made.entered += 1
            enter(loop)

        monkeypatch.setattr(SharedEventLoop, "run_forever", counted)
        made.deliver(b"first")
        assert made.entered == 1
        yield made
        runner.loop.remove_priority_reader(made.read_end)  # type: ignore[attr-defined]
        os.close(made.read_end)
        os.close(made.write_end)


def test_loop_is_not_entered_for_received_data(arrivals: Arrivals) -> None:
    for _ in range(10):
        arrivals.deliver(b"next")
    arrivals.runner.wait(timeout_s=0)
    arrivals.runner.wait(timeout_s=0.001)
    assert arrivals.entered == 1
    asyncio.run(asyncio.sleep(0))  # no running loop remains set in this thread


def test_remaining_work_of_a_read_runs_inside_the_loop(arrivals: Arrivals) -> None:
    arrivals.deliver(b"rest")
    arrivals.runner.wait(lambda: arrivals.rest, timeout_s=10)
    assert arrivals.rest == [b"rest"]


def test_callbacks_scheduled_between_waits_are_run(arrivals: Arrivals) -> None:
    done: list[str] = []
    arrivals.loop.call_soon(done.append, "soon")
    arrivals.runner.wait(timeout_s=0)
    assert done == ["soon"]
    arrivals.loop.call_later(0.01, done.append, "later")
    arrivals.runner.wait(lambda: len(done) == 2, timeout_s=10)
    arrivals.deliver(b"next")
    thread = threading.Thread(target=arrivals.loop.call_soon_threadsafe, args=(done.append, "thread"))
    thread.start()
    thread.join()
    arrivals.runner.wait(timeout_s=0)
    assert done == ["soon", "later", "thread"]


def test_loop_timer_fires_although_data_keeps_arriving(arrivals: Arrivals) -> None:
    done: list[float] = []
    due = arrivals.loop.time() + 0.05
    arrivals.loop.call_at(due, lambda: done.append(arrivals.loop.time()))
    while not done and arrivals.loop.time() < due + 60:
        arrivals.deliver(b"next")
    assert done
    arrivals.deliver(b"next")


def test_coroutine_runs_while_another_thread_waits(arrivals: Arrivals) -> None:
    async def answer() -> int:
        await asyncio.sleep(0.001)  # a timer, for which asyncio is entered
        return 7

    arrivals.deliver(b"next")
    assert arrivals.runner.run(answer()) == 7
    arrivals.deliver(b"next")
    done: list[int] = []

    def other() -> None:
        done.append(arrivals.runner.run(answer()))
        arrivals.runner.wake()

    thread = threading.Thread(target=other)
    thread.start()
    assert arrivals.runner.wait(lambda: list(done)) == [7]
    thread.join()


def test_other_descriptors_are_polled_by_waits_with_zero_timeout(arrivals: Arrivals) -> None:
    here, there = socket.socketpair()
    with here, there:
        seen: list[bytes] = []
        arrivals.loop.add_reader(here.fileno(), lambda: seen.append(here.recv(10)))
        arrivals.deliver(b"next")
        there.send(b"a")
        arrivals.runner.wait(lambda: seen, timeout_s=10)
        there.send(b"b")
        arrivals.runner.wait(timeout_s=0)
        assert seen == [b"a", b"b"]
        arrivals.loop.remove_reader(here.fileno())


def test_loop_stop_ends_one_wait(arrivals: Arrivals) -> None:
    arrivals.deliver(b"next")
    arrivals.loop.stop()
    arrivals.runner.wait(lambda: False, timeout_s=30)
    arrivals.deliver(b"next")


def test_failing_condition_leaves_the_loop_usable(arrivals: Arrivals) -> None:
    asked: list[int] = []

    def fails() -> bool:
        asked.append(1)
        if len(asked) > 1:
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        arrivals.runner.wait(fails, timeout_s=10)
    assert not arrivals.loop.is_running()
    arrivals.deliver(b"next")
