"""Columns of messages that were decoded one by one, because the batch decoder does not support them."""

from __future__ import annotations

from itertools import chain
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


def column(selected: SelectedColumn, messages: Sequence[Any]) -> Any:
    """Return a column of all messages as an Arrow array."""
    for node in selected.path:
        messages = _field_values(node, messages)
    return _column(selected.node, messages)


def _field_values(node: ColumnNode, messages: Sequence[Any]) -> list[Any]:
    name = node.field.py_name
    return [getattr(message, name) for message in messages]


def _column(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.length is None:
        return _elements(node, values)
    counts = np.fromiter(map(len, values), np.int64, len(values))
    if node.kind is Kind.NUMBER:
        return arrow_builders.sequences(node, counts, np.concatenate([np.empty(0, DTYPES[node.code]), *values]))
    return arrow_builders.lists(node, counts, _elements(node, [*chain.from_iterable(values)]))


def _elements(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.kind is Kind.STRUCT:
        return arrow_builders.struct(node, [_column(child, _field_values(child, values)) for child in node.children])
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.TIME or node.kind is Kind.DURATION:
        sec = np.fromiter((one.sec for one in values), np.int64, len(values))
        return arrow_builders.times(node, sec, np.fromiter((one.nanosec for one in values), np.int64, len(values)))
    return pa.array(values, element_type(node))
