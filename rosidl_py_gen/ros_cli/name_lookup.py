"""Names that a command was given, or finds: what ROS tools hide, who serves something, and waiting for one of them."""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.runtime import validate_full_name

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.runtime import Node

LIST_PARAMETERS = "/list_parameters", "rcl_interfaces/srv/ListParameters"
"""How the name of a service ends that every node with parameters has, and its type."""
_SILENT_S = 2.0
"""Fast DDS robots are found within 1.2 s."""
_FEEDBACK, _FEEDBACK_TYPE, _SEND_GOAL = "/_action/feedback", "_FeedbackMessage", "/_action/send_goal"
_EVENT = "/_service_event"
_ACTION = "/_action/"
_ACTION_TOPICS = "feedback", "status"
_ACTION_SERVICES = "send_goal", "cancel_goal", "get_result"
_EVENT_TYPE = re.compile(r"[^/]+/(srv|action)/[^/]+_Event\Z")
_ACTION_TYPE = re.compile(rf"action_msgs/msg/GoalStatusArray\Z|.+{_FEEDBACK_TYPE}\Z")


# --------------------------------------------------------------------------------------------------------------- topics


def is_hidden(name: str) -> bool:
    """Whether ROS tools leave a topic or a service out: a part of its name begins with an underscore."""
    return "/_" in name


def full_topic_name(session: CommandNode, topic: str) -> str:
    """The full name of a topic that need not be there. Raises `InvalidNameError`."""
    return session.node.resolve_topic_name(topic if topic.startswith("/") else f"/{topic}")


async def find_topic(session: CommandNode, topic: str, timeout_s: float | None) -> str:
    """The full name of a topic that somebody publishes or subscribes to; waits for it, and says so after 2 s.

    Raises:
        ToolError: it did not appear. InvalidNameError.
    """
    node = session.node
    waiting = asyncio.get_running_loop().call_later(
        _SILENT_S, terminal_output.note, f"topic {topic} does not appear to be published yet; waiting for it"
    )
    try:
        return await session.find("topic", topic, lambda: [*dict(node.get_topic_names_and_types())], timeout_s)
    finally:
        waiting.cancel()


def is_one_of(wanted: str, types: list[str], kind: str) -> bool:
    """Whether a type, perhaps in the short form ``pkg/Name``, is among `types`.

    Raises:
        InvalidNameError: it is no name of a type.
    """
    return str(split_ros_name(wanted, kind)) in types


# ---------------------------------------------------------------------------------------------------------------- nodes


def is_hidden_node(name: str) -> bool:
    """Whether ROS tools leave a node out, by its full name: they hide themselves like that."""
    return name.rpartition("/")[2].startswith("_")


def has_server(node: Node, service: str) -> bool:
    """Whether somebody serves it; never for a name that ROS refuses, which DDS programs may use."""
    try:
        validate_full_name(service)
    except InvalidNameError:
        return False
    return node.count_services(service) > 0


def nodes_serving(node: Node, ending: str, type_name: str, *, hidden: bool) -> list[str]:
    """Full names, sorted, of the nodes with a service of that type below their own name; clients alone do not count."""
    found = [
        name.removesuffix(ending)
        for name, types in node.get_service_names_and_types()
        if name.endswith(ending) and type_name in types and has_server(node, name)
    ]
    return [name for name in found if hidden or not is_hidden_node(name)]


async def find_node(session: CommandNode, node: str, timeout_s: float | None = None) -> str:
    """The full name; raises as `Session.find`."""
    return await session.find("node", node, session.node.get_node_names, timeout_s)


# -------------------------------------------------------------------------------------------------------------- actions


def actions(topics: Iterable[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
    """The actions among topics, by their feedback as for ``ros2 action``: servers publish it, clients subscribe."""
    ends = len(_FEEDBACK_TYPE)
    return [
        (name.removesuffix(_FEEDBACK), [one[:-ends] for one in types if one.endswith(_FEEDBACK_TYPE)])
        for name, types in topics
        if name.endswith(_FEEDBACK)
    ]


async def find_action(session: CommandNode, action: str, timeout_s: float | None = None) -> str:
    """The full name, once its services are known, too; raises as `Session.find`."""
    node = session.node

    def known() -> list[str]:
        services = {name for name, _ in node.get_service_names_and_types()}
        return [name for name, _ in actions(node.get_topic_names_and_types()) if name + _SEND_GOAL in services]

    return await session.find("action", action, known, timeout_s)


# ----------------------------------------------------------------------------------------------------------- recordings


class TopicOwner(NamedTuple):
    """What a topic belongs to.

    Attributes:
        kind: ``topic``, ``service`` or ``action``.
        name: of the topic itself, the service, or the action.
        service: whose events these are, of a service or of an action; empty for others.
    """

    kind: str
    name: str
    service: str = ""


def topic_owner(topic: str, type_name: str) -> TopicOwner:
    """What a topic belongs to, by its name and type, as other topics may be called alike."""
    is_event = topic.endswith(_EVENT) and _EVENT_TYPE.match(type_name) is not None
    service = topic.removesuffix(_EVENT) if is_event else ""
    action, mark, part = (service or topic).rpartition(_ACTION)
    is_part = part in _ACTION_SERVICES if service else part in _ACTION_TOPICS and _ACTION_TYPE.match(type_name)
    if mark and action and is_part:
        return TopicOwner("action", action, service)
    return TopicOwner("service", service, service) if service else TopicOwner("topic", topic)
