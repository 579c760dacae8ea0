"""Helpers that all numpy conversions share: the error class, checks of fields, the class of the result, HTML texts."""

from __future__ import annotations

from functools import partial, wraps
from html import escape
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import TypeVar

    M = TypeVar("M", bound=Message, default=Any)  # without `cls` the class is not known
else:
    from typing import TypeVar

    M = TypeVar("M", bound=Message)
P = ParamSpec("P")
R = TypeVar("R")

_OF_DICTS = "subscribe with the class instead of the name"

MAX_UINT32 = 2**32 - 1
"""Maximum of rows, columns and sizes, which are uint32 in all messages."""


class ConversionError(RosidlError, ValueError):
    """Error for a message and an array that do not fit each other.

    The text names the field, the found and the expected value.
    """


def reads_message(expected: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a function whose first argument is a message.

    The function raises `ConversionError` if a field is missing. `expected` describes the message in the error text.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def read(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return function(*args, **kwargs)
            except AttributeError as error:
                message = [*args, *kwargs.values()][0]
                reason = _OF_DICTS if isinstance(message, dict) else f"{error!s:.200}"
                raise ConversionError(f"expected {expected}, got {type(message).__name__}: {reason}") from error

        return read

    return decorated


def flat_bytes(data: Any, field: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the bytes of a message field as a one-dimensional array, without a copy if they are contiguous.

    Raises `ConversionError` if the value has no bytes.
    """
    try:
        if isinstance(data, bytes | bytearray | memoryview):
            return np.frombuffer(data, np.uint8)
        row = np.ascontiguousarray(data)
        return row.reshape(-1).view(np.uint8) if row.dtype.itemsize == 1 else row.astype(np.uint8, casting="safe")
    except (TypeError, ValueError, OverflowError) as error:
        raise ConversionError(f"{field}: expected bytes, got {type(data).__name__}: {error}") from None


def as_float64(value: Any, expected: str, field: str = "") -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a value as an array of float64; raises `ConversionError` if it is not made of numbers."""
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise ConversionError(f"{field}expected {expected}, got {type(value).__name__}: {error!s:.200}") from None


def message_class(cls: type[M] | None, name: str, header: Message | None = None) -> Callable[..., M]:
    """Return a function that creates the result message with a header.

    Its class is `cls`, or the message class named `name`.
    """
    found: Any = get_message(name) if cls is None else cls
    return found if header is None else partial(found, header=header)


def check_count(value: Any, field: str) -> int:
    """Return a number of rows or bytes unchanged if it is a uint32; else raise `ConversionError` that names `field`."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and 0 <= value <= MAX_UINT32:
        return int(value)
    raise ConversionError(f"{field}: expected a number from 0 to {MAX_UINT32}, got {value!r:.50}")


def check_flag(value: Any, field: str) -> bool:
    """Return a number or bool as bool; raise `ConversionError` that names `field` if the value is something else."""
    if isinstance(value, int | np.integer | np.bool_):
        return bool(value)
    raise ConversionError(f"{field}: expected 0 or 1, got {value!r:.50}")


def contiguous_native(array: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], bool]:
    """Return the array in contiguous memory, and True if its byte order is big-endian."""
    piece = np.ascontiguousarray(array)
    return piece, piece.dtype.newbyteorder(">") == piece.dtype and piece.dtype.newbyteorder("<") != piece.dtype


def escaped(text: str, max_length: int = 1000) -> str:
    """Return a text cut to `max_length` characters and escaped for HTML, because texts of peers are not trusted."""
    return escape(printable(text, max_length))
