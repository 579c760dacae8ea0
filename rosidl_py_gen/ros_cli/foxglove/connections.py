"""Connection graph of viewers: which nodes publish, subscribe and serve."""

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
    """Sends the graph to viewers; `refresh` is called after changes."""

    def __init__(self, node: Node, server: Server, *, hidden: bool) -> None:
        self._node = node
        self._server = server
        self._hidden = hidden
        self._sent_graph: Graph = NO_GRAPH

    def refresh(self) -> None:
        """Send changes of the graph."""
        published: Names = {}
        subscribed: Names = {}
        served_names: Names = {}
        for info in {(one.name, one.namespace): one for one in self._node.get_nodes()}.values():
            if not self._is_shown(info):
                continue
            node_name = info.fully_qualified_name
            for nodes_by_name, names in (
                (published, self._node.get_publisher_names_and_types_by_node(info.name, info.namespace)),
                (subscribed, self._node.get_subscriber_names_and_types_by_node(info.name, info.namespace)),
                (served_names, self._node.get_service_names_and_types_by_node(info.name, info.namespace)),
            ):
                for name, _ in names:
                    if self._hidden or not is_hidden(name):
                        nodes_by_name.setdefault(name, []).append(node_name)
        if (published, subscribed, served_names) != self._sent_graph:
            self._sent_graph = published, subscribed, served_names
            self._server.publish_graph(published, subscribed, served_names)

    def _is_shown(self, info: NodeInfo) -> bool:
        try:
            validate_full_name(info.fully_qualified_name)
        except InvalidNameError:
            return False
        return self._hidden or not is_hidden_node(info.fully_qualified_name)
