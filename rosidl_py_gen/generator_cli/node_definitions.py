"""The definitions that a running node uses, asked of the node.

Decides that what cannot be learned is said and left out: nodes of ROS 2 describe the messages of topics, but services
and actions only to those who know their hash. What a node says is bounded and checked as any definition is.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import individual_descriptions, rihs01
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.cdr.convert import to_dict
from rosidl_py_gen.cdr.typesupport import type_description
from rosidl_py_gen.compiler.compatibility.definition_set import DefinitionSet, collect_with_dependencies, merge
from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.description_cache import MAX_BYTES

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

_QUIET_S = 0.5
_ANSWER_S = 5.0
_HIDDEN, _EVENTS = "/_action/", "/_service_event"


class NodeDefinitionsError(RosidlError):
    """A node is not there, or tells nothing that could be compared."""


def types_of_node(name: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """The types of a node's topics, services and actions, and what could not be learned.

    Raises:
        NodeDefinitionsError: it did not appear in time, or describes none of its types. KeyboardInterrupt.
    """
    from rosidl_py_gen.runtime import run

    found = run(_asked(name, timeout_s))
    if found is None:  # a signal
        raise KeyboardInterrupt
    return found


async def _asked(name: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    from rosidl_py_gen.runtime import Node

    options: dict[str, Any] = {"enable_rosout": False, "start_services": False, "parameter_events": False}
    async with Node(f"_rosidl_py_gen_{os.getpid()}", **options) as node:
        return await definitions_of_node(node, name, timeout_s)


async def definitions_of_node(node: Node, robot: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """What another node, `robot`, uses; as `types_of_node`."""
    import asyncio

    from rosidl_py_gen.runtime import WaitTimeoutError

    try:
        await node.wait_for_node(robot, timeout_s)
    except WaitTimeoutError as error:
        raise NodeDefinitionsError(str(error)) from None
    before = None
    while (now := _used(node, robot)) != before:  # endpoints follow the name
        before = now
        await asyncio.sleep(_QUIET_S)
    return await _learned(node, robot, now)


def _used(node: Node, full_name: str) -> dict[str, dict[str, str]]:
    """Types by kind, each with the name of one topic, service or action that has it."""
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
                elif hidden and "/action/" in one:  # of A_SendGoal, A_GetResult and A_FeedbackMessage
                    found["action"].setdefault(one.rpartition("_")[0], action)
    return found


async def _learned(node: Node, robot: str, used: dict[str, dict[str, str]]) -> tuple[DefinitionSet, list[str]]:
    import asyncio

    parts: list[tuple[str, DefinitionSet]] = []
    notes: list[str] = []
    for kind, entries in used.items():
        for type_name, entry in sorted(entries.items()):
            try:
                if kind == "msg":
                    told = await node.get_type_description(robot, type_name, timeout_s=_ANSWER_S)
                    facts = await asyncio.to_thread(_described, type_name, told)
                else:
                    resolve = node.resolve_service_type if kind == "srv" else node.resolve_action_type
                    cls: type[Any] = await resolve(entry, type_name, timeout_s=_ANSWER_S)
                    facts = await asyncio.to_thread(_of_class, type_name, cls)
            except RosidlError as error:
                notes.append(f"{robot}: left out {type_name} of {entry}: {error}")
                continue
            parts.append((f"{entry} of {robot}", facts))
    if notes and not parts:
        raise NodeDefinitionsError(f"{robot} describes none of its types: {notes[0]}")
    if used["srv"] or used["action"]:
        notes.append(f"{robot}: of services and actions, constants are not known, and defaults may be those known here")
    return merge(parts), notes


def _described(type_name: str, told: Any) -> DefinitionSet:
    """Facts of an answer, which may be about something else, or be as large as a message can be."""
    if len(encode(told)) > MAX_BYTES:
        raise NodeDefinitionsError(f"it is described in more than {MAX_BYTES} bytes")
    description = to_dict(told.type_description)
    name = split_ros_name(type_name)
    if description["type_description"]["type_name"] != type_name:
        raise NodeDefinitionsError(
            f"the answer describes another type: {description['type_description']['type_name'][:100]}"
        )
    sources = {one.type_name: (one.encoding, one.raw_file_contents) for one in told.type_sources}
    registry = registry_from_descriptions(name, individual_descriptions(description), sources)
    if registry.type_hash(type_name) != rihs01(description):
        raise NodeDefinitionsError("the answer describes types that do not belong to it")
    return collect_with_dependencies(registry, registry.owner(name) or name)


def _of_class(type_name: str, cls: type[Any]) -> DefinitionSet:
    """Facts of the class of a service or action, whose constants nobody told."""
    name = split_ros_name(type_name)
    individuals = individual_descriptions(type_description(cls))
    return collect_with_dependencies(
        registry_from_descriptions(name, individuals, {}, is_service=name.kind == "srv"), name
    )
