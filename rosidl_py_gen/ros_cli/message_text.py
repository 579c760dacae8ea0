"""Messages as people write and read them: YAML, arrays and strings cut when they are long.

Decides what is cut: arrays and strings of more than 128 elements, as `ros2 topic echo` does.
"""

from __future__ import annotations

import re
import sys
from functools import reduce
from time import time_ns
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import yaml

from rosidl_py_gen import from_dict
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.output import printable_lines
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import EncodeError, InvalidNameError, TypeNotFoundError
from rosidl_py_gen.ros_cli import ToolError, values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.cdr import Field

M = TypeVar("M", bound=Message)

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
TRUNCATE = 128
_TYPE = re.compile(r"\w+(/\w+){1,2}\Z")


class ArraySummary(str):
    """Text that replaces the elements of an array."""

    __slots__ = ()


class _DisplayOptions(NamedTuple):
    truncate: int | None
    arrays: bool
    strings: bool


def to_plain(
    message: Message, *, truncate: int | None = TRUNCATE, arrays: bool = True, strings: bool = True
) -> dict[str, Any]:
    """Dicts, lists and scalars with ROS names; what is longer than `truncate` is cut and ends with ``'...'``.

    Only what is shown is converted, so a 6 MB image costs as little as a small one.

    Args:
        arrays: False shows only types and sizes of arrays.
        strings: False shows only lengths of strings.
    """
    return _message(message, _DisplayOptions(truncate, arrays, strings))


def plain_value(value: Any, *, truncate: int | None = TRUNCATE, arrays: bool = True, strings: bool = True) -> Any:
    """`to_plain` for the value of a field, or for a dict of such values."""
    return _plain(value, _DisplayOptions(truncate, arrays, strings))


def _message(message: Message, shown: _DisplayOptions) -> dict[str, Any]:
    if shown.arrays:
        return {field.ros_name: _plain(getattr(message, field.py_name), shown) for field in message._TYPE.fields}
    return {field.ros_name: _without_arrays(field, message, shown) for field in message._TYPE.fields}


def _without_arrays(field: Field, message: Message, shown: _DisplayOptions) -> Any:
    value = getattr(message, field.py_name)
    return _plain(value, shown) if field.type.arity is Arity.SCALAR else str(array_summary(field, value))


def array_summary(field: Field, value: Any) -> ArraySummary:
    """Return type and size of the value of an array field, or of a slice of one."""
    kind = field.type
    if kind.arity is Arity.ARRAY and len(value) == kind.capacity:
        return ArraySummary(f"<array type: {kind}>")
    return ArraySummary(f"<sequence type: {kind.element}, length: {len(value)}>")


def _plain(value: Any, shown: _DisplayOptions) -> Any:
    truncate = shown.truncate
    if isinstance(value, dict):
        return {name: _plain(item, shown) for name, item in value.items()}
    if isinstance(value, ArraySummary):
        return str(value)
    if isinstance(value, Message):
        return _message(value, shown)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, str):
        if not shown.strings:
            return f"<string length: {len(value)}>"
        return value if truncate is None or len(value) <= truncate else value[:truncate] + "..."
    if isinstance(value, bytes | bytearray | memoryview):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.ndarray | list | tuple):
        rest = [] if truncate is None or len(value) <= truncate else ["..."]
        kept = value if truncate is None else value[:truncate]
        items = kept.tolist() if isinstance(kept, np.ndarray) else [_plain(item, shown) for item in kept]
        return [*items, *rest]
    return value


def to_yaml(value: Any, *, flow: bool | None = False) -> str:
    """YAML of a plain value, keys in their order, with a line break at the end.

    Where a character may not be printed, all characters beyond ASCII are escaped: reading it gives the same value.

    Args:
        flow: on one line; None: only what holds nothing but scalars is on one line.
    """
    style = {"Dumper": _Dumper, "sort_keys": False, "default_flow_style": flow, "width": 1 << 30}
    text: str = yaml.dump(value, allow_unicode=True, **style)
    if not text.isascii() and printable_lines(text) != text:
        text = yaml.dump(value, allow_unicode=False, **style)
    return text.removesuffix("...\n") if text.endswith("\n...\n") else text  # the end mark behind a scalar


def type_and_values(words: Sequence[str], *, stdin: bool = False) -> tuple[str | None, str]:
    """What ``[TYPE] [VALUES]`` on a command line mean: both may be left out, a type has a ``/`` and no blanks.

    Args:
        stdin: the values are what standard input says.

    Raises:
        ToolError: too many words.
    """
    rest = list(words)
    name = rest.pop(0) if rest and _TYPE.match(rest[0]) else None
    if len(rest) > (0 if stdin else 1):
        expected = "no values beside --stdin" if stdin else "values in one word: put them between '"
        raise ToolError(f"cannot make sense of {' '.join(rest)[:200]!r}; expected {expected}")
    if stdin:
        return name, sys.stdin.read(values.MAX_JSON + 1)
    return name, rest[0] if rest else ""


def message_from(cls: type[M], text: str) -> M:
    """A message from YAML or JSON; what is left out has its default, as with ``ros2 topic pub``.

    Raises:
        ToolError: names the field, what was found and what was expected.
    """
    message, stamps = message_and_stamps(cls, text)
    set_stamps(stamps)
    return message


def message_and_stamps(cls: type[M], text: str) -> tuple[M, list[Any]]:
    """A message, as of `message_from`, and the times in it that shall be now: ``header: auto``, ``stamp: now``."""
    value = values.parse_value(text) if text.strip() else {}
    if value is None:
        value = {}
    if not isinstance(value, dict):
        raise ToolError(f"{cls.__name__} takes a mapping such as '{{{_example(cls)}}}', got {text[:200]!r}")
    paths: list[_Path] = []
    value = _without_stamps(cls, values.fit(cls, value), (), paths)
    try:
        message = from_dict(cls, value)
    except (EncodeError, InvalidNameError, TypeNotFoundError) as error:
        raise ToolError(str(error)) from None
    return message, [reduce(_follow, path, message) for path in paths]


def set_stamps(stamps: Sequence[Any]) -> None:
    """Set times of a message to now."""
    now_ns = time_ns()
    for stamp in stamps:
        set_stamp(stamp, now_ns)


_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
_Path = tuple[str | int, ...]
"""Attributes and indices, from a message to a time in it."""


def _follow(value: Any, step: str | int) -> Any:
    return value[step] if isinstance(step, int) else getattr(value, step)


def _without_stamps(cls: type[Message], value: Any, here: _Path, paths: list[_Path]) -> Any:
    """The value with each ``auto`` and ``now`` taken out; `paths` is told where they were."""
    if not isinstance(value, dict):
        return value
    fields = {field.ros_name: field for field in cls._TYPE.fields if field.cls is not None}
    kept = dict(value)
    for name, field in fields.items():
        if name not in kept or field.cls is None:
            continue
        path, inside = (*here, field.py_name), kept[name]
        if isinstance(inside, list):
            items = enumerate(inside)
            kept[name] = [_without_stamps(field.cls, item, (*path, index), paths) for index, item in items]
        elif (inside, field.cls._TYPE.name) == ("auto", _HEADER):
            kept[name] = {}
            paths.append((*path, "stamp"))
        elif (inside, field.cls._TYPE.name) == ("now", _TIME):
            kept[name] = {}
            paths.append(path)
        else:
            kept[name] = _without_stamps(field.cls, inside, path, paths)
    return kept


def _example(cls: type[Message]) -> str:
    names: Sequence[str] = [field.ros_name for field in cls._TYPE.fields]
    return ", ".join(f"{name}: ..." for name in names[:3])


def shown(value: Any, truncate: int | None) -> str:
    """A message as rclpy shows it: ``std_msgs.msg.ColorRGBA(r=1.0, g=0.0, b=0.0, a=1.0)``, arrays as lists.

    Args:
        truncate: after so many elements or characters comes ``...``; None shows all.
    """
    if isinstance(value, Message):
        fields = (f"{field.ros_name}={shown(getattr(value, field.py_name), truncate)}" for field in value._TYPE.fields)
        return f"{value._TYPE.name.replace('/', '.')}({', '.join(fields)})"
    if isinstance(value, bytes | bytearray | memoryview):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.ndarray | list | tuple):
        kept = value if truncate is None else value[:truncate]
        items = [shown(item, truncate) for item in (kept.tolist() if isinstance(kept, np.ndarray) else kept)]
        return f"[{', '.join([*items, '...'] if len(kept) < len(value) else items)}]"
    if isinstance(value, str) and truncate is not None and len(value) > truncate:
        return f"{value[:truncate]!r}..."
    return repr(value.item() if isinstance(value, np.generic) else value)
