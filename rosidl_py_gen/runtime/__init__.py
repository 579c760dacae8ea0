"""ROS 2 nodes in Python: topics, services, graph, QoS, clocks and timers over Cyclone DDS.

Everything is imported when it is first used; Cyclone DDS itself only when a context without transport is opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.client import Client, WouldDeadlockError
    from rosidl_py_gen.runtime.clock import Clock, ClockChange, ClockType, Duration, Time, TimeJump
    from rosidl_py_gen.runtime.context import Context
    from rosidl_py_gen.runtime.graph import EndpointType, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.memory import MemoryTransport
    from rosidl_py_gen.runtime.node import Node
    from rosidl_py_gen.runtime.publisher import Publisher
    from rosidl_py_gen.runtime.qos import (
        Compatibility,
        Durability,
        History,
        InvalidQoSError,
        Liveliness,
        QoSProfile,
        Reliability,
        check_compatible,
    )
    from rosidl_py_gen.runtime.request import CallTimeoutError, ForeignServiceError
    from rosidl_py_gen.runtime.runner import run, spin
    from rosidl_py_gen.runtime.scope import WaitTimeoutError
    from rosidl_py_gen.runtime.service import ServiceRequest, ServiceServer
    from rosidl_py_gen.runtime.subscription import MessageInfo, Subscription
    from rosidl_py_gen.runtime.timer import Timer
    from rosidl_py_gen.runtime.transport import BackendMissingError, TransportError

_HOMES = {
    "client": ("Client", "WouldDeadlockError"),
    "clock": ("Clock", "ClockChange", "ClockType", "Duration", "Time", "TimeJump"),
    "context": ("Context",),
    "graph": ("EndpointType", "NodeInfo", "TopicEndpointInfo"),
    "memory": ("MemoryTransport",),
    "node": ("Node",),
    "publisher": ("Publisher",),
    "qos": (
        "Compatibility",
        "Durability",
        "History",
        "InvalidQoSError",
        "Liveliness",
        "QoSProfile",
        "Reliability",
        "check_compatible",
    ),
    "request": ("CallTimeoutError", "ForeignServiceError"),
    "runner": ("run", "spin"),
    "scope": ("WaitTimeoutError",),
    "service": ("ServiceRequest", "ServiceServer"),
    "subscription": ("MessageInfo", "Subscription"),
    "timer": ("Timer",),
    "transport": ("BackendMissingError", "TransportError"),
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "BackendMissingError",
    "CallTimeoutError",
    "Client",
    "Clock",
    "ClockChange",
    "ClockType",
    "Compatibility",
    "Context",
    "Durability",
    "Duration",
    "EndpointType",
    "ForeignServiceError",
    "History",
    "InvalidQoSError",
    "Liveliness",
    "MemoryTransport",
    "MessageInfo",
    "Node",
    "NodeInfo",
    "Publisher",
    "QoSProfile",
    "Reliability",
    "ServiceRequest",
    "ServiceServer",
    "Subscription",
    "Time",
    "TimeJump",
    "Timer",
    "TopicEndpointInfo",
    "TransportError",
    "WaitTimeoutError",
    "WouldDeadlockError",
    "check_compatible",
    "run",
    "spin",
]


def __getattr__(name: str) -> object:
    module = _MODULE_OF.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(f"{__name__}.{module}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
