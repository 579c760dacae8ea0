"""Values carried over from messages of one class to those of another, by a plan.

Decides that no value becomes another one in silence: what does not fit is an `EncodeError` with the field's path, here
or when the message is encoded. The only exception is float64 to float32, which is rounded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity
from rosidl_py_gen.cdr.typesupport import referenced_classes
from rosidl_py_gen.compiler.compatibility.migration import ConversionKind
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.compiler.compatibility.migration import FieldConversion, Plans

    Converter = Callable[[Any], Any]


def message_converter(plans: Plans, old: type[Message], new: type[Message]) -> Callable[[Any], Any]:
    """A function that makes a message of the new class of one of the old class; it raises `EncodeError`."""
    makers: dict[tuple[str, str], Converter] = {}
    old_classes, new_classes = referenced_classes(old), referenced_classes(new)

    def maker(pair: tuple[str, str]) -> Converter:
        """Of a nested pair; types do not contain themselves, so that this ends."""
        if pair not in makers:
            makers[pair] = _maker(pair)
        return makers[pair]

    def carry_of(step: FieldConversion, path: str) -> Converter | None:
        return None if step.way is ConversionKind.MESSAGE and is_same(step) else _field_converter(step, path, maker)

    def is_same(step: FieldConversion) -> bool:
        """Whether messages stay what they are, down to the last one."""
        pair = step.old_type.base, step.new_type.base
        nested = (one for one in plans[pair].steps if one.way is ConversionKind.MESSAGE)
        same_class = old_classes[pair[0]] is new_classes[pair[1]]
        return same_class and not plans[pair].is_conversion and all(map(is_same, nested))

    def _maker(pair: tuple[str, str]) -> Converter:
        then: Any = old_classes[pair[0]]
        cls: Any = new_classes[pair[1]]
        then_names = {one.ros_name: one.py_name for one in then._TYPE.fields}
        now_names = {one.ros_name: one.py_name for one in cls._TYPE.fields}
        steps = [
            (then_names[step.old], now_names[step.new], carry_of(step, f"{pair[1]}.{step.new}"))
            for step in plans[pair].steps
        ]

        def carried(message: Any) -> Any:
            made = cls()
            for source, target, carry in steps:
                value = getattr(message, source)
                setattr(made, target, value if carry is None else carry(value))
            return made

        return carried

    return maker((old._TYPE.name, new._TYPE.name))


def _field_converter(
    step: FieldConversion, path: str, maker: Callable[[tuple[str, str]], Converter]
) -> Converter | None:
    """None where the value is taken as it is; how many there may be is found out when the message is encoded."""
    is_scalar = step.new_type.arity is Arity.SCALAR
    match step.way:
        case ConversionKind.COPY:
            return None
        case ConversionKind.MESSAGE:
            one = maker((step.old_type.base, step.new_type.base))
            return one if is_scalar else lambda values: [one(value) for value in values]
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
        found = float(value)
        if isinstance(value, int) and found != value:
            raise EncodeError(path, f"{value} is no floating point number")
        return found

    return real


def _array(dtype: np.dtype[Any], code: str, path: str) -> Converter:
    def carried(values: Any) -> Any:
        found = np.asarray(values)
        if not found.size:
            return found.astype(dtype)
        if code in INTEGER_RANGES:
            low, high = INTEGER_RANGES[code]
            if int(found.min()) < low or int(found.max()) > high:
                raise EncodeError(path, f"expected {low} to {high}, found {int(found.min())} to {int(found.max())}")
            return found.astype(dtype)
        with np.errstate(over="ignore", invalid="ignore"):
            made = found.astype(dtype)
            if found.dtype.kind == "f":
                is_right = np.isinf(made) == np.isinf(found)
            else:
                # As Python's numbers where they are large: numpy would compare both as floating point.
                is_right = made.astype(object) == found.astype(object) if found.dtype.itemsize > 2 else True
        if not np.all(is_right):
            raise EncodeError(path, f"has values that are no {dtype} numbers")
        return made

    return carried
