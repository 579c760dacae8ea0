"""Checks of parameter declarations and of values against descriptors, with rclpy's texts."""

import warnings
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

from rclpy.parameter import Parameter
from rclpy.validate_parameter_name import validate_parameter_name
from rosidl_py_gen.runtime import _rclpy_support as rules

_NAME_ONLY = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated; pass a default "
    "value, a Parameter.Type, or a descriptor with dynamic_typing=True"
)


def refusal_reason(parameter: Parameter, descriptor: Any, *, is_declared: bool, check_read_only: bool) -> str:
    """Return the reason why a value is refused, or an empty string. A dynamic descriptor takes the value's type."""
    if check_read_only and descriptor.read_only:
        return rules.read_only_reason(parameter.name)
    is_set = parameter.type_ is not Parameter.Type.NOT_SET
    if descriptor.dynamic_typing:
        descriptor.type = parameter.type_.value
    elif is_declared and not is_set:
        return rules.UNDECLARED_REASON
    elif is_set and parameter.type_.value != descriptor.type:
        return rules.type_reason(Parameter.Type(descriptor.type).name, parameter.type_.name)
    if parameter.type_ is Parameter.Type.INTEGER and descriptor.integer_range:
        return rules.integer_range_reason(parameter.name, parameter.value, descriptor.integer_range[0])
    if parameter.type_ is Parameter.Type.DOUBLE and descriptor.floating_point_range:
        return rules.float_range_reason(parameter.name, parameter.value, descriptor.floating_point_range[0])
    return ""


def read_declaration(namespace: str, index: int, declaration: tuple[Any, ...]) -> tuple[str, Any, Any]:
    """Return name, value and completed descriptor of a tuple for `Node.declare_parameters`."""
    if not 1 <= len(declaration) <= 3:
        raise TypeError(
            f"Invalid parameter tuple length at index {index} in parameters list: {declaration}; "
            "expecting length between 1 and 3"
        )
    name, value, descriptor = (*declaration, None, None)[:3]
    if not isinstance(name, str):
        raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
    name = f"{namespace}.{name}" if namespace else name
    validate_parameter_name(name)
    descriptor = ParameterDescriptor() if len(declaration) < 3 else descriptor
    if not isinstance(descriptor, ParameterDescriptor):
        text = f"Third element {descriptor} at index {index} in parameters list is not a ParameterDescriptor."
        raise TypeError(text)
    if len(declaration) == 1:
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


def to_rclpy_value(value: Any) -> Any:
    """Return an initial value with arrays as lists, and bytes (``!!binary``) as a list of single bytes."""
    items = [bytes([byte]) for byte in value] if isinstance(value, bytes) else value
    return list(items) if isinstance(items, (tuple, list)) else items
