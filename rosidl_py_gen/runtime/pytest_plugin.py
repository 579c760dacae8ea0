"""Fixtures for tests of programs that use this package: nodes that meet in memory, without network.

Loaded by pytest through the entry point ``rosidl_py_gen``; decides nothing, imports the runtime when a fixture is used.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.memory import MemoryTransport
    from rosidl_py_gen.runtime.node import Node


@pytest.fixture
def ros_world() -> MemoryTransport:
    """A fresh `MemoryTransport`; give it to every `Context` of the test."""
    from rosidl_py_gen.runtime.memory import MemoryTransport

    return MemoryTransport()


@pytest.fixture
def ros_node(ros_world: MemoryTransport) -> Iterator[Callable[..., Node]]:
    """A function ``ros_node(name, namespace="", args=())`` that makes nodes of `ros_world`, closed after the test.

    Each node has a context of its own, as if it were another process; `args` is its command line.
    """
    from rosidl_py_gen.runtime.context import Context
    from rosidl_py_gen.runtime.node import Node

    with ExitStack() as stack:

        def make(name: str, namespace: str = "", args: tuple[str, ...] = ()) -> Node:
            context = stack.enter_context(Context(0, transport=ros_world, args=["test", *args]))
            return stack.enter_context(Node(name, namespace, context=context))

        yield make
