"""Waiting for a condition, across threads and loops."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from rosidl_py_gen.base.waiters import Waiters


def test_what_became_so_before_the_waiter_could_be_woken_is_seen() -> None:
    looks = iter((False, True))  # another thread changed it, and woke nobody yet, between the two
    assert asyncio.run(asyncio.wait_for(Waiters().wait(lambda: next(looks)), 10))


def test_the_time_limit_holds_however_often_it_is_woken_in_vain() -> None:
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


def test_one_who_was_cancelled_waits_no_more() -> None:
    async def main() -> None:
        waiters = Waiters()
        waiting = asyncio.create_task(waiters.wait(lambda: False))
        await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        assert not waiters

    asyncio.run(main())


def test_loops_of_other_threads_are_woken_and_closed_ones_forgotten() -> None:
    waiters, happened, looks = Waiters(), threading.Event(), list[int]()
    forgotten = asyncio.new_event_loop()
    abandoned = waiters.wait(lambda: looks.append(1) or happened.is_set())
    task = forgotten.create_task(abandoned)
    forgotten.run_until_complete(asyncio.sleep(0))
    forgotten.close()
    with ThreadPoolExecutor(3) as pool:
        waits = [waiters.wait(lambda: looks.append(1) or happened.is_set(), 60) for _ in range(3)]
        waiting = [pool.submit(asyncio.run, one) for one in waits]
        while len(looks) < 8:  # the second look of each, which can be woken by then
            time.sleep(0.001)
        happened.set()
        waiters.wake()
        waiters.wake()
        assert [one.result(20) for one in waiting] == [True] * 3
    with pytest.raises(RuntimeError, match="closed"):
        task.cancel()
    task._log_destroy_pending = False


def test_no_wake_is_lost_between_the_look_and_the_wait() -> None:
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
