"""Columns of a message class in Arrow: the schema, and arrays made from numpy.

Nested messages are structs, sequences lists, fixed arrays lists of fixed size, `Time` and `Duration` nanoseconds. Bytes
(``uint8[]``, ``byte[]``, ``char[]``) are binary: a list of them is eight times as large in Parquet, and no image is
read number by number. A message without fields has the type null, as Parquet and DuckDB have no structs without fields;
nothing else is ever null. The metadata has the ROS type, definition and QoS.

Functions raise `BagError` if a column of one batch exceeds 2 GiB, the limit of Arrow's offsets.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.field_columns import VARIABLE_LENGTH
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.cdr.type_queries import constants, referenced_classes
from rosidl_py_gen.tables.arrow import from_buffers, from_numpy, pa
from rosidl_py_gen.tables.columns import LOG_TIME, PUBLISH_TIME, Kind

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.common import BagTopic
    from rosidl_py_gen.tables.columns import ColumnNode, SelectedColumn

    Array = NDArray[Any]

TOPIC = b"ros.topic"
TYPE = b"ros.type"
HASH = b"ros.type_hash"
DEFINITION = b"ros.definition"
ENCODING = b"ros.definition_encoding"
QOS = b"ros.offered_qos"
CONSTANTS = b"ros.constants"
ITEM = "item"
NUMBERS = {
    "?": pa.bool_(),
    "b": pa.int8(),
    "B": pa.uint8(),
    "h": pa.int16(),
    "H": pa.uint16(),
    "i": pa.int32(),
    "I": pa.uint32(),
    "q": pa.int64(),
    "Q": pa.uint64(),
    "f": pa.float32(),
    "d": pa.float64(),
}
NANOSECONDS = pa.timestamp("ns")
_ELEMENT_TYPES = {
    Kind.STRING: pa.string(),
    Kind.TIME: NANOSECONDS,
    Kind.DURATION: pa.duration("ns"),
    Kind.EMPTY: pa.null(),
}
ColumnArrays: TypeAlias = "dict[ColumnNode, Any]"
"""Arrow arrays by column; those of structs are assembled of their children by `assembled`."""
_MAX_OFFSET = (1 << 31) - 1


def element_type(node: ColumnNode) -> Any:
    """Return the Arrow type of one element of a column."""
    if node.kind is Kind.NUMBER:
        return NUMBERS[node.code]
    if node.kind is Kind.STRUCT:
        return pa.struct([field_of(child) for child in node.children])
    return _ELEMENT_TYPES[node.kind]


def type_of(node: ColumnNode) -> Any:
    """Return the Arrow type of a column; raises `BagError` if it is too large for Arrow."""
    try:
        if node.is_binary:
            return pa.binary(node.length if node.length is not None else VARIABLE_LENGTH)
        element = element_type(node)
        if node.length is None:
            return element
        return pa.list_(pa.field(ITEM, element, nullable=node.kind is Kind.EMPTY), node.length)
    except (OverflowError, ValueError) as error:
        raise BagError(f"{node.name}: Arrow has no type for {node.field.type}: {error}") from None


def field_of(node: ColumnNode, name: str | None = None) -> Any:
    """Return the Arrow field of a column."""
    nullable = node.kind is Kind.EMPTY and node.length is None
    return pa.field(name or node.name, type_of(node), nullable, {TYPE: str(node.field.type)})


def schema_of(cls: type[Any], columns: Sequence[SelectedColumn], topic: BagTopic | None = None) -> Any:
    """Return the schema of a table with the bag's times and these columns; raises `BagError`."""
    times = [pa.field(name, NANOSECONDS, nullable=False) for name in (LOG_TIME, PUBLISH_TIME)]
    fields = [field_of(column.node, column.name) for column in columns]
    by_type = {name: values for name, one in referenced_classes(cls).items() if (values := constants(one))}
    metadata = {TYPE: cls._TYPE.name, HASH: cls._TYPE.hash, CONSTANTS: json.dumps(by_type)}
    if topic is not None:
        metadata |= {TOPIC: topic.name, DEFINITION: topic.definition, ENCODING: topic.encoding, QOS: topic.offered_qos}
    return pa.schema([*times, *fields], metadata=metadata)


# --------------------------------------------------------------------------------------------------------------- arrays


def offsets(node: ColumnNode, sizes: Array) -> NDArray[np.int32]:
    """Return Arrow offsets for lists or texts of these sizes."""
    result = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=result[1:])
    if result[-1] > _MAX_OFFSET:
        raise BagError(f"{node.name}: {result[-1]} elements in one batch; expected at most {_MAX_OFFSET}")
    return result.astype(np.int32)


def elements(node: ColumnNode, values: Array) -> Any:
    """Return one-dimensional values as elements of a column of numbers, times or messages without fields."""
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.NUMBER:
        return from_numpy(values != 0 if node.code == "?" else values)
    return times(node, values["sec"], values["nanosec"])


def times(node: ColumnNode, sec: Array, nanosec: Array) -> Any:
    """Return seconds and nanoseconds as one number; `nanosec` may exceed 10**9."""
    return from_numpy(sec.astype(np.int64) * NS_PER_S + nanosec, element_type(node))


def fixed(node: ColumnNode, values: Array) -> Any:
    """Return a column of values in rows of equal length."""
    if node.length is None:
        return elements(node, values.reshape(len(values)))
    if node.is_binary:
        return from_buffers(type_of(node), len(values), values)
    return fixed_lists(node, len(values), elements(node, values.reshape(-1)))


def fixed_lists(node: ColumnNode, count: int, children: Any) -> Any:
    """Return a column of `count` lists of fixed size."""
    return from_buffers(type_of(node), count, children=[children])


def lists(node: ColumnNode, counts: Array, children: Any) -> Any:
    """Return a column of lists, of fixed size or with `counts` elements."""
    if node.length != VARIABLE_LENGTH:
        return fixed_lists(node, len(counts), children)
    return from_buffers(type_of(node), len(counts), offsets(node, counts), children=[children])


def sequences(node: ColumnNode, counts: Array, values: Array) -> Any:
    """Return a column of sequences with `counts` elements from all their elements."""
    if not node.is_binary:
        return lists(node, counts, elements(node, values))
    buffers = (offsets(node, counts), values) if node.length == VARIABLE_LENGTH else (values,)
    return from_buffers(type_of(node), len(counts), *buffers)


def texts(node: ColumnNode, sizes: Array, octets: Any) -> Any:
    """Return a column of strings; raises ``ArrowInvalid``, a ValueError, if one is not UTF-8."""
    array = from_buffers(pa.string(), len(sizes), offsets(node, sizes), octets)
    array.validate(full=True)
    return array


def assembled(node: ColumnNode, arrays: Mapping[ColumnNode, Any], count: int) -> Any:
    """Return the array of a column, or of list elements, from its own array or those of its fields."""
    if (array := arrays.get(node)) is not None:
        return array
    return struct(node, [assembled(child, arrays, count) for child in node.children])


def struct(node: ColumnNode, children: Sequence[Any]) -> Any:
    """Return messages from the columns of their fields."""
    return pa.StructArray.from_arrays(children, fields=[field_of(child) for child in node.children])


def from_records(node: ColumnNode, values: Array) -> Any:
    """Return an array of fixed-size messages from a structured array."""
    return struct(node, [_field_from_records(child, values[child.field.ros_name]) for child in node.children])


def _field_from_records(node: ColumnNode, values: Array) -> Any:
    if node.kind is not Kind.STRUCT:
        return fixed(node, np.ascontiguousarray(values.reshape(len(values), node.length or 1)))
    if node.length is None:
        return from_records(node, values)
    return fixed_lists(node, len(values), from_records(node, values.reshape(-1)))
