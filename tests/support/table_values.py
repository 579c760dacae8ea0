"""Messages and rows of tables as the same plain values, to compare them; not how the package makes tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rosidl_py_gen import Message, get_message, type_name
from rosidl_py_gen.bags import BagWriter
from support.inner_state import type_fields

Imu: Any = get_message("sensor_msgs/msg/Imu")


def of_message(message: Any) -> Any:
    """Return a message as dicts and lists, with times in nanoseconds, and None for a message without fields."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list):
        return [of_message(one) for one in message]
    if not isinstance(message, Message):
        return message
    fields = type_fields(message)
    if not fields:
        return None
    if type_name(message) in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        return message.sec * 10**9 + message.nanosec
    return {field.ros_name: of_message(getattr(message, field.py_name)) for field in fields}


def of_row(value: Any) -> Any:
    """Convert a value returned by ``to_pylist`` to the form of `of_message`."""
    if isinstance(value, pd.Timestamp | pd.Timedelta):
        return value.value
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, list):
        return [of_row(one) for one in value]
    if isinstance(value, dict):
        return {name: of_row(one) for name, one in value.items()}
    return value


def rows(table: Any) -> list[Any]:
    """Return all rows without the times of the bag."""
    table.validate(full=True)
    return [of_row(row) for row in table.drop_columns(["log_time", "publish_time"]).to_pylist()]


def same(left: Any, right: Any) -> bool:
    """Return True if values are equal; NaN equals NaN, and 0.0 differs from -0.0."""
    return repr(left) == repr(right)


def write(path: Path, topic: str, *messages: Any, step: int = 10) -> Path:
    with BagWriter(path) as writer:
        for number, message in enumerate(messages):
            writer.write(topic, message, number * step)
    return path


def imus(count: int) -> list[Any]:
    made = [Imu() for _ in range(count)]
    for number, one in enumerate(made):
        one.header.stamp.sec, one.header.frame_id = number, "base" if number % 3 else "a longer frame"
        one.linear_acceleration.x = number / 2
    return made
