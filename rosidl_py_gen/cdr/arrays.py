"""Numeric arrays and sequences in messages: conversion of assigned values to bytes, and of bytes to numpy.

The usual value, a one-dimensional numpy array of the right dtype, is recognised by three cheap tests and not copied.
All other values are converted strictly: a value that does not fit is an error, never a silent wrap-around. Only floats
are rounded, to the precision of the field, as `struct` rounds.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[Any]
    Buffer = bytes | bytearray | memoryview

BOOL_BYTE: dict[Any, int] = {False: 0, True: 1}


class _Dtypes(dict[str, "np.dtype[Any]"]):
    """Dictionary of numpy dtypes by struct code, filled at the first access, because importing numpy is slow.

    Thread: any. Threads that fill the dictionary at the same time store the same dtypes.
    """

    def __missing__(self, code: str) -> np.dtype[Any]:
        found = {one.code: np.dtype(one.numpy) for one in PRIMITIVES.values()}
        self.update(found)
        return found[code]


DTYPES = _Dtypes()
"""Numpy dtypes by struct code. On little-endian machines, the only ones that `support` accepts, they are numpy's own
objects for these types, so comparing a dtype with `is` is correct."""


class FieldValueError(RosidlError, ValueError):
    """Error of a value that does not fit its field, raised by code that does not know the name of the field.

    Attributes:
        suffix: index of the wrong element in brackets; "" for the whole value.
    """

    def __init__(self, reason: str, index: int | None = None) -> None:
        self.reason = reason
        self.index = index
        self.suffix = "" if index is None else f"[{index}]"
        super().__init__(reason)


def short_repr(value: object, width: int = 80) -> str:
    """Return the `repr` of a value for an error text, cut to `width` characters; never raises."""
    try:
        text = repr(value[: width + 1]) if isinstance(value, (str, bytes, bytearray, list, tuple)) else repr(value)
    except Exception as error:  # a user's own __repr__ may raise anything
        text = f"<{type(value).__name__} whose repr raised {type(error).__name__}>"
    return text if len(text) <= width else text[: width - 3] + "..."


def coerce(value: object, code: str) -> Array:
    """Convert the value of a numeric array field to a contiguous one-dimensional array of the dtype that is encoded.

    Accepts numpy arrays, lists, tuples, ranges, array.array, memoryview, and bytes for 8-bit integers. Raises
    `FieldValueError` for any other value, or for a number that does not fit.
    """
    if isinstance(value, (bytes, bytearray)):
        if code not in "Bb":
            raise FieldValueError(f"expected a sequence of {DTYPES[code].name}, found {short_repr(value)}")
        return np.frombuffer(value, DTYPES[code])
    if isinstance(value, (array, memoryview)):
        try:
            value = np.asarray(value)
        except (ValueError, TypeError, BufferError) as error:
            raise FieldValueError(f"expected a buffer of numbers, found {short_repr(value)} ({error})") from error
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "O":
            return cast_array(value, code)
        value = value.tolist()
    if isinstance(value, (str, dict)) or not isinstance(value, Sequence):
        raise FieldValueError(f"expected a sequence of {DTYPES[code].name}, found {short_repr(value)}")
    return _pack(value, code)


def cast_array(value: Array, code: str) -> Array:
    """Convert a one-dimensional numpy array of numbers to a contiguous array of the dtype that is encoded.

    Raises `FieldValueError` if the array's type or a number does not fit.
    """
    dtype = DTYPES[code]
    if value.ndim != 1:
        raise FieldValueError(f"expected one dimension, found shape {value.shape}; use .ravel()")
    if value.dtype == dtype:
        return np.ascontiguousarray(value, dtype)
    kind, target = value.dtype.kind, dtype.kind
    if target == "b" or kind not in "biuf" or (target in "iu" and kind == "f"):
        raise FieldValueError(f"expected an array of {dtype.name}, found one of {value.dtype.name}")
    if target in "iu" and kind in "iu" and value.size:
        fits = np.iinfo(dtype)
        outside = (value < fits.min) | (value > fits.max) if value.dtype != np.uint64 else value > np.uint64(fits.max)
        _require_none(outside, value, f"{dtype.name} in {fits.min}..{fits.max}")
    with np.errstate(over="ignore"):
        result = value.astype(dtype)
    if target == "f" and kind == "f":
        _require_none(np.isfinite(value) & ~np.isfinite(result), value, dtype.name)
    return result


def _require_none(bad: Array, value: Array, expected: str) -> None:
    if bad.any():
        index = int(bad.argmax())
        raise FieldValueError(f"expected {expected}, found {value[index].item()!r}", index)


def _pack(value: Sequence[Any], code: str) -> Array:
    items = list(value)
    try:
        if code == "?":
            return np.frombuffer(bytes([BOOL_BYTE[item] for item in items]), np.bool_)
        return np.frombuffer(struct.pack(f"<{len(items)}{code}", *items), DTYPES[code])
    except Exception:  # as in scalar_problem
        for index, item in enumerate(items):
            reason = scalar_problem(item, code)
            if reason:
                raise FieldValueError(reason, index) from None
        raise


def scalar_problem(value: object, code: str) -> str:
    """Return a text that states why a value cannot be encoded with a struct code; "" if it can."""
    try:
        if code == "?":
            BOOL_BYTE[value]
        else:
            struct.pack("<" + code, value)
    except Exception:  # a caller's own __index__, __float__ or __hash__ may raise anything
        if code == "?":
            return f"expected bool, found {short_repr(value)}"
        dtype = DTYPES[code]
        if dtype.kind == "f":
            is_number = isinstance(value, (int, float))
            return f"expected float{f' that fits {dtype.name}' if is_number else ''}, found {short_repr(value)}"
        if isinstance(value, (int, np.integer)):
            fits = np.iinfo(dtype)
            return f"expected {dtype.name} in {fits.min}..{fits.max}, found {short_repr(value)}"
        return f"expected int, found {short_repr(value)}"
    return ""


def sequence_converter(code: str) -> Callable[[object], Any]:
    """Return the function by which generated code converts the value of a sequence field to a buffer with a `len`.

    The function returns an array of the right dtype unchanged. If the array is not contiguous, joining the segments
    raises TypeError and the slow path copies the array, as a test here would cost more than all others.
    """
    dtype: np.dtype[Any] | None = None  # set by the first call, as this would import numpy
    ndarray: type[Array] | None = None
    is_bytes = code == "B"

    def convert(value: object) -> Any:
        nonlocal dtype, ndarray
        if type(value) is ndarray and value.dtype is dtype and value.ndim == 1:
            return value
        if is_bytes and type(value) is bytes:
            return value
        converted = coerce(value, code)
        if dtype is None:
            dtype, ndarray = DTYPES[code], np.ndarray
        return converted

    return convert


def fixed_converter(code: str) -> Callable[[object, int], bytes]:
    """Return the function by which generated code converts the value of an array field to bytes.

    The function raises `FieldValueError` if the value does not have exactly `count` elements.
    """
    dtype: np.dtype[Any] | None = None
    ndarray: type[Array] | None = None

    def convert(value: object, count: int) -> bytes:
        nonlocal dtype, ndarray
        if type(value) is not ndarray or value.dtype is not dtype or value.ndim != 1:
            value = coerce(value, code)
            if dtype is None:
                dtype, ndarray = DTYPES[code], np.ndarray
        if len(value) != count:
            raise FieldValueError(f"expected exactly {count} elements, found {len(value)}")
        return value.tobytes()

    return convert


def view_of_bools(data: Buffer, count: int, offset: int) -> Array:
    """Return `count` bytes at an offset as an array of bools, which shares the memory of the data if all bytes are 0 or
    1.

    Numpy allows only 0 and 1 in arrays of bools, so other bytes are copied and converted to 1.
    """
    if not count:
        return np.zeros(0, np.bool_)  # a fifth of the time of a view
    raw = np.frombuffer(data, np.uint8, count, offset)
    if raw.max() > 1:
        bools: Array = raw != 0
        bools.flags.writeable = raw.flags.writeable
        return bools
    return raw.view(np.bool_)
