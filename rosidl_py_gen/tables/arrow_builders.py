"""Arrow arrays from numpy: how the values of a column lie in Arrow's memory. No value is ever null.

Raises `BagError` where a column of one batch has more than 2 GiB, which Arrow's offsets cannot count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.tables.arrow import from_buffers, from_numpy, pa
from rosidl_py_gen.tables.columns import VARIABLE_LENGTH, Kind
from rosidl_py_gen.tables.schema import element_type, field_of, type_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.tables.columns import ColumnNode

    Array = NDArray[Any]

Built: TypeAlias = "dict[ColumnNode, Any]"
"""Arrow arrays of columns; those of structs are made of their children's by `assembled`."""
_MOST = (1 << 31) - 1
_S = 1_000_000_000


def offsets(node: ColumnNode, sizes: Array) -> NDArray[np.int32]:
    """Where each of several parts of these sizes begins, and the last ends."""
    found = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=found[1:])
    if found[-1] > _MOST:
        raise BagError(f"{node.name}: {found[-1]} elements in one batch; expected at most {_MOST}")
    return found.astype(np.int32)


def elements(node: ColumnNode, values: Array) -> Any:
    """One-dimensional values as elements of a column of numbers, times or messages without fields."""
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.NUMBER:
        return from_numpy(values != 0 if node.code == "?" else values)
    return times(node, values["sec"], values["nanosec"])


def times(node: ColumnNode, sec: Array, nanosec: Array) -> Any:
    """Seconds and nanoseconds as one number; a second may have more than 10**9 of these."""
    return from_numpy(sec.astype(np.int64) * _S + nanosec, element_type(node))


def fixed(node: ColumnNode, values: Array) -> Any:
    """A column of values in rows of equal length."""
    count = len(values)
    if node.length is None:
        return elements(node, values.reshape(count))
    if node.is_binary:
        return from_buffers(type_of(node), count, values)
    return fixed_lists(node, count, elements(node, values.reshape(-1)))


def fixed_lists(node: ColumnNode, count: int, children: Any) -> Any:
    """A column of so many fixed-size lists."""
    return from_buffers(type_of(node), count, children=[children])


def lists(node: ColumnNode, counts: Array, children: Any) -> Any:
    """A column of lists, of fixed size or with so many elements each."""
    if node.length != VARIABLE_LENGTH:
        return fixed_lists(node, len(counts), children)
    return from_buffers(type_of(node), len(counts), offsets(node, counts), children=[children])


def sequences(node: ColumnNode, counts: Array, values: Array) -> Any:
    """A column of sequences, of all their elements and how many each has."""
    if node.is_binary and node.length == VARIABLE_LENGTH:
        return from_buffers(type_of(node), len(counts), offsets(node, counts), values)
    if node.is_binary:
        return from_buffers(type_of(node), len(counts), values)
    return lists(node, counts, elements(node, values))


def texts(node: ColumnNode, sizes: Array, octets: Any) -> Any:
    """Strings of all their bytes; raises ``ArrowInvalid``, a ValueError, when one is no UTF-8."""
    found = from_buffers(pa.string(), len(sizes), offsets(node, sizes), octets)
    found.validate(full=True)
    return found


def assembled(node: ColumnNode, found: Mapping[ColumnNode, Any], count: int) -> Any:
    """A column, or the elements of a list of messages, of what was built for it or for its fields."""
    made = found.get(node)
    return made if made is not None else struct(node, [assembled(child, found, count) for child in node.children])


def struct(node: ColumnNode, children: Sequence[Any]) -> Any:
    """Messages of the columns of their fields."""
    return pa.StructArray.from_arrays(children, fields=[field_of(child) for child in node.children])


def from_records(node: ColumnNode, values: Array) -> Any:
    """Messages of fixed size, as an array of them or the elements of a list, from a structured array."""
    return struct(node, [_of_records(child, values[child.field.ros_name]) for child in node.children])


def _of_records(node: ColumnNode, values: Array) -> Any:
    if node.kind is not Kind.STRUCT:
        rows = values.reshape(len(values), node.length or 1)
        return fixed(node, np.ascontiguousarray(rows))
    if node.length is None:
        return from_records(node, values)
    return fixed_lists(node, len(values), from_records(node, values.reshape(-1)))
