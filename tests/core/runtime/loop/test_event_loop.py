"""Event loop with a selector that calls priority readers."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32
from support.waiting import until, while_the_loop_sleeps

from rosidl_py_gen.runtime import new_event_loop, run
from rosidl_py_gen.runtime.loop import event_loop
from rosidl_py_gen.runtime.loop.event_loop import EventLoop

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it needs epoll")


@pytest.fixture
def loop() -> Iterator[EventLoop]:
    made = EventLoop()
    yield made
    made.close()


class Pipe:
    def __init__(self) -> None:
        self.read_end, self.write_end = os.pipe()
        self.write()
        self.seen = 0

    def write(self) -> None:
        os.write(self.write_end, b"x")

    def read(self) -> bool:
        os.read(self.read_end, 100)
        self.seen += 1
        return False

    def on_read(self) -> None:
        raise AssertionError("nothing was left to do")

    def close(self) -> None:
        os.close(self.read_end)
        os.close(self.write_end)


@pytest.fixture
def pipes() -> Iterator[list[Pipe]]:
    made = [Pipe() for _ in range(3 * event_loop.MAX_EVENTS)]
    yield made
    for each in made:
        each.close()


@pytest.fixture
def rounds(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    waits: list[float | None] = []
    select = event_loop.PriorityReaderSelector.select

    def note(self: Any, timeout: float | None = None) -> Any:
        waits.append(timeout)
        return select(self, timeout)

    monkeypatch.setattr(event_loop.PriorityReaderSelector, "select", note)
    return waits


def test_task_resumes_in_the_loop_iteration_in_which_its_data_arrived(
    loop: EventLoop, pipes: list[Pipe], rounds: list[float | None]
) -> None:
    pipe = pipes[0]
    pipe.read()

    async def main() -> tuple[int, int]:
        future: asyncio.Future[int] = loop.create_future()

        def arrived() -> bool:
            future.set_result(len(rounds))
            return pipe.read()

        loop.add_priority_reader(pipe.read_end, arrived, pipe.on_read)
        pipe.write()
        return await future, len(rounds)

    arrival_round, resume_round = loop.run_until_complete(main())
    assert arrival_round == resume_round


def test_sample_wakes_task_without_another_loop_iteration(dds: World, rounds: list[float | None]) -> None:
    alice, bob = dds.pair()
    publisher, subscription = alice.create_publisher(Int32, "n"), bob.create_subscription(Int32, "n")
    last: list[float | None] = []

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        await subscription.wait_for_publishers(timeout_s=20)
        for number in range(100):
            sending = while_the_loop_sleeps(partial(publisher.publish, Int32(data=number)))
            assert (await subscription.receive(timeout_s=20)).data == number
            last.append(rounds[-1])  # 0 if another iteration followed the one that slept
            sending.join()
            if last[-1]:
                break

    run(main)
    assert last[-1], last


def test_remaining_work_of_priority_reader_runs_as_callback_in_same_iteration(
    loop: EventLoop, pipes: list[Pipe], rounds: list[float | None]
) -> None:
    pipe, seen = pipes[0], list[tuple[str, int]]()

    async def main() -> None:
        done = asyncio.Event()

        def early() -> bool:
            pipe.read()
            seen.append(("early", len(rounds)))
            return True

        def callback() -> None:
            seen.append(("callback", len(rounds)))
            done.set()

        loop.add_priority_reader(pipe.read_end, early, callback)
        await asyncio.wait_for(done.wait(), 10)
        for _ in range(3):  # a second call would happen in these iterations
            await asyncio.sleep(0)

    loop.run_until_complete(main())
    assert seen == [("early", seen[0][1]), ("callback", seen[0][1])]


def test_all_ready_descriptors_are_read_even_above_max_events(loop: EventLoop, pipes: list[Pipe]) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        theirs.send(b"x")
        for pipe in pipes:
            loop.add_priority_reader(pipe.read_end, pipe.read, pipe.on_read)

        async def main() -> bytes:
            return await loop.sock_recv(ours, 1)

        assert loop.run_until_complete(asyncio.wait_for(main(), 10)) == b"x"
        loop.run_until_complete(until(lambda: all(pipe.seen for pipe in pipes)))
        assert [pipe.seen for pipe in pipes] == [1] * len(pipes)


def test_permanently_ready_descriptors_do_not_starve_timers_and_sockets(loop: EventLoop, pipes: list[Pipe]) -> None:
    calls = dict.fromkeys(range(len(pipes)), 0)
    for number, pipe in enumerate(pipes):

        def poll(number: int = number) -> bool:
            calls[number] += 1
            return False

        loop.add_priority_reader(pipe.read_end, poll, pipe.on_read)

    async def main() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            for _ in range(20):
                theirs.send(b"x")
                await asyncio.wait_for(loop.sock_recv(ours, 1), 10)
                start = time.monotonic()
                await asyncio.sleep(0.002)  # the timer under test
                assert time.monotonic() - start < 10

    loop.run_until_complete(main())
    assert min(calls.values()) >= 10


def test_priority_reader_may_remove_itself_and_another_reader(loop: EventLoop, pipes: list[Pipe]) -> None:
    calls: list[int] = []
    for number in (0, 1):

        def call(number: int = number) -> bool:
            calls.append(number)
            loop.remove_priority_reader(pipes[0].read_end)
            loop.remove_priority_reader(pipes[1].read_end)
            return True

        loop.add_priority_reader(pipes[number].read_end, call, pipes[number].on_read)

    async def rounds() -> None:
        await until(lambda: calls)
        for _ in range(3):
            await asyncio.sleep(0)

    loop.run_until_complete(rounds())
    assert len(calls) == 1


def test_closed_loop_leaves_no_descriptors_and_allows_reader_removal(pipes: list[Pipe]) -> None:
    before = len(os.listdir("/proc/self/fd"))
    loop = EventLoop()
    loop.add_priority_reader(pipes[0].read_end, pipes[0].read, pipes[0].on_read)
    loop.close()
    loop.remove_priority_reader(pipes[0].read_end)
    assert len(os.listdir("/proc/self/fd")) <= before  # less where a connection of an earlier test ends just now


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of policies, which programs use until 3.16
def test_event_loop_of_a_policy_is_used() -> None:
    class Chosen(asyncio.SelectorEventLoop):
        pass

    if sys.version_info >= (3, 16):
        pytest.skip("asyncio has no policies, and so no choice of a loop for the process")

    class Policy(asyncio.DefaultEventLoopPolicy):
        def new_event_loop(self) -> asyncio.AbstractEventLoop:
            return Chosen()

    for policy, kind in ((Policy(), Chosen), (None, EventLoop)):
        asyncio.set_event_loop_policy(policy)
        try:
            loop = new_event_loop()
            assert type(loop) is kind
            loop.close()
        finally:
            asyncio.set_event_loop_policy(None)


def test_run_uses_our_event_loop() -> None:
    async def main() -> type[asyncio.AbstractEventLoop]:
        return type(asyncio.get_running_loop())

    assert run(main) is EventLoop
