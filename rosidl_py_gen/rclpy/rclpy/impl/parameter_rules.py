"""Whether a descriptor lets a parameter have a value. Texts are rclpy's: programs and tools show them."""

from __future__ import annotations

import math
from typing import Any

from rclpy.parameter import Parameter

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
    if given.step != 0.0:
        nearest = least + round((value - least) / given.step) * given.step
        if not math.isclose(nearest, value, rel_tol=PARAM_REL_TOL):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {least}, max: {most}, value: {value}, step: {given.step}"
            )
    return ""
