"""Tree of a message in HTML: ``<details>`` for each nested message, with long arrays and texts shortened."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.numpy.html_text import escaped

_MAX_TEXT, _MAX_NUMBERS, _MAX_MESSAGES, _MAX_DEPTH, _MAX_LINES = 200, 12, 10, 20, 1000
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


def tree(message: Message, *, is_open: bool) -> str:
    """Return the tree of a message; the nested messages are closed."""
    return _Tree().message("", message, is_open, 0)


class _Tree:
    """Builder that stops after a number of lines."""

    def __init__(self) -> None:
        self._lines = 0

    def message(self, name: str, message: Message, is_open: bool, depth: int) -> str:
        fields = message._TYPE.fields
        kind = message._TYPE.name
        summary = f"{_name(name)}<i>{escaped(kind)}</i>"
        if depth > _MAX_DEPTH:
            return f"<div>{summary} …</div>"
        lines = []
        for field in fields:
            if self._lines >= _MAX_LINES:
                lines.append("<div>…</div>")
                break
            self._lines += 1
            lines.append(self._field(field, getattr(message, field.py_name, None), depth))
        body = f'<div style="margin-left: 1.5em">{"".join(lines)}</div>'
        return f"<details{' open' if is_open else ''}><summary>{summary}</summary>{body}</details>"

    def _field(self, field: Any, value: Any, depth: int) -> str:
        name = field.ros_name
        if field.type.arity is Arity.SCALAR:
            if not isinstance(value, Message):
                return f"<div>{_name(name)}{_scalar(value)}</div>"
            if value._TYPE.name in _TIMES:
                return f"<div>{_name(name)}{_time(value)}</div>"
            return self.message(name, value, False, depth + 1)
        if isinstance(value, str) or not hasattr(value, "__len__"):
            return f"<div>{_name(name)}{_scalar(value)}</div>"
        count = len(value)
        kind = f"<i>{escaped(str(field.type.element))}[{count}]</i>"
        if field.cls is None or isinstance(value, np.ndarray) or not count:
            return f"<div>{_name(name)}{kind} {_elements(value)}</div>"
        items = []
        for number, one in enumerate(islice(value, _MAX_MESSAGES)):
            if self._lines >= _MAX_LINES:
                break
            self._lines += 1
            is_message = isinstance(one, Message)
            items.append(self.message(f"[{number}]", one, False, depth + 1) if is_message else _scalar(one))
        more = f"<div>… {count - len(items)} more</div>" if count > len(items) else ""
        body = f'<div style="margin-left: 1.5em">{"".join(items)}{more}</div>'
        return f"<details><summary>{_name(name)}{kind}</summary>{body}</details>"


def _name(name: str) -> str:
    return f"<b>{escaped(name)}</b> " if name else ""


def _scalar(value: Any) -> str:
    if isinstance(value, str):
        more = f" … {len(value)} characters" if len(value) > _MAX_TEXT else ""
        return f"&quot;{escaped(value[:_MAX_TEXT])}&quot;{more}"
    return escaped(repr(value.item() if isinstance(value, np.generic) else value), _MAX_TEXT)


def _time(value: Any) -> str:
    try:
        seconds, rest = divmod(stamp_ns(value), 1_000_000_000)
    except TypeError:
        return _scalar(value)
    return f"{seconds}.{rest:09d} s"


def _elements(values: Any) -> str:
    if isinstance(values, bytes | bytearray | memoryview):
        values = np.frombuffer(values, np.uint8)
    first = values[:_MAX_NUMBERS] if isinstance(values, np.ndarray) else list(islice(values, _MAX_NUMBERS))
    items = first.tolist() if isinstance(first, np.ndarray) else first
    texts = [_scalar(item) for item in items]
    return ", ".join([*texts, "…"] if len(values) > len(texts) else texts)
