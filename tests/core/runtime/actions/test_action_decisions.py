"""Decisions about goals and cancels, and goals that have not started."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest
from fibonacci_action import fibonacci, goal, pair, result, until_canceled
from support.waiting import take, until
from support.worlds import World

from rosidl_py_gen.runtime import (
    AlreadyTerminatedError,
    CancelRejectedError,
    GoalDecision,
    GoalRejectedError,
    GoalStatus,
    GoalTransitionError,
)
from rosidl_py_gen.runtime.actions.server_goal import record_of

S = GoalStatus


# ------------------------------------------------------------------------------------- return values of callbacks


AGREE = (None, True, 1, np.True_, "yes", GoalDecision.ACCEPT)
REFUSE = (False, 0, np.False_, "", GoalDecision.REJECT)
FAIL = (np.array([True, False]), RuntimeError("boom"), asyncio.CancelledError())
ANSWERS = [(answer, True) for answer in AGREE] + [(answer, False) for answer in (*REFUSE, *FAIL)]


def deciding(answer: object) -> Any:
    async def decide(_: Any) -> object:
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return decide


@pytest.mark.parametrize(("answer", "agreed"), ANSWERS)
async def test_goal_callback_return_value_accepts_or_rejects(world: World, answer: object, agreed: bool) -> None:
    server, client = await pair(world, goal_callback=deciding(answer))
    if agreed:
        assert (await (await client.send_goal(goal())).result(timeout_s=5))[0] is S.SUCCEEDED
        return
    with pytest.raises(GoalRejectedError, match="rejected the goal"):
        await client.send_goal(goal(), timeout_s=5)
    assert server.goals == [] and server._undecided == {}


@pytest.mark.parametrize(("answer", "agreed"), ANSWERS)
async def test_cancel_callback_return_value_accepts_or_rejects(world: World, answer: object, agreed: bool) -> None:
    callback = answer if answer is False else deciding(answer)
    _, client = await pair(world, until_canceled, cancel_callback=callback)
    handle = await client.send_goal(goal())
    if agreed:
        await handle.cancel(timeout_s=5)
        assert (await handle.result(timeout_s=5))[0] is S.CANCELED
        return
    with pytest.raises(CancelRejectedError):
        await handle.cancel(timeout_s=5)
    with pytest.raises(CancelRejectedError):
        await client.cancel_all(timeout_s=5)


# ------------------------------------------------------------------------------- goals that end during a decision


@pytest.mark.parametrize("agreed", [True, False])
@pytest.mark.parametrize("by_id", [True, False])
async def test_cancel_reply_for_goal_that_ends_during_cancel_decision(world: World, by_id: bool, agreed: bool) -> None:
    """docs/internals/protocol.md 8.4: GOAL_TERMINATED for a goal named by its id, else code 0 with an empty list."""
    callback_entered, decide = asyncio.Event(), asyncio.Event()

    async def on_cancel(handle: Any) -> bool:
        callback_entered.set()
        await decide.wait()
        return agreed

    server, client = await pair(world, None, cancel_callback=on_cancel)
    sent = [asyncio.ensure_future(client.send_goal(goal())) for _ in range(1 if by_id else 2)]
    accepted = [(await take(server.__aiter__())).accept() for _ in sent]
    handles = [await one for one in sent]
    waiting = asyncio.ensure_future(handles[0].cancel(timeout_s=5) if by_id else client.cancel_all(timeout_s=5))
    await asyncio.wait_for(callback_entered.wait(), 5)
    for handle in accepted:
        handle.succeed(result(1))
    decide.set()
    if by_id:
        with pytest.raises(AlreadyTerminatedError):
            await waiting
    else:
        assert await waiting == []
    assert [(await handle.result(timeout_s=5))[0] for handle in handles] == [S.SUCCEEDED] * len(handles)


# ------------------------------------------------------------------------------------------------ one at a time


@pytest.mark.parametrize("policy", ["queue", "preempt"])
async def test_executing_deferred_goal_follows_goal_policy(world: World, policy: str) -> None:
    running: list[int] = []
    most: list[int] = []
    release = asyncio.Event()

    async def execute(handle: Any) -> Any:
        running.append(handle.request.order)
        most.append(len(running))
        await release.wait()
        running.remove(handle.request.order)
        return result(handle.request.order)

    def accept(request: Any) -> GoalDecision:
        return GoalDecision.DEFER if request.order == 2 else GoalDecision.ACCEPT

    server, client = await pair(world, execute, goal_callback=accept, goal_policy=policy)
    deferred = await client.send_goal(goal(2))
    first = await client.send_goal(goal(1))
    await until(lambda: running == [1])
    waiting, runs = server.goals
    waiting.execute()
    waiting.execute()
    await asyncio.sleep(0.02)
    assert waiting.status is S.ACCEPTED
    assert runs.status is (S.EXECUTING if policy == "queue" else S.CANCELING)
    release.set()
    assert [(await one.result(timeout_s=5))[0] for one in (first, deferred)] == [S.SUCCEEDED, S.SUCCEEDED]
    assert most == [1, 1]


async def test_deferred_goal_does_not_block_queued_goals(world: World) -> None:
    def accept(request: Any) -> GoalDecision:
        return GoalDecision.DEFER if request.order == 13 else GoalDecision.ACCEPT

    server, client = await pair(world, goal_callback=accept, goal_policy="queue")
    await client.send_goal(goal(13))
    handles = [await client.send_goal(goal(n)) for n in (1, 2)]
    assert [(await one.result(timeout_s=5))[0] for one in handles] == [S.SUCCEEDED] * 2
    assert [one.status for one in server.goals] == [S.ACCEPTED]


async def test_started_reports_when_queued_stream_goals_start(world: World) -> None:
    server, client = await pair(world, None, goal_policy="queue")
    requests = server.__aiter__()
    sent = [asyncio.ensure_future(client.send_goal(goal(n))) for n in range(3)]
    first, second, third = [(await take(requests)).accept() for _ in sent]
    handles = [await one for one in sent]
    assert await first.started()
    assert (second.status, record_of(second).has_started) == (S.ACCEPTED, False)
    with pytest.raises(GoalTransitionError):
        second.succeed(result(1))
    starts = [asyncio.ensure_future(one.started()) for one in (second, third)]
    await next(h for h in handles if h.goal_id == third.goal_id).cancel(timeout_s=5)
    assert await starts[1] is False and third.status is S.CANCELED
    assert not starts[0].done()
    first.succeed(result(0))
    assert await starts[0] is True and second.status is S.EXECUTING
    second.succeed(result(1))
    statuses = sorted([(await one.result(timeout_s=5))[0] for one in handles])
    assert statuses == [S.SUCCEEDED, S.SUCCEEDED, S.CANCELED]


async def test_started_returns_false_when_server_closes(world: World) -> None:
    server, client = await pair(world, None, goal_policy="queue")
    requests = server.__aiter__()
    sent = [asyncio.ensure_future(client.send_goal(goal(n))) for n in range(2)]
    first, second = [(await take(requests)).accept() for _ in sent]
    start = asyncio.ensure_future(second.started())
    await asyncio.sleep(0)
    server.close()
    assert await start is False and await first.started() is True
    assert first.is_cancel_requested and second.is_cancel_requested
    await asyncio.gather(*sent, return_exceptions=True)


@pytest.mark.parametrize("by", ["defer", "accept"])
async def test_cancelling_a_deferred_goal_finishes_it_as_canceled(world: World, by: str) -> None:
    if by == "accept":
        server, client = await pair(world, fibonacci, goal_callback=lambda request: GoalDecision.DEFER)
        handle = await client.send_goal(goal())
        (waiting,) = server.goals
    else:
        server, client = await pair(world, None)
        sent = asyncio.ensure_future(client.send_goal(goal()))
        waiting = (await take(server.__aiter__())).defer()
        handle = await sent
    await handle.cancel(timeout_s=5)
    assert (await handle.result(timeout_s=5))[0] is S.CANCELED
    assert server.goals == [] and await waiting.started() is False and waiting.is_cancel_requested
