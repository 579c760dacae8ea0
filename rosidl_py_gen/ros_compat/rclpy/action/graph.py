"""Names and types of actions, found by their feedback topics."""

from typing import List, Tuple

from rclpy.node import Node, _NamesAndTypes

_TOPIC_SUFFIX = "/_action/feedback"
_TYPE_SUFFIX = "_FeedbackMessage"


def _actions_of_topics(topics: _NamesAndTypes) -> _NamesAndTypes:
    return [
        (
            name.removesuffix(_TOPIC_SUFFIX),
            [type_.removesuffix(_TYPE_SUFFIX) for type_ in types if type_.endswith(_TYPE_SUFFIX)],
        )
        for name, types in topics
        if name.endswith(_TOPIC_SUFFIX)
    ]


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions a node has clients of, as ``('/turn', ['pkg/action/Turn'])``.

    Raises:
        NodeNameNonExistentError: the node is not in the graph.
    """
    return _actions_of_topics(node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions of a node's servers; see `get_action_client_names_and_types_by_node`."""
    return _actions_of_topics(node.get_publisher_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_names_and_types(node: Node) -> _NamesAndTypes:
    """Return the actions of all clients and servers."""
    return _actions_of_topics(node.get_topic_names_and_types())
