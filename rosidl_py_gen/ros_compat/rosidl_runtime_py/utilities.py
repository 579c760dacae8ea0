"""Import of the classes of messages, services and actions by their full names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosidl_parser.definition import NamespacedType

from rosidl_runtime_py.import_message import import_message_from_namespaced_type


def get_interface(identifier: str) -> Any:
    """Return the class of a message, service or action such as ``std_msgs/msg/String``."""
    return import_message_from_namespaced_type(get_namespaced_type(identifier))


def get_message(identifier: str) -> Any:
    """Return the class of a message by its name, ``std_msgs/msg/String`` or ``std_msgs/String``.

    Raises:
        ValueError: the name is not the name of a message.
    """
    return _import_interface(identifier, get_message_namespaced_type(identifier), is_message, "a message")


def get_service(identifier: str) -> Any:
    """Return the class of a service by its name, ``std_srvs/srv/SetBool`` or ``std_srvs/SetBool``.

    Raises:
        ValueError: the name is not the name of a service.
    """
    return _import_interface(identifier, get_service_namespaced_type(identifier), is_service, "a service")


def get_action(identifier: str) -> Any:
    """Return the class of an action by its name, ``example_interfaces/action/Fibonacci`` or without ``action``.

    Raises:
        ValueError: the name is not the name of an action.
    """
    return _import_interface(identifier, get_action_namespaced_type(identifier), is_action, "an action")


def get_namespaced_type(identifier: str) -> Any:
    """Return the `NamespacedType` of `rosidl_parser` for a full name such as ``std_msgs/msg/String``."""
    return _to_namespaced_type(identifier, None)


def get_message_namespaced_type(identifier: str) -> Any:
    """Return the `NamespacedType` for the name of a message, also for a name without ``msg``."""
    return _to_namespaced_type(identifier, "msg")


def get_service_namespaced_type(identifier: str) -> Any:
    """Return the `NamespacedType` for the name of a service, also for a name without ``srv``."""
    return _to_namespaced_type(identifier, "srv")


def get_action_namespaced_type(identifier: str) -> Any:
    """Return the `NamespacedType` for the name of an action, also for a name without ``action``."""
    return _to_namespaced_type(identifier, "action")


def is_message(interface: Any) -> bool:
    return hasattr(interface, "SLOT_TYPES")


def is_service(interface: Any) -> bool:
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    return all(hasattr(interface, name) for name in ("Goal", "Result", "Feedback"))


def _import_interface(identifier: str, type_: Any, is_expected: Callable[[Any], bool], kind: str) -> Any:
    interface = import_message_from_namespaced_type(type_)
    if not is_expected(interface):
        raise ValueError(f"Expected the full name of {kind}, got '{identifier}'")
    return interface


def _to_namespaced_type(identifier: str, kind: str | None) -> Any:
    *namespaces, name = identifier.split("/")
    if len(namespaces) == 1 and kind is not None:
        namespaces.append(kind)
    return NamespacedType(namespaces, name)
