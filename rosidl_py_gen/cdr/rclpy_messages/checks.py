"""Checks of values that programs assign to message fields, with the rules and error texts of rclpy for
ROS_PYTHON_CHECK_FIELDS=1.

These checks differ from the checks of encoding: an int is not a float, and a set may be a sequence.
"""

from __future__ import annotations

import math
from array import array
from collections import UserList, UserString
from collections.abc import Sequence, Set
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity
from rosidl_py_gen.cdr.arrays import DTYPES

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.cdr.message import Field

_MAX_FLOAT = {"f": 3.402823466e38, "d": 1.7976931348623157e308}
_NOUNS = {"f": "float", "d": "double"}


def check(field: Field, value: Any) -> bool:
    """Check a value before it is assigned to a field; raise AssertionError with rclpy's text if the value is invalid.

    Returns True if the value is to be stored unchanged, because it is a scalar or an array of the right type, and False
    if it must be converted.
    """
    if field.type.arity is Arity.SCALAR:
        _check_scalar(field, value)
        return True
    return _is_right_array(field, value) or _check_many(field, value)


def _require(ok: bool, text: str) -> None:
    if not ok:
        raise AssertionError(text)


def _check_scalar(field: Field, value: Any) -> None:
    name, kind = field.py_name, field.type
    if field.cls is not None:
        cls = field.cls
        _require(isinstance(value, cls), f"The '{name}' field must be a sub message of type '{cls.__name__}'")
    elif kind.string_bound:
        text = f"The '{name}' field must be string value not longer than {kind.string_bound}"
        _require(isinstance(value, (str, UserString)) and len(value) <= kind.string_bound, text)
    elif kind.base == "byte":
        text = f"The '{name}' field must be of type 'bytes' or 'ByteString' with length 1"
        _require(isinstance(value, (bytes, bytearray)) and len(value) == 1, text)
    else:
        python = _python_type(field)
        _require(isinstance(value, python), f"The '{name}' field must be of type '{python.__name__}'")
        code = _number_code(kind)
        if code:
            _require(_is_in_range(value, code), f"The '{name}' field must be {_range_text(code)}")


def _range_text(code: str) -> str:
    if code in _MAX_FLOAT:
        return f"a {_NOUNS[code]} in [{-_MAX_FLOAT[code]!r}, {_MAX_FLOAT[code]!r}]"
    low, high = INTEGER_RANGES[code]
    return f"an {'integer' if low else 'unsigned integer'} in [{low}, {high}]"


def _number_code(kind: FieldType) -> str:
    return kind.primitive.code if kind.primitive is not None and kind.base not in ("byte", "bool") else ""


def _python_type(field: Field) -> type:
    kind = field.type
    if field.cls is not None:
        return field.cls
    types = {"bool": bool, "int": int, "float": float}
    return bytes if kind.base == "byte" else types[kind.primitive.python] if kind.primitive is not None else str


def _is_in_range(value: Any, code: str) -> bool:
    if code in _MAX_FLOAT:
        return not (value < -_MAX_FLOAT[code] or value > _MAX_FLOAT[code]) or math.isinf(value)
    low, high = INTEGER_RANGES[code]
    return bool(low <= value <= high)


def _is_right_array(field: Field, value: Any) -> bool:
    """Return True for an array of numbers of the field's type and size, and False if the value is not an array.

    Raises AssertionError for an array of another type or size.
    """
    name, kind, code = field.py_name, field.type, _number_code(field.type)
    if not code:
        return False
    if kind.arity is Arity.ARRAY:
        if not isinstance(value, np.ndarray):
            return False
        dtype = DTYPES[code].name
        text = f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype}'"
        _require(value.dtype == DTYPES[code], text)
        _require(value.size == kind.capacity, f"The '{name}' numpy.ndarray() must have a size of {kind.capacity}")
        return True
    if not isinstance(value, array):
        return False
    _require(value.typecode == code, f"The '{name}' array.array() must have the type code of '{code}'")
    if kind.arity is Arity.BOUNDED:
        _require(len(value) <= kind.capacity, f"The '{name}' array.array() must have a size <= {kind.capacity}")
    return True


def _check_many(field: Field, value: Any) -> bool:
    """Check a collection that is not an array for a field; raise AssertionError if it is invalid.

    Returns False, which means that the collection must be converted before it is stored.
    """
    kind, python, code = field.type, _python_type(field), _number_code(field.type)
    lengths = {Arity.ARRAY: f" with length {kind.capacity}", Arity.BOUNDED: f" with length <= {kind.capacity}"}
    text = f"The '{field.py_name}' field must be a set or sequence{lengths.get(kind.arity, '')} and each value of type "
    text += f"'{python.__name__}'"
    if code in _MAX_FLOAT:
        text += f" and each {_NOUNS[code]} in [{-_MAX_FLOAT[code]:f}, {_MAX_FLOAT[code]:f}]"
    elif code:
        text += f" and each {_range_text(code).removeprefix('an ')}"
    is_sequence = isinstance(value, (Sequence, Set, UserList, array)) and not isinstance(value, (str, UserString))
    _require(is_sequence, text)
    _require(kind.arity is not Arity.ARRAY or len(value) == kind.capacity, text)
    _require(kind.arity is not Arity.BOUNDED or len(value) <= kind.capacity, text)
    _require(all(isinstance(item, python) for item in value), text)
    _require(not code or all(_is_in_range(item, code) for item in value), text)
    return False
