"""Classes by their full names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosidl_parser.definition import NamespacedType

from rosidl_runtime_py.import_message import import_message_from_namespaced_type


def get_interface(identifier: str) -> Any:
    """The class of a message, service or action such as ``std_msgs/msg/String``."""
    return import_message_from_namespaced_type(get_namespaced_type(identifier))


def get_message(identifier: str) -> Any:
    """The class of a message; ``std_msgs/String`` will do. ValueError if it is none."""
    return _required(identifier, get_message_namespaced_type(identifier), is_message, "a message")


def get_service(identifier: str) -> Any:
    """The class of a service; ``std_srvs/SetBool`` will do. ValueError if it is none."""
    return _required(identifier, get_service_namespaced_type(identifier), is_service, "a service")


def get_action(identifier: str) -> Any:
    """The class of an action; ``example_interfaces/Fibonacci`` will do. ValueError if it is none."""
    return _required(identifier, get_action_namespaced_type(identifier), is_action, "an action")


def get_namespaced_type(identifier: str) -> Any:
    """A full name in the words of `rosidl_parser`."""
    return _namespaced(identifier, None)


def get_message_namespaced_type(identifier: str) -> Any:
    """The same for a message, whose ``msg`` may be left out."""
    return _namespaced(identifier, "msg")


def get_service_namespaced_type(identifier: str) -> Any:
    """The same for a service, whose ``srv`` may be left out."""
    return _namespaced(identifier, "srv")


def get_action_namespaced_type(identifier: str) -> Any:
    """The same for an action, whose ``action`` may be left out."""
    return _namespaced(identifier, "action")


def is_message(interface: Any) -> bool:
    """Whether it is the class of a message."""
    return hasattr(interface, "SLOT_TYPES")


def is_service(interface: Any) -> bool:
    """Whether it is the class of a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    """Whether it is the class of an action."""
    return all(hasattr(interface, name) for name in ("Goal", "Result", "Feedback"))


def _required(identifier: str, named: Any, is_wanted: Callable[[Any], bool], wanted: str) -> Any:
    interface = import_message_from_namespaced_type(named)
    if not is_wanted(interface):
        raise ValueError(f"Expected the full name of {wanted}, got '{identifier}'")
    return interface


def _namespaced(identifier: str, kind: str | None) -> Any:
    *namespaces, name = identifier.split("/")
    if len(namespaces) == 1 and kind is not None:
        namespaces.append(kind)
    return NamespacedType(namespaces, name)
