"""Lifetime: a node closes all that was created with it, a composite entity its parts."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import participant_of, scope_of
from support.worlds import World

from rosidl_py_gen import get_action, get_message
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import ActionServerLostError, AlreadyRespondedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import Node

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
Int32: Any = get_message("std_msgs/msg/Int32")


def parameters_with_events(node: Node) -> Any:
    client = node.create_parameter_client("/other")
    client.events()
    return client


COMPOSITES: dict[str, Callable[[Node], Any]] = {
    "action server": lambda node: node.create_action_server(Fibonacci, "fib", lambda goal: None),
    "action client": lambda node: node.create_action_client(Fibonacci, "fib"),
    "parameter client": parameters_with_events,
    "publisher of time": lambda node: node.create_sim_time_publisher(rate=1.0),
}


def in_thread(function: Callable[[], object]) -> None:
    thread = threading.Thread(target=function)
    thread.start()
    thread.join()


@pytest.mark.parametrize("call", [lambda function: function(), in_thread], ids=["here", "in a thread"])
@pytest.mark.parametrize("name", COMPOSITES)
async def test_closing_composite_entity_closes_all_its_endpoints(world: World, name: str, call: Any) -> None:
    node = world.node("n")
    scope = scope_of(node)
    owned, endpoints = list(scope.owned.values()), scope.discovery.endpoints_of(scope.number)
    composite = COMPOSITES[name](node)
    assert scope.discovery.endpoints_of(scope.number) - endpoints
    call(composite.close)
    call(composite.close)
    assert list(scope.owned.values()) == owned
    assert scope.discovery.endpoints_of(scope.number) == endpoints
    assert not scope.closed and node.create_publisher(Int32, "still_alive")


@pytest.mark.parametrize("closed_first", [False, True])
def test_closing_node_announces_its_end_in_one_message(
    memory: World, monkeypatch: pytest.MonkeyPatch, closed_first: bool
) -> None:
    node = memory.node("n")
    composites = [make(node) for make in COMPOSITES.values()]
    if closed_first:
        composites[0].close()
    participant, announced = participant_of(node), []
    monkeypatch.setattr(participant, "announce", lambda nodes: announced.append(len(nodes)))
    node.close()
    assert announced == [0]


def test_entity_creation_during_node_close_raises_and_leaves_no_endpoints(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, other = memory.node("n"), memory.node("other")
    participant, create, made = participant_of(node), participant_of(node).create_client, []

    def create_client(*arguments: Any, **options: Any) -> Any:
        made.append(create(*arguments, **options))
        if len(made) == 3:
            in_thread(node.close)
        return made[-1]

    monkeypatch.setattr(participant, "create_client", create_client)
    with pytest.raises(ClosedError, match=r"^node /n is closed$"):
        node.create_action_client(Fibonacci, "fib")
    assert not scope_of(node).owned
    assert other.count_subscribers("/fib/_action/feedback") == other.count_clients("/fib/_action/get_result") == 0


async def test_handler_that_closes_its_own_server_runs_to_completion(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    has_continued = asyncio.Event()

    async def close_and_continue(goal: Any) -> Any:
        server.close()
        await asyncio.sleep(0)
        has_continued.set()
        return Fibonacci.Result()

    server = world.node("server").create_action_server(Fibonacci, "fib", close_and_continue)
    client = world.node("client").create_action_client(Fibonacci, "fib")
    asked = asyncio.ensure_future(client.send_goal(Fibonacci.Goal(), timeout_s=5))
    await asyncio.wait_for(has_continued.wait(), 5)
    asked.cancel()
    with contextlib.suppress(asyncio.CancelledError, Exception):
        await asked
    assert "Traceback" not in caplog.text and "without ending goal" not in caplog.text


@pytest.mark.parametrize("what", ["node", "action server"])
async def test_tasks_end_when_another_thread_closes_their_owner(world: World, what: str) -> None:
    began, ended = asyncio.Event(), asyncio.Event()

    async def wait(_: Any) -> None:
        began.set()
        try:
            await asyncio.sleep(60)
        finally:
            ended.set()

    asyncio.get_running_loop().set_debug(True)
    node, other = world.node("n"), world.node("other")
    if what == "node":
        closing: Any = node
        node.create_subscription(Int32, "t", wait)
        publisher = other.create_publisher(Int32, "t")
        assert await publisher.wait_for_subscribers(5)
        publisher.publish(Int32())
    else:
        closing = node.create_action_server(Fibonacci, "fib", wait)
        await other.create_action_client(Fibonacci, "fib").send_goal(Fibonacci.Goal(), timeout_s=5)
    await asyncio.wait_for(began.wait(), 5)
    failures: list[BaseException] = []

    def close() -> None:
        try:
            closing.close()
        except BaseException as error:
            failures.append(error)

    await asyncio.to_thread(close)
    await asyncio.wait_for(ended.wait(), 5)
    assert failures == []


async def test_pending_waits_end_when_another_thread_closes_server_and_client(memory: World) -> None:
    asyncio.get_running_loop().set_debug(True)
    node, other = memory.node("n"), memory.node("other")
    server = other.create_action_server(Fibonacci, "fib")
    client = node.create_action_client(Fibonacci, "fib")
    goals, cancels = server.__aiter__(), server.cancel_requests()
    asked = [asyncio.ensure_future(client.send_goal(Fibonacci.Goal())) for _ in range(2)]
    taken = (await anext(goals)).accept()
    undecided = await anext(goals)
    cancelling = asyncio.ensure_future((await asked[0]).cancel())
    cancel = await anext(cancels)
    await asyncio.to_thread(server.close)
    await asyncio.sleep(0)  # from 3.14 on a thread that has already ended does not make the loop run
    assert taken.is_cancel_requested
    assert [goal async for goal in goals] == [one async for one in cancels] == []
    for request in (undecided, cancel):
        with pytest.raises(AlreadyRespondedError):
            request.accept()
    await asyncio.to_thread(client.close)
    for waiting in (asked[1], cancelling):  # whichever event arrives first
        with pytest.raises((ClosedError, ActionServerLostError)):
            await asyncio.wait_for(waiting, 5)
