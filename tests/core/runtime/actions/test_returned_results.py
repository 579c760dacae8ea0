"""Handlers written for rclpy, which end the goal first and return its result afterwards."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import TYPE_CHECKING, Any

import pytest
from fibonacci_action import Fibonacci, goal, pair, result, retained_goal_count
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.runtime import Duration, GoalStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import ServerGoal

S = GoalStatus


def succeed(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    return result(1, 2, 3)


def abort(handle: ServerGoal[Fibonacci]) -> Any:
    handle.abort()
    return result(4, 5)


async def succeed_async(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    await asyncio.sleep(0)
    return result(6)


def succeed_later(handle: ServerGoal[Fibonacci]) -> Any:
    return succeed_async(handle)


def succeed_without_result(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()


def return_succeed(handle: ServerGoal[Fibonacci]) -> Any:
    return handle.succeed()


def succeed_and_return_same_result(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed(result(7))
    return result(7)


@pytest.mark.parametrize(
    ("handler", "status", "sequence"),
    [
        (succeed, S.SUCCEEDED, [1, 2, 3]),
        (abort, S.ABORTED, [4, 5]),
        (succeed_async, S.SUCCEEDED, [6]),
        (succeed_later, S.SUCCEEDED, [6]),
        (succeed_without_result, S.SUCCEEDED, []),
        (return_succeed, S.SUCCEEDED, []),
        (succeed_and_return_same_result, S.SUCCEEDED, [7]),
    ],
)
async def test_result_returned_after_goal_end_is_sent(
    world: World,
    caplog: pytest.LogCaptureFixture,
    handler: Callable[[ServerGoal[Fibonacci]], Any],
    status: GoalStatus,
    sequence: list[int],
) -> None:
    _, client = await pair(world, handler)
    handle = await client.send_goal(goal(), timeout_s=5)
    got, answer = await handle.result(timeout_s=5)
    assert (got, list(answer.sequence)) == (status, sequence)
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


async def test_result_returned_after_canceled_is_sent(world: World) -> None:
    def execute(handle: ServerGoal[Fibonacci]) -> Any:
        while not handle.is_cancel_requested:
            threading.Event().wait(0.001)
        handle.canceled()
        return result(8)

    _, client = await pair(world, execute)
    handle = await client.send_goal(goal(), timeout_s=5)
    await handle.cancel(timeout_s=5)
    got, answer = await handle.result(timeout_s=5)
    assert (got, list(answer.sequence)) == (S.CANCELED, [8])


async def test_status_changes_at_succeed_and_result_follows_when_handler_returns(world: World) -> None:
    may_continue = asyncio.Event()
    seen: list[GoalStatus] = []

    async def execute(handle: ServerGoal[Fibonacci]) -> Any:
        handle.succeed()
        seen.append(handle.status)
        await may_continue.wait()
        return result(9)

    server, client = await pair(world, execute)
    handle = await client.send_goal(goal(), timeout_s=5)
    await until(lambda: handle.status is S.SUCCEEDED)
    assert seen == [S.SUCCEEDED] and server.goals == [] and not handle.is_done
    may_continue.set()
    assert list((await handle.result(timeout_s=5))[1].sequence) == [9]
    assert list((await handle.result(timeout_s=5))[1].sequence) == [9]


async def raise_after_succeed(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    raise ValueError("too late")


def return_wrong_type(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    return 5


def return_unencodable_result(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    return result("one", None)


@pytest.mark.parametrize("execute", [raise_after_succeed, return_wrong_type, return_unencodable_result])
async def test_handler_that_fails_after_succeed_sends_aborted_result(world: World, execute: Callable[..., Any]) -> None:
    _, client = await pair(world, execute)
    sent = await client.send_goal(goal(), timeout_s=5)
    got, answer = await sent.result(timeout_s=5)
    assert (got, list(answer.sequence)) == (S.ABORTED, [])
    assert await sent.result(timeout_s=5) == (got, answer)


async def test_result_returned_after_goal_was_aborted_elsewhere_is_ignored_with_warning(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    may_continue = asyncio.Event()

    async def execute(handle: ServerGoal[Fibonacci]) -> Any:
        await may_continue.wait()
        return result(1)

    server, client = await pair(world, execute)
    handle = await client.send_goal(goal(), timeout_s=5)
    server.goals[0].abort()
    assert await handle.result(timeout_s=5) == (S.ABORTED, result())
    may_continue.set()
    await until(lambda: "is ignored, because the goal had ended" in caplog.text)


async def test_result_timeout_starts_when_handler_returns(world: World) -> None:
    may_continue = asyncio.Event()

    async def execute(handle: ServerGoal[Fibonacci]) -> Any:
        handle.succeed()
        await may_continue.wait()
        if handle.request.order:
            raise ValueError("too late")
        return result(9)

    server, client = await pair(world, execute, result_timeout_s=0.1)
    handles = [await client.send_goal(goal(order), timeout_s=5) for order in (0, 1)]
    await until(lambda: all(handle.status is S.SUCCEEDED for handle in handles))
    await world.nodes[0].clock.sleep_for(Duration(seconds=0.3))
    may_continue.set()
    got = [await handle.result(timeout_s=5) for handle in handles]
    assert [(status, list(answer.sequence)) for status, answer in got] == [(S.SUCCEEDED, [9]), (S.ABORTED, [])]
    await until(lambda: retained_goal_count(server) == 0)
