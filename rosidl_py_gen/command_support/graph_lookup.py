"""Names and types in the ROS graph: hidden names, nodes that serve a service, actions, owners of topics, classes.

A type that a node announces is resolved by the command's node, which compares hashes and requests unknown definitions
from peers. Any other type must be in the folders of ``--path``, in AMENT_PREFIX_PATH, or bundled.
"""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message, TypeInfo
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import InvalidNameError, TypeNotFoundError
from rosidl_py_gen.type_loading import load_compiler

if TYPE_CHECKING:
    from collections.abc import Awaitable, Iterable, Sequence

    from rosidl_py_gen.command_support.command_node import CommandNode
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


T = TypeVar("T")

_DESCRIPTION_TIMEOUT_S = 10.0
"""Maximum time to wait for a node's description of an unknown type, in seconds."""
_PRELOAD_DELAY_S = 0.02
"""Delay in seconds before the compiler is imported while a command waits. On a quiet network peers are found earlier;
then importing would delay the command, whose type may be generated already."""
_GOAL_SERVICE, _GOAL_TYPE = "/_action/send_goal", "_SendGoal"
_KINDS: dict[str, tuple[str, Any, str]] = {
    "topic": ("msg", get_message, "resolve_type"),
    "service": ("srv", get_service, "resolve_service_type"),
    "action": ("action", get_action, "resolve_action_type"),
}
"""For topics, services and actions: kind of definition, function that returns an installed class, and method of `Node`
for an announced type."""


def require_stamp(topic: str, cls: type[Message]) -> None:
    """Raise `CommandError` if the messages of a topic have no ``header`` with a stamp."""
    if not any(one.ros_name == "header" and str(one.type) == "std_msgs/msg/Header" for one in cls._TYPE.fields):
        raise CommandError(f"messages of {topic} have no header with a stamp: {cls._TYPE.name}")


async def preload_while_waiting(awaitable: Awaitable[T]) -> T:
    """Return the result of an awaitable, and use the time while waiting.

    If the wait takes more than 20 ms, the compiler is imported in a thread.
    """
    loading = asyncio.get_running_loop().call_later(_PRELOAD_DELAY_S, _preload_compiler)
    try:
        return await awaitable
    finally:
        loading.cancel()


def _preload_compiler() -> None:
    loading = asyncio.get_running_loop().run_in_executor(None, load_compiler)
    loading.add_done_callback(lambda done: done.cancelled() or done.exception())  # the next import raises it again


async def interface_class(
    command_node: CommandNode, kind: str, name: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> Any:
    """Return the class of a topic's messages, of a service or of an action (`kind`).

    Args:
        name: full name of the topic, service or action; a node must have it if `type_name` is None.
        type_name: type such as ``pkg/msg/Name`` or ``pkg/Name``, or None; nodes may announce other types for a topic.

    Raises:
        CommandError: several types are announced and `type_name` is None, or a service or action has another type.
        RosidlError: the type is unknown.
    """
    definition, get, resolve = _KINDS[kind]
    types = announced_types(command_node, kind, name)
    wanted = _only(kind, name, types) if type_name is None else str(split_ros_name(type_name, definition))
    if wanted in types:
        return await getattr(command_node.node, resolve)(name, wanted, path=paths, timeout_s=_DESCRIPTION_TIMEOUT_S)
    if types and kind != "topic":
        raise CommandError(f"{kind} {name} has type {', '.join(types)}, not {wanted}")
    return get(wanted, path=paths)


def installed_class(kind: str, type_name: str, paths: Sequence[str]) -> Any:
    """Return the class of a topic's messages, of a service or of an action by its type, without asking nodes."""
    return _KINDS[kind][1](type_name, path=paths)


def opaque_message_class(type_name: str, type_hash: str) -> type[Message]:
    """Return a class without fields that has the name and hash of a type, for serialized messages."""

    class OpaqueMessage(Message):
        __slots__ = ()
        _TYPE = TypeInfo(str(split_ros_name(type_name, "msg")), type_hash, ())

    return OpaqueMessage


def opaque_class(command_node: CommandNode, topic: str, type_name: str | None = None) -> type[Message]:
    """Return a class without fields for serialized messages of a topic; raises `CommandError` for several types."""
    types = announced_types(command_node, "topic", topic)
    name = str(split_ros_name(type_name, "msg")) if type_name else _only("topic", topic, types)
    endpoints = [
        *command_node.node.get_publishers_info_by_topic(topic),
        *command_node.node.get_subscriptions_info_by_topic(topic),
    ]
    hashes = [one.topic_type_hash for one in endpoints if one.topic_type == name and one.topic_type_hash]
    return opaque_message_class(name, hashes[0] if hashes else "")


def announced_types(command_node: CommandNode, kind: str, name: str) -> list[str]:
    """Return the types that nodes announce for a topic, service or action (`kind`)."""
    if kind == "topic":
        return dict(command_node.node.get_topic_names_and_types()).get(name, [])
    services = dict(command_node.node.get_service_names_and_types())
    if kind == "service":
        return services.get(name, [])
    return [one.removesuffix(_GOAL_TYPE) for one in services.get(name + _GOAL_SERVICE, [])]


def _only(kind: str, name: str, types: Sequence[str]) -> str:
    if not types:
        raise TypeNotFoundError(f"no node announces the type of {kind} {name}; add the type to the command line")
    if len(types) > 1:
        raise CommandError(
            f"{kind} {name} has more than one type: {', '.join(types)}; add one of them to the command line"
        )
    return types[0]
