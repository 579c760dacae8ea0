"""Fixtures for tests of programs that use this package: nodes that meet in memory, without network.

Loaded by pytest through the entry point ``rosidl_py_gen``; imports the runtime when a fixture is used. Decides that the
nodes of a test share its event loop.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport


@pytest.fixture
def ros_world() -> MemoryTransport:
    """A fresh `MemoryTransport`; give it to every `Context` of the test."""
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport

    return MemoryTransport()


@pytest.fixture
def ros_node(ros_world: MemoryTransport) -> Iterator[Callable[..., Node]]:
    """A function ``ros_node(name, namespace="", args=())`` that makes nodes of `ros_world`, closed after the test.

    Each node has a context of its own, as if it were another process; `args` is its command line. Nodes may be made
    before the test's event loop runs: the first use of any of them inside the loop is enough for all.
    """
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.node.node import Node

    contexts: list[Context] = []

    def attach_all() -> None:
        for context in contexts:
            context.bridge.adopt_running_loop()

    with ExitStack() as stack:

        def make(name: str, namespace: str = "", args: tuple[str, ...] = ()) -> Node:
            context = stack.enter_context(Context(0, transport=ros_world, args=["test", *args]))
            contexts.append(context)
            context.bridge.on_start(attach_all)
            return stack.enter_context(Node(name, namespace, context=context))

        yield make
