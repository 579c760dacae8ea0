"""LoopRunner that waits in front of the loop while asyncio has nothing to do."""

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
    def __init__(self, driver: LoopRunner) -> None:
        self.driver, self.loop = driver, driver.loop
        self.read_end, self.write_end = os.pipe()
        self.entered = 0
        self.early: list[tuple[bytes, bool, asyncio.AbstractEventLoop]] = []
        self.rest: list[bytes] = []
        assert isinstance(driver.loop, SharedEventLoop)
        driver.loop.add_priority_reader(self.read_end, self._take, lambda: self.rest.append(self.early[-1][0]))

    def _take(self) -> bool:
        data = os.read(self.read_end, 100)
        self.early.append((data, self.loop.is_running(), asyncio.get_running_loop()))
        self.driver.wake()
        return data == b"rest"

    def bring(self, data: bytes) -> None:
        count = len(self.early)
        os.write(self.write_end, data)
        self.driver.wait(lambda: len(self.early) > count, timeout_s=10)
        assert self.early[-1] == (data, True, self.loop)
        assert not self.loop.is_running()
        with pytest.raises(RuntimeError):
            asyncio.get_running_loop()


@pytest.fixture
def arrivals(monkeypatch: pytest.MonkeyPatch) -> Iterator[Arrivals]:
    with LoopRunner() as driver:
        made = Arrivals(driver)
        enter = SharedEventLoop.run_forever

        def counted(loop: Any) -> None:
            made.entered += 1
            enter(loop)

        monkeypatch.setattr(SharedEventLoop, "run_forever", counted)
        made.bring(b"first")
        assert made.entered == 1
        yield made
        driver.loop.remove_priority_reader(made.read_end)  # type: ignore[attr-defined]
        os.close(made.read_end)
        os.close(made.write_end)


def test_the_loop_is_not_entered_for_what_arrives(arrivals: Arrivals) -> None:
    for _ in range(10):
        arrivals.bring(b"next")
    arrivals.driver.wait(timeout_s=0)
    arrivals.driver.wait(timeout_s=0.001)
    assert arrivals.entered == 1
    asyncio.run(asyncio.sleep(0))  # nothing is left of it outside


def test_what_was_left_to_do_is_done_in_the_loop(arrivals: Arrivals) -> None:
    arrivals.bring(b"rest")
    arrivals.driver.wait(lambda: arrivals.rest, timeout_s=10)
    assert arrivals.rest == [b"rest"]


def test_what_the_loop_is_given_between_waits_is_done(arrivals: Arrivals) -> None:
    done: list[str] = []
    arrivals.loop.call_soon(done.append, "soon")
    arrivals.driver.wait(timeout_s=0)
    assert done == ["soon"]
    arrivals.loop.call_later(0.01, done.append, "later")
    arrivals.driver.wait(lambda: len(done) == 2, timeout_s=10)
    arrivals.bring(b"next")
    thread = threading.Thread(target=arrivals.loop.call_soon_threadsafe, args=(done.append, "thread"))
    thread.start()
    thread.join()
    arrivals.driver.wait(timeout_s=0)
    assert done == ["soon", "later", "thread"]


def test_a_timer_that_was_set_before_is_in_time_though_more_arrives(arrivals: Arrivals) -> None:
    done: list[float] = []
    due = arrivals.loop.time() + 0.05
    arrivals.loop.call_at(due, lambda: done.append(arrivals.loop.time()))
    while not done and arrivals.loop.time() < due + 5:
        arrivals.bring(b"next")
    assert done
    arrivals.bring(b"next")


def test_a_task_is_begun_while_somebody_waits(arrivals: Arrivals) -> None:
    async def answer() -> int:
        await asyncio.sleep(0.001)  # a timer, for which asyncio is entered
        return 7

    arrivals.bring(b"next")
    assert arrivals.driver.run(answer()) == 7
    arrivals.bring(b"next")
    done: list[int] = []

    def other() -> None:
        done.append(arrivals.driver.run(answer()))
        arrivals.driver.wake()

    thread = threading.Thread(target=other)
    thread.start()
    assert arrivals.driver.wait(lambda: list(done)) == [7]
    thread.join()


def test_other_descriptors_are_seen_also_without_waiting(arrivals: Arrivals) -> None:
    here, there = socket.socketpair()
    with here, there:
        seen: list[bytes] = []
        arrivals.loop.add_reader(here.fileno(), lambda: seen.append(here.recv(10)))
        arrivals.bring(b"next")
        there.send(b"a")
        arrivals.driver.wait(lambda: seen, timeout_s=10)
        there.send(b"b")
        arrivals.driver.wait(timeout_s=0)
        assert seen == [b"a", b"b"]
        arrivals.loop.remove_reader(here.fileno())


def test_stop_ends_one_wait(arrivals: Arrivals) -> None:
    arrivals.bring(b"next")
    arrivals.loop.stop()
    arrivals.driver.wait(lambda: False, timeout_s=30)
    arrivals.bring(b"next")


def test_an_error_of_a_condition_leaves_nothing_behind(arrivals: Arrivals) -> None:
    asked: list[int] = []

    def fails() -> bool:
        asked.append(1)
        if len(asked) > 1:
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        arrivals.driver.wait(fails, timeout_s=10)
    assert not arrivals.loop.is_running()
    arrivals.bring(b"next")
