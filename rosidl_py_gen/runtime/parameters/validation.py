"""Validation of names, descriptors and values of parameters, and listings of names; functions without side effects.

Functions with names ``…_reason`` return the reason against a value, or "". Reasons against setting a value are sent to
other nodes, and equal the texts of rclpy literally. Source: docs/internals/protocol.md 9.3, 9.4.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, get_type_hints

from rosidl_py_gen.runtime.parameters.values import (
    INT64_MAX,
    INT64_MIN,
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    WrongParameterTypeError,
    parameter_value,
    widened,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

NumberT = TypeVar("NumberT", int, float, covariant=True)

SEPARATOR = "."
DEPTH_RECURSIVE = 0
RELATIVE_TOLERANCE = 1e-6
"""Relative distance up to which a double counts as equal to an end or step of a range."""
UNDECLARED_REASON = "Static parameter cannot be undeclared"
EMPTY_LIST_REASON = (
    "parameter list cannot be empty, this might be due to "
    "pre_set_parameters_callback modifying the original parameters list."
)


def refusal_reason(parameter: Parameter, descriptor: ParameterDescriptor, *, declaring: bool = False) -> str:
    """Return the reason why a parameter cannot be set, by its descriptor; "" if it can.

    Args:
        parameter: name and new value.
        descriptor: declared type, range and others.
        declaring: the value is of a declaration, so a read-only parameter may be set, and may have no value.
    """
    name, value = parameter.name, parameter.value
    if descriptor.read_only and not declaring:
        return read_only_reason(name)
    if not descriptor.dynamic_typing and descriptor.type is not ParameterType.NOT_SET:
        if not value.is_set:
            return "" if declaring else UNDECLARED_REASON
        if value.type is not descriptor.type:
            return type_reason(descriptor.type.name, value.type.name)
    if value.type is ParameterType.INTEGER and descriptor.integer_range is not None:
        assert isinstance(value.value, int)
        return integer_range_reason(name, value.value, descriptor.integer_range)
    if value.type is ParameterType.DOUBLE and descriptor.floating_point_range is not None:
        assert isinstance(value.value, float)
        return float_range_reason(name, value.value, descriptor.floating_point_range)
    return ""


def read_only_reason(name: str) -> str:
    """Return the reason for refusing to set a read-only parameter, with the text of rclpy."""
    return f"Trying to set a read-only parameter: {name}."


def type_reason(expected: str, found: str) -> str:
    """Return the reason for refusing a value of another type, with the text of rclpy."""
    return f"Wrong parameter type, expected 'Type.{expected}' got 'Type.{found}'"


class _Range(Protocol[NumberT]):
    """Type of a range of numbers: a class of this package, or a message of rcl_interfaces."""

    @property
    def from_value(self) -> NumberT: ...
    @property
    def to_value(self) -> NumberT: ...
    @property
    def step(self) -> NumberT: ...


def integer_range_reason(name: str, value: int, allowed: _Range[int]) -> str:
    """Return the reason why an integer is not in a range; "" if it is an end of the range, or a step inside it."""
    low, high = min(allowed.from_value, allowed.to_value), max(allowed.from_value, allowed.to_value)
    if value in (low, high):
        return ""
    if not low < value < high:
        return f"Parameter {name} out of range. Min: {low}, Max: {high}, value: {value}"
    if allowed.step != 0 and (value - low) % allowed.step != 0:
        return (
            f"The parameter value for {name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return ""


def float_range_reason(name: str, value: float, allowed: _Range[float]) -> str:
    """Return the reason why a double is not in a range.

    Returns "" if it is in the range, with a tolerance of 1e-6 at the ends and steps. If steps cannot be counted,
    because they are too small or the range has no lower end, every value counts as being on a step.
    """
    low, high = min(allowed.from_value, allowed.to_value), max(allowed.from_value, allowed.to_value)
    if any(math.isclose(value, end, rel_tol=RELATIVE_TOLERANCE) for end in (low, high)):
        return ""
    if not low < value < high:
        return f"Parameter {name} out of range Min: {low}, Max: {high}, value: {value}"
    steps = (value - low) / allowed.step if allowed.step != 0.0 else math.inf
    if math.isfinite(steps):
        nearest = low + round(steps) * allowed.step
        if not math.isclose(nearest, value, rel_tol=RELATIVE_TOLERANCE):
            return (
                f"The parameter value for {name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return ""


def name_reason(name: object) -> str:
    """Return the reason why a parameter cannot have a name; "" if it can."""
    if isinstance(name, str) and name and (name.isascii() or name.encode("utf-8", "ignore").decode() == name):
        return ""
    return f"the name of a parameter must be a str that is not empty, got {name!r}"


def range_reason(allowed: FloatRange | IntRange | None) -> str:
    """Return the reason why the range of a descriptor is invalid or cannot be sent; "" if it is valid or None."""
    if allowed is None:
        return ""
    numbers = (allowed.from_value, allowed.to_value, allowed.step)
    if isinstance(allowed, IntRange):
        fits = all(isinstance(number, int) and INT64_MIN <= number <= INT64_MAX for number in numbers)
        if not fits or allowed.step < 0:
            return f"{allowed!r} must have 64-bit integers and a step >= 0"
        return ""
    if not all(isinstance(number, (int, float)) and _fits_float(number) for number in numbers):
        return f"{allowed!r} must have numbers as its ends and step"
    if allowed.step != 0 and (math.isinf(min(allowed.from_value, allowed.to_value)) or math.isinf(allowed.step)):
        return f"{allowed!r} has a step, so its step and lower end must be finite"
    return ""


def _fits_float(number: float) -> bool:
    try:
        return not math.isnan(number)
    except OverflowError:
        return False


@dataclass(frozen=True, slots=True)
class ListParametersResult:
    """Names of parameters in the order of declaration, and their groups."""

    names: tuple[str, ...]
    prefixes: tuple[str, ...]


def list_names(names: Iterable[str], prefixes: Sequence[str], depth: int) -> ListParametersResult:
    """Return the names, with their groups, that a list_parameters request selects (docs/internals/protocol.md 9.3).

    Args:
        names: names of all parameters.
        prefixes: groups whose parameters are selected; empty: all parameters.
        depth: maximum number of parts of a name below the prefix; 0 is unlimited.
    """
    selected = tuple(name for name in names if _is_listed(name, prefixes, depth))
    groups = dict.fromkeys(name.rpartition(SEPARATOR)[0] for name in selected if SEPARATOR in name)
    return ListParametersResult(selected, tuple(groups))


def _is_listed(name: str, prefixes: Sequence[str], depth: int) -> bool:
    if not prefixes:
        return depth == DEPTH_RECURSIVE or name.count(SEPARATOR) < depth
    for prefix in prefixes:
        if name == prefix:
            return True
        if name.startswith(prefix + SEPARATOR):
            rest = name[len(prefix) + 1 :]
            if depth == DEPTH_RECURSIVE or rest.count(SEPARATOR) < depth:
                return True
    return False


@functools.cache
def _descriptor_types() -> dict[str, Any]:
    return get_type_hints(ParameterDescriptor)


def checked_descriptor(name: str, descriptor: ParameterDescriptor) -> ParameterDescriptor:
    """Return the descriptor of a parameter with the parameter's name in it.

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid.
    """
    if not isinstance(descriptor, ParameterDescriptor):
        raise TypeError(f"parameter {name!r}: the descriptor must be a ParameterDescriptor, got {descriptor!r}")
    for attribute, kind in _descriptor_types().items():
        value = getattr(descriptor, attribute)
        if not isinstance(value, kind):
            expected = ParameterDescriptor.__annotations__[attribute]
            raise TypeError(f"parameter {name!r}: {attribute} of the descriptor must be a {expected}, got {value!r}")
    if reason := range_reason(descriptor.floating_point_range) or range_reason(descriptor.integer_range):
        raise InvalidParameterValueError(f"parameter {name!r}: {reason}")
    return replace(descriptor, name=name)


def declared_descriptor(
    name: str, default: ParameterValue, descriptor: ParameterDescriptor | None
) -> ParameterDescriptor:
    """Return the descriptor of a declared parameter; if it has no type, it gets the type of the default.

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid, or there is no type.
        WrongParameterTypeError: the default has another type than the descriptor.
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
    """Apply a new descriptor to a parameter, without storing anything.

    The value is retained if it fits, else replaced by the alternative, if there is one. A descriptor without a type
    gets the type of the parameter.

    Args:
        before: current descriptor.
        value: current value.
        descriptor: new descriptor.
        alternative: new value if the current value does not fit; NOT_SET if there is none.

    Returns:
        new descriptor, parameter with its new value, and the reason why they do not fit, or "".

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid.
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
    """Return an empty list, whose element type is unknown in YAML and Python, as the declared array type.

    Other values are returned unchanged.
    """
    if descriptor.type.is_array and value.type.is_array and not value.value:
        return parameter_value((), descriptor.type)
    return value
