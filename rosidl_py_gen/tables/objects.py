"""Columns of messages that were decoded one by one: what `rows` refuses, and what has been found damaged or guessed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.tables import build
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.columns import Kind
from rosidl_py_gen.tables.schema import element_type

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.tables.columns import Chosen, Node


def column(chosen: Chosen, messages: Sequence[Any]) -> Any:
    """A column of all messages, as an Arrow array."""
    for node in chosen.path[:-1]:
        messages = _held(node, messages)
    return _column(chosen.node, _held(chosen.node, messages))


def _held(node: Node, messages: Sequence[Any]) -> list[Any]:
    name = node.field.py_name
    return [getattr(message, name) for message in messages]


def _column(node: Node, values: Sequence[Any]) -> Any:
    if node.length is None:
        return _elements(node, values)
    counts = np.fromiter(map(len, values), np.int64, len(values))
    if node.kind is Kind.NUMBER:
        dtype = DTYPES[node.code]
        return build.sequences(node, counts, np.concatenate(values) if len(values) else np.empty(0, dtype))
    return build.lists(node, counts, _elements(node, [one for value in values for one in value]))


def _elements(node: Node, values: Sequence[Any]) -> Any:
    if node.kind is Kind.STRUCT:
        return build.struct(node, [_column(child, _held(child, values)) for child in node.children])
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.TIME or node.kind is Kind.DURATION:
        sec = np.fromiter((one.sec for one in values), np.int64, len(values))
        return build.times(node, sec, np.fromiter((one.nanosec for one in values), np.int64, len(values)))
    return pa.array(values, element_type(node))
