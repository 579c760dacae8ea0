"""Message and service types whose modules are imported with their first message.

Every node announces the parameter services and few nodes use them, but importing their messages would take longer than
all other steps of a node's start. Names and hashes come from a table that is generated with the bundled packages.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.entities.message_types import MessageType, ServiceType, message_type, service_type

if TYPE_CHECKING:
    from collections.abc import Callable


def lazy_service_type(name: str) -> ServiceType[Any, Any]:
    """Return the type that `service_type` returns for a service of the bundled packages."""
    load = cache(lambda: service_type(_bundled_class(name)))
    request = _lazy_type(f"{name}_Request", lambda: load().request)
    return ServiceType(name, HASHES[name], request, _lazy_type(f"{name}_Response", lambda: load().response))


def lazy_message_type(name: str) -> MessageType[Any]:
    """Return the type that `message_type` returns for a message of the bundled packages."""
    return _lazy_type(name, cache(lambda: message_type(_bundled_class(name))))


def _lazy_type(name: str, load: Callable[[], MessageType[Any]]) -> MessageType[Any]:
    return MessageType(name, HASHES[name], lambda value: load().encode(value), lambda data: load().decode(data))


def _bundled_class(name: str) -> Any:
    package, kind, stem = name.split("/")
    return getattr(import_module(f"rosidl_py_gen.msgs.{package}.{kind}"), stem)
