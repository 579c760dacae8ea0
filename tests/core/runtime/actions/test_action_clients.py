"""Action clients: feedback, servers that appear and disappear, ids, and resources."""

from __future__ import annotations

import asyncio
import gc
import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fibonacci_action import (
    Fibonacci,
    feedback,
    fibonacci,
    goal,
    known_goals,
    pair,
    result,
    result_client,
    retained_goal_count,
    served_in_thread,
    until_canceled,
)
from support.inner_state import graph_of, scope_of, servers_of, transport_end_of
from support.waiting import run, until
from support.worlds import World, entity

from rosidl_py_gen.errors import EncodeError, RosidlError
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage
from rosidl_py_gen.runtime import (
    ActionArgumentError,
    ActionTimeoutError,
    CancelError,
    CancelRejectedError,
    Duration,
    GoalDecision,
    GoalRejectedError,
    GoalStatus,
    Time,
)
from rosidl_py_gen.runtime.actions.server import FeedbackReadiness
from rosidl_py_gen.runtime.graph import Graph
from rosidl_py_gen.runtime.time_values import TimeRangeError

pytestmark = pytest.mark.on_zenoh

S = GoalStatus


# ------------------------------------------------------------------------------------------------------ feedback


async def fifty(handle: Any) -> Any:
    for number in range(50):
        handle.publish_feedback(feedback(handle.request.order, number))
    return result()


@pytest.mark.every_transport
async def test_feedback_published_in_a_burst_arrives_completely(world: World) -> None:
    _, client = await pair(world, fifty)
    handles = await asyncio.gather(*(client.send_goal(goal(number)) for number in range(4)))
    for number, handle in enumerate(handles):
        await handle.result(timeout_s=20)
        got = [list(item.sequence) async for item in handle.feedback()]
        assert got == [[number, index] for index in range(50)] and handle.feedback_dropped == 0


@pytest.mark.parametrize(("is_known", "after_s"), [(True, 0.1), (False, 2.0)])
async def test_handler_start_waits_longer_while_client_endpoints_are_incomplete(
    memory: World, monkeypatch: pytest.MonkeyPatch, is_known: bool, after_s: float
) -> None:
    monkeypatch.setattr(Graph, "endpoints_complete", lambda self, of: is_known)
    time, began = asyncio.get_running_loop().time, list[float]()

    async def execute(handle: Any) -> Any:
        began.append(time())
        return result()

    memory.node("server").create_action_server(Fibonacci, "fib", execute)
    bare = memory.node("bare").create_client(Fibonacci.SendGoal, "fib/_action/send_goal")
    asked = time()
    await bare.call(Fibonacci.SendGoal.Request(goal=goal()), 5)
    await until(lambda: began)
    assert began[0] - asked == pytest.approx(after_s, abs=0.05)


async def test_feedback_readiness_timeout_is_counted_for_each_client(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Graph, "endpoints_complete", lambda self, of: False)
    monkeypatch.setattr(Graph, "participant_of", lambda self, guid: guid)
    loop, clients, connected_subscriptions = asyncio.get_running_loop(), [b"a"], list[bytes]()
    goals = SimpleNamespace(matched_clients=lambda: [*clients])
    ends: Any = goals, SimpleNamespace(matched_subscriptions=lambda: [*connected_subscriptions])
    readiness, began = FeedbackReadiness(scope_of(memory.node("server")), *ends), loop.time()
    loop.call_later(1.0, clients.append, b"b")
    loop.call_later(1.2, connected_subscriptions.append, b"a")
    loop.call_later(2.5, connected_subscriptions.append, b"b")
    for connected_s in (1.2, 2.5):
        assert not readiness.is_satisfied()
        await readiness.wait()
        assert loop.time() - began == pytest.approx(connected_s, abs=0.05)
    assert readiness.is_satisfied()


async def test_unread_feedback_is_dropped_oldest_first_and_counted(world: World) -> None:
    world.node().create_action_server(Fibonacci, "fib", fifty)
    client = world.node().create_action_client(Fibonacci, "fib", feedback_depth=3)
    handle = await client.send_goal(goal(1), timeout_s=5)
    await handle.result(timeout_s=5)
    assert handle.feedback_dropped == 47
    assert [list(item.sequence) async for item in handle.feedback()] == [[1, 47], [1, 48], [1, 49]]


@pytest.mark.every_transport
async def test_goal_is_not_sent_until_all_server_endpoints_are_connected(world: World) -> None:
    half = world.node()
    served: list[Any] = []

    def serve(request: Any) -> Any:
        served.append(request)
        return Fibonacci.SendGoal.Response()

    half.create_service(Fibonacci.SendGoal, "fib/_action/send_goal", serve)
    client = world.node().create_action_client(Fibonacci, "fib")
    await until(entity(client, "/send_goal").service_is_available)
    with pytest.raises(ActionTimeoutError, match=r"no server appeared in 0\.2 s at /fib/_action/cancel_goal") as e:
        await client.send_goal(goal(), timeout_s=0.2)
    assert "/fib/_action/feedback" in str(e.value) and "send_goal" not in str(e.value)
    assert served == [] and known_goals(client) == {}
    with pytest.raises(EncodeError):
        await client.send_goal(goal(2**40))  # raised at once, without a server
    with pytest.raises(TypeError, match="expected a Fibonacci_Goal"):
        await client.send_goal(result())


# ---------------------------------------------------------------------------------------------- servers that change


@pytest.mark.every_transport
async def test_unknown_reply_from_another_server_is_ignored(world: World) -> None:
    async def execute(handle: Any) -> Any:
        await until(lambda: bool(asked) and transport_end_of(second_server).all_acknowledged())  # UNKNOWN has arrived
        return result(5)

    _, client = await pair(world, execute)
    asked: list[Any] = []

    def answer(request: Any) -> Any:
        asked.append(request)
        return Fibonacci.GetResult.Response()

    second_server = world.node().create_service(Fibonacci.GetResult, "fib/_action/get_result", answer)
    await until(lambda: len(servers_of(result_client(client))) == 2)
    handle = await client.send_goal(goal(), timeout_s=20)
    status, got = await handle.result(timeout_s=20)
    assert (status, list(got.sequence), len(asked)) == (S.SUCCEEDED, [5], 1)
    second_server.close()


async def test_unknown_cancel_return_code_raises_plain_cancel_error(world: World) -> None:
    node = world.node()
    node.create_service(CancelGoal, "fib/_action/cancel_goal", lambda r: CancelGoal.Response(return_code=77))
    client = world.node().create_action_client(Fibonacci, "fib")
    for ask in (client.cancel_goal(bytes(range(16)), timeout_s=5), client.cancel_all(timeout_s=5)):
        with pytest.raises(CancelError, match="code 77") as caught:
            await ask
        assert type(caught.value) is CancelError and not isinstance(caught.value, CancelRejectedError)


# ---------------------------------------------------------------------------------------------------- ids and stamps


async def test_duplicate_goal_id_is_refused_before_sending(world: World) -> None:
    _, client = await pair(world, until_canceled)
    one = bytes(range(16))
    first = await client.send_goal(goal(), goal_id=one)
    with pytest.raises(ActionArgumentError, match="belongs to a goal of this client") as caught:
        await client.send_goal(goal(), goal_id=one)
    assert isinstance(caught.value, RosidlError) and isinstance(caught.value, ValueError)
    await first.cancel(timeout_s=5)
    assert (await first.result(timeout_s=5))[0] is S.CANCELED
    with pytest.raises(GoalRejectedError):
        await client.send_goal(goal(), goal_id=one, timeout_s=5)


@pytest.mark.parametrize(
    ("goal_id", "error", "words"),
    [
        (b"short", ActionArgumentError, "goal_id must be 16 bytes, got 5"),
        (bytes(17), ActionArgumentError, "goal_id must be 16 bytes, got 17"),
        (bytes(16), ActionArgumentError, r"16 zero bytes.*use cancel_all\(\)"),
        ("0" * 16, TypeError, "goal_id must be 16 bytes"),
        (16, TypeError, "goal_id must be 16 bytes"),
    ],
)
async def test_invalid_goal_id_is_refused(world: World, goal_id: Any, error: type[Exception], words: str) -> None:
    _, client = await pair(world, until_canceled)
    running = await client.send_goal(goal())
    with pytest.raises(error, match=words):
        await client.send_goal(goal(), goal_id=goal_id)
    with pytest.raises(error, match=words):
        await client.cancel_goal(goal_id)
    assert list(known_goals(client)) == [running.goal_id] and not running.is_done


async def test_cancel_before_refuses_zero_stamp(world: World) -> None:
    server, client = await pair(world, until_canceled)
    await client.send_goal(goal())
    for stamp in (Time(), TimeMessage()):
        with pytest.raises(ActionArgumentError, match=r"stamp must not be zero.*use cancel_all\(\)"):
            await client.cancel_before(stamp)
    for nonsense in (5, None, "now"):
        with pytest.raises(TypeError, match="stamp must be a Time"):
            await client.cancel_before(nonsense)
    assert [one.is_cancel_requested for one in server.goals] == [False]
    message = TimeMessage(sec=2**31 - 1)
    assert len(await client.cancel_before(message, timeout_s=5)) == 1


# ------------------------------------------------------------------------------------------------- wrong arguments


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"result_timeout_s": math.nan}, TimeRangeError, "result_timeout_s must be finite"),
        ({"result_timeout_s": -1}, TimeRangeError, "result_timeout_s must be 0 or more seconds"),
        ({"result_timeout_s": None}, TypeError, "result_timeout_s must be a number of seconds"),
        ({"execute": 5}, TypeError, "execute of action /fib must be a function"),
        ({"goal_callback": 5}, TypeError, "goal_callback of action /fib must be a function"),
        ({"cancel_callback": None}, TypeError, "cancel_callback of action /fib must be True, False or a function"),
        ({"execute": None, "goal_callback": print}, TypeError, "goal_callback of action /fib needs execute"),
        ({"goal_policy": "random"}, ValueError, "policy must be one of parallel, reject, preempt, queue"),
        ({"feedback_depth": 0}, ActionArgumentError, "feedback_depth must be 1 or more"),
        ({"feedback_depth": "a"}, TypeError, "feedback_depth must be an int"),
        ({"feedback_depth": 1.5}, TypeError, "feedback_depth must be an int"),
        ({"server_lost_timeout_s": math.nan}, TimeRangeError, "server_lost_timeout_s must be finite"),
        ({"server_lost_timeout_s": -0.1}, TimeRangeError, "server_lost_timeout_s must be 0 or more seconds"),
        ({"server_lost_timeout_s": "x"}, TypeError, "server_lost_timeout_s must be a number of seconds"),
    ],
)
def test_invalid_action_arguments_raise_and_create_no_endpoint(
    world: World, options: Any, error: type[Exception], words: str
) -> None:
    node = world.node()
    is_of_client = options.keys() & {"feedback_depth", "server_lost_timeout_s"}
    make: Any = node.create_action_client if is_of_client else node.create_action_server
    with pytest.raises(error, match=words):
        make(Fibonacci, "fib", **options if is_of_client else {"execute": fibonacci, **options})
    scope_of(node).discovery.refresh()
    assert not [e for e in graph_of(node).endpoints.values() if "_action/" in e.topic_key.name]


@pytest.mark.parametrize(
    ("timeout_s", "error"), [("x", TypeError), (math.nan, ValueError), (False, TypeError), (-0.1, ValueError)]
)
async def test_invalid_timeouts_raise_and_leave_no_pending_requests(
    world: World, timeout_s: Any, error: type[Exception]
) -> None:
    _, client = await pair(world, until_canceled)
    handle = await client.send_goal(goal())
    calls: list[Callable[[], Any]] = [
        lambda: client.send_goal(goal(), timeout_s),
        lambda: client.wait_for_server(timeout_s),
        lambda: client.cancel_all(timeout_s),
        lambda: client.cancel_goal(bytes(range(16)), timeout_s),
        lambda: client.cancel_before(Time(seconds=5), timeout_s),
        lambda: handle.cancel(timeout_s),
        lambda: handle.result(timeout_s),
    ]
    for call in calls:
        with pytest.raises(error, match="timeout_s must be"):
            await call()
    assert list(known_goals(client)) == [handle.goal_id]
    assert [entity(client, name).in_flight_count for name in ("/send_goal", "/cancel_goal")] == [0, 0]


async def test_infinite_timeouts_never_expire(world: World) -> None:
    server, client = await pair(world, result_timeout_s=math.inf)
    handle = await client.send_goal(goal(1), timeout_s=math.inf)
    assert (await handle.result(timeout_s=math.inf))[0] is S.SUCCEEDED
    clock = world.nodes[0].clock
    clock.enable_ros_time_override()
    clock.set_ros_time_override(clock.now() + Duration(seconds=9e9))
    assert retained_goal_count(server) == 1
    patient_client = world.node().create_action_client(Fibonacci, "fib", server_lost_timeout_s=math.inf)
    assert await patient_client.wait_for_server(timeout_s=math.inf)


# --------------------------------------------------------------------------------------------------------- remains


def sizes(thing: Any) -> dict[str, int]:
    return {name: len(value) for name, value in vars(thing).items() if hasattr(value, "__len__") and name != "name"}


@pytest.mark.slow
def test_memory_does_not_grow_after_a_thousand_goals(world: World) -> None:
    async def main() -> None:
        def accept(request: Any) -> GoalDecision:
            return GoalDecision.REJECT if request.order == 1 else GoalDecision.ACCEPT

        server, client = await pair(world, goal_callback=accept, result_timeout_s=0.3)
        clock = world.nodes[0].clock
        clock.enable_ros_time_override()  # no result expires before the test requests it
        ask = world.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
        request = Fibonacci.GetResult.Request()
        scopes = scope_of(server), scope_of(client)

        async def some(count: int) -> None:
            for number in range(count):
                if number % 5 == 1:
                    with pytest.raises(GoalRejectedError):
                        await client.send_goal(goal(1), timeout_s=5)
                    continue
                handle = await client.send_goal(goal(0), timeout_s=20)
                request.goal_id.uuid = handle.goal_id
                await handle.result(timeout_s=20)
                await ask.call(request, timeout_s=20)
                clock.set_ros_time_override(clock.now() + Duration(seconds=0.1))
            clock.set_ros_time_override(clock.now() + Duration(seconds=1))
            assert retained_goal_count(server) == 0

        await some(20)
        results = client._result
        things = (server, server._goals, server._goals.table, client, results, results.client, *scopes)
        before = [sizes(thing) for thing in things]
        await some(1000 if world.kind == "memory" else 100)
        assert [sizes(thing) for thing in things] == before
        assert before[1]["active"] == before[2]["_goals"] == before[3]["_goals"] == 0
        assert before[4]["_pending"] == before[5]["_pending"] == 0

    run(main, 60)


def test_no_task_is_pending_after_sync_action_client_closes(world: World, caplog: pytest.LogCaptureFixture) -> None:
    with served_in_thread(world, until_canceled):
        node = world.node()
        client = node.create_action_client(Fibonacci, "fib")
        handle = client.send_goal_sync(goal(), timeout_s=20)
        with pytest.raises(ActionTimeoutError):
            handle.result_sync(timeout_s=0.05)
        assert len(scope_of(node).tasks) == 0 and not handle.is_done
        node.close()
        node.context.close()
        assert handle.is_done
        del client, handle
        gc.collect()
    assert "Task was destroyed" not in caplog.text


@pytest.mark.every_transport
async def test_result_requests_respect_the_queue_depth_of_the_server(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Services of rclpy queue ten requests and overwrite older ones."""

    _, client = await pair(world, until_canceled)
    requests = result_client(client)
    servers = transport_end_of(requests).servers
    monkeypatch.setattr(transport_end_of(requests), "servers", lambda: replace(servers(), request_queue_depth=3))
    handles = []
    for _ in range(10):
        handles.append(await client.send_goal(goal()))
    await until(lambda: not requests._window.waiting)
    await client.cancel_all(timeout_s=20)
    assert {(await handle.result(timeout_s=20))[0] for handle in handles} == {S.CANCELED}
