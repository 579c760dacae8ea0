"""Output formats of ``topic echo``.

YAML and CSV truncate long values as `ros2 topic echo` does. JSON, and a string that is printed alone, are truncated
only if the user sets a length.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.message_text import TRUNCATE, to_plain, to_yaml

Style = Literal["yaml", "flow", "csv", "json"]


@dataclass(frozen=True, slots=True)
class Format:
    """Format options of ``topic echo``."""

    style: Style = "yaml"
    full_length: bool = False
    truncate_length: int | None = None
    arrays: bool = True
    strings: bool = True

    def printer(self) -> Callable[[Any], None]:
        """Return a function that prints a message, the value of a field, or the bytes of a message."""
        default = None if self.style == "json" else TRUNCATE
        truncate = default if self.truncate_length is None else self.truncate_length
        plain = partial(
            to_plain,
            truncate=None if self.full_length else truncate,
            arrays=self.arrays,
            strings=self.strings,
        )
        match self.style:
            case "json":
                return lambda value: terminal_output.document(plain(_hex(value)), in_stream=True)
            case "csv":
                return lambda value: terminal_output.line(to_csv(plain(_hex(value))))
        return lambda value: terminal_output.block(self._document(value, plain) + "\n---")

    def _document(self, value: Any, plain: Callable[[Any], Any]) -> str:
        if isinstance(value, bytes):
            return repr(value)
        if isinstance(value, str) and self.truncate_length is None and self.strings:
            return value
        value = plain(value)
        if isinstance(value, dict | list):
            return to_yaml(value, flow=self.style == "flow").removesuffix("\n")
        return str(value)


def to_csv(value: Any) -> str:
    """Return all scalars of a plain value as a line of CSV."""
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
