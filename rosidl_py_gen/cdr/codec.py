"""`encode` and `decode` as functions: they work whatever the fields of a message are called. And between the two forms
of a sequence of fixed-size messages: a list of them, and a structured array.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rosidl_py_gen.cdr.arrays import FieldValueError, short_repr
from rosidl_py_gen.cdr.message import Message, is_of_type, require_message
from rosidl_py_gen.cdr.structured_arrays import StructuredCodec, structured_codec
from rosidl_py_gen.cdr.structured_layout import varying_field
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.cdr.support import Readable, Records

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """The message as XCDR1 little endian with its 4-byte header, exact size, no padding behind.

    These are the bytes rclpy.serialization gives on rmw_cyclonedds.

    Raises:
        EncodeError: a value does not fit its type; names the field path. Nothing is changed.
        TypeNotFoundError: not a generated message.

    Source: docs/internals/protocol.md 2.
    """
    try:
        return message._encode()
    except AttributeError:
        require_message(message)
        raise


def decode(cls: type[M], data: Readable, *, copy: bool = False, arrays: bool = False) -> M:
    """Read a message from CDR with its 4-byte header, either byte order; bytes behind it are ignored.

    Args:
        cls: a generated message class.
        data: bytes, bytearray, memoryview or another contiguous buffer.
        copy: False makes arrays read-only views of `data`; True gives writable arrays of their own.
        arrays: True makes sequences and arrays of fixed-size messages structured arrays; see `dtype`.

    Raises:
        DecodeError: names field path and byte offset.

    Source: docs/internals/protocol.md 2.
    """
    try:
        return cls._decode(data, copy, arrays)
    except AttributeError:
        require_message(cls)
        raise


def dtype(cls: type[Message]) -> np.dtype[np.void]:
    """The dtype of structured arrays of a fixed-size message: ROS names, native byte order.

    Offsets and item size are those of CDR, so that such arrays are views of encoded messages and are encoded by copying
    bytes. Where the elements of a sequence do not lie alike (the first one can begin at another alignment than those
    behind it), arrays are copies: same dtype, same values.

    Raises:
        TypeError: messages vary in size, because of the field that is named; or are too large for numpy.
        TypeNotFoundError: not a generated message.
    """
    return _record_type(cls).dtype


def records(values: Sequence[Message] | Records, cls: type[Message] | None = None) -> Records:
    """Messages of one fixed-size class as a structured array with `dtype`; what is such an array already is returned.

    Args:
        values: a list of messages, or a structured array.
        cls: their class, which an empty list does not tell; without it the class of the first.

    Raises:
        EncodeError: an element is of another class, or has a value that does not fit; names index and field. Or an
            array has other fields than `cls`.
        TypeError: an empty list without `cls`; else as `dtype`.
    """
    if isinstance(values, np.ndarray):
        return values if cls is None else _converted(_record_type(cls), values)
    if cls is None:
        if not len(values):
            raise TypeError("an empty sequence does not tell its class: records(values, cls)")
        cls = type(values[0])
    known = _record_type(cls)
    for index, value in enumerate(values):
        if not is_of_type(value, cls):
            raise EncodeError(f"{cls._TYPE.name}[{index}]", f"expected {cls._TYPE.name}, found {short_repr(value)}")
    return known.from_messages(values)


def messages(cls: type[M], values: Sequence[M] | Records) -> list[M]:
    """The elements of a structured array as messages; a list of messages is copied.

    Raises:
        EncodeError: the array has other fields than `cls`; names them.
        TypeError, TypeNotFoundError: as `dtype`.
    """
    if not isinstance(values, np.ndarray):
        return list(values)
    known = _record_type(cls)
    return known.to_messages(_converted(known, values))


def _record_type(cls: type[Message]) -> StructuredCodec:
    require_message(cls)
    field = varying_field(cls)
    if field:
        raise TypeError(f"{cls._TYPE.name} is not of fixed size, because of its field {field}")
    try:
        return structured_codec(cls)
    except FieldValueError as problem:
        raise TypeError(problem.reason) from problem


def _converted(known: StructuredCodec, values: Records) -> Records:
    try:
        return known.to_wire_dtype(values)
    except FieldValueError as problem:
        index = "" if problem.index is None else f"[{problem.index}]"
        raise EncodeError(known.cls._TYPE.name + index, problem.reason) from None
