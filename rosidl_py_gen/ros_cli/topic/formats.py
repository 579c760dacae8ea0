"""Output formats of ``topic echo``.

YAML and CSV truncate long values as `ros2 topic echo` does. JSON, and a string that is printed alone, are truncated
only if the user sets a length.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.message_text import TRUNCATE, to_plain, to_yaml

Style = Literal["yaml", "flow", "csv", "json"]


def value_printer(
    style: Style, *, full_length: bool, truncate_length: int | None, arrays: bool, strings: bool
) -> Callable[[Any], None]:
    """Return a function that prints a message, the value of a field, or the bytes of a message."""
    default = None if style == "json" else TRUNCATE
    truncate = default if truncate_length is None else truncate_length
    plain = partial(to_plain, truncate=None if full_length else truncate, arrays=arrays, strings=strings)

    def yaml_text(value: Any) -> str:
        if isinstance(value, bytes):
            return repr(value)
        if isinstance(value, str) and truncate_length is None and strings:
            return value
        value = plain(value)
        return to_yaml(value, flow=style == "flow").removesuffix("\n") if isinstance(value, dict | list) else str(value)

    match style:
        case "json":
            return lambda value: terminal_output.document(plain(_hex(value)), in_stream=True)
        case "csv":
            return lambda value: terminal_output.line(_csv_line(plain(_hex(value))))
    return lambda value: terminal_output.block(yaml_text(value) + "\n---")


def _csv_line(value: Any) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(_scalars(value))
    return text.getvalue()


def _scalars(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _scalars(item)
    else:
        yield value


def _hex(value: Any) -> Any:
    return value.hex() if isinstance(value, bytes) else value
