"""Waiting for a condition, across threads and loops."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from rosidl_py_gen.base.waiters import Waiters


def test_wait_rechecks_condition_after_registering_the_waiter() -> None:
    checks = iter((False, True))  # another thread changes the condition between both checks and has not called wake()
    assert asyncio.run(asyncio.wait_for(Waiters().wait(lambda: next(checks)), 10))


def test_wait_timeout_holds_despite_repeated_wake_ups() -> None:
    async def main() -> None:
        waiters = Waiters()
        waiting = asyncio.create_task(waiters.wait(lambda: False, 0.05))
        started = time.monotonic()
        while not waiting.done() and time.monotonic() - started < 10:
            waiters.wake()
            await asyncio.sleep(0.001)
        assert waiting.done() and not waiting.result() and time.monotonic() - started > 0.04
        assert not await waiters.wait(lambda: False, 0) and await waiters.wait(lambda: True, 0)
        assert not waiters

    asyncio.run(main())


def test_cancelled_waiter_is_removed() -> None:
    async def main() -> None:
        waiters = Waiters()
        waiting = asyncio.create_task(waiters.wait(lambda: False))
        await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        assert not waiters

    asyncio.run(main())


def test_wake_reaches_loops_of_other_threads_and_skips_closed_loops() -> None:
    waiters, happened, checks = Waiters(), threading.Event(), list[int]()
    closed_loop = asyncio.new_event_loop()
    closed_loop_wait = waiters.wait(lambda: checks.append(1) or happened.is_set())
    task = closed_loop.create_task(closed_loop_wait)
    closed_loop.run_until_complete(asyncio.sleep(0))
    closed_loop.close()
    with ThreadPoolExecutor(3) as pool:
        waits = [waiters.wait(lambda: checks.append(1) or happened.is_set(), 60) for _ in range(3)]
        waiting = [pool.submit(asyncio.run, one) for one in waits]
        while len(checks) < 8:  # after its second check each waiter can be woken
            time.sleep(0.001)
        happened.set()
        waiters.wake()
        waiters.wake()
        assert [one.result(20) for one in waiting] == [True] * 3
    with pytest.raises(RuntimeError, match="closed"):
        task.cancel()
    task._log_destroy_pending = False


def test_no_wake_up_is_lost_between_check_and_wait() -> None:
    async def main() -> None:
        waiters, count = Waiters(), 0

        def push() -> None:
            nonlocal count
            for _ in range(5000):
                count += 1
                waiters.wake()

        thread = threading.Thread(target=push)
        thread.start()
        seen = 0
        while seen < 5000:
            assert await waiters.wait(lambda: count > seen, 5)  # noqa: B023 - waited for in here
            seen = count
        thread.join()

    asyncio.run(main())
