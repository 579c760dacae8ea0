"""Nodes with parameters that see each other, on the memory transport or on DDS over loopback."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Coroutine
from typing import Any

from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.node.environment import cyclone_xml, read_environment

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

    def context(self, args: str = "") -> Context:
        context = open_context(["p", *args.split()], self.transport)
        self.contexts.append(context)
        return context

    def node(self, name: str, namespace: str = "", *, args: str = "", **options: Any) -> Node:
        node = Node(name, namespace, context=self.context(args), **options)
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


async def take(stream: Any) -> Any:
    """The next item."""
    return await asyncio.wait_for(stream.__anext__(), 5)
