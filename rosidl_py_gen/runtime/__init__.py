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
    from rosidl_py_gen.runtime.actions.checks import ActionArgumentError
    from rosidl_py_gen.runtime.actions.client import ActionClient
    from rosidl_py_gen.runtime.actions.client_goal import (
        ActionServerLostError,
        ActionTimeoutError,
        AlreadyTerminatedError,
        CancelError,
        CancelRejectedError,
        ClientGoal,
        GoalRejectedError,
    )
    from rosidl_py_gen.runtime.actions.decisions import CancelRequest, GoalRequest
    from rosidl_py_gen.runtime.actions.server import ActionServer
    from rosidl_py_gen.runtime.actions.server_goal import Finished, ServerGoal
    from rosidl_py_gen.runtime.actions.states import (
        ActionError,
        GoalDecision,
        GoalStatus,
        GoalTransitionError,
        UnknownGoalError,
    )
    from rosidl_py_gen.runtime.endpoints.client import Client, WouldDeadlockError
    from rosidl_py_gen.runtime.endpoints.header import CallTimeoutError, ForeignServiceError, IntrospectionState
    from rosidl_py_gen.runtime.endpoints.publisher import Publisher
    from rosidl_py_gen.runtime.endpoints.server import AlreadyRespondedError, ServiceRequest, ServiceServer
    from rosidl_py_gen.runtime.endpoints.subscription import CallbackInUseError, MessageInfo, Subscription
    from rosidl_py_gen.runtime.endpoints.timer import Timer
    from rosidl_py_gen.runtime.graph.state import EndpointType, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.lifecycle.node import LifecycleNode
    from rosidl_py_gen.runtime.lifecycle.states import Outcome, State, TransitionError
    from rosidl_py_gen.runtime.logs.file import LogFileError
    from rosidl_py_gen.runtime.logs.loggers import LogLevelError
    from rosidl_py_gen.runtime.loop.bridge import LoopMismatchError
    from rosidl_py_gen.runtime.names.remap import InvalidRemapRuleError
    from rosidl_py_gen.runtime.node.arguments import RosArgumentError
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.node.environment import EnvironmentSettingError
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.node.type_description import TypeDescriptionError
    from rosidl_py_gen.runtime.parameters.callbacks import CallbackAnswerError
    from rosidl_py_gen.runtime.parameters.classes import snapshot, update_parameters
    from rosidl_py_gen.runtime.parameters.client import MalformedAnswerError
    from rosidl_py_gen.runtime.parameters.fields import (
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
    from rosidl_py_gen.runtime.parameters.overrides import ParameterFileError
    from rosidl_py_gen.runtime.parameters.values import (
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
    from rosidl_py_gen.runtime.runner import run, spin
    from rosidl_py_gen.runtime.time.clock import Clock, ClockChange, ClockType, Duration, JumpHandle, Time, TimeJump
    from rosidl_py_gen.runtime.time.deadline import WaitTimeoutError
    from rosidl_py_gen.runtime.time.sleep import Rate
    from rosidl_py_gen.runtime.time.values import ClockTypeError, TimeRangeError
    from rosidl_py_gen.runtime.transport.interface import BackendMissingError, TransportError
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport
    from rosidl_py_gen.runtime.transport.qos import (
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

_HOMES = {
    ".errors": ("ClosedError", "DecodeError", "EncodeError", "InvalidNameError", "RosidlError", "TypeNotFoundError"),
    "actions.checks": ("ActionArgumentError",),
    "actions.client": ("ActionClient",),
    "actions.decisions": ("CancelRequest", "GoalRequest"),
    "actions.server_goal": ("Finished", "ServerGoal"),
    "actions.client_goal": (
        "ActionServerLostError",
        "ActionTimeoutError",
        "AlreadyTerminatedError",
        "CancelError",
        "CancelRejectedError",
        "ClientGoal",
        "GoalRejectedError",
    ),
    "actions.server": ("ActionServer",),
    "node.arguments": ("RosArgumentError",),
    "loop.bridge": ("LoopMismatchError",),
    "endpoints.client": ("Client", "WouldDeadlockError"),
    "time.clock": ("Clock", "ClockChange", "ClockType", "Duration", "JumpHandle", "Time", "TimeJump"),
    "time.sleep": ("Rate",),
    "node.context": ("Context",),
    "node.environment": ("EnvironmentSettingError",),
    "actions.states": ("ActionError", "GoalDecision", "GoalStatus", "GoalTransitionError", "UnknownGoalError"),
    "graph.state": ("EndpointType", "NodeInfo", "TopicEndpointInfo"),
    "lifecycle.node": ("LifecycleNode",),
    "lifecycle.states": ("Outcome", "State", "TransitionError"),
    "logs.file": ("LogFileError",),
    "logs.loggers": ("LogLevelError",),
    "transport.memory": ("MemoryTransport",),
    "node.node": ("Node",),
    "parameters.callbacks": ("CallbackAnswerError",),
    "parameters.classes": ("snapshot", "update_parameters"),
    "parameters.client": ("MalformedAnswerError",),
    "parameters.fields": (
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
    "parameters.overrides": ("ParameterFileError",),
    "parameters.values": (
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
    "endpoints.publisher": ("Publisher",),
    "transport.qos": (
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
    "names.remap": ("InvalidRemapRuleError",),
    "endpoints.header": ("CallTimeoutError", "ForeignServiceError", "IntrospectionState"),
    "runner": ("run", "spin"),
    "time.deadline": ("WaitTimeoutError",),
    "endpoints.server": ("AlreadyRespondedError", "ServiceRequest", "ServiceServer"),
    "endpoints.subscription": ("CallbackInUseError", "MessageInfo", "Subscription"),
    "time.values": ("ClockTypeError", "TimeRangeError"),
    "endpoints.timer": ("Timer",),
    "transport.interface": ("BackendMissingError", "TransportError"),
    "node.type_description": ("TypeDescriptionError",),
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
