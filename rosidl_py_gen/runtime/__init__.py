"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers over Cyclone DDS.

Everything is imported when it is first used; Cyclone DDS itself only when a context without transport is opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.errors import (
        ClosedError,
        DecodeError,
        EncodeError,
        InvalidNameError,
        RosidlError,
        TypeNotFoundError,
    )
    from rosidl_py_gen.runtime.action_checks import ActionArgumentError
    from rosidl_py_gen.runtime.action_client import ActionClient
    from rosidl_py_gen.runtime.action_goal import (
        CancelRequest,
        Finished,
        GoalDecision,
        GoalRequest,
        ServerGoal,
    )
    from rosidl_py_gen.runtime.action_handle import (
        ActionServerLostError,
        ActionTimeoutError,
        AlreadyTerminatedError,
        CancelError,
        CancelRejectedError,
        ClientGoal,
        GoalRejectedError,
    )
    from rosidl_py_gen.runtime.action_server import ActionServer
    from rosidl_py_gen.runtime.arguments import RosArgumentError
    from rosidl_py_gen.runtime.bridge import LoopMismatchError
    from rosidl_py_gen.runtime.client import Client, WouldDeadlockError
    from rosidl_py_gen.runtime.clock import Clock, ClockChange, ClockType, Duration, JumpHandle, Time, TimeJump
    from rosidl_py_gen.runtime.clock_sleep import Rate
    from rosidl_py_gen.runtime.context import Context
    from rosidl_py_gen.runtime.environment import EnvironmentSettingError
    from rosidl_py_gen.runtime.goal import ActionError, GoalStatus, GoalTransitionError, UnknownGoalError
    from rosidl_py_gen.runtime.graph import EndpointType, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.introspection import IntrospectionState
    from rosidl_py_gen.runtime.lifecycle_node import LifecycleNode
    from rosidl_py_gen.runtime.lifecycle_rule import Outcome, State, TransitionError
    from rosidl_py_gen.runtime.log_file import LogFileError
    from rosidl_py_gen.runtime.logging import LogLevelError
    from rosidl_py_gen.runtime.memory import MemoryTransport
    from rosidl_py_gen.runtime.node import Node
    from rosidl_py_gen.runtime.parameter_callbacks import CallbackAnswerError
    from rosidl_py_gen.runtime.parameter_classes import snapshot, update_parameters
    from rosidl_py_gen.runtime.parameter_client import MalformedAnswerError
    from rosidl_py_gen.runtime.parameter_fields import (
        Int8,
        Int16,
        Int32,
        Int64,
        ParameterClassError,
        Range,
        ReadOnly,
        UInt8,
        UInt16,
        UInt32,
        UInt64,
    )
    from rosidl_py_gen.runtime.parameter_overrides import ParameterFileError
    from rosidl_py_gen.runtime.parameter_values import (
        FloatRange,
        IntRange,
        InvalidParameterName,
        InvalidParameterValue,
        Parameter,
        ParameterAlreadyDeclared,
        ParameterDescriptor,
        ParameterError,
        ParameterImmutable,
        ParameterNotDeclared,
        ParameterType,
        ParameterUninitialized,
        ParameterValue,
        SetResult,
        WrongParameterType,
        parameter_value,
    )
    from rosidl_py_gen.runtime.publisher import Publisher
    from rosidl_py_gen.runtime.qos import (
        Compatibility,
        CompatibilityResult,
        Durability,
        History,
        InvalidQoSError,
        Liveliness,
        QoSProfile,
        Reliability,
        check_compatible,
    )
    from rosidl_py_gen.runtime.remap_rules import InvalidRemapRuleError
    from rosidl_py_gen.runtime.request import CallTimeoutError, ForeignServiceError
    from rosidl_py_gen.runtime.runner import run, spin
    from rosidl_py_gen.runtime.scope import WaitTimeoutError
    from rosidl_py_gen.runtime.service import AlreadyRespondedError, ServiceRequest, ServiceServer
    from rosidl_py_gen.runtime.subscription import CallbackInUseError, MessageInfo, Subscription
    from rosidl_py_gen.runtime.time_values import ClockTypeError, TimeRangeError
    from rosidl_py_gen.runtime.timer import Timer
    from rosidl_py_gen.runtime.transport import BackendMissingError, TransportError
    from rosidl_py_gen.runtime.type_description_service import TypeDescriptionError

_HOMES = {
    ".errors": ("ClosedError", "DecodeError", "EncodeError", "InvalidNameError", "RosidlError", "TypeNotFoundError"),
    "action_checks": ("ActionArgumentError",),
    "action_client": ("ActionClient",),
    "action_goal": (
        "CancelRequest",
        "Finished",
        "GoalDecision",
        "GoalRequest",
        "ServerGoal",
    ),
    "action_handle": (
        "ActionServerLostError",
        "ActionTimeoutError",
        "AlreadyTerminatedError",
        "CancelError",
        "CancelRejectedError",
        "ClientGoal",
        "GoalRejectedError",
    ),
    "action_server": ("ActionServer",),
    "arguments": ("RosArgumentError",),
    "bridge": ("LoopMismatchError",),
    "client": ("Client", "WouldDeadlockError"),
    "clock": ("Clock", "ClockChange", "ClockType", "Duration", "JumpHandle", "Time", "TimeJump"),
    "clock_sleep": ("Rate",),
    "context": ("Context",),
    "environment": ("EnvironmentSettingError",),
    "goal": ("ActionError", "GoalStatus", "GoalTransitionError", "UnknownGoalError"),
    "graph": ("EndpointType", "NodeInfo", "TopicEndpointInfo"),
    "introspection": ("IntrospectionState",),
    "lifecycle_node": ("LifecycleNode",),
    "lifecycle_rule": ("Outcome", "State", "TransitionError"),
    "log_file": ("LogFileError",),
    "logging": ("LogLevelError",),
    "memory": ("MemoryTransport",),
    "node": ("Node",),
    "parameter_callbacks": ("CallbackAnswerError",),
    "parameter_classes": ("snapshot", "update_parameters"),
    "parameter_client": ("MalformedAnswerError",),
    "parameter_fields": (
        "Int16",
        "Int32",
        "Int64",
        "Int8",
        "ParameterClassError",
        "Range",
        "ReadOnly",
        "UInt16",
        "UInt32",
        "UInt64",
        "UInt8",
    ),
    "parameter_overrides": ("ParameterFileError",),
    "parameter_values": (
        "FloatRange",
        "IntRange",
        "InvalidParameterName",
        "InvalidParameterValue",
        "Parameter",
        "ParameterAlreadyDeclared",
        "ParameterDescriptor",
        "ParameterError",
        "ParameterImmutable",
        "ParameterNotDeclared",
        "ParameterType",
        "ParameterUninitialized",
        "ParameterValue",
        "SetResult",
        "WrongParameterType",
        "parameter_value",
    ),
    "publisher": ("Publisher",),
    "qos": (
        "Compatibility",
        "CompatibilityResult",
        "Durability",
        "History",
        "InvalidQoSError",
        "Liveliness",
        "QoSProfile",
        "Reliability",
        "check_compatible",
    ),
    "remap_rules": ("InvalidRemapRuleError",),
    "request": ("CallTimeoutError", "ForeignServiceError"),
    "runner": ("run", "spin"),
    "scope": ("WaitTimeoutError",),
    "service": ("AlreadyRespondedError", "ServiceRequest", "ServiceServer"),
    "subscription": ("CallbackInUseError", "MessageInfo", "Subscription"),
    "time_values": ("ClockTypeError", "TimeRangeError"),
    "timer": ("Timer",),
    "transport": ("BackendMissingError", "TransportError"),
    "type_description_service": ("TypeDescriptionError",),
}
"""Module -> what it exports; what begins with a dot stands beside this package."""
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ActionArgumentError",
    "ActionClient",
    "ActionError",
    "ActionServer",
    "ActionServerLostError",
    "ActionTimeoutError",
    "AlreadyRespondedError",
    "AlreadyTerminatedError",
    "BackendMissingError",
    "CallTimeoutError",
    "CallbackAnswerError",
    "CallbackInUseError",
    "CancelError",
    "CancelRejectedError",
    "CancelRequest",
    "Client",
    "ClientGoal",
    "Clock",
    "ClockChange",
    "ClockType",
    "ClockTypeError",
    "ClosedError",
    "Compatibility",
    "CompatibilityResult",
    "Context",
    "DecodeError",
    "Durability",
    "Duration",
    "EncodeError",
    "EndpointType",
    "EnvironmentSettingError",
    "Finished",
    "FloatRange",
    "ForeignServiceError",
    "GoalDecision",
    "GoalRejectedError",
    "GoalRequest",
    "GoalStatus",
    "GoalTransitionError",
    "History",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "IntRange",
    "IntrospectionState",
    "InvalidNameError",
    "InvalidParameterName",
    "InvalidParameterValue",
    "InvalidQoSError",
    "InvalidRemapRuleError",
    "JumpHandle",
    "LifecycleNode",
    "Liveliness",
    "LogFileError",
    "LogLevelError",
    "LoopMismatchError",
    "MalformedAnswerError",
    "MemoryTransport",
    "MessageInfo",
    "Node",
    "NodeInfo",
    "Outcome",
    "Parameter",
    "ParameterAlreadyDeclared",
    "ParameterClassError",
    "ParameterDescriptor",
    "ParameterError",
    "ParameterFileError",
    "ParameterImmutable",
    "ParameterNotDeclared",
    "ParameterType",
    "ParameterUninitialized",
    "ParameterValue",
    "Publisher",
    "QoSProfile",
    "Range",
    "Rate",
    "ReadOnly",
    "Reliability",
    "RosArgumentError",
    "RosidlError",
    "ServerGoal",
    "ServiceRequest",
    "ServiceServer",
    "SetResult",
    "State",
    "Subscription",
    "Time",
    "TimeJump",
    "TimeRangeError",
    "Timer",
    "TopicEndpointInfo",
    "TransitionError",
    "TransportError",
    "TypeDescriptionError",
    "TypeNotFoundError",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
    "UnknownGoalError",
    "WaitTimeoutError",
    "WouldDeadlockError",
    "WrongParameterType",
    "check_compatible",
    "parameter_value",
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

    value: object = getattr(import_module(f".{module}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
