"""Results that do not arrive: lost requests, unknown goals, restarted servers."""

from __future__ import annotations

import asyncio
import itertools
from typing import TYPE_CHECKING, Any

import pytest
from fibonacci_action import Fibonacci, fibonacci, goal, pair, until_canceled
from support.node_fixtures import until

from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.runtime import GoalStatus, UnknownGoalError
from rosidl_py_gen.runtime.actions.server import ActionServer

if TYPE_CHECKING:
    from support.node_fixtures import World

S = GoalStatus


def lose(monkeypatch: pytest.MonkeyPatch, count: int, *, deny: bool = False) -> list[bytes]:
    original, lost = ActionServer._on_get_result, list[bytes]()

    def on_get_result(self: ActionServer[Any], request: Any) -> Any:
        if len(lost) == count:
            return original(self, request)
        lost.append(bytes(request.goal_id.uuid))
        return self._unknown if deny else asyncio.Event().wait()

    monkeypatch.setattr(ActionServer, "_on_get_result", on_get_result)
    return lost


@pytest.mark.every_transport
async def test_a_lost_result_is_asked_for_again_once_its_goal_has_ended(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = lose(monkeypatch, 3)
    _, client = await pair(world)
    handles = [await client.send_goal(goal(2), timeout_s=5) for _ in range(3)]
    for handle in handles:
        assert (await handle.result(timeout_s=10))[0] is S.SUCCEEDED
    assert len(lost) == 3
    assert not client._result._pending and client._result.client.in_flight_count == 0


async def test_the_result_of_a_goal_that_goes_on_is_asked_for_once(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._RETRY_DELAY_S", 0.001)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._CHECK_INTERVAL_S", 0.001)
    lost = lose(monkeypatch, 100)
    _, client = await pair(memory, until_canceled)
    handle = await client.send_goal(goal(), timeout_s=5)
    await until(lambda: len(lost) == 1)
    looks, look = 0, client._result._check_servers

    def counted() -> None:
        nonlocal looks
        looks += 1
        look()

    monkeypatch.setattr(client._result, "_check_servers", counted)
    await until(lambda: looks > 20)
    assert lost == [handle.goal_id]


async def test_a_server_that_forgot_an_ended_goal_is_asked_again(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    original = ActionServer._on_get_result
    denied = 0

    def on_get_result(self: ActionServer[Any], request: Any) -> Any:
        nonlocal denied
        if not self._goals.active and denied == 1:
            return original(self, request)
        denied += 1

        async def later() -> Any:
            await until(lambda: handle.status.is_terminal)
            return self._unknown

        return later()

    monkeypatch.setattr(ActionServer, "_on_get_result", on_get_result)
    _, client = await pair(world)
    handle = await client.send_goal(goal(1), timeout_s=5)
    assert (await handle.result(timeout_s=10))[0] is S.SUCCEEDED and denied == 1


async def test_a_server_that_always_denies_an_ended_goal_ends_it(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._RETRY_DELAY_S", 0.001)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._CHECK_INTERVAL_S", 0.001)
    lose(monkeypatch, 1000, deny=True)
    _, client = await pair(memory)
    handle = await client.send_goal(goal(0), timeout_s=5)
    with pytest.raises(UnknownGoalError, match="does not know goal"):
        await handle.result(timeout_s=10)
    assert not client._result._pending and client._result.client.in_flight_count == 0


async def test_a_server_that_registers_a_goal_after_its_acceptance_is_asked_again(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulate a reentrant server of rclcpp: a result request or cancel that arrives early finds no goal."""
    now_s = asyncio.get_running_loop().time
    times_s, get_result, cancel = list[float](), ActionServer._on_get_result, ActionServer._on_cancel_goal
    registration_s = 0.5

    def on_get_result(self: ActionServer[Any], request: Any) -> Any:
        times_s.append(now_s())
        return self._unknown if now_s() < times_s[0] + registration_s else get_result(self, request)

    async def on_cancel_goal(self: ActionServer[Any], request: Any) -> Any:
        if now_s() < times_s[0] + registration_s:
            return CancelGoal.Response(return_code=CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID)
        return await cancel(self, request)

    monkeypatch.setattr(ActionServer, "_on_get_result", on_get_result)
    monkeypatch.setattr(ActionServer, "_on_cancel_goal", on_cancel_goal)
    _, client = await pair(memory, until_canceled)
    handle = await client.send_goal(goal(), timeout_s=5)
    await handle.cancel(timeout_s=5)
    assert (await handle.result(timeout_s=5))[0] is S.CANCELED
    delays_s = [later - earlier for earlier, later in itertools.pairwise(times_s)]
    assert len(delays_s) == 5 and all(later > 1.5 * earlier for earlier, later in itertools.pairwise(delays_s))
    registration_s = 3.0  # longer than the client waits
    times_s.clear()
    handle = await client.send_goal(goal(), timeout_s=5)
    with pytest.raises(UnknownGoalError, match="does not know"):
        await handle.cancel(timeout_s=0.1)
    for wait in (handle.result, handle.cancel):
        with pytest.raises(UnknownGoalError, match="does not know goal"):
            await wait(timeout_s=5)
    assert 2.0 <= now_s() - times_s[0] < 3.0 and len(times_s) == 8
    assert not client._result._pending and client._result.client.in_flight_count == 0


async def test_a_second_node_of_the_name_ends_no_goal_of_the_first(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._ACK_TIMEOUT_S", 0.05)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.result_requests._CHECK_INTERVAL_S", 0.02)
    _, client = await pair(dds, until_canceled)
    handle = await client.send_goal(goal(), timeout_s=5)
    dds.node("server").create_action_server(Fibonacci, "fib", fibonacci)
    (wanted,) = client._result._pending
    await until(lambda: wanted.unknown_reply is not None)
    seen = client._result._server_seen_s
    await until(lambda: client._result._server_seen_s > seen + 0.5)
    assert not handle.is_done
    await client.cancel_all(timeout_s=5)
    assert (await handle.result(timeout_s=5))[0] is S.CANCELED
