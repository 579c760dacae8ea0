"""Types that every node announces and few nodes ever use: known by name and hash, imported with their first message.

Importing the messages of the parameter services takes longer than everything else in the start of a node. Decides
nothing; the hashes are a table that is generated with the bundled packages.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.entities.message_types import MessageType, ServiceType, message_type, service_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.samples import Payload


def late_service_type(name: str) -> ServiceType[Any, Any]:
    """A service of the bundled packages, as `service_type` would give it."""

    @cache
    def known() -> ServiceType[Any, Any]:
        return service_type(_bundled(name))

    return ServiceType(
        name,
        HASHES[name],
        _late(f"{name}_Request", lambda: known().request),
        _late(f"{name}_Response", lambda: known().response),
    )


def lazy_message_type(name: str) -> MessageType[Any]:
    """A message of the bundled packages, as `message_type` would give it."""

    @cache
    def known() -> MessageType[Any]:
        return message_type(_bundled(name))

    return _late(name, known)


def _late(name: str, known: Callable[[], MessageType[Any]]) -> MessageType[Any]:
    def encode(value: Any) -> bytes:
        return known().encode(value)

    def decode(data: Payload) -> Any:
        return known().decode(data)

    return MessageType(name, HASHES[name], encode, decode)


def _bundled(name: str) -> Any:
    package, kind, stem = name.split("/")
    return getattr(import_module(f"rosidl_py_gen.msgs.{package}.{kind}"), stem)
