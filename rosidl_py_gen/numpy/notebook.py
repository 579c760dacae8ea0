"""HTML displays of objects in notebooks: pictures and trees of messages, topics of a bag, entities of a node.

IPython calls the functions when it displays an object. They are registered when `rosidl_py_gen.numpy` is imported in
IPython, or by ``%load_ext rosidl_py_gen.numpy``; this module never imports IPython. Bags and nodes are recognized by
the names of their classes, as this package does not import them.
"""

from __future__ import annotations

import sys
from itertools import islice
from typing import Any

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.numpy.common import escaped

_MAX_ROWS = 500
_MAX_TEXT, _MAX_NUMBERS, _MAX_MESSAGES, _MAX_DEPTH, _MAX_LINES = 200, 12, 10, 20, 1000
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


def load_ipython_extension(ipython: Any) -> None:
    """Register HTML displays of messages, bags and nodes in an IPython shell.

    Called by ``%load_ext rosidl_py_gen.numpy``.
    """
    html = ipython.display_formatter.formatters["text/html"]
    html.for_type(Message, message_html)
    html.for_type_by_name("rosidl_py_gen.bags.reader", "BagReader", bag_html)
    html.for_type_by_name("rosidl_py_gen.runtime.node.node", "Node", node_html)


def register_if_running() -> None:
    """Register HTML displays of messages, bags and nodes if this process is an IPython shell."""
    module = sys.modules.get("IPython")
    ipython = module.get_ipython() if module is not None and hasattr(module, "get_ipython") else None
    if getattr(ipython, "display_formatter", None) is not None:
        load_ipython_extension(ipython)


def message_html(message: Any) -> str:
    """Return HTML of a message: its picture, if there is one for its type, above the tree of its fields.

    If the message cannot be drawn, a line states the reason.
    """
    from rosidl_py_gen.numpy.pictures import picture_html

    try:
        with np.errstate(all="ignore"):  # numpy would print warnings about extreme numbers below the cell
            picture = picture_html(message)
    except Exception as error:  # a message of a peer may be anything; its tree can still be displayed
        reason = str(error) or type(error).__name__
        return f"<div>No picture: {escaped(reason, 300)}</div>{_tree(message, is_open=True)}"
    return _tree(message, is_open=True) if picture is None else picture + _tree(message, is_open=False)


def bag_html(bag: Any) -> str:
    """Return HTML of a bag: a table of its topics."""
    seconds = (bag.end_ns - bag.start_ns) / 1e9
    rows = [[one.name, one.type_name, "" if one.count is None else str(one.count)] for one in bag.channels]
    title = f"{bag.path}: {pluralize(len(bag.topics), 'topic')}, {seconds:.3f} s"
    return f"<div>{escaped(title)}</div>{_table(('topic', 'type', 'messages'), rows)}"


def node_html(node: Any) -> str:
    """Return HTML of a node: a table of its entities, with the entities that every node has in a closed section."""
    rows: list[list[str]] = []
    own: list[list[str]] = []
    for entity in node.entities:
        kind, _, rest = repr(entity).removesuffix(")").partition("(")
        name, _, details = rest.partition(", ")
        is_own = details.startswith(("rcl_interfaces/", "type_description_interfaces/"))
        (own if is_own else rows).append([kind, name, details])
    headings = ("kind", "name", "type and state")
    text = f"<div>{escaped(repr(node))}</div>{_table(headings, rows)}"
    if own:
        text += f"<details><summary>{len(own)} of every node</summary>{_table(headings, own)}</details>"
    return text


def _table(headings: tuple[str, ...], rows: list[list[str]]) -> str:
    left = ' style="text-align: left"'
    head = "".join(f"<th{left}>{escaped(text)}</th>" for text in headings)
    body = "".join(
        "<tr>" + "".join(f"<td{left}>{escaped(text)}</td>" for text in row) + "</tr>" for row in rows[:_MAX_ROWS]
    )
    more = f"<div>{len(rows) - _MAX_ROWS} more</div>" if len(rows) > _MAX_ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


# ---------------------------------------------------------------------------------------------------------------- trees


def _tree(message: Message, *, is_open: bool) -> str:
    """Return a message as an HTML tree of ``<details>``; nested messages are closed, long arrays and texts are cut."""
    return _Tree().message("", message, is_open, 0)


class _Tree:
    """Builder of the HTML tree of a message, which stops after a number of lines."""

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
