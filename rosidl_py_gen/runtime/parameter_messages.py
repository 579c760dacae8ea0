"""Parameter values, descriptors and events to and from rcl_interfaces messages.

Decides nothing but the mapping of fields (protocol.md 9.2). A message from a peer may hold anything: a type number that
does not exist is NOT_SET.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.msgs.rcl_interfaces import msg
from rosidl_py_gen.runtime.parameter_values import (
    FloatRange,
    IntRange,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
)
from rosidl_py_gen.runtime.parameters import ParameterEvent, SetResult

if TYPE_CHECKING:
    from collections.abc import Iterable

_MEMBERS = {
    ParameterType.BOOL: "bool_value",
    ParameterType.INTEGER: "integer_value",
    ParameterType.DOUBLE: "double_value",
    ParameterType.STRING: "string_value",
    ParameterType.BYTE_ARRAY: "byte_array_value",
    ParameterType.BOOL_ARRAY: "bool_array_value",
    ParameterType.INTEGER_ARRAY: "integer_array_value",
    ParameterType.DOUBLE_ARRAY: "double_array_value",
    ParameterType.STRING_ARRAY: "string_array_value",
}


def parameter_type(number: int) -> ParameterType:
    """NOT_SET for numbers that do not exist."""
    return ParameterType(number) if 0 <= number <= ParameterType.STRING_ARRAY else ParameterType.NOT_SET


def value_to_message(value: ParameterValue) -> msg.ParameterValue:
    """The member that `type` selects is set, the others keep their defaults."""
    message = msg.ParameterValue(type=int(value.type))
    member = _MEMBERS.get(value.type)
    if member is not None:
        content: Any = value.value
        if isinstance(content, bytes):
            content = np.frombuffer(content, np.uint8)
        elif isinstance(content, tuple):
            content = list(content)
        setattr(message, member, content)
    return message


def value_from_message(message: msg.ParameterValue) -> ParameterValue:
    """The reverse of `value_to_message`."""
    kind = parameter_type(message.type)
    if kind is ParameterType.NOT_SET:
        return ParameterValue()
    content: Any = getattr(message, _MEMBERS[kind])
    if kind is ParameterType.BYTE_ARRAY:
        content = bytes(content)
    elif kind.is_array:
        content = tuple(content.tolist() if isinstance(content, np.ndarray) else content)
    return ParameterValue(kind, content)


def to_message(parameter: Parameter) -> msg.Parameter:
    """Name and value."""
    return msg.Parameter(name=parameter.name, value=value_to_message(parameter.value))


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
    message = msg.ParameterEvent(
        node=node,
        new_parameters=[to_message(p) for p in event.new],
        changed_parameters=[to_message(p) for p in event.changed],
        deleted_parameters=[to_message(p) for p in event.deleted],
    )
    message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


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
    """Success and reason."""
    return msg.SetParametersResult(successful=result.successful, reason=result.reason)


def result_from_message(message: msg.SetParametersResult) -> SetResult:
    """Success and reason."""
    return SetResult(message.successful, message.reason)
