"""Reading the graph in a thread while the loop changes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.graph.graph import Graph
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, TopicKey

TOPIC_KEY = TopicKey("topic", "/t")


@dataclass(frozen=True)
class Meanwhile:
    """Endpoint that adds another one to the graph whenever it is read, like a concurrent thread."""

    of: DiscoveredEndpoint
    come: Callable[[], None]

    def __getattr__(self, name: str) -> Any:
        if name not in ("guid", "topic_key"):
            self.come()
        return getattr(self.of, name)


@pytest.mark.parametrize(
    "ask",
    [
        lambda graph: len(graph.endpoints_on(TOPIC_KEY, writers=True)),
        lambda graph: len(graph.topics()),
    ],
)
def test_others_may_come_while_it_is_asked(ask: Callable[[Graph], int]) -> None:
    graph = Graph()
    numbers = iter(range(1, 100))

    def endpoint() -> DiscoveredEndpoint:
        guid = next(numbers).to_bytes(16, "big")
        return DiscoveredEndpoint(guid, bytes(16), True, TOPIC_KEY, "std_msgs/msg/String", QoSProfile())

    first = endpoint()
    graph.apply(first)
    looked_at: Any = Meanwhile(first, lambda: graph.apply(endpoint()) and None)
    graph.add(looked_at)
    assert ask(graph) == 1
    assert len(graph.endpoints) > 1
