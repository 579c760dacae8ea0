"""Functions that find names in the ROS graph (hidden names, nodes that serve a service, actions), and the owner of a
recorded topic.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import InvalidNameError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime import Node

LIST_PARAMETERS = "/list_parameters", "rcl_interfaces/srv/ListParameters"
"""Name after the node's name, and type, of a service by which nodes with parameters are found."""
_FEEDBACK, _FEEDBACK_TYPE, _SEND_GOAL = "/_action/feedback", "_FeedbackMessage", "/_action/send_goal"
_EVENT = "/_service_event"
_ACTION = "/_action/"
_ACTION_TOPICS = "feedback", "status"
_ACTION_SERVICES = "send_goal", "cancel_goal", "get_result"
_EVENT_TYPE = re.compile(r"[^/]+/(srv|action)/[^/]+_Event\Z")
_ACTION_TYPE = re.compile(rf"action_msgs/msg/GoalStatusArray\Z|.+{_FEEDBACK_TYPE}\Z")


# --------------------------------------------------------------------------------------------------------------- topics


def is_hidden(name: str) -> bool:
    """Return True for a topic or service that ROS tools hide: a part of its name begins with an underscore."""
    return "/_" in name


def full_name(node: Node, name: str, kind: str = "topic") -> str:
    """Return the full name of a topic, service, action or node, which need not exist. Raises `InvalidNameError`."""
    resolve = node.resolve_topic_name if kind == "topic" else node.resolve_service_name
    return resolve(name if name.startswith("/") else f"/{name}")


def graph_names(node: Node, kind: str) -> list[str]:
    """Return the names of the topics, services, actions or nodes (`kind`) in the graph."""
    services = [name for name, _ in node.get_service_names_and_types()]
    match kind:
        case "topic":
            return [name for name, _ in node.get_topic_names_and_types()]
        case "service":
            return services
        case "action":  # both its topics and its services
            return [name for name, _ in actions(node.get_topic_names_and_types()) if name + _SEND_GOAL in services]
    return node.get_node_names()


# ---------------------------------------------------------------------------------------------------------------- nodes


def is_hidden_node(name: str) -> bool:
    """Return True for the full name of a node that ROS tools hide, because its name begins with an underscore."""
    return name.rpartition("/")[2].startswith("_")


def has_server(node: Node, service: str) -> bool:
    """Return True if a service has a server; False for a name that ROS does not allow, which DDS programs may use."""
    from rosidl_py_gen.runtime import validate_full_name  # most functions of this module need no node

    try:
        validate_full_name(service)
    except InvalidNameError:
        return False
    return node.count_services(service) > 0


def nodes_serving(node: Node, ending: str, type_name: str, *, hidden: bool) -> list[str]:
    """Return the sorted full names of nodes that serve the service ``NODE`` + `ending` of type `type_name`."""
    names = [
        name.removesuffix(ending)
        for name, types in node.get_service_names_and_types()
        if name.endswith(ending) and type_name in types and has_server(node, name)
    ]
    return [name for name in names if hidden or not is_hidden_node(name)]


# -------------------------------------------------------------------------------------------------------------- actions


def actions(topics: Iterable[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
    """Return names and types of the actions among topics, found by their feedback topics as in ``ros2 action``."""
    ends = len(_FEEDBACK_TYPE)
    return [
        (name.removesuffix(_FEEDBACK), [one[:-ends] for one in types if one.endswith(_FEEDBACK_TYPE)])
        for name, types in topics
        if name.endswith(_FEEDBACK)
    ]


# ----------------------------------------------------------------------------------------------------------- recordings


class TopicOwner(NamedTuple):
    """Topic, service or action that a topic belongs to.

    Attributes:
        kind: ``topic``, ``service`` or ``action``.
        name: name of the topic, service or action.
        service: service whose events the topic has, also one of an action; empty for other topics.
    """

    kind: str
    name: str
    service: str = ""


def topic_owner(topic: str, type_name: str) -> TopicOwner:
    """Return the topic, service or action that a topic belongs to, by name and type; the name alone is ambiguous."""
    is_event = topic.endswith(_EVENT) and _EVENT_TYPE.match(type_name) is not None
    service = topic.removesuffix(_EVENT) if is_event else ""
    action, mark, part = (service or topic).rpartition(_ACTION)
    is_part = part in _ACTION_SERVICES if service else part in _ACTION_TOPICS and _ACTION_TYPE.match(type_name)
    if mark and action and is_part:
        return TopicOwner("action", action, service)
    return TopicOwner("service", service, service) if service else TopicOwner("topic", topic)
