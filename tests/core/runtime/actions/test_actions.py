"""Actions on the memory transport (docs/internals/protocol.md 8), and defects of r2r 0.9.5."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest
from fibonacci_action import (
    Fibonacci,
    fibonacci,
    goal,
    is_awaited,
    known_goals,
    pair,
    pending_results,
    result,
    retained_goal_count,
    served_in_thread,
    statuses_of,
    until_canceled,
)
from support.waiting import run, take, until
from support.worlds import World, entity

from rosidl_py_gen.errors import ClosedError, EncodeError
from rosidl_py_gen.msgs.action_msgs.msg import GoalStatusArray
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as StampMessage
from rosidl_py_gen.runtime import (
    ActionError,
    ActionServerLostError,
    ActionTimeoutError,
    AlreadyRespondedError,
    AlreadyTerminatedError,
    CancelRejectedError,
    ClockType,
    Duration,
    GoalDecision,
    GoalRejectedError,
    GoalStatus,
    GoalTransitionError,
    IntrospectionState,
    Time,
    UnknownGoalError,
    WaitTimeoutError,
)
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS

pytestmark = pytest.mark.on_zenoh

S = GoalStatus


async def test_invalid_result_status_raises_action_error_and_invalid_stamp_becomes_none(world: World) -> None:
    node, status = world.node("raw"), 0
    stamp = StampMessage(sec=-1)
    node.create_publisher(Fibonacci.FeedbackMessage, "fib/_action/feedback")
    node.create_publisher(GoalStatusArray, "fib/_action/status", ACTION_STATUS)
    accept = lambda r: Fibonacci.SendGoal.Response(accepted=True, stamp=stamp)  # noqa: E731
    node.create_service(Fibonacci.SendGoal, "fib/_action/send_goal", accept)
    node.create_service(CancelGoal, "fib/_action/cancel_goal", lambda r: CancelGoal.Response())
    answer = lambda r: Fibonacci.GetResult.Response(status=status)  # noqa: E731
    node.create_service(Fibonacci.GetResult, "fib/_action/get_result", answer)
    client = world.node().create_action_client(Fibonacci, "fib")
    for number, found in ((77, "77"), (-5, "-5"), (1, r"1 \(ACCEPTED\)"), (3, r"3 \(CANCELING\)")):
        status = number
        handle = await client.send_goal(goal(), timeout_s=5)
        with pytest.raises(ActionError, match=f"status {found}; expected 4"):
            await handle.result(timeout_s=5)
    status = 6
    handle = await client.send_goal(goal(), timeout_s=5)
    assert (await handle.result(timeout_s=5))[0] is S.ABORTED and handle.accepted_stamp is None


@pytest.mark.every_transport
async def test_goal_yields_feedback_and_result(world: World) -> None:
    _, client = await pair(world)
    handle = await client.send_goal(goal(3), timeout_s=20)
    feedback = [list(item.sequence) async for item in handle.feedback()]
    status, got = await handle.result(timeout_s=20)
    assert feedback == [[0], [0, 1], [0, 1, 2]]
    assert (status, list(got.sequence), handle.status) == (S.SUCCEEDED, [0, 1, 2], S.SUCCEEDED)
    assert (await handle.result())[0] is S.SUCCEEDED  # any number of times


@pytest.mark.every_transport
async def test_introspection_publishes_events_of_all_three_action_services(world: World) -> None:
    server, client = await pair(world, until_canceled)
    node, events = world.node("watcher"), dict[str, list[Any]]()
    services = {"send_goal": Fibonacci.SendGoal, "cancel_goal": CancelGoal, "get_result": Fibonacci.GetResult}
    for name, cls in services.items():
        events[name] = []
        node.create_subscription(cls.Event, f"fib/_action/{name}/_service_event", events[name].append, 100)
    for end in (server, client):
        end.configure_introspection(node.clock, 100, IntrospectionState.CONTENTS)
    await until(lambda: all(node.count_publishers(f"fib/_action/{name}/_service_event") == 2 for name in services))
    publishers = [entity(end, f"/{name}/_service_event") for end in (server, client) for name in services]
    await until(lambda: all(publisher.subscription_count for publisher in publishers))
    handle = await client.send_goal(goal(3), timeout_s=20)
    await handle.cancel(timeout_s=20)
    status, _ = await handle.result(timeout_s=20)
    await until(lambda: all(len(found) == 4 for found in events.values()))
    for found in events.values():
        assert sorted(event.info.event_type for event in found) == [0, 1, 2, 3]
    sent = {event.info.event_type: event for event in events["send_goal"]}
    assert bytes(sent[0].request[0].goal_id.uuid) == handle.goal_id and sent[2].response[0].accepted
    (answer,) = [event.response[0] for event in events["get_result"] if event.info.event_type == 2]
    assert (status, answer.status) == (S.CANCELED, S.CANCELED)
    for end in (server, client):
        end.configure_introspection(node.clock, 10, IntrospectionState.OFF)
    await until(lambda: not node.count_publishers("fib/_action/send_goal/_service_event"))
    server.close()
    with pytest.raises(ClosedError, match="action /fib of node"):
        server.configure_introspection(node.clock, 10, IntrospectionState.CONTENTS)


async def test_feedback_received_before_acceptance_is_delivered(world: World) -> None:
    node = world.node("raw")
    feedback = node.create_publisher(Fibonacci.FeedbackMessage, "fib/_action/feedback")
    node.create_publisher(GoalStatusArray, "fib/_action/status", ACTION_STATUS)

    async def send_goal(request: Any) -> Any:
        message = Fibonacci.FeedbackMessage(feedback=Fibonacci.Feedback(sequence=[9]))
        message.goal_id.uuid = request.goal_id.uuid
        feedback.publish(message)
        await asyncio.sleep(0.02)
        return Fibonacci.SendGoal.Response(accepted=True)

    node.create_service(Fibonacci.SendGoal, "fib/_action/send_goal", send_goal)
    node.create_service(CancelGoal, "fib/_action/cancel_goal", lambda r: CancelGoal.Response())
    node.create_service(Fibonacci.GetResult, "fib/_action/get_result", lambda r: Fibonacci.GetResult.Response(status=4))
    client = world.node().create_action_client(Fibonacci, "fib")
    handle = await client.send_goal(goal(), timeout_s=5)
    assert [list(item.sequence) async for item in handle.feedback()] == [[9]]


@pytest.mark.parametrize(
    ("finish", "status"),
    [
        (lambda handle: handle.succeed(result(1)), S.SUCCEEDED),
        (lambda handle: handle.abort(result(1)), S.ABORTED),
        (lambda handle: None, S.ABORTED),
        (lambda handle: 1 / 0, S.ABORTED),
        (lambda handle: result(1), S.SUCCEEDED),
        (lambda handle: "no result at all", S.ABORTED),
        (lambda handle: result(2**40), S.ABORTED),
        (lambda handle: handle.canceled(result(1)), S.ABORTED),  # no cancel was requested: the error aborts
    ],
)
async def test_handler_outcome_determines_goal_status(world: World, finish: Any, status: GoalStatus) -> None:
    async def execute(handle: Any) -> Any:
        return finish(handle)

    _, client = await pair(world, execute)
    assert (await (await client.send_goal(goal())).result(timeout_s=5))[0] is status


@pytest.mark.every_transport
async def test_cancelled_goal_publishes_executing_canceling_canceled(world: World) -> None:
    """r2r: the status stays CANCELING forever."""

    server, client = await pair(world, until_canceled)
    seen = await statuses_of(world, server)
    handle = await client.send_goal(goal())
    await until(lambda: handle.status is S.EXECUTING)
    await handle.cancel(timeout_s=20)
    status, got = await handle.result(timeout_s=20)
    assert (status, list(got.sequence)) == (S.CANCELED, [7])
    await until(lambda: seen[-1:] == [[5]])
    assert seen == [[2], [3], [5]]


async def test_each_cancel_failure_raises_its_own_exception(world: World) -> None:
    server, client = await pair(world, until_canceled, cancel_callback=lambda handle: handle.request.order != 13)
    handle = await client.send_goal(goal(13))
    with pytest.raises(CancelRejectedError, match="refused to cancel"):
        await handle.cancel(timeout_s=5)
    other = await client.send_goal(goal(1))
    await other.cancel()
    await other.result()
    with pytest.raises(AlreadyTerminatedError):
        await other.cancel()
    with pytest.raises(UnknownGoalError):
        await client.cancel_goal(bytes(range(16)))
    assert [g.goal_id for g in server.goals] == [handle.goal_id]
    with pytest.raises(TypeError, match="has cancel_callback=; its cancel requests cannot be iterated over"):
        server.cancel_requests()


@pytest.mark.every_transport
async def test_cancel_all_returns_every_goal_id(world: World) -> None:
    """r2r answers REJECTED with an empty list as soon as there are two goals."""

    _, client = await pair(world, until_canceled)
    handles = [await client.send_goal(goal()) for _ in range(3)]
    assert sorted(await client.cancel_all(timeout_s=20)) == sorted(h.goal_id for h in handles)
    assert [(await h.result())[0] for h in handles] == [S.CANCELED] * 3
    assert await client.cancel_all() == []


async def test_cancel_before_cancels_only_goals_accepted_until_stamp(world: World) -> None:
    _, client = await pair(world, until_canceled)
    clock = world.nodes[0].clock
    clock.enable_ros_time_override()
    handles = []
    for second in (10, 20, 30):
        clock.set_ros_time_override(Time(seconds=second, clock_type=ClockType.ROS_TIME))
        handles.append(await client.send_goal(goal()))
    assert [h.accepted_stamp.seconds for h in handles] == [10, 20, 30]
    canceled = await client.cancel_before(Time(seconds=20, clock_type=ClockType.ROS_TIME))
    assert canceled == [h.goal_id for h in handles[:2]]
    assert handles[2].status in (S.ACCEPTED, S.EXECUTING)


async def test_accepted_stamp_remains_after_goal_expired(world: World) -> None:
    stamps = []

    async def execute(handle: Any) -> Any:
        stamps.append(handle.accepted_stamp)
        return result(1)

    server, client = await pair(world, execute, goal_callback=lambda request: GoalDecision.DEFER, result_timeout_s=0)
    clock = world.nodes[0].clock
    clock.enable_ros_time_override()
    accepted, later, much_later = (Time(seconds=s, clock_type=ClockType.ROS_TIME) for s in (10, 20, 30))
    clock.set_ros_time_override(accepted)
    handle = await client.send_goal(goal(1))
    (waiting,) = server.goals
    clock.set_ros_time_override(later)
    waiting.execute()
    await handle.result()
    clock.set_ros_time_override(much_later)
    assert (retained_goal_count(server), waiting.status) == (0, S.UNKNOWN)
    assert stamps == [accepted]
    assert waiting.accepted_stamp == handle.accepted_stamp == accepted


@pytest.mark.every_transport
async def test_results_are_retained_until_result_timeout(world: World) -> None:
    server, client = await pair(world, result_timeout_s=60)
    clock = world.nodes[0].clock
    clock.enable_ros_time_override()
    clock.set_ros_time_override(Time(seconds=100, clock_type=ClockType.ROS_TIME))
    handle = await client.send_goal(goal(1))
    await handle.result()
    ask = world.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
    request = Fibonacci.GetResult.Request()
    request.goal_id.uuid = handle.goal_id
    assert (await ask.call(request, timeout_s=20)).status == 4
    clock.set_ros_time_override(Time(seconds=160, clock_type=ClockType.ROS_TIME))
    assert (await ask.call(request, timeout_s=20)).status == 4
    clock.set_ros_time_override(Time(seconds=161, clock_type=ClockType.ROS_TIME))
    got = await ask.call(request, timeout_s=20)
    assert (got.status, list(got.result.sequence)) == (0, []) and retained_goal_count(server) == 0


@pytest.mark.slow
async def test_short_goals_return_results_with_zero_result_timeout(network: World) -> None:
    server, client = await pair(network, lambda handle: result(1), result_timeout_s=0)
    ask = network.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
    await ask.wait_for_service(20)
    for _ in range(20):
        handle = await client.send_goal(goal(1), timeout_s=20)
        request = Fibonacci.GetResult.Request()
        request.goal_id.uuid = handle.goal_id
        response, (status, value) = await asyncio.gather(ask.call(request, timeout_s=20), handle.result(timeout_s=20))
        assert (response.status, status, list(value.sequence)) == (4, S.SUCCEEDED, [1])
    await until(lambda: retained_goal_count(server) == 0)


async def test_results_expire_in_real_time(world: World) -> None:
    async def execute(handle: Any) -> Any:
        await until(lambda: is_awaited(handle))
        return result(1)

    server, client = await pair(world, execute, result_timeout_s=0.3)
    clock = world.nodes[0].clock
    begin = clock.now()
    await (await client.send_goal(goal(1))).result()
    await until(lambda: retained_goal_count(server) == 0)
    assert clock.now() - begin > Duration(seconds=0.3)


@pytest.mark.every_transport
async def test_deferred_goals_stay_accepted_until_they_are_executed(world: World) -> None:
    server, client = await pair(world, goal_callback=lambda request: GoalDecision.DEFER)
    seen = await statuses_of(world, server)
    handle = await client.send_goal(goal(1))
    await until(lambda: seen == [[1]])
    (waiting,) = server.goals
    assert waiting.status is S.ACCEPTED
    with pytest.raises(GoalTransitionError):
        waiting.succeed(result(1))
    waiting.execute()
    waiting.execute()
    assert (await handle.result())[0] is S.SUCCEEDED
    await until(lambda: seen == [[1], [2], [4]])


@pytest.mark.every_transport
async def test_policy_preempt_cancels_the_running_goal_for_the_newest(world: World) -> None:
    started: list[int] = []
    release = asyncio.Event()

    async def execute(handle: Any) -> Any:
        started.append(handle.request.order)
        if handle.request.order == 3:
            return result(3)
        await handle.wait_for_cancel()
        await release.wait()
        return handle.canceled()

    _, client = await pair(world, execute, goal_policy="preempt")
    first = await client.send_goal(goal(1))
    await until(lambda: started == [1])
    second = await client.send_goal(goal(2))
    third = await client.send_goal(goal(3))
    assert (await second.result())[0] is S.CANCELED
    assert started == [1]
    release.set()
    assert [(await h.result())[0] for h in (first, third)] == [S.CANCELED, S.SUCCEEDED]
    assert started == [1, 3]


async def test_goals_can_be_served_by_iterating_over_the_server(world: World) -> None:
    server, client = await pair(world, None)

    async def serve() -> None:
        async for request in server:
            if request.goal.order == 13:
                request.reject()
                continue
            handle = request.accept()
            assert handle.status is S.EXECUTING and handle.goal_id == request.goal_id
            with pytest.raises(AlreadyRespondedError):
                request.reject()
            handle.publish_feedback(Fibonacci.Feedback(sequence=[1]))
            handle.succeed(result(8))

    task = asyncio.ensure_future(serve())
    with pytest.raises(GoalRejectedError):
        await client.send_goal(goal(13), timeout_s=5)
    handle = await client.send_goal(goal(1), timeout_s=5)
    assert list((await handle.result(timeout_s=5))[1].sequence) == [8]
    assert [list(f.sequence) async for f in handle.feedback()] == [[1]]
    server.close()
    await asyncio.wait_for(task, 5)


def test_goal_request_dropped_by_the_program_is_rejected_with_warning(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    """r2r: nothing is sent, and the client waits forever."""

    async def main() -> None:
        server, client = await pair(world, None, goal_policy="reject")

        retained: list[Any] = []

        async def serve() -> None:
            async for request in server:
                if request.goal.order == 1:
                    continue  # neither accepted nor rejected; released when the next request arrives
                if request.goal.order == 3:
                    retained.append(request)
                    continue
                retained.append(request.accept())

        task = asyncio.ensure_future(serve())
        forgotten = asyncio.ensure_future(client.send_goal(goal(1), timeout_s=20))
        late = asyncio.ensure_future(client.send_goal(goal(3), timeout_s=20))
        with pytest.raises(GoalRejectedError):
            await forgotten
        accepted = await client.send_goal(goal(2), timeout_s=20)
        with pytest.raises(AlreadyRespondedError, match="another goal is active"):
            retained[0].accept()
        with pytest.raises(GoalRejectedError):
            await late
        with pytest.raises(GoalRejectedError):
            await client.send_goal(goal(2), timeout_s=5)
        retained[1].succeed(result(8))
        assert list((await accepted.result(timeout_s=20))[1].sequence) == [8]
        assert not server._undecided
        server.close()
        await asyncio.wait_for(task, 20)

    run(main)
    assert "dropped without accept(), defer() or reject()" in caplog.text


@pytest.mark.every_transport
async def test_cancel_requests_can_be_accepted_and_rejected_one_by_one(world: World) -> None:
    """r2r: `is_cancelling` and `succeed` fail after an accepted cancel."""

    server, client = await pair(world, None)
    cancels = server.cancel_requests()
    task = asyncio.ensure_future(_accept_all(server))
    handles = [await client.send_goal(goal()) for _ in range(2)]
    asked = asyncio.ensure_future(client.cancel_all())
    first, second = await take(cancels), await take(cancels)
    first.accept()
    second.reject()
    with pytest.raises(AlreadyRespondedError):
        second.accept()
    assert await asked == [first.goal.goal_id]
    assert first.goal.is_cancel_requested and not second.goal.is_cancel_requested
    first.goal.succeed(result(1))
    second.goal.abort()
    assert [(await h.result())[0] for h in handles] == [S.SUCCEEDED, S.ABORTED]
    task.cancel()


async def test_undecided_cancel_request_is_answered_when_its_goal_ends(world: World) -> None:
    server, client = await pair(world, None)
    cancels = server.cancel_requests()
    sending = asyncio.ensure_future(client.send_goal(goal()))
    accepted = (await take(aiter(server))).accept()
    cancelling = asyncio.ensure_future((await sending).cancel(timeout_s=5))
    request = await take(cancels)
    accepted.succeed(result(1))
    with pytest.raises(AlreadyTerminatedError):
        await cancelling
    with pytest.raises(AlreadyRespondedError):
        request.accept()


async def _accept_all(server: Any) -> None:
    async for request in server:
        request.accept()


@pytest.mark.every_transport
async def test_action_named_by_text_uses_dicts(world: World) -> None:
    name = "example_interfaces/action/Fibonacci"

    async def execute(handle: Any) -> Any:
        handle.publish_feedback({"sequence": [0]})
        return {"sequence": list(range(handle.request["order"]))}

    world.node().create_action_server(name, "fib", execute, goal_callback=lambda g: g["order"] < 9)
    client = world.node().create_action_client(name, "fib")
    handle = await client.send_goal({"order": 3}, timeout_s=20)
    assert [item async for item in handle.feedback()] == [{"sequence": [0]}]
    assert await handle.result() == (S.SUCCEEDED, {"sequence": [0, 1, 2]})
    with pytest.raises(GoalRejectedError):
        await client.send_goal({"order": 9})
    with pytest.raises(EncodeError):
        await client.send_goal({"order": "three"})
    assert known_goals(client) == {}


@pytest.mark.every_transport
async def test_calls_without_action_server_time_out(world: World) -> None:
    client = world.node().create_action_client(Fibonacci, "fib")
    with pytest.raises(WaitTimeoutError, match=r"no server of action /fib \(.*Fibonacci\) appeared at .* in 0.05 s"):
        await client.wait_for_server(timeout_s=0.05)
    with pytest.raises(ActionTimeoutError, match="action /fib: goal not sent"):
        await client.send_goal(goal(), timeout_s=0.05)
    with pytest.raises(TimeoutError):
        await client.cancel_all(timeout_s=0.05)
    assert known_goals(client) == {} and entity(client, "/send_goal").in_flight_count == 0


async def test_result_can_be_awaited_again_after_timeout(world: World) -> None:
    _, client = await pair(world, until_canceled)
    handle = await client.send_goal(goal())
    with pytest.raises(ActionTimeoutError, match=r"in 0.05 s; it is (ACCEPTED|EXECUTING)"):
        await handle.result(timeout_s=0.05)
    await handle.cancel()
    assert (await handle.result(timeout_s=5))[0] is S.CANCELED


@pytest.mark.every_transport
async def test_closed_server_raises_server_lost_error_for_running_goal(world: World) -> None:
    server, client = await pair(world, until_canceled)
    handle = await client.send_goal(goal())
    server.close()
    with pytest.raises(ActionServerLostError, match="disappeared, and none has replaced it"):
        await handle.result(timeout_s=10)
    with pytest.raises(ActionServerLostError):
        async for _ in handle.feedback():
            pass
    assert known_goals(client) == {} and not pending_results(client)


@pytest.mark.every_transport
async def test_goal_of_replaced_server_raises_unknown_goal_error(world: World) -> None:
    server, client = await pair(world, until_canceled, lost_after_s=30)
    handle = await client.send_goal(goal())
    server.close()
    world.node("server").create_action_server(Fibonacci, "fib", fibonacci)
    with pytest.raises(UnknownGoalError, match="does not know goal"):
        await handle.result(timeout_s=10)
    assert (await (await client.send_goal(goal(1))).result(timeout_s=20))[0] is S.SUCCEEDED


@pytest.mark.every_transport
async def test_closing_action_client_wakes_pending_waits_with_closed_error(world: World) -> None:
    _, client = await pair(world, until_canceled)
    handle = await client.send_goal(goal())
    waiting = asyncio.ensure_future(handle.result())
    feedback = asyncio.ensure_future(take(handle.feedback()))
    await asyncio.sleep(0)  # both have begun to wait
    client.close()
    client.close()
    for task in (waiting, feedback):
        with pytest.raises(ClosedError):
            await task
    with pytest.raises(ClosedError):
        await client.send_goal(goal())


@pytest.mark.every_transport
def test_sync_calls_work_in_plain_code(world: World) -> None:
    with served_in_thread(world, fibonacci):
        client = world.node().create_action_client(Fibonacci, "fib")
        handle = client.send_goal_sync(goal(4), timeout_s=20)
        status, got = handle.result_sync(timeout_s=20)
        assert (status, list(got.sequence)) == (S.SUCCEEDED, [0, 1, 2, 3])
        with pytest.raises(AlreadyTerminatedError):
            handle.cancel_sync(timeout_s=5)


def test_single_action_topic_can_be_remapped(world: World) -> None:
    node = world.node(args="--ros-args -r fib/_action/feedback:=/elsewhere")
    node.create_action_server(Fibonacci, "fib", fibonacci)
    names = [name for name, _ in node.get_topic_names_and_types()]
    assert "/elsewhere" in names and "/fib/_action/status" in names and "/fib/_action/feedback" not in names


@pytest.mark.slow
@pytest.mark.every_transport
def test_two_hundred_goals_with_random_cancels_each_finish_once(world: World) -> None:
    generator = random.Random(5)

    async def execute(handle: Any) -> Any:
        if handle.request.order < 3:
            await handle.wait_for_cancel()  # however long that takes to come
        for _ in range(generator.randrange(1, 30)):
            if handle.is_cancel_requested:
                return handle.canceled(result(handle.request.order))
            handle.publish_feedback(Fibonacci.Feedback(sequence=[handle.request.order]))
            await asyncio.sleep(0)
        if generator.random() < 0.1:
            raise RuntimeError("some fail")
        return result(handle.request.order)

    async def one(client: Any, number: int) -> tuple[GoalStatus, int]:
        handle = await client.send_goal(goal(number), timeout_s=20)
        cancel = number < 3 or generator.random() < 0.4
        for _ in range(generator.randrange(0, 10)):
            await asyncio.sleep(0)
        outcome = "none"
        if cancel:
            try:
                await handle.cancel(timeout_s=20)
                outcome = "yes"
            except AlreadyTerminatedError:
                outcome = "late"
        status, got = await handle.result(timeout_s=20)
        assert status.is_terminal and (status is not S.CANCELED or outcome == "yes")
        feedback = [list(item.sequence) async for item in handle.feedback()]
        assert all(item == [number] for item in feedback)
        assert list(got.sequence) == ([] if status is S.ABORTED else [number])
        return status, number

    async def main() -> None:
        server, first = await pair(world, execute)
        clients = [first, world.node().create_action_client(Fibonacci, "fib")]
        ends = await asyncio.gather(*(one(clients[n % 2], n) for n in range(200)))
        assert sorted(number for _, number in ends) == list(range(200))
        assert {status for status, _ in ends} == {S.SUCCEEDED, S.CANCELED, S.ABORTED}
        assert server.goals == [] and all(known_goals(client) == {} for client in clients)

    run(main, 60)
