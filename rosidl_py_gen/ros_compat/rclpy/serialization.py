"""Messages as bytes, as they are sent."""

from __future__ import annotations

from typing import Any

from rclpy._rclpy_pybind11 import RMWError
from rclpy.type_support import check_for_type_support
from rosidl_py_gen import DecodeError, EncodeError, decode, encode


def serialize_message(message: Any) -> bytes:
    """The message in CDR with its header; AttributeError for what is no message, TypeError for a wrong value."""
    check_for_type_support(type(message))
    try:
        return encode(message)
    except EncodeError as error:
        raise TypeError(str(error)) from error


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """The other way; RMWError for bytes that are no such message."""
    check_for_type_support(message_type)
    if not isinstance(serialized_message, bytes):
        raise TypeError(f"serialized_message must be bytes, got {type(serialized_message).__name__}")
    try:
        return decode(message_type, serialized_message)
    except DecodeError as error:
        raise RMWError(f"failed to deserialize ROS message: {error}") from error
