"""Validation of names, descriptors and values of parameters, and listings of names; pure functions.

`…_reason` functions return the reason against a value, or an empty text. Reasons against setting a value are sent to
other nodes, and equal rclpy literally. Source: docs/internals/protocol.md 9.3, 9.4.
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
"""Relative distance at which a double counts as equal to a limit or a step."""
UNDECLARED_REASON = "Static parameter cannot be undeclared"
EMPTY_LIST_REASON = (
    "parameter list cannot be empty, this might be due to "
    "pre_set_parameters_callback modifying the original parameters list."
)


def refusal_reason(parameter: Parameter, descriptor: ParameterDescriptor, *, declaring: bool = False) -> str:
    """Return the reason why a value does not fit a descriptor. A read-only parameter may be declared."""
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
    """Return the reason against setting a parameter that is read-only."""
    return f"Trying to set a read-only parameter: {name}."


def type_reason(expected: str, found: str) -> str:
    """Return the reason against a value of another type."""
    return f"Wrong parameter type, expected 'Type.{expected}' got 'Type.{found}'"


class _Range(Protocol[NumberT]):
    """Range of this package, or of rcl_interfaces."""

    @property
    def from_value(self) -> NumberT: ...
    @property
    def to_value(self) -> NumberT: ...
    @property
    def step(self) -> NumberT: ...


def integer_range_reason(name: str, value: int, allowed: _Range[int]) -> str:
    """Return a reason unless the value is an end of the range, or inside it on a step from the lower end."""
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
    """Return a reason if a double is outside of its range, with a tolerance of 1e-6 at the ends and steps.

    All values are on a step if steps cannot be counted: they are too small, or the range has no lower end.
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
    """Return the reason why a parameter cannot have this name."""
    if isinstance(name, str) and name and (name.isascii() or name.encode("utf-8", "ignore").decode() == name):
        return ""
    return f"the name of a parameter must be a str that is not empty, got {name!r}"


def range_reason(allowed: FloatRange | IntRange | None) -> str:
    """Return the reason why a range is invalid or cannot be sent."""
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
    """Select the names for prefixes and a depth, of which 0 is unlimited; docs/internals/protocol.md 9.3."""
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
    """Return the descriptor with the name of its parameter; raises `TypeError`, `InvalidParameterValueError`."""
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
    """Return the descriptor of a declaration; if it has no type, it gets the type of the default."""
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
    the type of the parameter. Raises as `checked_descriptor`.
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
