"""`encode` and `decode` as functions: they work whatever the fields of a message are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.cdr.message import Message, require_message

if TYPE_CHECKING:
    from rosidl_py_gen.cdr.support import Readable

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """The message as XCDR1 little endian with its 4-byte header, exact size, no padding behind.

    These are the bytes rclpy.serialization gives on rmw_cyclonedds.

    Raises:
        EncodeError: a value does not fit its type; names the field path. Nothing is changed.
        TypeNotFoundError: not a generated message.

    Source: protocol.md 2.
    """
    try:
        return message._encode()
    except AttributeError:
        require_message(message)
        raise


def decode(cls: type[M], data: Readable, *, copy: bool = False) -> M:
    """Read a message from CDR with its 4-byte header, either byte order; bytes behind it are ignored.

    Args:
        cls: a generated message class.
        data: bytes, bytearray, memoryview or another contiguous buffer.
        copy: False makes numeric arrays read-only views of `data`; True gives writable arrays of their own.

    Raises:
        DecodeError: names field path and byte offset.

    Source: protocol.md 2.
    """
    try:
        return cls._decode(data, copy)
    except AttributeError:
        require_message(cls)
        raise
