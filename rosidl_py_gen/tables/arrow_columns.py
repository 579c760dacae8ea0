"""Columns of a message class: the tree of columns that schema, reading and writing use, and Arrow arrays made from
numpy arrays.

Columns have the names of fields. `log_time` and `publish_time` are the times of the bag: a field of that name gets a
trailing underscore, which ROS does not allow in names. The number of columns is limited, because definitions in bags
are not trusted, and a few lines of them can define any number of fields.

Nested messages become structs, sequences lists, fixed arrays lists of fixed size, `Time` and `Duration` nanoseconds.
Bytes (``uint8[]``, ``byte[]``, ``char[]``) become binary values: a list of bytes is eight times as large in Parquet,
and no program reads an image number by number. A message without fields has the type null, as Parquet and DuckDB have
no structs without fields; no other value is ever null. The metadata of the schema has the ROS type, definition and QoS.

Functions that make arrays raise `BagError` if a column of one batch exceeds 2 GiB, the limit of Arrow's offsets.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.bags import BagError
from rosidl_py_gen.base.field_columns import Column
from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.cdr.structured_arrays import cached_per_class
from rosidl_py_gen.cdr.type_queries import constants, referenced_classes
from rosidl_py_gen.tables.arrow import from_buffers, from_numpy, pa

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.bags import BagTopic
    from rosidl_py_gen.cdr import Field

    Array = NDArray[Any]


class Kind(Enum):
    """Kind of the single values in a column; for a column of lists, of the elements."""

    NUMBER = "number"
    STRING = "string"
    TIME = "time"
    DURATION = "duration"
    EMPTY = "empty"  # a message without fields
    STRUCT = "struct"


LOG_TIME = "log_time"
PUBLISH_TIME = "publish_time"
_MAX_DEPTH = 60
_MAX_LISTED_NAMES = 200
_TIME_KINDS = {"builtin_interfaces/msg/Time": Kind.TIME, "builtin_interfaces/msg/Duration": Kind.DURATION}


@dataclass(frozen=True, slots=True, eq=False)
class ColumnNode:
    """Field of a message as a column of a table.

    Attributes:
        name: name of the column.
        length: None for a single value, number of elements of a fixed array, `Column.VARIABLE_LENGTH` for sequences.
        children: fields of a nested message.
    """

    name: str
    field: Field
    kind: Kind
    length: int | None
    children: tuple[ColumnNode, ...] = ()

    @property
    def code(self) -> str:
        """Struct code of the numbers in the column, such as ``d`` for float64."""
        primitive = self.field.type.primitive
        assert primitive is not None
        return primitive.code

    @property
    def is_binary(self) -> bool:
        """True for sequences and arrays of bytes, which are one binary value, not a list of numbers."""
        return self.kind is Kind.NUMBER and self.length is not None and self.code == "B"


def kind_of(field: Field) -> Kind:
    """Return the kind of a single value of a field; for arrays and sequences, of one element."""
    if field.cls is None:
        return Kind.STRING if field.type.is_string else Kind.NUMBER
    if not field.cls._TYPE.fields:
        return Kind.EMPTY
    return _TIME_KINDS[field.type.base] if Column.holds_time(field.cls) else Kind.STRUCT


@cached_per_class
def column_count(cls: type[Any], depth: int = 0) -> int:
    """Return the number of columns that a message class needs, including columns in list elements.

    Raises `BagError` if messages are nested too deeply.
    """
    if depth > _MAX_DEPTH:
        raise BagError(f"{cls._TYPE.name} is nested too deeply for a table; expected at most {_MAX_DEPTH} levels")
    return sum(
        column_count(field.cls, depth + 1) if field.cls is not None and kind_of(field) is Kind.STRUCT else 1
        for field in cls._TYPE.fields
    )


@cached_per_class
def nodes_of(cls: type[Any]) -> tuple[ColumnNode, ...]:
    """Return the top-level columns of a message class; raises `BagError` if they are too many or nested too deeply."""
    count = column_count(cls)
    if count > Column.MAX_COLUMNS:
        raise BagError(f"{cls._TYPE.name} has {count} columns; expected at most {Column.MAX_COLUMNS}")
    names = {field.ros_name for field in cls._TYPE.fields}
    reserved = LOG_TIME, PUBLISH_TIME
    return tuple(_node(field, free_name(field.ros_name, names, reserved)) for field in cls._TYPE.fields)


def free_name(name: str, names: Collection[str], reserved: Collection[str]) -> str:
    """Return a name for the column of a field, with underscores appended while the name is reserved or used."""
    result = name
    while result in reserved or (result != name and result in names):
        result += "_"
    return result


def _node(field: Field, name: str) -> ColumnNode:
    kind, arity = kind_of(field), field.type.arity
    length = None if arity is Arity.SCALAR else field.type.capacity if arity is Arity.ARRAY else Column.VARIABLE_LENGTH
    inner = field.cls._TYPE.fields if field.cls is not None and kind is Kind.STRUCT else ()
    return ColumnNode(name, field, kind, length, tuple(_node(one, one.ros_name) for one in inner))


# ----------------------------------------------------------------------------------------------------------- selection


@dataclass(frozen=True, slots=True)
class SelectedColumn:
    """Column of a table: its name, and the columns on the path from the top of the message to its field."""

    name: str
    path: tuple[ColumnNode, ...]

    @property
    def node(self) -> ColumnNode:
        return self.path[-1]


def select_columns(cls: type[Any], columns: Iterable[str] | str | None) -> list[SelectedColumn]:
    """Return the columns that paths such as ``header.stamp`` select, named like the paths; None selects all fields.

    Raises `BagError` if a field does not exist, or is inside the elements of a list.
    """
    nodes = nodes_of(cls)
    if columns is None:
        return [SelectedColumn(node.name, (node,)) for node in nodes]
    paths = [columns] if isinstance(columns, str) else list(dict.fromkeys(columns))
    return [_select(nodes, path) for path in paths if path not in (LOG_TIME, PUBLISH_TIME)]


def _select(columns: tuple[ColumnNode, ...], path: str) -> SelectedColumn:
    selected: list[ColumnNode] = []
    if not isinstance(path, str):
        raise BagError(f"expected columns as paths, such as header.stamp, found {path!r:.50}")
    nodes = columns
    for name in path.split("."):
        if selected and selected[-1].length is not None:
            parent = ".".join(node.name for node in selected)
            raise BagError(f"{path}: {parent} is a list of messages; select it as a whole: {parent}")
        node = next((one for one in nodes if one.name == name), None)
        if node is None:
            known = [*islice(_names(columns), _MAX_LISTED_NAMES)]
            raise BagError(f"no column {path:.100}{did_you_mean(path, known)}; there are {', '.join(known)[:500]}")
        selected.append(node)
        nodes = node.children
    return SelectedColumn(path, tuple(selected))


def _names(nodes: Iterable[ColumnNode], prefix: str = "") -> Iterator[str]:
    for node in nodes:
        yield prefix + node.name
        if node.length is None:
            yield from _names(node.children, f"{prefix}{node.name}.")


# --------------------------------------------------------------------------------------------------------------- schema

TOPIC = b"ros.topic"
TYPE = b"ros.type"
HASH = b"ros.type_hash"
DEFINITION = b"ros.definition"
ENCODING = b"ros.definition_encoding"
QOS = b"ros.offered_qos"
CONSTANTS = b"ros.constants"
ITEM = "item"
NUMBERS = {one.code: pa.from_numpy_dtype(np.dtype(one.numpy)) for one in PRIMITIVES.values()}
"""Arrow types of numbers by struct code."""
NANOSECONDS = pa.timestamp("ns")
_ELEMENT_TYPES = {
    Kind.STRING: pa.string(),
    Kind.TIME: NANOSECONDS,
    Kind.DURATION: pa.duration("ns"),
    Kind.EMPTY: pa.null(),
}
ColumnArrays: TypeAlias = "dict[ColumnNode, Any]"
"""Arrow arrays by column. A struct column has no array of its own; `assembled` makes its array from the arrays of its
fields."""
_MAX_OFFSET = (1 << 31) - 1


def element_type(node: ColumnNode) -> Any:
    """Return the Arrow type of a single value of a column, not of a list."""
    if node.kind is Kind.NUMBER:
        return NUMBERS[node.code]
    if node.kind is Kind.STRUCT:
        return pa.struct([field_of(child) for child in node.children])
    return _ELEMENT_TYPES[node.kind]


def type_of(node: ColumnNode) -> Any:
    """Return the Arrow type of a column; raises `BagError` if Arrow has no such type."""
    try:
        if node.is_binary:
            return pa.binary(node.length if node.length is not None else Column.VARIABLE_LENGTH)
        element = element_type(node)
        if node.length is None:
            return element
        return pa.list_(pa.field(ITEM, element, nullable=node.kind is Kind.EMPTY), node.length)
    except (OverflowError, ValueError) as error:
        raise BagError(f"{node.name}: Arrow has no type for {node.field.type}: {error}") from None


def field_of(node: ColumnNode, name: str | None = None) -> Any:
    """Return the Arrow field of a column: name, type, and the ROS type as metadata."""
    nullable = node.kind is Kind.EMPTY and node.length is None
    return pa.field(name or node.name, type_of(node), nullable, {TYPE: str(node.field.type)})


def schema_of(cls: type[Any], columns: Sequence[SelectedColumn], topic: BagTopic | None = None) -> Any:
    """Return the Arrow schema of a table with the bag's times and the selected columns.

    The metadata describes message type and topic. Raises `BagError` if Arrow has no type for a column.
    """
    times = [pa.field(name, NANOSECONDS, nullable=False) for name in (LOG_TIME, PUBLISH_TIME)]
    fields = [field_of(column.node, column.name) for column in columns]
    by_type = {name: values for name, one in referenced_classes(cls).items() if (values := constants(one))}
    metadata = {TYPE: cls._TYPE.name, HASH: cls._TYPE.hash, CONSTANTS: json.dumps(by_type)}
    if topic is not None:
        metadata |= {TOPIC: topic.name, DEFINITION: topic.definition, ENCODING: topic.encoding, QOS: topic.offered_qos}
    return pa.schema([*times, *fields], metadata=metadata)


# --------------------------------------------------------------------------------------------------------------- arrays


def offsets(node: ColumnNode, sizes: Array) -> NDArray[np.int32]:
    """Return Arrow offsets for lists or texts of these sizes; raises `BagError` if the total exceeds Arrow's limit."""
    result = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=result[1:])
    if result[-1] > _MAX_OFFSET:
        raise BagError(f"{node.name}: {result[-1]} elements in one batch; expected at most {_MAX_OFFSET}")
    return result.astype(np.int32)


def elements(node: ColumnNode, values: Array) -> Any:
    """Return numpy values as an Arrow array of single values: numbers, times or messages without fields."""
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.NUMBER:
        return from_numpy(values != 0 if node.code == "?" else values)
    return times(node, values["sec"], values["nanosec"])


def times(node: ColumnNode, sec: Array, nanosec: Array) -> Any:
    """Return seconds and nanoseconds as an Arrow array of nanoseconds in total; `nanosec` may exceed 10**9."""
    return from_numpy(sec.astype(np.int64) * NS_PER_S + nanosec, element_type(node))


def fixed(node: ColumnNode, values: Array) -> Any:
    """Return a two-dimensional numpy array as an Arrow column: single values, fixed arrays or bytes."""
    if node.length is None:
        return elements(node, values.reshape(len(values)))
    if node.is_binary:
        return from_buffers(type_of(node), len(values), values)
    return fixed_lists(node, len(values), elements(node, values.reshape(-1)))


def fixed_lists(node: ColumnNode, count: int, children: Any) -> Any:
    """Return an Arrow column of `count` lists of fixed size from the array `children` of all elements."""
    return from_buffers(type_of(node), count, children=[children])


def lists(node: ColumnNode, counts: Array, children: Any) -> Any:
    """Return an Arrow column of lists from the array `children` of all elements; `counts` has the size of each list."""
    if node.length != Column.VARIABLE_LENGTH:
        return fixed_lists(node, len(counts), children)
    return from_buffers(type_of(node), len(counts), offsets(node, counts), children=[children])


def sequences(node: ColumnNode, counts: Array, values: Array) -> Any:
    """Return an Arrow column of sequences from the numpy array of all elements; `counts` has the size of each."""
    if not node.is_binary:
        return lists(node, counts, elements(node, values))
    buffers = (offsets(node, counts), values) if node.length == Column.VARIABLE_LENGTH else (values,)
    return from_buffers(type_of(node), len(counts), *buffers)


def texts(node: ColumnNode, sizes: Array, octets: Any) -> Any:
    """Return an Arrow column of strings from their sizes and joined UTF-8 bytes.

    Raises ``ArrowInvalid``, a ValueError, if a string is not UTF-8.
    """
    array = from_buffers(pa.string(), len(sizes), offsets(node, sizes), octets)
    array.validate(full=True)
    return array


def assembled(node: ColumnNode, arrays: Mapping[ColumnNode, Any], count: int) -> Any:
    """Return the Arrow array of a column, or of the elements of its lists.

    The array of a struct is made from the arrays of its fields.
    """
    if (array := arrays.get(node)) is not None:
        return array
    return struct(node, [assembled(child, arrays, count) for child in node.children])


def struct(node: ColumnNode, children: Sequence[Any]) -> Any:
    """Return an Arrow struct array of messages from the columns of their fields."""
    return pa.StructArray.from_arrays(children, fields=[field_of(child) for child in node.children])


def from_records(node: ColumnNode, values: Array) -> Any:
    """Return an Arrow struct array of fixed-size messages from a numpy structured array."""
    return struct(node, [_field_from_records(child, values[child.field.ros_name]) for child in node.children])


def _field_from_records(node: ColumnNode, values: Array) -> Any:
    if node.kind is not Kind.STRUCT:
        return fixed(node, np.ascontiguousarray(values.reshape(len(values), node.length or 1)))
    if node.length is None:
        return from_records(node, values)
    return fixed_lists(node, len(values), from_records(node, values.reshape(-1)))
