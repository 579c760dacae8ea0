"""Classes of the topics, services and actions that a command uses.

A type that a node announces is resolved by the command's node, which compares hashes and requests unknown definitions
from peers. Any other type must be in the folders of ``--path``, in AMENT_PREFIX_PATH, or bundled.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message, TypeInfo
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.type_loading.class_lookup import load_compiler

if TYPE_CHECKING:
    from collections.abc import Awaitable, Sequence

    from rosidl_py_gen.cdr import Action, Service
    from rosidl_py_gen.ros_cli.command_node import CommandNode

T = TypeVar("T")

_DESCRIPTION_TIMEOUT_S = 10.0
"""Maximum time to wait for a node's description of an unknown type."""
_PRELOAD_DELAY_S = 0.02
"""Delay before the compiler is imported. On a quiet network peers are found earlier; importing would delay the command
then, and its type may be generated already."""
_GOAL_SERVICE, _GOAL_TYPE = "/_action/send_goal", "_SendGoal"


async def preload_while_waiting(awaitable: Awaitable[T]) -> T:
    """Await; if that takes long, import the compiler in a thread at the same time."""
    loading = asyncio.get_running_loop().call_later(_PRELOAD_DELAY_S, _preload_compiler)
    try:
        return await awaitable
    finally:
        loading.cancel()


def _preload_compiler() -> None:
    loading = asyncio.get_running_loop().run_in_executor(None, load_compiler)
    loading.add_done_callback(lambda done: done.cancelled() or done.exception())  # the next import raises it again


async def message_class(
    command_node: CommandNode, topic: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Message]:
    """Return the class of a topic's messages.

    Args:
        topic: full name; a node must have it if `type_name` is None.
        type_name: ``pkg/msg/Name`` or ``pkg/Name``.
    """
    types = _topic_types(command_node, topic)
    name = _only("topic", topic, types) if type_name is None else str(split_ros_name(type_name, "msg"))
    if name not in types:
        return get_message(name, path=paths)
    return await command_node.node.resolve_type(topic, name, path=paths, timeout_s=_DESCRIPTION_TIMEOUT_S)


async def service_class(
    command_node: CommandNode, service: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Service[Any, Any]]:
    """Return the class of a service. Raises `CommandError`, `RosidlError`."""
    types = _services(command_node).get(service, [])
    name = _given_or_only("service", service, types, type_name)
    if name not in types:
        return get_service(name, path=paths)
    return await command_node.node.resolve_service_type(service, name, path=paths, timeout_s=_DESCRIPTION_TIMEOUT_S)


async def action_class(
    command_node: CommandNode, action: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Action[Any, Any, Any]]:
    """Return the class of an action; raises as `service_class`."""
    name = _given_or_only("action", action, types := _action_types(command_node, action), type_name)
    if name not in types:
        return get_action(name, path=paths)
    return await command_node.node.resolve_action_type(action, name, path=paths, timeout_s=_DESCRIPTION_TIMEOUT_S)


def opaque_message_class(type_name: str, type_hash: str) -> type[Message]:
    """Return a class without fields that has the name and hash of a type, for serialized messages."""

    class OpaqueMessage(Message):
        __slots__ = ()
        _TYPE = TypeInfo(str(split_ros_name(type_name, "msg")), type_hash, ())

    return OpaqueMessage


def opaque_class(command_node: CommandNode, topic: str, type_name: str | None = None) -> type[Message]:
    """Return a class for the serialized messages of a topic. Raises `CommandError`, `InvalidNameError`."""
    name = (
        str(split_ros_name(type_name, "msg")) if type_name else _only("topic", topic, _topic_types(command_node, topic))
    )
    endpoints = [
        *command_node.node.get_publishers_info_by_topic(topic),
        *command_node.node.get_subscriptions_info_by_topic(topic),
    ]
    hashes = [one.topic_type_hash for one in endpoints if one.topic_type == name and one.topic_type_hash]
    return opaque_message_class(name, hashes[0] if hashes else "")


def interface_names(kind: str = "msg", paths: Sequence[str] = ()) -> list[str]:
    """Return the full names of the definitions on the search path, sorted; raises `DefinitionError`."""
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

    packages = scan_search_path(paths).packages.values()
    return sorted(str(name) for package in packages for name in package.files if name.kind == kind)


def announced_types(command_node: CommandNode, kind: str, name: str) -> list[str]:
    """Return the types that nodes announce for a topic, service or action (`kind`)."""
    match kind:
        case "topic":
            return _topic_types(command_node, name)
        case "service":
            return _services(command_node).get(name, [])
    return _action_types(command_node, name)


def _topic_types(command_node: CommandNode, topic: str) -> list[str]:
    return dict(command_node.node.get_topic_names_and_types()).get(topic, [])


def _services(command_node: CommandNode) -> dict[str, list[str]]:
    return dict(command_node.node.get_service_names_and_types())


def _action_types(command_node: CommandNode, action: str) -> list[str]:
    return [name.removesuffix(_GOAL_TYPE) for name in _services(command_node).get(action + _GOAL_SERVICE, [])]


def _given_or_only(kind: str, name: str, types: Sequence[str], type_name: str | None) -> str:
    if type_name is None:
        return _only(kind, name, types)
    requested = str(split_ros_name(type_name, "srv" if kind == "service" else kind))
    if types and requested not in types:
        raise CommandError(f"{kind} {name} has type {', '.join(types)}, not {requested}")
    return requested


def _only(kind: str, name: str, types: Sequence[str]) -> str:
    if not types:
        raise TypeNotFoundError(f"no node announces the type of {kind} {name}; add the type to the command line")
    if len(types) > 1:
        raise CommandError(
            f"{kind} {name} has more than one type: {', '.join(types)}; add one of them to the command line"
        )
    return types[0]
