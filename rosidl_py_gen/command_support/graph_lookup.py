"""Classes of the types in the ROS graph.

A type that a node announces is resolved by the command's node, which compares hashes and requests unknown definitions
from peers. Any other type must be in the folders of ``--path``, in AMENT_PREFIX_PATH, or bundled.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.message import opaque_message_class
from rosidl_py_gen.command_support.errors import CommandError
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.type_loading import load_compiler

if TYPE_CHECKING:
    from collections.abc import Awaitable, Sequence

    from rosidl_py_gen.command_support.command_node import CommandNode

T = TypeVar("T")
_DESCRIPTION_TIMEOUT_S = 10.0
"""Maximum time to wait for a node's description of an unknown type, in seconds."""
_PRELOAD_DELAY_S = 0.02
"""Delay in seconds before the compiler is imported while a command waits. On a quiet network peers are found earlier;
then importing would delay the command, whose type may be generated already."""
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
    types = command_node.announced_types(kind, name)
    wanted = _only(kind, name, types) if type_name is None else str(RosName.parse(type_name, definition))
    if wanted in types:
        return await getattr(command_node.node, resolve)(name, wanted, path=paths, timeout_s=_DESCRIPTION_TIMEOUT_S)
    if types and kind != "topic":
        raise CommandError(f"{kind} {name} has type {', '.join(types)}, not {wanted}")
    return get(wanted, path=paths)


def opaque_class(command_node: CommandNode, topic: str, type_name: str | None = None) -> type[Message]:
    """Return a class without fields for serialized messages of a topic; raises `CommandError` for several types."""
    types = command_node.announced_types("topic", topic)
    name = str(RosName.parse(type_name, "msg")) if type_name else _only("topic", topic, types)
    endpoints = [
        *command_node.node.get_publishers_info_by_topic(topic),
        *command_node.node.get_subscriptions_info_by_topic(topic),
    ]
    hashes = [one.topic_type_hash for one in endpoints if one.topic_type == name and one.topic_type_hash]
    return opaque_message_class(name, hashes[0] if hashes else "")


def _only(kind: str, name: str, types: Sequence[str]) -> str:
    if not types:
        raise TypeNotFoundError(f"no node announces the type of {kind} {name}; add the type to the command line")
    if len(types) > 1:
        raise CommandError(
            f"{kind} {name} has more than one type: {', '.join(types)}; add one of them to the command line"
        )
    return types[0]
