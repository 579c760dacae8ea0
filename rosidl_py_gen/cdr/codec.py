"""Public functions `encode` and `decode`, which work for messages with any field names, and conversion of structured
arrays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
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
    """Return the message as XCDR1 little endian with its 4-byte header, without padding at the end.

    ``rclpy.serialization`` on rmw_cyclonedds returns the same bytes.

    Raises:
        EncodeError: a value does not fit its type; names the field path. The message is not changed.
        TypeNotFoundError: the argument is not a generated message.
    """
    # Source: docs/internals/protocol.md 2.
    try:
        return message._encode()
    except AttributeError:
        require_message(message)
        raise


def decode(cls: type[M], data: Readable, *, copy: bool = False, arrays: bool = False) -> M:
    """Return the message that CDR data encodes; ignore bytes after the message.

    The data has its 4-byte header, and may have either byte order.

    Args:
        cls: a generated message class.
        data: bytes, bytearray, memoryview or another contiguous buffer.
        copy: False makes arrays read-only views of `data`; True makes them writable copies.
        arrays: True makes sequences and arrays of fixed-size messages structured arrays, whose dtype `dtype` returns.

    Raises:
        DecodeError: the data is not valid; names field path and byte offset.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    # Source: docs/internals/protocol.md 2.
    try:
        return cls._decode(data, copy, arrays)
    except AttributeError:
        require_message(cls)
        raise


def dtype(cls: type[Message]) -> np.dtype[np.void]:
    """Return the numpy dtype of structured arrays of a fixed-size message, with ROS names and native byte order.

    Offsets and item size follow CDR, so that such arrays are views of encoded messages and are encoded by copying
    bytes. If the first element of a sequence is laid out differently from the others, arrays are copies with the same
    dtype.

    Raises:
        TypeError: the size of messages varies, because of the field that is named; or it is too large for numpy.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    return _require_codec(cls).dtype


def records(values: Sequence[Message] | Records, cls: type[Message] | None = None) -> Records:
    """Return messages of one fixed-size class as a structured array with the dtype that `dtype` returns.

    Args:
        values: a list of messages, or a structured array, which is converted to the dtype of `cls` if that is given.
        cls: class of the messages; required for an empty list, otherwise by default the class of the first message.

    Raises:
        EncodeError: an element has another class, or a value that does not fit; names index and field. Or an array has
            other fields than `cls`.
        TypeError: the list is empty and `cls` missing, or messages of the class are not of fixed size or too large.
        TypeNotFoundError: the class is not a generated message class.
    """
    if isinstance(values, np.ndarray):
        return values if cls is None else _to_wire_dtype(_require_codec(cls), values)
    if cls is None:
        if not len(values):
            raise TypeError("the class of an empty sequence is not known: pass records(values, cls)")
        cls = type(values[0])
    codec = _require_codec(cls)
    for index, value in enumerate(values):
        if not is_of_type(value, cls):
            raise EncodeError(f"{cls._TYPE.name}[{index}]", f"expected {cls._TYPE.name}, found {short_repr(value)}")
    return codec.from_messages(values)


def messages(cls: type[M], values: Sequence[M] | Records) -> list[M]:
    """Return the elements of a structured array as message objects; a list of messages is copied.

    Raises:
        EncodeError: the array has other fields than `cls`; names them.
        TypeError: messages of the class are not of fixed size or too large for numpy.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    if not isinstance(values, np.ndarray):
        return list(values)
    codec = _require_codec(cls)
    return codec.to_messages(_to_wire_dtype(codec, values))


def _require_codec(cls: type[Message]) -> StructuredCodec:
    require_message(cls)
    field = varying_field(cls)
    if field:
        raise TypeError(f"{cls._TYPE.name} is not of fixed size, because of its field {field}")
    try:
        return structured_codec(cls)
    except FieldValueError as error:
        raise TypeError(error.reason) from error


def _to_wire_dtype(codec: StructuredCodec, values: Records) -> Records:
    try:
        return codec.to_wire_dtype(values)
    except FieldValueError as error:
        raise EncodeError(codec.cls._TYPE.name + error.suffix, error.reason) from None
