"""Results that do not arrive: lost requests, unknown goals, restarted servers."""

from __future__ import annotations

import asyncio
import itertools
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from fibonacci_action import Fibonacci, fibonacci, goal, pair, pending_results, result_client, until_canceled
from support.waiting import until

from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.runtime import GoalStatus, UnknownGoalError
from rosidl_py_gen.runtime.actions import server as action_server
from rosidl_py_gen.runtime.entities.services import ServiceServer

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

S = GoalStatus


def replace_handlers(monkeypatch: pytest.MonkeyPatch, **replacements: Callable[[Any, Any], Any]) -> None:
    """Replace service handlers of the next created server by functions of handler and request."""

    def create(parts: Any, types: Any, name: str, handler: Any, qos: Any) -> Any:
        replacement = replacements.get(name.rpartition("/")[2])
        return ServiceServer(parts, types, name, partial(replacement, handler) if replacement else handler, qos)

    monkeypatch.setattr(action_server, "ServiceServer", create)


def unknown(get_result: Any) -> Any:
    """The response about a goal that the server does not know."""
    return get_result(Fibonacci.GetResult.Request())


def lose(monkeypatch: pytest.MonkeyPatch, count: int, *, deny: bool = False) -> list[bytes]:
    lost = list[bytes]()

    def on_get_result(get_result: Any, request: Any) -> Any:
        if len(lost) == count:
            return get_result(request)
        lost.append(bytes(request.goal_id.uuid))
        return unknown(get_result) if deny else asyncio.Event().wait()

    replace_handlers(monkeypatch, get_result=on_get_result)
    return lost


@pytest.mark.every_transport
async def test_lost_result_request_is_repeated_after_its_goal_ended(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = lose(monkeypatch, 3)
    _, client = await pair(world)
    handles = [await client.send_goal(goal(2), timeout_s=20) for _ in range(3)]
    for handle in handles:
        assert (await handle.result(timeout_s=10))[0] is S.SUCCEEDED
    assert len(lost) == 3
    assert not pending_results(client) and result_client(client).in_flight_count == 0


async def test_result_of_running_goal_is_requested_only_once(memory: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.RETRY_DELAY_S", 0.001)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.CHECK_INTERVAL_S", 0.001)
    lost = lose(monkeypatch, 100)
    _, client = await pair(memory, until_canceled)
    handle = await client.send_goal(goal(), timeout_s=5)
    await until(lambda: len(lost) == 1)
    await asyncio.sleep(0.1)  # a hundred checks
    assert lost == [handle.goal_id]


async def test_result_request_denied_for_ended_goal_is_repeated(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    denied = 0

    def on_get_result(get_result: Any, request: Any) -> Any:
        nonlocal denied
        if not server.goals and denied == 1:
            return get_result(request)
        denied += 1

        async def later() -> Any:
            await until(lambda: handle.status.is_terminal)
            return unknown(get_result)

        return later()

    replace_handlers(monkeypatch, get_result=on_get_result)
    server, client = await pair(world)
    handle = await client.send_goal(goal(1), timeout_s=5)
    assert (await handle.result(timeout_s=10))[0] is S.SUCCEEDED and denied == 1


async def test_repeated_denial_of_ended_goal_raises_unknown_goal_error(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.RETRY_DELAY_S", 0.001)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.CHECK_INTERVAL_S", 0.001)
    lose(monkeypatch, 1000, deny=True)
    _, client = await pair(memory)
    handle = await client.send_goal(goal(0), timeout_s=5)
    with pytest.raises(UnknownGoalError, match="does not know goal"):
        await handle.result(timeout_s=10)
    assert not pending_results(client) and result_client(client).in_flight_count == 0


async def test_requests_are_repeated_until_server_has_registered_accepted_goal(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulate a reentrant server of rclcpp: a result request or cancel that arrives early finds no goal."""
    now_s = asyncio.get_running_loop().time
    times_s, registration_s = list[float](), 0.5

    def on_get_result(get_result: Any, request: Any) -> Any:
        times_s.append(now_s())
        return unknown(get_result) if now_s() < times_s[0] + registration_s else get_result(request)

    async def on_cancel_goal(cancel: Any, request: Any) -> Any:
        if now_s() < times_s[0] + registration_s:
            return CancelGoal.Response(return_code=CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID)
        return await cancel(request)

    replace_handlers(monkeypatch, get_result=on_get_result, cancel_goal=on_cancel_goal)
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
    assert not pending_results(client) and result_client(client).in_flight_count == 0


async def test_unknown_reply_of_second_node_with_same_name_ends_no_goal(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.ACK_TIMEOUT_S", 0.05)
    monkeypatch.setattr("rosidl_py_gen.runtime.actions.client.CHECK_INTERVAL_S", 0.02)
    _, client = await pair(dds, until_canceled)
    handle = await client.send_goal(goal(), timeout_s=20)
    dds.node("server").create_action_server(Fibonacci, "fib", fibonacci)
    (wanted,) = pending_results(client)
    await until(lambda: wanted.unknown_reply is not None)
    await asyncio.sleep(0.5)  # 25 checks
    assert not handle.is_done
    await client.cancel_all(timeout_s=20)
    assert (await handle.result(timeout_s=20))[0] is S.CANCELED
