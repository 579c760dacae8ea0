"""Conversion of messages of one class to another, by a migration plan.

No value changes silently: a value that does not fit raises `EncodeError` with the path of the field, here or when the
message is encoded. The only exception is float64 to float32, which is rounded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.compiler.compatibility.migration import ConversionKind
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.compiler.compatibility.migration import FieldConversion, Plans

    Converter = Callable[[Any], Any]


def fields_of(cls: type[Message]) -> dict[str, list[tuple[str, FieldType]]]:
    """Return the fields of a message and of all types in it, as input of `plan`."""
    classes: dict[str, Any] = referenced_classes(cls)
    return {name: [(one.ros_name, one.type) for one in planned._TYPE.fields] for name, planned in classes.items()}


def message_converter(plans: Plans, old: type[Message], new: type[Message]) -> Callable[[Any], Any]:
    """Return a function that converts messages of the old class to the new one, or raises `EncodeError`."""
    makers: dict[tuple[str, str], Converter] = {}
    old_classes, new_classes = referenced_classes(old), referenced_classes(new)

    def maker(pair: tuple[str, str]) -> Converter:
        if pair not in makers:
            makers[pair] = _maker(pair)
        return makers[pair]

    def converter_of(step: FieldConversion, path: str) -> Converter | None:
        return None if step.kind is ConversionKind.MESSAGE and is_same(step) else _field_converter(step, path, maker)

    def is_same(step: FieldConversion) -> bool:
        pair = step.old_type.base, step.new_type.base
        nested = (field for field in plans[pair].steps if field.kind is ConversionKind.MESSAGE)
        same_class = old_classes[pair[0]] is new_classes[pair[1]]
        return same_class and not plans[pair].is_conversion and all(map(is_same, nested))

    def _maker(pair: tuple[str, str]) -> Converter:
        old_class: Any = old_classes[pair[0]]
        cls: Any = new_classes[pair[1]]
        old_fields = {field.ros_name: field for field in old_class._TYPE.fields}
        new_fields = {field.ros_name: field for field in cls._TYPE.fields}
        steps = [
            (old_fields[step.old], new_fields[step.new], converter_of(step, f"{pair[1]}.{step.new}"))
            for step in plans[pair].steps
        ]

        def convert(message: Any) -> Any:
            converted = cls()
            for source, target, converter in steps:
                value = message._get_plain(source)
                converted._set_plain(target, value if converter is None else converter(value))
            return converted

        return convert

    return maker((old._TYPE.name, new._TYPE.name))


def _field_converter(
    step: FieldConversion, path: str, maker: Callable[[tuple[str, str]], Converter]
) -> Converter | None:
    """Return a converter, None if the value is copied; array sizes are checked when the message is encoded."""
    is_scalar = step.new_type.arity is Arity.SCALAR
    match step.kind:
        case ConversionKind.COPY:
            return None
        case ConversionKind.MESSAGE:
            field = maker((step.old_type.base, step.new_type.base))
            return field if is_scalar else lambda values: [field(value) for value in values]
        case ConversionKind.NUMBER:
            assert step.new_type.primitive is not None
            primitive = step.new_type.primitive
            if is_scalar:
                return _scalar(primitive.python, path)
            return _array(np.dtype(primitive.numpy), primitive.code, path)


def _scalar(kind: str, path: str) -> Converter:
    if kind == "int":  # its range is looked at when it is encoded
        return int

    def real(value: Any) -> float:
        array = float(value)
        if isinstance(value, int) and array != value:
            raise EncodeError(path, f"{value} cannot be represented exactly as a float")
        return array

    return real


def _array(dtype: np.dtype[Any], code: str, path: str) -> Converter:
    def convert(values: Any) -> Any:
        array = np.asarray(values)
        if not array.size:
            return array.astype(dtype)
        if code in INTEGER_RANGES:
            low, high = INTEGER_RANGES[code]
            if int(array.min()) < low or int(array.max()) > high:
                raise EncodeError(path, f"expected {low} to {high}, found {int(array.min())} to {int(array.max())}")
            return array.astype(dtype)
        with np.errstate(over="ignore", invalid="ignore"):
            converted = array.astype(dtype)
            if array.dtype.kind == "f":
                is_right = np.isinf(converted) == np.isinf(array)
            else:
                # As Python's numbers where they are large: numpy would compare both as floating point.
                is_right = converted.astype(object) == array.astype(object) if array.dtype.itemsize > 2 else True
        if not np.all(is_right):
            raise EncodeError(path, f"has values that {dtype} cannot represent")
        return converted

    return convert
