"""The classes a command works with: of a name the user gave, or of what is announced on the network.

Decides where a definition comes from. What somebody announces is asked of the node, which compares hashes and asks its
peers for what is known nowhere here; a type that nobody announces has to be importable, in the folders of ``--path``,
in AMENT_PREFIX_PATH, or bundled.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message, TypeInfo
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.type_loading.class_lookup import load_compiler

if TYPE_CHECKING:
    from collections.abc import Awaitable, Sequence

    from rosidl_py_gen.cdr import Action, Service
    from rosidl_py_gen.ros_cli.command_node import CommandNode

T = TypeVar("T")

_PATIENCE_S = 10.0
"""How long somebody may take to describe a type that is known nowhere else."""
_A_WHILE_S = 0.02
"""Peers on a quiet network are found before; with them loading would only compete with what the command does next, and
the type may be ready-made."""
_GOAL_SERVICE, _GOAL_TYPE = "/_action/send_goal", "_SendGoal"


async def preload_while_waiting(others: Awaitable[T]) -> T:
    """Wait for others; if that takes a while, what making classes needs is loaded meanwhile, in a thread."""
    loading = asyncio.get_running_loop().call_later(_A_WHILE_S, _preload_compiler)
    try:
        return await others
    finally:
        loading.cancel()


def _preload_compiler() -> None:
    loading = asyncio.get_running_loop().run_in_executor(None, load_compiler)
    loading.add_done_callback(lambda done: done.cancelled() or done.exception())  # whoever needs it meets that again


async def message_class(
    session: CommandNode, topic: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Message]:
    """The class of a topic's messages.

    Args:
        topic: full name; somebody has it when `type_name` is None.
        type_name: ``pkg/msg/Name`` or ``pkg/Name``.

    Raises:
        ToolError: the topic has several types.
        TypeNotFoundError, TypeDescriptionError, InvalidNameError, DefinitionError: as their names say.
    """
    types = _topic_types(session, topic)
    name = _only("topic", topic, types) if type_name is None else str(split_ros_name(type_name, "msg"))
    if name not in types:
        return get_message(name, path=paths)
    return await session.node.resolve_type(topic, name, path=paths, timeout_s=_PATIENCE_S)


async def service_class(
    session: CommandNode, service: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Service[Any, Any]]:
    """The class of a service; as `message_class`.

    Raises:
        ToolError: a type was given, and all who have the service say another.
    """
    types = _services(session).get(service, [])
    name = _given_or_only("service", service, types, type_name)
    if name not in types:
        return get_service(name, path=paths)
    return await session.node.resolve_service_type(service, name, path=paths, timeout_s=_PATIENCE_S)


async def action_class(
    session: CommandNode, action: str, type_name: str | None = None, paths: Sequence[str] = ()
) -> type[Action[Any, Any, Any]]:
    """The class of an action; as `service_class`."""
    name = _given_or_only("action", action, types := _action_types(session, action), type_name)
    if name not in types:
        return get_action(name, path=paths)
    return await session.node.resolve_action_type(action, name, path=paths, timeout_s=_PATIENCE_S)


def topic_type(session: CommandNode, topic: str) -> str:
    """The one type of a topic that somebody has.

    Raises:
        ToolError: it has several; the user has to say which one.
    """
    return _only("topic", topic, _topic_types(session, topic))


def opaque_class(session: CommandNode, topic: str, type_name: str | None = None) -> type[Message]:
    """A class with the name and hash of a topic's messages and nothing else, for subscribing to their bytes.

    Raises:
        ToolError: the topic has several types. InvalidNameError.
    """
    name = str(split_ros_name(type_name, "msg")) if type_name else topic_type(session, topic)
    endpoints = [
        *session.node.get_publishers_info_by_topic(topic),
        *session.node.get_subscriptions_info_by_topic(topic),
    ]
    hashes = [one.topic_type_hash for one in endpoints if one.topic_type == name and one.topic_type_hash]

    class OpaqueMessage(Message):
        __slots__ = ()
        _TYPE = TypeInfo(name, hashes[0] if hashes else "", ())

    return OpaqueMessage


def interface_names(kind: str = "msg", paths: Sequence[str] = ()) -> list[str]:
    """Full names of the definitions on the search path, sorted.

    Raises:
        DefinitionError: a folder cannot be used.
    """
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

    packages = scan_search_path(paths).packages.values()
    return sorted(str(name) for package in packages for name in package.files if name.kind == kind)


def announced_types(session: CommandNode, kind: str, name: str) -> list[str]:
    """Return the types with which nodes have a topic, service or action; `kind` is one of these words."""
    match kind:
        case "topic":
            return _topic_types(session, name)
        case "service":
            return _services(session).get(name, [])
    return _action_types(session, name)


def _topic_types(session: CommandNode, topic: str) -> list[str]:
    return dict(session.node.get_topic_names_and_types()).get(topic, [])


def _services(session: CommandNode) -> dict[str, list[str]]:
    return dict(session.node.get_service_names_and_types())


def _action_types(session: CommandNode, action: str) -> list[str]:
    return [name.removesuffix(_GOAL_TYPE) for name in _services(session).get(action + _GOAL_SERVICE, [])]


def _given_or_only(kind: str, name: str, types: Sequence[str], type_name: str | None) -> str:
    """The type somebody named, unless nobody has it: nobody would answer then."""
    if type_name is None:
        return _only(kind, name, types)
    wanted = str(split_ros_name(type_name, "srv" if kind == "service" else kind))
    if types and wanted not in types:
        raise ToolError(f"{kind} {name} has type {', '.join(types)}, not {wanted}")
    return wanted


def _only(kind: str, name: str, types: Sequence[str]) -> str:
    if not types:
        raise TypeNotFoundError(f"nobody says which type {kind} {name} has; give the type")
    if len(types) > 1:
        raise ToolError(f"{kind} {name} has more than one type: {', '.join(types)}; give the one you mean")
    return types[0]
