"""Which nodes publish, subscribe and serve what, as viewers draw it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli.foxglove.protocol import NO_GRAPH, Graph, Names
from rosidl_py_gen.ros_cli.name_lookup import is_hidden, is_hidden_node
from rosidl_py_gen.runtime import validate_full_name

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import Node, NodeInfo


class ConnectionGraph:
    """Tells viewers of the graph: `refresh` after its changes."""

    def __init__(self, node: Node, server: Server, *, hidden: bool) -> None:
        self._node = node
        self._server = server
        self._hidden = hidden
        self._told: Graph = NO_GRAPH

    def refresh(self) -> None:
        """Follow the graph."""
        published: Names = {}
        subscribed: Names = {}
        served: Names = {}
        for info in {(one.name, one.namespace): one for one in self._node.get_nodes()}.values():
            if not self._is_shown(info):
                continue
            whole = info.fully_qualified_name
            for found, names in (
                (published, self._node.get_publisher_names_and_types_by_node(info.name, info.namespace)),
                (subscribed, self._node.get_subscriber_names_and_types_by_node(info.name, info.namespace)),
                (served, self._node.get_service_names_and_types_by_node(info.name, info.namespace)),
            ):
                for name, _ in names:
                    if self._hidden or not is_hidden(name):
                        found.setdefault(name, []).append(whole)
        if (published, subscribed, served) != self._told:
            self._told = published, subscribed, served
            self._server.publish_graph(published, subscribed, served)

    def _is_shown(self, info: NodeInfo) -> bool:
        """Not with a namespace that ROS refuses: participants may tell anything."""
        try:
            validate_full_name(info.fully_qualified_name)
        except InvalidNameError:
            return False
        return self._hidden or not is_hidden_node(info.fully_qualified_name)
