"""Type and value of a parameter after a declaration or a change of its descriptor; pure functions.

Source: docs/internals/protocol.md 9.3.
"""

from __future__ import annotations

from dataclasses import replace

from rosidl_py_gen.runtime.parameters.validation import descriptor_reason, range_reason, refusal_reason
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    WrongParameterTypeError,
    parameter_value,
    widened,
)


def checked_descriptor(name: str, descriptor: ParameterDescriptor) -> ParameterDescriptor:
    """Return the descriptor with the name of its parameter.

    Raises:
        TypeError: it is not a descriptor, or one of its fields has the wrong type.
        InvalidParameterValueError: a range is invalid.
    """
    if reason := descriptor_reason(descriptor):
        raise TypeError(f"parameter {name!r}: {reason}")
    if reason := range_reason(descriptor.floating_point_range) or range_reason(descriptor.integer_range):
        raise InvalidParameterValueError(f"parameter {name!r}: {reason}")
    return replace(descriptor, name=name)


def declared_descriptor(
    name: str, default: ParameterValue, descriptor: ParameterDescriptor | None
) -> ParameterDescriptor:
    """Return the descriptor of a declaration, with its type or else that of the default.

    Raises:
        WrongParameterTypeError: the default has another type.
        InvalidParameterValueError: the type is unknown and not dynamic, or as `checked_descriptor`.
        TypeError: as `checked_descriptor`.
    """
    descriptor = checked_descriptor(name, descriptor or ParameterDescriptor())
    default = coerce_empty_list(default, descriptor)
    if descriptor.dynamic_typing:
        return descriptor
    kind = default.type if descriptor.type is ParameterType.NOT_SET else descriptor.type
    if kind is ParameterType.NOT_SET:
        raise InvalidParameterValueError(
            f"parameter {name!r} has no type; pass a default, or a descriptor with a type or with dynamic_typing"
        )
    if default.is_set and default.type is not kind:
        raise WrongParameterTypeError(name, kind.name, default.type.name)
    return replace(descriptor, type=kind)


def apply_descriptor(
    before: ParameterDescriptor, value: ParameterValue, descriptor: ParameterDescriptor, alternative: ParameterValue
) -> tuple[ParameterDescriptor, Parameter, str]:
    """Apply another descriptor; return the descriptor, the parameter, and the reason why that is impossible.

    The value is retained if it fits, else replaced by the alternative, if that is set. A descriptor without a type gets
    that of the parameter. Raises as `checked_descriptor`.
    """
    descriptor = checked_descriptor(before.name, descriptor)
    if descriptor.type is ParameterType.NOT_SET and not descriptor.dynamic_typing:
        descriptor = replace(descriptor, type=before.type)
    parameter = Parameter(before.name, coerce_empty_list(value, descriptor))
    reason = refusal_reason(parameter, descriptor, declaring=True)
    if reason and alternative.is_set:
        value = coerce_empty_list(alternative, descriptor)
        value = value if descriptor.dynamic_typing else widened(value, descriptor.type)
        parameter = Parameter(before.name, value)
        reason = refusal_reason(parameter, descriptor, declaring=True)
    if descriptor.dynamic_typing:
        descriptor = replace(descriptor, type=parameter.value.type)
    return descriptor, parameter, reason


def coerce_empty_list(value: ParameterValue, descriptor: ParameterDescriptor) -> ParameterValue:
    """Convert an empty list, whose type is unknown in YAML and Python, to the declared array type."""
    if descriptor.type.is_array and value.type.is_array and not value.value:
        return parameter_value((), descriptor.type)
    return value
