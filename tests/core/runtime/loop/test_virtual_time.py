"""Event loop with virtual time, on which tests wait without delay."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from rosidl_py_gen.runtime import Node
from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeDeadlockError, VirtualTimeLoop


def test_virtual_loop_sleeps_a_day_without_waiting(ros_loop: VirtualTimeLoop) -> None:
    async def main() -> float:
        await asyncio.sleep(86400)
        return asyncio.get_running_loop().time()

    before = time.monotonic()
    assert ros_loop.run(main()) == 86400
    assert time.monotonic() - before < 5


def test_virtual_time_does_not_advance_while_code_runs(ros_loop: VirtualTimeLoop) -> None:
    async def main() -> None:
        time.sleep(0.01)  # slow code is the condition under test
        await asyncio.sleep(0)

    ros_loop.run(main())
    assert ros_loop.time() == 0


def test_timers_and_clocks_are_exact_in_virtual_time(ros_node: Callable[..., Node], ros_loop: VirtualTimeLoop) -> None:
    node = ros_node("n")
    stamps: list[int] = []

    async def main() -> None:
        before = node.clock.now_ns()
        node.create_timer(0.05, lambda: stamps.append(node.clock.now_ns() - before))
        await asyncio.sleep(0.26)

    ros_loop.run(main())
    assert stamps == [50_000_000, 100_000_000, 150_000_000, 200_000_000, 250_000_000]


def test_virtual_loop_reports_pending_task_that_can_never_be_woken(ros_loop: VirtualTimeLoop) -> None:
    async def wait_forever() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(VirtualTimeDeadlockError, match=r"nothing will ever wake this test\n  pending: .*wait_forever"):
        ros_loop.run(wait_forever())


def test_virtual_loop_fails_a_test_that_exceeds_its_limit() -> None:
    async def main() -> None:
        while True:
            await asyncio.sleep(1)

    with pytest.raises(VirtualTimeDeadlockError, match=r"the test has not ended after 0\.2 s"):
        VirtualTimeLoop(limit_s=0.2).run(main())


@pytest.mark.parametrize("way", ["executor", "thread"])
def test_virtual_time_follows_real_time_while_a_thread_works(ros_loop: VirtualTimeLoop, way: str) -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        done = loop.create_future()

        def work() -> None:
            time.sleep(0.2)  # a slow thread is the condition under test
            loop.call_soon_threadsafe(done.set_result, loop.time())

        if way == "thread":
            threading.Thread(target=work).start()
        else:
            loop.run_in_executor(None, work)
        other = asyncio.ensure_future(asyncio.sleep(100))
        ended: Any = await done
        assert not other.done()
        other.cancel()
        return float(ended)

    assert 0.1 < ros_loop.run(main()) < 10
