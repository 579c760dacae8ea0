"""Fibonacci action with handlers, and a server with its client."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_action
from rosidl_py_gen.msgs.action_msgs.msg import GoalStatusArray
from rosidl_py_gen.runtime.actions.server_goal import record_of
from support.waiting import until
from support.worlds import entity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")


def goal(order: int = 3) -> Any:
    return Fibonacci.Goal(order=order)


def result(*numbers: int) -> Any:
    return Fibonacci.Result(sequence=list(numbers))


def feedback(*numbers: int) -> Any:
    return Fibonacci.Feedback(sequence=list(numbers))


async def fibonacci(handle: Any) -> Any:
    done: list[int] = []
    for number in range(handle.request.order):
        if handle.is_cancel_requested:
            return handle.canceled(Fibonacci.Result(sequence=done))
        done.append(number)
        handle.publish_feedback(Fibonacci.Feedback(sequence=done))
        await asyncio.sleep(0)
    return Fibonacci.Result(sequence=done)


async def until_canceled(handle: Any) -> Any:
    await handle.wait_for_cancel()
    return handle.canceled(result(7))


async def pair(world: World, execute: Any = fibonacci, *, lost_after_s: float = 0.3, **options: Any) -> Any:
    server = world.node("server").create_action_server(Fibonacci, "fib", execute, **options)
    client = world.node("client").create_action_client(Fibonacci, "fib", server_lost_timeout_s=lost_after_s)
    assert await client.wait_for_server(timeout_s=20)
    return server, client


async def statuses_of(world: World, server: Any) -> list[list[int]]:
    seen: list[list[int]] = []
    world.node().create_subscription(
        GoalStatusArray, "fib/_action/status", lambda m: seen.append([row.status for row in m.status_list]), 100
    )
    await until(lambda: entity(server, "/status").subscription_count == 2)
    return seen


def retained_goal_count(server: Any) -> int:
    """Return the number of active goals and retained results of a server."""
    return len(server._goals.table)


def known_goals(client: Any) -> Any:
    """Return the goals of a client that have not ended, by their ids."""
    return client._goals


def pending_results(client: Any) -> Any:
    """Return the requests for results that a client has not finished."""
    return client._result._pending


def result_client(client: Any) -> Any:
    """Return the service client that requests results."""
    return client._result.client


@contextlib.contextmanager
def served_in_thread(world: World, execute: Any) -> Iterator[None]:
    """Serve the action on an event loop of another thread."""
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
        assert ready.wait(20)
        yield
    finally:
        stop.set()
        thread.join()


def is_awaited(handle: Any) -> bool:
    return bool(record_of(handle).changed)
