"""How parameters are declared, and whether a descriptor lets one have a value. Texts are rclpy's: programs show."""

from __future__ import annotations

import math
import warnings
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

from rclpy.parameter import Parameter
from rclpy.validate_parameter_name import validate_parameter_name

_NAME_ONLY = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated; pass a default "
    "value, a Parameter.Type, or a descriptor with dynamic_typing=True"
)

PARAM_REL_TOL = 1e-6
"""How far a DOUBLE may be off a step or a limit, in proportion."""


def refusal(parameter: Parameter, descriptor: Any, *, is_declared: bool, check_read_only: bool) -> str:
    """Why not; empty when it may. A descriptor of dynamic type takes over the type."""
    if check_read_only and descriptor.read_only:
        return f"Trying to set a read-only parameter: {parameter.name}."
    is_set = parameter.type_ is not Parameter.Type.NOT_SET
    if descriptor.dynamic_typing:
        descriptor.type = parameter.type_.value
    elif is_declared and not is_set:
        return "Static parameter cannot be undeclared"
    elif is_set and parameter.type_.value != descriptor.type:
        return f"Wrong parameter type, expected '{Parameter.Type(descriptor.type)}' got '{parameter.type_}'"
    if parameter.type_ is Parameter.Type.INTEGER and descriptor.integer_range:
        return _out_of_integers(parameter, descriptor.integer_range[0])
    if parameter.type_ is Parameter.Type.DOUBLE and descriptor.floating_point_range:
        return _out_of_numbers(parameter, descriptor.floating_point_range[0])
    return ""


def _limits(given: Any) -> tuple[Any, Any]:
    return min(given.from_value, given.to_value), max(given.from_value, given.to_value)


def _out_of_integers(parameter: Parameter, given: Any) -> str:
    least, most = _limits(given)
    value = parameter.value
    if value in (least, most):  # also where that is no step
        return ""
    if not least < value < most:
        return f"Parameter {parameter.name} out of range. Min: {least}, Max: {most}, value: {value}"
    if given.step != 0 and (value - least) % given.step != 0:
        return (
            f"The parameter value for {parameter.name} is not a valid step. "
            f"Min: {least}, max: {most}, value: {value}, step: {given.step}"
        )
    return ""


def _out_of_numbers(parameter: Parameter, given: Any) -> str:
    least, most = _limits(given)
    value = parameter.value
    if any(math.isclose(value, limit, rel_tol=PARAM_REL_TOL) for limit in (least, most)):
        return ""
    if not least < value < most:
        return f"Parameter {parameter.name} out of range Min: {least}, Max: {most}, value: {value}"
    steps = (value - least) / given.step if given.step != 0.0 else math.inf
    if math.isfinite(steps):  # else no step counts
        nearest = least + round(steps) * given.step
        if not math.isclose(nearest, value, rel_tol=PARAM_REL_TOL):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {least}, max: {most}, value: {value}, step: {given.step}"
            )
    return ""


def read_declaration(namespace: str, index: int, given: tuple[Any, ...]) -> tuple[str, Any, Any]:
    """Name, value and completed descriptor of a tuple that `Node.declare_parameters` was given, and which."""
    if not 1 <= len(given) <= 3:
        raise TypeError(
            f"Invalid parameter tuple length at index {index} in parameters list: {given}; "
            "expecting length between 1 and 3"
        )
    name, value, descriptor = (*given, None, None)[:3]
    if not isinstance(name, str):
        raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
    name = f"{namespace}.{name}" if namespace else name
    validate_parameter_name(name)
    descriptor = ParameterDescriptor() if len(given) < 3 else descriptor
    if not isinstance(descriptor, ParameterDescriptor):
        text = f"Third element {descriptor} at index {index} in parameters list is not a ParameterDescriptor."
        raise TypeError(text)
    if len(given) == 1:
        warnings.warn(_NAME_ONLY.format(name), stacklevel=5)
        descriptor.dynamic_typing = True
    if isinstance(value, Parameter.Type):
        if value is Parameter.Type.NOT_SET:
            raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
        if descriptor.dynamic_typing:
            raise ValueError(
                f"When declaring parameter {{{name}}} passing a descriptor with"
                "`dynamic_typing=True` is not allowed when the parameter type is provided"
            )
        descriptor.type = value.value
        return name, None, descriptor
    if not descriptor.dynamic_typing:
        is_message = isinstance(value, ParameterValue)
        descriptor.type = value.type if is_message else Parameter.Type.from_parameter_value(value).value
        if descriptor.type == Parameter.Type.NOT_SET.value:
            text = "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET"
            raise ValueError(text)
    return name, value, descriptor


def initial_value(value: Any) -> Any:
    """Return an initial value as rclpy has it: arrays are lists, those of bytes (``!!binary``) of single ones."""
    items = [bytes([one]) for one in value] if isinstance(value, bytes) else value
    return list(items) if isinstance(items, (tuple, list)) else items
