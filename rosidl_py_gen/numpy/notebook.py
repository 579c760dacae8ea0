"""Views of objects in notebooks: pictures, trees of messages, topics of a bag, entities of a node.

IPython calls the functions when it displays an object. They are registered when `rosidl_py_gen.numpy` is imported in
IPython, or by ``%load_ext rosidl_py_gen.numpy``; this module never imports IPython. Bags and nodes are known by the
names of their classes, as this package does not import them.
"""

from __future__ import annotations

import sys
from typing import Any

from rosidl_py_gen.cdr import Message
from rosidl_py_gen.numpy.html_text import escaped

_MAX_ROWS = 500


def load_ipython_extension(ipython: Any) -> None:
    """Display messages, bags and nodes in this IPython: ``%load_ext rosidl_py_gen.numpy`` calls it."""
    html = ipython.display_formatter.formatters["text/html"]
    html.for_type(Message, message_html)
    html.for_type_by_name("rosidl_py_gen.bags.reader", "BagReader", bag_html)
    html.for_type_by_name("rosidl_py_gen.runtime.node.node", "Node", node_html)


def register_if_running() -> None:
    """Display objects if this process is an IPython."""
    module = sys.modules.get("IPython")
    ipython = module.get_ipython() if module is not None and hasattr(module, "get_ipython") else None
    if getattr(ipython, "display_formatter", None) is not None:
        load_ipython_extension(ipython)


def message_html(message: Any) -> str:
    """Return a picture of a message, if there is one for its type, above the tree of its fields.

    If the message cannot be drawn, a line states the reason.
    """
    import numpy as np

    from rosidl_py_gen.numpy.message_tree import tree
    from rosidl_py_gen.numpy.pictures import picture_html

    try:
        with np.errstate(all="ignore"):  # numpy would print warnings about extreme numbers below the cell
            picture = picture_html(message)
    except Exception as error:  # a message of a peer may be anything; its tree can still be displayed
        reason = str(error) or type(error).__name__
        return f"<div>No picture: {escaped(reason, 300)}</div>{tree(message, is_open=True)}"
    return tree(message, is_open=True) if picture is None else picture + tree(message, is_open=False)


def bag_html(bag: Any) -> str:
    """Return a table of the topics of a bag."""
    seconds = (bag.end_ns - bag.start_ns) / 1e9
    rows = [[one.name, one.type_name, "" if one.count is None else str(one.count)] for one in bag.channels]
    title = f"{bag.path}: {len(bag.topics)} topics, {seconds:.3f} s"
    return f"<div>{escaped(title)}</div>{_table(('topic', 'type', 'messages'), rows)}"


def node_html(node: Any) -> str:
    """Return the entities of a node; those that every node has are in a list that is closed."""
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
