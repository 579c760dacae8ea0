"""What a declaration, or a new descriptor, makes of a value and a descriptor; pure functions.

Decides which of them has the type, and what is refused before anybody is asked (docs/internals/protocol.md 9.3).
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
    """The descriptor, with the name of its parameter.

    Raises:
        TypeError: it is none, or a field of it has the wrong type. InvalidParameterValueError: a range makes no sense.
    """
    if reason := descriptor_reason(descriptor):
        raise TypeError(f"parameter {name!r}: {reason}")
    if reason := range_reason(descriptor.floating_point_range) or range_reason(descriptor.integer_range):
        raise InvalidParameterValueError(f"parameter {name!r}: {reason}")
    return replace(descriptor, name=name)


def declared_descriptor(name: str, default: ParameterValue, given: ParameterDescriptor | None) -> ParameterDescriptor:
    """What is declared: the type is the descriptor's when it has one, else the default's.

    Raises:
        WrongParameterTypeError: the default has another one. InvalidParameterValueError: there is none, and no dynamic
            typing. TypeError.
    """
    descriptor = checked_descriptor(name, ParameterDescriptor() if given is None else given)
    default = coerce_empty_list(default, descriptor)
    if descriptor.dynamic_typing:
        return descriptor
    kind = default.type if descriptor.type is ParameterType.NOT_SET else descriptor.type
    if kind is ParameterType.NOT_SET:
        raise InvalidParameterValueError(
            f"parameter {name!r} has no default, so its type is unknown; give a default, a type, or a descriptor "
            "with dynamic_typing"
        )
    if default.is_set and default.type is not kind:
        raise WrongParameterTypeError(name, kind.name, default.type.name)
    return replace(descriptor, type=kind)


def redescribed(
    before: ParameterDescriptor, value: ParameterValue, given: ParameterDescriptor, alternative: ParameterValue
) -> tuple[ParameterDescriptor, Parameter, str]:
    """A parameter under another descriptor: what is declared then, with which value, and why that cannot be.

    The value is kept where it fits, and replaced by the alternative, if there is one, where it does not. A descriptor
    without type keeps that of the parameter. Raises as `checked_descriptor`.
    """
    descriptor = checked_descriptor(before.name, given)
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


def coerce_empty_list(value: ParameterValue, described: ParameterDescriptor) -> ParameterValue:
    """An empty list from YAML or Python says nothing about its type; let it be what was declared."""
    if described.type.is_array and value.type.is_array and not value.value:
        return parameter_value((), described.type)
    return value
