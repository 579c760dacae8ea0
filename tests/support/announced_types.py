"""Types that exist only as announcements of nodes; a class with the same hash in this process would be used instead."""

from __future__ import annotations

import itertools
from copy import copy
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen import from_dict
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import SourceText
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.msgs.type_description_interfaces.msg import TypeDescription, TypeSource
from rosidl_py_gen.msgs.type_description_interfaces.srv import (
    GetTypeDescription,
    GetTypeDescription_Request,
    GetTypeDescription_Response,
)
from rosidl_py_gen.runtime.transport.dds import discovery_info
from rosidl_py_gen.runtime.transport.dds.names import wire_type
from support import raw_endpoints
from support.raw_endpoints import topic_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import Node
    from support.worlds import World

SERVICE_OFF = {"start_type_description_service": False}
_numbers = itertools.count()


class Told:
    """Names, hashes and descriptions of a definition, without a class."""

    def __init__(self, name: str, text: str, **others: str) -> None:
        self.name, self.text = name, text
        self.library = InterfaceRegistry(SearchPath.scan((), ament=""))
        for full_name, body in {name: text, **others}.items():
            part = RosName.parse(full_name)
            self.library.add_text(part, SourceText(full_name, body, part.kind))

    @property
    def hash(self) -> str:
        return self.library.type_hash(self.name)

    def answer(self, name: str = "", *, sources: bool = True) -> GetTypeDescription_Response:
        told = from_dict(TypeDescription, self.library.type_description(name or self.name))
        kind = self.name.split("/")[1]
        source = TypeSource(type_name=self.name, encoding=kind, raw_file_contents=self.text)
        return GetTypeDescription_Response(
            successful=True, type_description=told, type_sources=[source] if sources and not name else []
        )

    def announce(self, node: Node, topic: str, part: str = "", announced: str | None = None) -> None:
        """Announce a writer, or the reader of requests, that carries the type or a derived type."""
        name = self.name + part
        told = self.library.type_hash(name) if announced is None else announced
        raw_endpoints.announce(node, topic, wire_type(name), told, is_writer="Request" not in part)

    def __call__(self, request: GetTypeDescription_Request) -> GetTypeDescription_Response:
        for name in (self.name, *self.library.all_hashes(self.name)):
            if request.type_hash == self.library.type_hash(name):
                return self.answer("" if name == self.name else name)
        return GetTypeDescription_Response(failure_reason="Type not currently in use by this node")


def without_hash(cls: Any) -> Any:
    """Return a class that a publisher of Humble would have: it announces no hash."""
    info = copy(cls._TYPE)
    info.hash = ""
    return type("NoHash", (cls,), {"__slots__": (), "_TYPE": info})


def humble_node(world: World, name: str) -> Node:
    """Return a node that announces itself like one of Humble, on DDS."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DISTRO", "humble")
        patch.setattr(discovery_info, "HASHES", dict.fromkeys(discovery_info.HASHES, ""))
        return world.node(name)


def fresh(text: str = "int32 x 5\nstring LABEL=deep", kind: str = "msg", **others: str) -> Told:
    """Return a type with a new name, as compiled classes are never freed."""
    return Told(f"nowhere_msgs/{kind}/Kind{next(_numbers)}", text, **others)


def teller(world: World, name: str, answer: Callable[[Any], Any] | None) -> Node:
    """Return a node whose type description service is replaced, or that has no such service."""
    node = world.node(name, parameter_overrides=SERVICE_OFF)
    if answer is not None:
        node.create_service(GetTypeDescription, "~/get_type_description", answer)
    return node


def told_by(world: World, told: Told, topic: str = "/t", answer: Callable[[Any], Any] | None = None) -> Node:
    node = teller(world, "robot", answer or told)
    told.announce(node, topic_name(topic))
    return node
