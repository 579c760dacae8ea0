"""Conversion of messages to text: YAML that users read and write, and the `repr` of rclpy.

Printed arrays and strings are truncated to 128 elements, as in `ros2 topic echo`.
"""

from __future__ import annotations

import csv
import io
import re
import sys
from functools import partial, reduce
from time import time_ns
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

import numpy as np
import yaml

from rosidl_py_gen import from_dict
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.base.terminal_text import printable_lines
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import EncodeError, InvalidNameError, TypeNotFoundError
from rosidl_py_gen.ros_cli import values

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rosidl_py_gen.cdr import Field

M = TypeVar("M", bound=Message)
Style = Literal["yaml", "flow", "csv", "json"]

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
TRUNCATE = 128
_TYPE = re.compile(r"\w+(/\w+){1,2}\Z")


class ArraySummary(str):
    """Text that replaces the elements of an array in output, such as ``<array type: double[9]>``."""

    __slots__ = ()


class _DisplayOptions(NamedTuple):
    truncate: int | None
    arrays: bool
    strings: bool


def to_plain(value: Any, *, truncate: int | None = TRUNCATE, arrays: bool = True, strings: bool = True) -> Any:
    """Convert a message, the value of a field, or a dict of values to dicts, lists and scalars with ROS names.

    Only the part that is printed is converted, so a 6 MB image takes as long as a small one.

    Args:
        truncate: maximum length of arrays and strings; longer ones end with ``'...'``.
        arrays: False replaces arrays of messages by their types and sizes.
        strings: False replaces strings by their lengths.
    """
    return _plain(value, _DisplayOptions(truncate, arrays, strings))


def _message(message: Message, options: _DisplayOptions) -> dict[str, Any]:
    values = ((field, getattr(message, field.py_name)) for field in message._TYPE.fields)
    return {
        field.ros_name: _plain(value, options)
        if options.arrays or field.type.arity is Arity.SCALAR
        else str(array_summary(field, value))
        for field, value in values
    }


def array_summary(field: Field, value: Any) -> ArraySummary:
    """Return a text with the type and size of the value of an array field, or of a slice of the array."""
    kind = field.type
    if kind.arity is Arity.ARRAY and len(value) == kind.capacity:
        return ArraySummary(f"<array type: {kind}>")
    return ArraySummary(f"<sequence type: {kind.element}, length: {len(value)}>")


def _plain(value: Any, options: _DisplayOptions) -> Any:
    truncate = options.truncate
    if isinstance(value, dict):
        return {name: _plain(item, options) for name, item in value.items()}
    if isinstance(value, ArraySummary):
        return str(value)
    if isinstance(value, Message):
        return _message(value, options)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, str):
        if not options.strings:
            return f"<string length: {len(value)}>"
        return value if truncate is None or len(value) <= truncate else value[:truncate] + "..."
    if isinstance(value, bytes | bytearray | memoryview):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.ndarray | list | tuple):
        part = value if truncate is None else value[:truncate]
        items = part.tolist() if isinstance(part, np.ndarray) else [_plain(item, options) for item in part]
        return [*items, "..."] if len(part) < len(value) else items
    return value


def to_yaml(value: Any, *, flow: bool | None = False) -> str:
    """Return a plain value as YAML with a line break at the end; keys stay in their order.

    If the value contains an unprintable character, all characters beyond ASCII are escaped, so that the YAML can be
    parsed again.
    `flow` True prints everything on one line; None only lists and mappings of scalars.
    """
    style = {"Dumper": _Dumper, "sort_keys": False, "default_flow_style": flow, "width": 1 << 30}
    text: str = yaml.dump(value, allow_unicode=True, **style)
    if not text.isascii() and printable_lines(text) != text:
        text = yaml.dump(value, allow_unicode=False, **style)
    return text.removesuffix("...\n") if text.endswith("\n...\n") else text  # the end mark after a scalar


def type_and_values(words: Sequence[str], *, stdin: bool = False) -> tuple[str | None, str]:
    """Split the words ``[TYPE] [VALUES]`` of a command into type (None if omitted) and values (else "").

    A type has a ``/`` and no blanks. With `stdin`, the values are read from standard input.
    """
    rest = list(words)
    name = rest.pop(0) if rest and _TYPE.match(rest[0]) else None
    if len(rest) > (0 if stdin else 1):
        expected = "no values with --stdin" if stdin else "values in one word: put them between '"
        raise CommandError(f"cannot make sense of {' '.join(rest)[:200]!r}; expected {expected}")
    if stdin:
        return name, sys.stdin.read(values.MAX_JSON + 1)
    return name, rest[0] if rest else ""


def message_from(cls: type[M], text: str) -> M:
    """Return a message from a YAML or JSON text; omitted fields have their defaults. Raises `CommandError`."""
    message, stamps = message_and_stamps(cls, text)
    set_stamps(stamps)
    return message


def message_and_stamps(cls: type[M], text: str) -> tuple[M, list[Any]]:
    """Return a message from YAML or JSON, and its stamps that the text gives as ``header: auto`` or ``stamp: now``."""
    value = values.parse_value(text) if text.strip() else {}
    if value is None:
        value = {}
    if not isinstance(value, dict):
        raise CommandError(f"{cls.__name__} takes a mapping such as '{{{_example(cls)}}}', got {text[:200]!r}")
    paths: list[_Path] = []
    value = _without_stamps(cls, values.fit(cls, value), (), paths)
    try:
        message = from_dict(cls, value)
    except (EncodeError, InvalidNameError, TypeNotFoundError) as error:
        raise CommandError(str(error)) from None
    return message, [reduce(_follow, path, message) for path in paths]


def set_stamps(stamps: Sequence[Any]) -> None:
    """Set messages of type Time, which are `stamps` inside a message, to the current system time."""
    now_ns = time_ns()
    for stamp in stamps:
        set_stamp(stamp, now_ns)


_HEADER = "std_msgs/msg/Header"
_TIME = "builtin_interfaces/msg/Time"
_Path = tuple[str | int, ...]
"""Path of attribute names and indices that leads from a message to a stamp in it."""


def _follow(value: Any, step: str | int) -> Any:
    return value[step] if isinstance(step, int) else getattr(value, step)


def _without_stamps(cls: type[Message], value: Any, here: _Path, paths: list[_Path]) -> Any:
    """Return the values for a message without each ``auto`` and ``now``; add the paths of these stamps to `paths`."""
    if not isinstance(value, dict):
        return value
    fields = {field.ros_name: field for field in cls._TYPE.fields if field.cls is not None}
    result = dict(value)
    for name, field in fields.items():
        if name not in result or field.cls is None:
            continue
        path, inside = (*here, field.py_name), result[name]
        if isinstance(inside, list):
            items = enumerate(inside)
            result[name] = [_without_stamps(field.cls, item, (*path, index), paths) for index, item in items]
        elif (inside, field.cls._TYPE.name) == ("auto", _HEADER):
            result[name] = {}
            paths.append((*path, "stamp"))
        elif (inside, field.cls._TYPE.name) == ("now", _TIME):
            result[name] = {}
            paths.append(path)
        else:
            result[name] = _without_stamps(field.cls, inside, path, paths)
    return result


def _example(cls: type[Message]) -> str:
    names: Sequence[str] = [field.ros_name for field in cls._TYPE.fields]
    return ", ".join(f"{name}: ..." for name in names[:3])


def rclpy_repr(value: Any, truncate: int | None) -> str:
    """Return the `repr` that rclpy has for a value, such as ``std_msgs.msg.ColorRGBA(r=1.0, g=0.0, b=0.0, a=1.0)``.

    Arrays are lists. Arrays and strings are cut after `truncate` elements, and ``...`` follows; None means uncut.
    """
    if isinstance(value, Message):
        fields = (f"{one.ros_name}={rclpy_repr(getattr(value, one.py_name), truncate)}" for one in value._TYPE.fields)
        return f"{value._TYPE.name.replace('/', '.')}({', '.join(fields)})"
    if isinstance(value, bytes | bytearray | memoryview):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.ndarray | list | tuple):
        part = value if truncate is None else value[:truncate]
        items = [rclpy_repr(item, truncate) for item in (part.tolist() if isinstance(part, np.ndarray) else part)]
        return f"[{', '.join([*items, '...'] if len(part) < len(value) else items)}]"
    if isinstance(value, str) and truncate is not None and len(value) > truncate:
        return f"{value[:truncate]!r}..."
    return repr(value.item() if isinstance(value, np.generic) else value)


def value_printer(
    style: Style, *, full_length: bool, truncate_length: int | None, arrays: bool, strings: bool
) -> Callable[[Any], None]:
    """Return the function of ``topic echo`` that prints a message, the value of a field, or the bytes of a message.

    JSON, and a string that is printed alone, are truncated only if the user sets a length.
    """
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
