"""Parameter values, descriptors and events to and from rcl_interfaces messages.

Decides nothing but the mapping of fields (docs/internals/protocol.md 9.2). A message from a peer may hold anything: a
type number that does not exist is NOT_SET where a node tells of itself, and refused where it asks for something.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces import msg
from rosidl_py_gen.runtime.parameters.store import ParameterEvent, SetResult
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

_KINDS = tuple(ParameterType)
_UNSET = ParameterValue()
# What the members hold that do not count: empty, so that messages may share them.
_NOTHING = (0, False, 0, 0.0, "", *(np.zeros(0, kind) for kind in (np.uint8, np.bool_, np.int64, np.float64)))
_SCALARS = ("bool", "integer", "double", "string")
_MEMBERS = ("", *(f"{name}_value" for name in (*_SCALARS, "byte_array", *(f"{name}_array" for name in _SCALARS))))
"""Which member a type selects, in the order of the type numbers."""
_BYTE_ARRAY = 5


def parameter_type(number: int) -> ParameterType:
    """NOT_SET for numbers that do not exist."""
    return _KINDS[number] if 0 <= number < len(_KINDS) else ParameterType.NOT_SET


def value_to_message(value: ParameterValue) -> msg.ParameterValue:
    """The member that `type` selects is set, the others keep their defaults."""
    number = int(value.type)
    members: list[Any] = [*_NOTHING, []]
    members[0] = number
    if number:
        content: Any = value.value
        if isinstance(content, bytes):
            content = np.frombuffer(content, np.uint8)
        elif isinstance(content, tuple):
            content = list(content)
        members[number] = content  # members and type numbers have the same order
    return msg.ParameterValue(*members)


def value_from_message(message: msg.ParameterValue) -> ParameterValue:
    """The reverse of `value_to_message`."""
    number = message.type
    if not 0 < number < len(_KINDS):
        return _UNSET
    content = getattr(message, _MEMBERS[number])
    if number >= _BYTE_ARRAY:
        plain = content.tolist() if isinstance(content, np.ndarray) else content
        content = bytes(plain) if number == _BYTE_ARRAY else tuple(plain)
    return ParameterValue(_KINDS[number], content)


def to_message(parameter: Parameter) -> msg.Parameter:
    """Name and value."""
    return msg.Parameter(parameter.name, value_to_message(parameter.value))


def requested_parameter(message: msg.Parameter) -> Parameter:
    """What a peer wants to set; raises `InvalidParameterValueError` for a type number that does not exist.

    rclpy and rclcpp raise an error for one, which ends the server; nor can it mean NOT_SET, which would undeclare.
    """
    number = message.value.type
    if number >= len(_KINDS):
        raise InvalidParameterValueError(f"parameter {message.name!r} cannot be set: {number} is no parameter type")
    return from_message(message)


def from_message(message: msg.Parameter) -> Parameter:
    """Name and value."""
    return Parameter(message.name, value_from_message(message.value))


def descriptor_to_message(descriptor: ParameterDescriptor) -> msg.ParameterDescriptor:
    """A range becomes a list of one element."""
    floats, ints = descriptor.floating_point_range, descriptor.integer_range
    return msg.ParameterDescriptor(
        name=descriptor.name,
        type=int(descriptor.type),
        description=descriptor.description,
        additional_constraints=descriptor.additional_constraints,
        read_only=descriptor.read_only,
        dynamic_typing=descriptor.dynamic_typing,
        floating_point_range=[]
        if floats is None
        else [
            msg.FloatingPointRange(from_value=floats.from_value, to_value=floats.to_value, step=floats.step),
        ],
        integer_range=[]
        if ints is None
        else [msg.IntegerRange(from_value=ints.from_value, to_value=ints.to_value, step=ints.step)],
    )


def descriptor_from_message(message: msg.ParameterDescriptor) -> ParameterDescriptor:
    """The reverse of `descriptor_to_message`."""
    floats = [FloatRange(r.from_value, r.to_value, r.step) for r in message.floating_point_range]
    ints = [IntRange(r.from_value, r.to_value, r.step) for r in message.integer_range]
    return ParameterDescriptor(
        message.name,
        parameter_type(message.type),
        message.description,
        message.additional_constraints,
        message.read_only,
        message.dynamic_typing,
        floats[0] if floats else None,
        ints[0] if ints else None,
    )


def event_to_message(event: ParameterEvent, node: str, stamp_ns: int) -> msg.ParameterEvent:
    """`node` is the fully qualified name."""
    sec, nanosec = sec_nanosec(stamp_ns)
    return msg.ParameterEvent(
        stamp=Time(sec=sec, nanosec=nanosec),
        node=node,
        new_parameters=[to_message(p) for p in event.new],
        changed_parameters=[to_message(p) for p in event.changed],
        deleted_parameters=[to_message(p) for p in event.deleted],
    )


def event_from_message(message: msg.ParameterEvent) -> ParameterEvent:
    """The reverse of `event_to_message`, without node and stamp."""

    def parameters(found: Iterable[msg.Parameter]) -> tuple[Parameter, ...]:
        return tuple(from_message(item) for item in found)

    return ParameterEvent(
        parameters(message.new_parameters),
        parameters(message.changed_parameters),
        parameters(message.deleted_parameters),
    )


def result_to_message(result: SetResult) -> msg.SetParametersResult:
    """Success and reason; what cannot be sent of the reason becomes ``?``."""
    reason = result.reason
    if not reason.isascii():
        reason = reason.encode("utf-8", "replace").decode()
    return msg.SetParametersResult(successful=result.successful, reason=reason)


def result_from_message(message: msg.SetParametersResult) -> SetResult:
    """Success and reason."""
    return SetResult(message.successful, message.reason)
