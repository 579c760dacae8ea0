"""Conversion of messages to serialized bytes and back."""

from typing import Any

from rclpy._rclpy_pybind11 import RMWError
from rclpy.type_support import check_for_type_support
from rosidl_py_gen import DecodeError, EncodeError, decode, encode


def serialize_message(message: Any) -> bytes:
    """Return a message as CDR bytes with their 4-byte header.

    Raises:
        AttributeError: the object is not a message.
        TypeError: a value does not fit its field.
    """
    check_for_type_support(type(message))
    try:
        return encode(message)
    except EncodeError as error:
        raise TypeError(str(error)) from error


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Return the message in serialized bytes; raise RMWError for invalid bytes."""
    check_for_type_support(message_type)
    if not isinstance(serialized_message, bytes):
        raise TypeError(f"serialized_message must be bytes, got {type(serialized_message).__name__}")
    try:
        return decode(message_type, serialized_message)
    except DecodeError as error:
        raise RMWError(f"failed to deserialize ROS message: {error}") from error
