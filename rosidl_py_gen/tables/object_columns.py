"""Columns of messages that were decoded one by one: what `rows` refuses, and what has been found damaged or guessed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.tables import arrow_builders
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.columns import Kind
from rosidl_py_gen.tables.schema import element_type

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.tables.columns import ColumnNode, SelectedColumn


def column(chosen: SelectedColumn, messages: Sequence[Any]) -> Any:
    """A column of all messages, as an Arrow array."""
    for node in chosen.path[:-1]:
        messages = _held(node, messages)
    return _column(chosen.node, _held(chosen.node, messages))


def _held(node: ColumnNode, messages: Sequence[Any]) -> list[Any]:
    name = node.field.py_name
    return [getattr(message, name) for message in messages]


def _column(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.length is None:
        return _elements(node, values)
    counts = np.fromiter(map(len, values), np.int64, len(values))
    if node.kind is Kind.NUMBER:
        dtype = DTYPES[node.code]
        return arrow_builders.sequences(node, counts, np.concatenate(values) if len(values) else np.empty(0, dtype))
    return arrow_builders.lists(node, counts, _elements(node, [one for value in values for one in value]))


def _elements(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.kind is Kind.STRUCT:
        return arrow_builders.struct(node, [_column(child, _held(child, values)) for child in node.children])
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.TIME or node.kind is Kind.DURATION:
        sec = np.fromiter((one.sec for one in values), np.int64, len(values))
        return arrow_builders.times(node, sec, np.fromiter((one.nanosec for one in values), np.int64, len(values)))
    return pa.array(values, element_type(node))
