"""Action clients: feedback that must not be lost, servers that come and go, ids, and what is left behind."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from action_worlds import Fibonacci, feedback, fibonacci, goal, pair, result, until_canceled
from worlds import World, run, take, until

from rosidl_py_gen.errors import EncodeError, RosidlError
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage
from rosidl_py_gen.runtime.actions.checks import ActionArgumentError
from rosidl_py_gen.runtime.actions.client_goal import (
    ActionTimeoutError,
    CancelError,
    CancelRejected,
    GoalRejected,
    UnknownGoal,
)
from rosidl_py_gen.runtime.actions.server_goal import GoalDecision
from rosidl_py_gen.runtime.actions.states import GoalStatus
from rosidl_py_gen.runtime.time.values import Time, TimeRangeError

S = GoalStatus


# ------------------------------------------------------------------------------------------------------ feedback


async def fifty(handle: Any) -> Any:
    for number in range(50):
        handle.publish_feedback(feedback(handle.request.order, number))
    return result()


def test_feedback_published_at_once_arrives_completely(world: World) -> None:
    """All goals share one topic, whose queue is ten deep in ROS."""

    async def main() -> None:
        _, client = await pair(world, fifty)
        handles = await asyncio.gather(*(client.send_goal(goal(number)) for number in range(4)))
        for number, handle in enumerate(handles):
            await handle.result(timeout_s=5)
            got = [list(item.sequence) async for item in handle.feedback()]
            assert got == [[number, index] for index in range(50)] and handle.feedback_dropped == 0

    run(main)


def test_feedback_that_nobody_takes_is_dropped_oldest_first_and_counted(world: World) -> None:
    async def main() -> None:
        world.node().create_action_server(Fibonacci, "fib", fifty)
        client = world.node().create_action_client(Fibonacci, "fib", feedback_depth=3)
        handle = await client.send_goal(goal(1), timeout_s=5)
        await handle.result(timeout_s=5)
        assert handle.feedback_dropped == 47
        assert [list(item.sequence) async for item in handle.feedback()] == [[1, 47], [1, 48], [1, 49]]

    run(main)


def test_a_goal_waits_until_all_endpoints_of_a_server_are_connected(world: World) -> None:
    async def main() -> None:
        half = world.node()
        served: list[Any] = []

        def serve(request: Any) -> Any:
            served.append(request)
            return Fibonacci.SendGoal.Response()

        half.create_service(Fibonacci.SendGoal, "fib/_action/send_goal", serve)
        client = world.node().create_action_client(Fibonacci, "fib")
        with pytest.raises(ActionTimeoutError, match=r"no server appeared in 0\.2 s at /fib/_action/cancel_goal") as e:
            await client.send_goal(goal(), timeout_s=0.2)
        assert "/fib/_action/feedback" in str(e.value) and "send_goal" not in str(e.value)
        assert served == [] and client._goals == {}
        with pytest.raises(EncodeError):
            await client.send_goal(goal(2**40))  # at once, although nobody is there

    run(main)


# ---------------------------------------------------------------------------------------------- servers that change


def test_a_second_server_changes_nothing_while_the_first_lives(world: World) -> None:
    async def main() -> None:
        release = asyncio.Event()

        async def execute(handle: Any) -> Any:
            await release.wait()
            return result(5)

        _, client = await pair(world, execute)
        handle = await client.send_goal(goal())
        second = world.node("second").create_action_server(Fibonacci, "fib", fibonacci)
        await until(lambda: len(client._result._present()) == 2)
        await asyncio.sleep(1.2)  # the client looks at its servers twice a second
        assert not handle.is_done
        second.close()
        release.set()
        status, got = await handle.result(timeout_s=5)
        assert (status, list(got.sequence)) == (S.SUCCEEDED, [5])

    run(main)


def test_unknown_from_another_server_is_not_the_answer(world: World) -> None:
    async def main() -> None:
        async def execute(handle: Any) -> Any:
            await asyncio.sleep(0.1)
            return result(5)

        _, client = await pair(world, execute)
        asked: list[Any] = []

        def answer(request: Any) -> Any:
            asked.append(request)
            return Fibonacci.GetResult.Response()

        stranger = world.node().create_service(Fibonacci.GetResult, "fib/_action/get_result", answer)
        await until(lambda: len(client._result._reader.matched_writers()) == 2)
        handle = await client.send_goal(goal(), timeout_s=5)
        status, got = await handle.result(timeout_s=5)
        assert (status, list(got.sequence), len(asked)) == (S.SUCCEEDED, [5], 1)
        stranger.close()

    run(main)


def test_a_server_that_stayed_is_asked_when_the_one_that_accepted_is_gone(world: World) -> None:
    async def main() -> None:
        server, client = await pair(world, until_canceled)
        handle = await client.send_goal(goal())
        world.node("second").create_action_server(Fibonacci, "fib", fibonacci)
        await until(lambda: len(client._result._present()) == 2)
        server.close()
        with pytest.raises(UnknownGoal, match="does not know goal"):
            await handle.result(timeout_s=10)

    run(main)


def test_an_unknown_return_code_is_an_error_of_its_own(world: World) -> None:
    async def main() -> None:
        node = world.node()
        node.create_service(CancelGoal, "fib/_action/cancel_goal", lambda r: CancelGoal.Response(return_code=77))
        client = world.node().create_action_client(Fibonacci, "fib")
        for ask in (client.cancel_goal(bytes(range(16)), timeout_s=5), client.cancel_all(timeout_s=5)):
            with pytest.raises(CancelError, match="code 77") as caught:
                await ask
            assert type(caught.value) is CancelError and not isinstance(caught.value, CancelRejected)

    run(main)


# ---------------------------------------------------------------------------------------------------- ids and stamps


def test_the_id_of_a_running_goal_is_refused_before_anything_is_sent(world: World) -> None:
    async def main() -> None:
        _, client = await pair(world, until_canceled)
        one = bytes(range(16))
        first = await client.send_goal(goal(), goal_id=one)
        with pytest.raises(ActionArgumentError, match="belongs to a goal of this client") as caught:
            await client.send_goal(goal(), goal_id=one)
        assert isinstance(caught.value, RosidlError) and isinstance(caught.value, ValueError)
        await first.cancel(timeout_s=5)
        assert (await first.result(timeout_s=5))[0] is S.CANCELED
        with pytest.raises(GoalRejected):
            await client.send_goal(goal(), goal_id=one, timeout_s=5)

    run(main)


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
def test_what_is_no_goal_id_is_refused(world: World, goal_id: Any, error: type[Exception], words: str) -> None:
    async def main() -> None:
        _, client = await pair(world, until_canceled)
        running = await client.send_goal(goal())
        with pytest.raises(error, match=words):
            await client.send_goal(goal(), goal_id=goal_id)
        with pytest.raises(error, match=words):
            await client.cancel_goal(goal_id)
        assert list(client._goals) == [running.goal_id] and not running.is_done

    run(main)


@pytest.mark.parametrize("stamp", [Time(), TimeMessage()])
def test_a_zero_stamp_does_not_cancel_everything(world: World, stamp: Any) -> None:
    """Before the first /clock simulated time is zero, which on the wire selects all goals."""

    async def main() -> None:
        server, client = await pair(world, until_canceled)
        await client.send_goal(goal())
        with pytest.raises(ActionArgumentError, match=r"stamp must not be zero.*use cancel_all\(\)"):
            await client.cancel_before(stamp)
        assert [one.cancel_requested for one in server.goals] == [False]
        message = TimeMessage(sec=2**31 - 1)
        assert len(await client.cancel_before(message, timeout_s=5)) == 1

    run(main)


# ------------------------------------------------------------------------------------------------- wrong arguments


SERVER_ARGUMENTS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"result_timeout_s": math.nan}, TimeRangeError, "result_timeout_s must be finite"),
    ({"result_timeout_s": -1}, TimeRangeError, "result_timeout_s must be 0 or more seconds"),
    ({"result_timeout_s": None}, TypeError, "result_timeout_s must be a number of seconds"),
    ({"result_timeout_s": "x"}, TypeError, "result_timeout_s must be a number of seconds"),
    ({"execute": 5}, TypeError, "execute of action /fib must be a function"),
    ({"accept": 5}, TypeError, "accept of action /fib must be a function"),
    ({"on_cancel": 5}, TypeError, "on_cancel of action /fib must be a function"),
    ({"execute": None, "accept": lambda request: True}, TypeError, "accept of action /fib needs execute too"),
]
CLIENT_ARGUMENTS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"feedback_depth": -1}, ActionArgumentError, "feedback_depth must be 1 or more"),
    ({"feedback_depth": 0}, ActionArgumentError, "feedback_depth must be 1 or more"),
    ({"feedback_depth": "a"}, TypeError, "feedback_depth must be an int"),
    ({"feedback_depth": 1.5}, TypeError, "feedback_depth must be an int"),
    ({"server_lost_after_s": math.nan}, TimeRangeError, "server_lost_after_s must be finite"),
    ({"server_lost_after_s": -0.1}, TimeRangeError, "server_lost_after_s must be 0 or more seconds"),
    ({"server_lost_after_s": "x"}, TypeError, "server_lost_after_s must be a number of seconds"),
]


@pytest.mark.parametrize(("options", "error", "words"), SERVER_ARGUMENTS)
def test_wrong_arguments_of_a_server(world: World, options: Any, error: type[Exception], words: str) -> None:
    node = world.node()
    with pytest.raises(error, match=words):
        node.create_action_server(Fibonacci, "fib", **{"execute": fibonacci, **options})
    node.scope.discovery.refresh()
    assert not [e for e in node.scope.graph.endpoints.values() if "_action/" in e.info.topic]


@pytest.mark.parametrize(("options", "error", "words"), CLIENT_ARGUMENTS)
def test_wrong_arguments_of_a_client(world: World, options: Any, error: type[Exception], words: str) -> None:
    node = world.node()
    with pytest.raises(error, match=words):
        node.create_action_client(Fibonacci, "fib", **options)
    node.scope.discovery.refresh()
    assert not [e for e in node.scope.graph.endpoints.values() if "_action/" in e.info.topic]


@pytest.mark.parametrize(
    ("timeout_s", "error"), [("x", TypeError), (math.nan, ValueError), (False, TypeError), (-0.1, ValueError)]
)
def test_wrong_timeouts_leave_nothing_behind(world: World, timeout_s: Any, error: type[Exception]) -> None:
    async def main() -> None:
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
        assert list(client._goals) == [handle.goal_id] and client._send._pending == client._cancel._pending == {}

    run(main)


@pytest.mark.parametrize("stamp", [5, None, "now"])
def test_what_is_no_time_is_refused(world: World, stamp: Any) -> None:
    async def main() -> None:
        _, client = await pair(world)
        with pytest.raises(TypeError, match="stamp must be a Time"):
            await client.cancel_before(stamp)

    run(main)


def test_infinite_times_are_for_ever(world: World) -> None:
    async def main() -> None:
        server, client = await pair(world, result_timeout_s=math.inf)
        handle = await client.send_goal(goal(1), timeout_s=math.inf)
        assert (await handle.result(timeout_s=math.inf))[0] is S.SUCCEEDED
        assert server._expiry is None and len(server._rows) == 1
        patient = world.node().create_action_client(Fibonacci, "fib", server_lost_after_s=math.inf)
        assert await patient.wait_for_server(timeout_s=math.inf)

    run(main)


# --------------------------------------------------------------------------------------------------------- remains


def sizes(thing: Any) -> dict[str, int]:
    """How much every collection of an object holds."""
    return {name: len(value) for name, value in vars(thing).items() if hasattr(value, "__len__") and name != "name"}


def test_a_thousand_goals_leave_nothing_but_their_results(world: World) -> None:
    async def main() -> None:
        def accept(request: Any) -> GoalDecision:
            return GoalDecision.REJECT if request.order == 1 else GoalDecision.ACCEPT

        server, client = await pair(world, accept=accept, result_timeout_s=0.05)
        ask = world.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
        request = Fibonacci.GetResult.Request()
        scopes = server._scope, client._scope

        async def some(count: int) -> None:
            for number in range(count):
                if number % 5 == 1:
                    with pytest.raises(GoalRejected):
                        await client.send_goal(goal(1), timeout_s=5)
                    continue
                handle = await client.send_goal(goal(0), timeout_s=5)
                request.goal_id.uuid = handle.goal_id
                await handle.result(timeout_s=5)
                await ask.call(request, timeout_s=5)
            await until(lambda: len(server._rows) == 0)

        await some(20)
        things = (server, server._book, server._desk, server._runner, client, client._result, *scopes)
        before = [sizes(thing) for thing in things]
        await some(1000 if world.transport is not None else 100)
        assert [sizes(thing) for thing in things] == before
        assert before[0]["_goals"] == before[1]["_goals"] == before[4]["_goals"] == before[5]["_pending"] == 0

    run(main, 60)


def test_questions_about_finished_and_unknown_goals_leave_nothing(world: World) -> None:
    async def main() -> None:
        server, client = await pair(world)
        handle = await client.send_goal(goal(1), timeout_s=5)
        await handle.result(timeout_s=5)
        ask = world.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
        request = Fibonacci.GetResult.Request()
        before = sizes(server), sizes(server._book)
        for goal_id in (handle.goal_id, bytes(range(16))) * 20:
            request.goal_id.uuid = goal_id
            await ask.call(request, timeout_s=5)
        assert (sizes(server), sizes(server._book)) == before and server._book.waiting() == []

    run(main)


def test_nothing_is_pending_when_a_client_of_plain_code_closes(world: World, caplog: pytest.LogCaptureFixture) -> None:
    """A watching task once was destroyed while it waited: "Task was destroyed but it is pending!"."""
    with served_in_thread(world, until_canceled):
        node = world.node()
        client = node.create_action_client(Fibonacci, "fib")
        handle = client.send_goal_sync(goal(), timeout_s=5)
        with pytest.raises(ActionTimeoutError):
            handle.result_sync(timeout_s=0.05)
        assert len(node.scope._tasks) == 0 and not handle.is_done
        node.close()
        node.context.close()
        assert handle.is_done
        del client, handle
        gc.collect()
    assert "Task was destroyed" not in caplog.text


@contextlib.contextmanager
def served_in_thread(world: World, execute: Any) -> Iterator[None]:
    """A server on a loop of its own."""
    ready, stop = threading.Event(), threading.Event()

    async def serve() -> None:
        async with world.node("server") as node:
            node.create_action_server(Fibonacci, "fib", execute)
            ready.set()
            while not stop.is_set():
                await asyncio.sleep(0.005)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    try:
        assert ready.wait(5)
        yield
    finally:
        stop.set()
        thread.join()


def test_the_result_of_an_unfinished_goal_is_asked_for_without_a_task(world: World) -> None:
    async def main() -> None:
        _, client = await pair(world, until_canceled)
        before = len(client._scope._tasks)
        handles = [await client.send_goal(goal()) for _ in range(20)]
        assert len(client._scope._tasks) == before and len(client._result._pending) == 20
        await client.cancel_all(timeout_s=5)
        assert {(await handle.result(timeout_s=5))[0] for handle in handles} == {S.CANCELED}
        assert client._result._pending == {}

    run(main)


def test_servers_that_keep_few_requests_get_the_questions_in_turn(world: World) -> None:
    """rclpy's services keep ten requests and overwrite older ones."""

    async def main() -> None:
        _, client = await pair(world, until_canceled)
        questions = client._result
        questions._is_available()
        questions._burst = 3
        handles = []
        for _ in range(10):
            handles.append(await client.send_goal(goal()))
        await until(lambda: not questions._unsent)
        await client.cancel_all(timeout_s=5)
        assert {(await handle.result(timeout_s=5))[0] for handle in handles} == {S.CANCELED}

    run(main)


def test_feedback_ends_in_order_with_the_result(world: World) -> None:
    async def main() -> None:
        _, client = await pair(world, fifty)
        for number in range(30):
            handle = await client.send_goal(goal(number), timeout_s=5)
            stream = handle.feedback()
            assert list((await take(stream)).sequence) == [number, 0]
            assert [list(item.sequence)[1] async for item in stream] == list(range(1, 50))

    run(main)
