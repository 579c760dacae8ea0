"""What rclpy's setters check when ROS_PYTHON_CHECK_FIELDS is 1, in their words.

They look at less than encoding does, and at other things: an int is no float, a set may be a sequence.
"""

from __future__ import annotations

import math
from array import array
from collections import UserList, UserString
from collections.abc import Sequence, Set
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity
from rosidl_py_gen.cdr.arrays import DTYPES

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.cdr.message import Field

_MOST = {"f": 3.402823466e38, "d": 1.7976931348623157e308}
_NOUNS = {"f": "float", "d": "double"}


def check(field: Field, value: Any) -> bool:
    """Check a value that is about to be assigned.

    Returns:
        Whether it is stored as it is, because it is an array of the right type.

    Raises:
        AssertionError: it does not fit; the text is that of rclpy.
    """
    kind = field.type
    if kind.arity is Arity.SCALAR:
        _check_scalar(field, value)
        return True
    return _is_right_array(field, value) or _check_many(field, value)


def _refuse(ok: bool, text: str) -> None:
    if not ok:
        raise AssertionError(text)


def _check_scalar(field: Field, value: Any) -> None:
    name, kind = field.py_name, field.type
    if field.cls is not None:
        cls = field.cls
        _refuse(isinstance(value, cls), f"The '{name}' field must be a sub message of type '{cls.__name__}'")
    elif kind.string_bound:
        text = f"The '{name}' field must be string value not longer than {kind.string_bound}"
        _refuse(isinstance(value, (str, UserString)) and len(value) <= kind.string_bound, text)
    elif kind.base == "byte":
        text = f"The '{name}' field must be of type 'bytes' or 'ByteString' with length 1"
        _refuse(isinstance(value, (bytes, bytearray)) and len(value) == 1, text)
    else:
        python = _python(field)
        _refuse(isinstance(value, python), f"The '{name}' field must be of type '{python.__name__}'")
        code = _code(kind)
        if code and code != "?":
            _refuse(_in_range(value, code), f"The '{name}' field must be {_range_of(code)}")


def _range_of(code: str) -> str:
    if code in _MOST:
        return f"a {_NOUNS[code]} in [{-_MOST[code]!r}, {_MOST[code]!r}]"
    low, high = INTEGER_RANGES[code]
    return f"an {'integer' if low else 'unsigned integer'} in [{low}, {high}]"


def _code(kind: FieldType) -> str:
    return kind.primitive.code if kind.primitive is not None and kind.base != "byte" else ""


def _python(field: Field) -> type:
    kind = field.type
    if field.cls is not None:
        return field.cls
    names = {"bool": bool, "int": int, "float": float}
    return bytes if kind.base == "byte" else names[kind.primitive.python] if kind.primitive is not None else str


def _in_range(value: Any, code: str) -> bool:
    if code in _MOST:
        return not (value < -_MOST[code] or value > _MOST[code]) or math.isinf(value)
    low, high = INTEGER_RANGES[code]
    return bool(low <= value <= high)


def _is_right_array(field: Field, value: Any) -> bool:
    """Whether it is an array of numbers, which is then right."""
    name, kind, code = field.py_name, field.type, _code(field.type)
    if not code or code == "?":
        return False
    if kind.arity is Arity.ARRAY:
        if not isinstance(value, np.ndarray):
            return False
        dtype = DTYPES[code].name
        text = f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype}'"
        _refuse(value.dtype == DTYPES[code], text)
        _refuse(value.size == kind.capacity, f"The '{name}' numpy.ndarray() must have a size of {kind.capacity}")
        return True
    if not isinstance(value, array):
        return False
    _refuse(value.typecode == code, f"The '{name}' array.array() must have the type code of '{code}'")
    if kind.arity is Arity.BOUNDED:
        _refuse(len(value) <= kind.capacity, f"The '{name}' array.array() must have a size <= {kind.capacity}")
    return True


def _check_many(field: Field, value: Any) -> bool:
    """Always False: what is no array of the right type is converted."""
    kind, python, code = field.type, _python(field), _code(field.type)
    lengths = {Arity.ARRAY: f" with length {kind.capacity}", Arity.BOUNDED: f" with length <= {kind.capacity}"}
    text = f"The '{field.py_name}' field must be a set or sequence{lengths.get(kind.arity, '')} and each value of type "
    text += f"'{python.__name__}'"
    if code and code != "?":
        text += f" and each {_each_in(code)}"
    is_sequence = isinstance(value, (Sequence, Set, UserList, array)) and not isinstance(value, (str, UserString))
    _refuse(is_sequence and _fits(len(value), kind), text)
    _refuse(all(isinstance(item, python) for item in value), text)
    _refuse(not code or code == "?" or all(_in_range(item, code) for item in value), text)
    return False


def _each_in(code: str) -> str:
    if code in _MOST:
        return f"{_NOUNS[code]} in [{-_MOST[code]:f}, {_MOST[code]:f}]"
    return _range_of(code).removeprefix("an ")


def _fits(count: int, kind: FieldType) -> bool:
    return (
        count == kind.capacity if kind.arity is Arity.ARRAY else kind.arity is Arity.UNBOUNDED or count <= kind.capacity
    )
