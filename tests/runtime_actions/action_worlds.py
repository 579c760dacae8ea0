"""Nodes that see each other, on the memory transport or on DDS over loopback, with the Fibonacci action."""

from __future__ import annotations

import asyncio
import itertools
import os
from collections.abc import Callable, Coroutine
from typing import Any

from rosidl_py_gen import get_action
from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.node.environment import cyclone_xml, read_environment

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")


DOMAIN = 181 + os.getpid() % 50
"""Of this test process alone, so that parallel runs do not see each other."""


def open_context(args: list[str], transport: MemoryTransport | None) -> Context:
    """Nothing a test does may leave this machine; refuses before anything is opened."""
    xml = cyclone_xml(read_environment(os.environ, domain_id=DOMAIN, discovery="localhost"), process_id=1)
    assert 'address="127.0.0.1"' in xml and "<AllowMulticast>false</AllowMulticast>" in xml
    return Context(DOMAIN, discovery="localhost", args=args, transport=transport)


class World:
    """Opens nodes that see each other; everything is closed at the end of the test."""

    def __init__(self, kind: str) -> None:
        self.transport = MemoryTransport() if kind == "memory" else None
        self.contexts: list[Context] = []
        self.nodes: list[Node] = []
        self._numbers = itertools.count()

    def node(self, name: str = "", *, args: list[str] | None = None) -> Node:
        context = open_context(args or [], self.transport)
        self.contexts.append(context)
        node = Node(name or f"node{next(self._numbers)}", context=context)
        self.nodes.append(node)  # a node that nobody holds closes itself
        return node

    def close(self) -> None:
        for context in self.contexts:
            context.close()


def run(main: Callable[[], Coroutine[Any, Any, None]], timeout_s: float = 20) -> None:
    """Run an async test."""

    async def limited() -> None:
        await asyncio.wait_for(main(), timeout_s)

    asyncio.run(limited())


async def until(condition: Callable[[], bool], timeout_s: float = 5) -> None:
    """Let the loop run until `condition` holds."""
    deadline = asyncio.get_running_loop().time() + timeout_s
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, "never happened"
        await asyncio.sleep(0.001)


def goal(order: int = 3) -> Any:
    return Fibonacci.Goal(order=order)


def result(*numbers: int) -> Any:
    return Fibonacci.Result(sequence=list(numbers))


def feedback(*numbers: int) -> Any:
    return Fibonacci.Feedback(sequence=list(numbers))


async def fibonacci(handle: Any) -> Any:
    """The handler of the README."""
    done: list[int] = []
    for number in range(handle.request.order):
        if handle.cancel_requested:
            return handle.canceled(Fibonacci.Result(sequence=done))
        done.append(number)
        handle.publish_feedback(Fibonacci.Feedback(sequence=done))
        await asyncio.sleep(0)
    return Fibonacci.Result(sequence=done)


async def until_canceled(handle: Any) -> Any:
    await handle.wait_for_cancel()
    return handle.canceled(result(7))


async def pair(world: World, execute: Any = fibonacci, **options: Any) -> tuple[Any, Any]:
    """A server and a connected client."""
    server = world.node("server").create_action_server(Fibonacci, "fib", execute, **options)
    client = world.node("client").create_action_client(Fibonacci, "fib", server_lost_after_s=0.3)
    assert await client.wait_for_server(timeout_s=5)
    return server, client


async def anext_of(stream: Any) -> Any:
    return await asyncio.wait_for(stream.__anext__(), 5)
