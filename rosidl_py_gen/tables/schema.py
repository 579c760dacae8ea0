"""Arrow schema of a message class.

Nested messages are structs, sequences lists, fixed arrays lists of fixed size, `Time` and `Duration` nanoseconds. Bytes
(``uint8[]``, ``byte[]``, ``char[]``) are binary: a list of them is eight times as large in Parquet, and no image is
read number by number. A message without fields has the type null, as Parquet and DuckDB have no structs without fields;
nothing else is ever null. The metadata has the ROS type, definition and QoS.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.cdr.type_queries import constants, referenced_classes
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.columns import LOG_TIME, PUBLISH_TIME, VARIABLE_LENGTH, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.bags.common import BagTopic
    from rosidl_py_gen.tables.columns import ColumnNode, SelectedColumn

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
