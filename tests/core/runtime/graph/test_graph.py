"""Concurrent reads and changes of the graph."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.graph import Graph
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, TopicKey
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex

TOPIC_KEY = TopicKey("topic", "/t")


@dataclass(frozen=True)
class GrowingEndpoint:
    """Endpoint that adds another one to the graph whenever it is read, like a concurrent thread."""

    of: DiscoveredEndpoint
    add_endpoint: Callable[[], None]

    def __getattr__(self, name: str) -> Any:
        if name not in ("guid", "topic_key"):
            self.add_endpoint()
        return getattr(self.of, name)


@pytest.mark.parametrize(
    "read",
    [
        lambda graph: len(graph.endpoints_on(TOPIC_KEY, writers=True)),
        lambda graph: len(graph.topics()),
    ],
)
def test_graph_can_be_read_while_another_thread_adds_endpoints(read: Callable[[Graph], int]) -> None:
    index = EndpointIndex()
    graph = Graph(index)
    numbers = iter(range(1, 100))

    def endpoint() -> DiscoveredEndpoint:
        guid = next(numbers).to_bytes(16, "big")
        return DiscoveredEndpoint(guid, bytes(16), True, TOPIC_KEY, "std_msgs/msg/String", QoSProfile())

    first = endpoint()
    index.add(first)
    growing: Any = GrowingEndpoint(first, lambda: index.add(endpoint()))
    index.add(growing)
    assert read(graph) == 1
    assert len(graph.endpoints) > 1
