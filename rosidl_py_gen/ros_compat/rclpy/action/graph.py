"""Which actions there are. An action is known by the topic of its feedback."""

from __future__ import annotations

from typing import List, Tuple  # noqa: F401, UP035

from rclpy.node import Node as Node

_Found = list[tuple[str, list[str]]]
_TOPIC, _TYPE = "/_action/feedback", "_FeedbackMessage"


def _actions(topics: _Found) -> _Found:
    return [
        (name.removesuffix(_TOPIC), [one.removesuffix(_TYPE) for one in types if one.endswith(_TYPE)])
        for name, types in topics
        if name.endswith(_TOPIC)
    ]


def get_action_client_names_and_types_by_node(node: Node, remote_node_name: str, remote_node_namespace: str) -> _Found:
    """Of the clients of a node, as ``('/turn', ['pkg/action/Turn'])``; NodeNameNonExistentError for an unknown node."""
    return _actions(node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_server_names_and_types_by_node(node: Node, remote_node_name: str, remote_node_namespace: str) -> _Found:
    """Of the servers of a node, as ``('/turn', ['pkg/action/Turn'])``; NodeNameNonExistentError for an unknown node."""
    return _actions(node.get_publisher_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_names_and_types(node: Node) -> _Found:
    """Of all actions that a client or server is there for."""
    return _actions(node.get_topic_names_and_types())
