"""Handlers written for rclpy, which end the goal first and return its result afterwards."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import TYPE_CHECKING, Any

import pytest
from fibonacci_action import Fibonacci, goal, pair, result
from support.node_fixtures import World, until

from rosidl_py_gen.runtime import GoalStatus

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


def say_nothing(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()


def as_ours(handle: ServerGoal[Fibonacci]) -> Any:
    return handle.succeed()


def twice_the_same(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed(result(7))
    return result(7)


@pytest.mark.parametrize(
    ("handler", "status", "sequence"),
    [
        (succeed, S.SUCCEEDED, [1, 2, 3]),
        (abort, S.ABORTED, [4, 5]),
        (succeed_async, S.SUCCEEDED, [6]),
        (succeed_later, S.SUCCEEDED, [6]),
        (say_nothing, S.SUCCEEDED, []),
        (as_ours, S.SUCCEEDED, []),
        (twice_the_same, S.SUCCEEDED, [7]),
    ],
)
async def test_the_returned_result_of_an_ended_goal_is_sent(
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


async def test_a_canceled_goal_takes_its_result_from_the_handler_too(world: World) -> None:
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


async def test_the_status_changes_at_once_and_the_result_comes_when_the_handler_returns(world: World) -> None:
    go_on = asyncio.Event()
    seen: list[GoalStatus] = []

    async def execute(handle: ServerGoal[Fibonacci]) -> Any:
        handle.succeed()
        seen.append(handle.status)
        await go_on.wait()
        return result(9)

    server, client = await pair(world, execute)
    handle = await client.send_goal(goal(), timeout_s=5)
    await until(lambda: handle.status is S.SUCCEEDED)
    assert seen == [S.SUCCEEDED] and server.goals == [] and not handle.is_done
    go_on.set()
    assert list((await handle.result(timeout_s=5))[1].sequence) == [9]
    assert list((await handle.result(timeout_s=5))[1].sequence) == [9]


async def raise_behind_the_end(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    raise ValueError("too late")


def return_no_result(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    return 5


def return_what_cannot_be_sent(handle: ServerGoal[Fibonacci]) -> Any:
    handle.succeed()
    return result("one", None)


@pytest.mark.parametrize("execute", [raise_behind_the_end, return_no_result, return_what_cannot_be_sent])
async def test_a_handler_that_fails_behind_the_end_aborts_its_goal(world: World, execute: Callable[..., Any]) -> None:
    server, client = await pair(world, execute)
    sent = await client.send_goal(goal(), timeout_s=5)
    got, answer = await sent.result(timeout_s=5)
    assert (got, list(answer.sequence)) == (S.ABORTED, [])
    assert await sent.result(timeout_s=5) == (got, answer)
    assert server is not None


async def test_whoever_else_ends_a_goal_sends_its_result_and_what_is_returned_is_warned_about(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    go_on = asyncio.Event()

    async def execute(handle: ServerGoal[Fibonacci]) -> Any:
        await go_on.wait()
        return result(1)

    server, client = await pair(world, execute)
    handle = await client.send_goal(goal(), timeout_s=5)
    server.goals[0].abort()
    assert await handle.result(timeout_s=5) == (S.ABORTED, result())
    go_on.set()
    await until(lambda: "is ignored, because the goal had ended" in caplog.text)
