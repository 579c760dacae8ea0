"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers over Cyclone DDS.

Everything is imported when it is first used; Cyclone DDS itself only when a context without transport is opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.action_client import ActionClient
    from rosidl_py_gen.runtime.action_goal import GoalDecision, ServerGoal
    from rosidl_py_gen.runtime.action_handle import (
        ActionServerLost,
        ActionTimeoutError,
        AlreadyTerminated,
        CancelRejected,
        ClientGoal,
        GoalRejected,
        UnknownGoal,
    )
    from rosidl_py_gen.runtime.action_server import ActionServer
    from rosidl_py_gen.runtime.client import Client, WouldDeadlockError
    from rosidl_py_gen.runtime.clock import Clock, ClockChange, ClockType, Duration, Time, TimeJump
    from rosidl_py_gen.runtime.clock_sleep import Rate
    from rosidl_py_gen.runtime.context import Context
    from rosidl_py_gen.runtime.goal import GoalStatus
    from rosidl_py_gen.runtime.graph import EndpointType, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.introspection import IntrospectionState
    from rosidl_py_gen.runtime.lifecycle_node import LifecycleNode
    from rosidl_py_gen.runtime.lifecycle_rule import Outcome, State, TransitionError
    from rosidl_py_gen.runtime.memory import MemoryTransport
    from rosidl_py_gen.runtime.node import Node
    from rosidl_py_gen.runtime.parameter_classes import snapshot, update_parameters
    from rosidl_py_gen.runtime.parameter_fields import (
        Int8,
        Int16,
        Int32,
        Int64,
        Range,
        ReadOnly,
        UInt8,
        UInt16,
        UInt32,
        UInt64,
    )
    from rosidl_py_gen.runtime.parameter_values import (
        InvalidParameterValue,
        ParameterDescriptor,
        ParameterNotDeclared,
        ParameterType,
        WrongParameterType,
    )
    from rosidl_py_gen.runtime.parameters import SetResult
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
    "action_client": ("ActionClient",),
    "action_goal": ("GoalDecision", "ServerGoal"),
    "action_handle": (
        "ActionServerLost",
        "ActionTimeoutError",
        "AlreadyTerminated",
        "CancelRejected",
        "ClientGoal",
        "GoalRejected",
        "UnknownGoal",
    ),
    "action_server": ("ActionServer",),
    "clock_sleep": ("Rate",),
    "goal": ("GoalStatus",),
    "introspection": ("IntrospectionState",),
    "lifecycle_node": ("LifecycleNode",),
    "lifecycle_rule": ("Outcome", "State", "TransitionError"),
    "parameter_classes": ("snapshot", "update_parameters"),
    "parameter_fields": ("Int8", "Int16", "Int32", "Int64", "Range", "ReadOnly", "UInt8", "UInt16", "UInt32", "UInt64"),
    "parameter_values": (
        "InvalidParameterValue",
        "ParameterDescriptor",
        "ParameterNotDeclared",
        "ParameterType",
        "WrongParameterType",
    ),
    "parameters": ("SetResult",),
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
    "ActionClient",
    "ActionServer",
    "ActionServerLost",
    "ActionTimeoutError",
    "AlreadyTerminated",
    "BackendMissingError",
    "CallTimeoutError",
    "CancelRejected",
    "Client",
    "ClientGoal",
    "Clock",
    "ClockChange",
    "ClockType",
    "Compatibility",
    "Context",
    "Durability",
    "Duration",
    "EndpointType",
    "ForeignServiceError",
    "GoalDecision",
    "GoalRejected",
    "GoalStatus",
    "History",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "IntrospectionState",
    "InvalidParameterValue",
    "InvalidQoSError",
    "LifecycleNode",
    "Liveliness",
    "MemoryTransport",
    "MessageInfo",
    "Node",
    "NodeInfo",
    "Outcome",
    "ParameterDescriptor",
    "ParameterNotDeclared",
    "ParameterType",
    "Publisher",
    "QoSProfile",
    "Range",
    "Rate",
    "ReadOnly",
    "Reliability",
    "ServerGoal",
    "ServiceRequest",
    "ServiceServer",
    "SetResult",
    "State",
    "Subscription",
    "Time",
    "TimeJump",
    "Timer",
    "TopicEndpointInfo",
    "TransitionError",
    "TransportError",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
    "UnknownGoal",
    "WaitTimeoutError",
    "WouldDeadlockError",
    "WrongParameterType",
    "check_compatible",
    "run",
    "snapshot",
    "spin",
    "update_parameters",
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
