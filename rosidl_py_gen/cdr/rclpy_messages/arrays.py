"""Arrays of rclpy's message classes, for their encoders and decoders: `array.array`, lists of bytes and of bools."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.cdr.arrays import BOOL_BYTE, DTYPES, FieldValueError, sequence_converter, short_repr

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr.arrays import Buffer

    # Generated code imports these by the name of a numpy type.
    Reader = Callable[[Buffer, int, int], array[Any]]
    Converter = Callable[[object], Any]
    array_of_int8s: Reader
    buffer_of_int8s: Converter
    array_of_uint8s: Reader
    buffer_of_uint8s: Converter
    array_of_int16s: Reader
    buffer_of_int16s: Converter
    array_of_uint16s: Reader
    buffer_of_uint16s: Converter
    array_of_int32s: Reader
    buffer_of_int32s: Converter
    array_of_uint32s: Reader
    buffer_of_uint32s: Converter
    array_of_int64s: Reader
    buffer_of_int64s: Converter
    array_of_uint64s: Reader
    buffer_of_uint64s: Converter
    array_of_float32s: Reader
    buffer_of_float32s: Converter
    array_of_float64s: Reader
    buffer_of_float64s: Converter

BYTES = tuple(bytes([number]) for number in range(256))
_MAX_SLICE_BYTES = 1 << 14  # up to this size a second copy costs less than a memoryview


def _reader(code: str, array_code: str) -> Reader:
    """Return the function that reads a sequence of numbers, given by their struct code, as an array of a type code."""
    if array_code != code:  # `array.array` lacks the type
        return lambda view, count, at: array(array_code, struct.unpack_from(f"<{count}{code}", view, at))
    size = array(code).itemsize

    def read(view: Buffer, count: int, at: int) -> array[Any]:
        length = size * count
        if at + length > len(view):  # a slice would be shorter without an error
            raise FieldValueError("the data end inside a sequence")
        if length <= _MAX_SLICE_BYTES and type(view) is not memoryview:
            return array(code, view[at : at + length])
        values = array(code)
        values.frombytes(memoryview(view)[at : at + length])
        return values

    return read


def _buffer(code: str) -> Converter:
    convert = sequence_converter(code)

    def buffer(value: object) -> Any:
        return value if type(value) is array and value.typecode == code else convert(value)

    return buffer


_ARRAYS = {one.numpy: one for one in PRIMITIVES.values() if one.array_code}
"""Types of numbers whose sequences are arrays, by the name of a numpy type."""
# The readers and converters, which are declared above for type checkers.
globals().update({f"array_of_{name}s": _reader(one.code, one.array_code) for name, one in _ARRAYS.items()})
globals().update({f"buffer_of_{name}s": _buffer(one.code) for name, one in _ARRAYS.items()})
_bools = sequence_converter("?")


def buffer_of_bools(value: object) -> Any:
    """Return a sequence of bools as a buffer with one byte for each bool; raises `FieldValueError` for other values."""
    try:
        return bytes([BOOL_BYTE[item] for item in value]) if type(value) is list else _bools(value)
    except Exception:  # also of a `__hash__` of the caller
        return _bools(value)  # raises the error that names the wrong element


def _slice(view: Buffer, count: int, at: int) -> Buffer:
    if at + count > len(view):
        raise FieldValueError("the data end inside a sequence")
    return view[at : at + count]


def list_of_bools(view: Buffer, count: int, at: int) -> list[bool]:
    """Return `count` bytes at the offset `at` as bools; any byte but 0 is True."""
    return [number != 0 for number in _slice(view, count, at)]


def list_of_bytes(view: Buffer, count: int, at: int) -> list[bytes]:
    """Return `count` bytes at the offset `at` as a list of 1-byte bytes objects."""
    return [BYTES[number] for number in _slice(view, count, at)]


def joined_bytes(value: Any) -> bytes:
    """Return the elements of a list of 1-byte bytes objects joined to one bytes object.

    Raises `FieldValueError` for other elements.
    """
    if not isinstance(value, (list, tuple)):
        value = as_list(value)
        if not isinstance(value, list):
            raise FieldValueError(f"expected a list of bytes of length 1, found {short_repr(value)}")
    for index, item in enumerate(value):
        if not isinstance(item, (bytes, bytearray)) or len(item) != 1:
            raise FieldValueError(f"expected bytes of length 1, found {short_repr(item)}", index)
    return b"".join(value)


def fixed_bytes(value: Any, count: int) -> bytes:
    """Return the elements of a list of `count` 1-byte bytes objects joined to one bytes object.

    Raises `FieldValueError` for other elements or another number of elements.
    """
    joined = joined_bytes(value)
    if len(joined) != count:
        raise FieldValueError(f"expected exactly {count} elements, found {len(joined)}")
    return joined


def as_list(value: Any) -> Any:
    """Return a collection as a list, as rclpy does; other values, and structured arrays, are returned unchanged."""
    if isinstance(value, (list, tuple, str, bytes, bytearray, array, Mapping)) or not isinstance(value, Collection):
        return value
    return value if isinstance(value, np.ndarray) and value.dtype.names is not None else [*value]


def to_array(value: Any, code: str) -> array[Any]:
    """Return ``array.array(code, value)``, as the setters of rclpy's messages do.

    A numpy array of the same type is copied in one piece.
    """
    kind = type(value)
    is_array = kind is not list and kind is not tuple and kind is np.ndarray
    if is_array and value.ndim == 1 and value.dtype is DTYPES[code]:
        values = array(code)
        values.frombytes(np.ascontiguousarray(value).data.cast("B") if value.size else b"")
        return values
    return array(code, value)
