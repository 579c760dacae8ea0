"""Functions that return names and types of actions; since rclpy 10 also methods of `Node`."""

from typing import List, Tuple

from rclpy.node import Node, _NamesAndTypes


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions that a node has clients of, as ``('/turn', ['pkg/action/Turn'])``.

    Raises:
        NodeNameNonExistentError: the node is not in the graph.
    """
    return node.get_action_client_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions that a node serves, as ``('/turn', ['pkg/action/Turn'])``.

    Raises:
        NodeNameNonExistentError: the node is not in the graph.
    """
    return node.get_action_server_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_action_names_and_types(node: Node) -> _NamesAndTypes:
    """Return the actions of all clients and servers in the graph, as ``('/turn', ['pkg/action/Turn'])``."""
    return node.get_action_names_and_types()
