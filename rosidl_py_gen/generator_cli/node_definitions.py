"""Definitions that a running node uses, requested from the node.

Nodes of ROS 2 describe the messages of topics, but services and actions only by their hash; types without a description
are skipped with a note. Descriptions are limited and checked like other definitions.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import individual_descriptions, rihs01
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.cdr.convert import to_dict
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.compiler.compatibility.definition_set import DefinitionSet, collect_with_dependencies, merge
from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.description_cache import MAX_BYTES

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

_DISCOVERY_INTERVAL_S = 0.5
"""Interval of two checks of a node's endpoints, which are discovered after its name; equal results end the discovery.
"""
_ANSWER_TIMEOUT_S = 5.0
"""Maximum time for the description of one type."""
_HIDDEN = "/_action/"
_EVENTS = "/_service_event"


class NodeDefinitionsError(RosidlError):
    """A node does not exist, or describes none of its types."""


def types_of_node(name: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """Return the types of a node's topics, services and actions, and notes about skipped types.

    Raises:
        NodeDefinitionsError: the node was not discovered in time, or describes none of its types.
        KeyboardInterrupt: a signal ended the command.
    """
    from rosidl_py_gen.runtime import Node, run

    async def request() -> tuple[DefinitionSet, list[str]]:
        options: dict[str, Any] = {"enable_rosout": False, "start_services": False, "parameter_events": False}
        async with Node(f"_rosidl_py_gen_{os.getpid()}", **options) as node:
            return await definitions_of_node(node, name, timeout_s)

    result = run(request())
    if result is None:  # a signal
        raise KeyboardInterrupt
    return result


async def definitions_of_node(node: Node, robot: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """Return the types of another node, `robot`; raises as `types_of_node`."""
    import asyncio

    from rosidl_py_gen.runtime import WaitTimeoutError

    try:
        await node.wait_for_node(robot, timeout_s)
    except WaitTimeoutError as error:
        raise NodeDefinitionsError(str(error)) from None
    before = None
    while (now := _used_types(node, robot)) != before:
        before = now
        await asyncio.sleep(_DISCOVERY_INTERVAL_S)
    return await _request_types(node, robot, now)


def _used_types(node: Node, full_name: str) -> dict[str, dict[str, str]]:
    """Return types by kind, each with the name of one topic, service or action of the type."""
    namespace, _, name = full_name.rpartition("/")
    namespace = namespace or "/"
    found: dict[str, dict[str, str]] = {"msg": {}, "srv": {}, "action": {}}
    topics = [
        *node.get_publisher_names_and_types_by_node(name, namespace),
        *node.get_subscriber_names_and_types_by_node(name, namespace),
    ]
    services = [
        *node.get_service_names_and_types_by_node(name, namespace),
        *node.get_client_names_and_types_by_node(name, namespace),
    ]
    for kind, entries in (("msg", topics), ("srv", services)):
        for entry, types in entries:
            action, hidden, _ = entry.partition(_HIDDEN)
            for one in types:
                if not hidden and not entry.endswith(_EVENTS):
                    found[kind].setdefault(one, entry)
                elif hidden and "/action/" in one:  # A_SendGoal, A_GetResult or A_FeedbackMessage
                    found["action"].setdefault(one.rpartition("_")[0], action)
    return found


async def _request_types(node: Node, robot: str, used: dict[str, dict[str, str]]) -> tuple[DefinitionSet, list[str]]:
    import asyncio

    parts: list[tuple[str, DefinitionSet]] = []
    notes: list[str] = []
    for kind, entries in used.items():
        for type_name, entry in sorted(entries.items()):
            try:
                if kind == "msg":
                    answer = await node.get_type_description(robot, type_name, timeout_s=_ANSWER_TIMEOUT_S)
                    facts = await asyncio.to_thread(_from_description, type_name, answer)
                else:
                    resolve = node.resolve_service_type if kind == "srv" else node.resolve_action_type
                    cls: type[Any] = await resolve(entry, type_name, timeout_s=_ANSWER_TIMEOUT_S)
                    facts = await asyncio.to_thread(_from_class, type_name, cls)
            except RosidlError as error:
                notes.append(f"{robot}: skipped {type_name} of {entry}: {error}")
                continue
            parts.append((f"{entry} of {robot}", facts))
    if notes and not parts:
        raise NodeDefinitionsError(f"{robot} describes none of its types: {notes[0]}")
    if used["srv"] or used["action"]:
        notes.append(
            f"{robot}: constants of services and actions are unknown, and defaults may be those of this installation"
        )
    return merge(parts), notes


def _from_description(type_name: str, answer: Any) -> DefinitionSet:
    """Return the definitions of an answer, which may have another type or be too large."""
    if len(encode(answer)) > MAX_BYTES:
        raise NodeDefinitionsError(f"its description has more than {MAX_BYTES} bytes")
    description = to_dict(answer.type_description)
    name = split_ros_name(type_name)
    if (other := description["type_description"]["type_name"]) != type_name:
        raise NodeDefinitionsError(f"the answer describes another type: {other[:100]}")
    sources = {one.type_name: (one.encoding, one.raw_file_contents) for one in answer.type_sources}
    registry = registry_from_descriptions(name, individual_descriptions(description), sources)
    if registry.type_hash(type_name) != rihs01(description):
        raise NodeDefinitionsError("the answer describes types that do not belong to it")
    return collect_with_dependencies(registry, registry.owner(name) or name)


def _from_class(type_name: str, cls: type[Any]) -> DefinitionSet:
    name = split_ros_name(type_name)
    individuals = individual_descriptions(type_description(cls))
    return collect_with_dependencies(
        registry_from_descriptions(name, individuals, {}, is_service=name.kind == "srv"), name
    )
