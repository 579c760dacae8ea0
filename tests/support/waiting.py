"""Functions that wait for a condition or an item, and measure how much processor time passes meanwhile."""

from __future__ import annotations

import asyncio
import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine


def run(main: Callable[[], Coroutine[Any, Any, None]], timeout_s: float = 20) -> None:
    """Run an async test."""
    asyncio.run(asyncio.wait_for(main(), timeout_s))


async def until(condition: Callable[[], object], timeout_s: float = 60) -> None:
    deadline = asyncio.get_running_loop().time() + timeout_s
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, "never happened"
        await asyncio.sleep(0.001)


def wait_until(condition: Callable[[], object], timeout_s: float = 60) -> None:
    """Wait as `until` does, in code without an event loop."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "never happened"
        time.sleep(0.005)


def while_the_loop_sleeps(act: Callable[[], object]) -> threading.Thread:
    """Do something in another thread, which alone can wake the loop of this one; the thread, for `join`."""

    def wait_and_act() -> None:
        time.sleep(0.1)  # the loop sleeps by now; if it does not yet, the test shows less, and passes
        act()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    return thread


async def rests(for_s: float, cpu_s: float) -> bool:
    """Return True if this process takes less than `cpu_s` of CPU time while the loop sleeps, in one of three attempts.

    On a VM, stolen CPU time counts as ours.
    """
    for _ in range(3):
        before = time.process_time()
        await asyncio.sleep(for_s)  # what is measured
        if time.process_time() - before < cpu_s:
            return True
    return False


def held_up(cpu_s: float = 0.05) -> float:
    began, cpu = time.perf_counter(), time.thread_time()
    while time.thread_time() - cpu < cpu_s:
        pass
    return (time.perf_counter() - began) / (time.thread_time() - cpu)


async def take(stream: Any) -> Any:
    """Return the next item."""
    return await asyncio.wait_for(stream.__anext__(), 60)
