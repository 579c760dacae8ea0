"""Calls of callbacks: values, failures, cancellation."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from typing import Any

import pytest

from rosidl_py_gen.runtime.loop.user_callback import UserCallback, start_task


class Owner:
    def __init__(self) -> None:
        self.closed = False
        self.reports: list[str] = []

    def create_task(self, coroutine: Any) -> asyncio.Task[Any]:
        return start_task(asyncio.get_running_loop(), coroutine)

    def report_failure(self, doing: str) -> None:
        self.reports.append(f"{doing}: {type(sys.exc_info()[1]).__name__}")


def plain(number: int) -> int:
    return 6 // number


async def slow(number: int) -> int:
    await asyncio.sleep(0)
    return plain(number)


@pytest.mark.parametrize("function", [plain, slow, lambda number: slow(number)])
def test_its_answer_goes_on_and_its_failure_goes_into_the_log_once(function: Callable[[int], Any]) -> None:
    async def main() -> None:
        owner, answers = Owner(), []
        user = UserCallback(owner, function, "the callback")
        tasks = [user.call(number, on_result=answers.append) for number in (1, 0, 2)]
        assert all(task is None for task in tasks) == (function is plain)
        await asyncio.gather(*(task for task in tasks if task is not None))
        assert answers == [6, 3] and owner.reports == ["the callback: ZeroDivisionError"]

    asyncio.run(main())


def test_what_makes_use_of_the_answer_may_fail_too() -> None:
    async def main() -> None:
        owner = Owner()
        user = UserCallback(owner, lambda: "x", "the callback")
        assert user.call(on_result=int) is None
        assert owner.reports == ["the callback: ValueError"]

    asyncio.run(main())


def test_a_cancellation_from_elsewhere_is_a_failure_and_an_own_one_an_end() -> None:
    async def main() -> None:
        owner, foreign = Owner(), asyncio.get_running_loop().create_future()
        user = UserCallback(owner, lambda: asyncio.wait_for(foreign, 5), "the callback")
        task = user.call()
        assert task is not None
        await asyncio.sleep(0)
        foreign.cancel()
        await task
        assert owner.reports == ["the callback: CancelledError"]
        task = UserCallback(owner, lambda: asyncio.Event().wait(), "the callback").call()
        assert task is not None
        task.cancel()  # before it has begun
        with pytest.raises(asyncio.CancelledError):
            await task
        assert len(owner.reports) == 1

    asyncio.run(main())
