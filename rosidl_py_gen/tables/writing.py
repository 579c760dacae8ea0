"""Messages from tables: any object with ``__arrow_c_stream__``, as of polars, pandas and DuckDB.

Columns are matched by name, nested ones in structs or as ``header.stamp``; lists, texts and bytes may have any layout
of Arrow, times any unit or integers of nanoseconds. Fields without a column have the default of their definition.
Nothing is guessed: a null, an unknown column and a value that does not fit are errors with the column's name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.bags.common import BagError, BagTopic
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import EncodeError, RosidlError, printable
from rosidl_py_gen.tables import schema, values
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.columns import LOG_TIME, PUBLISH_TIME, Kind, nodes_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosidl_py_gen.tables.columns import ColumnNode

Tree: TypeAlias = "dict[str, Any]"
"""Arrow arrays by name; nested columns are trees."""
_MAX_NAME = 1000
_PORTION_ROWS = 4096
"""Number of rows that become messages at once."""


def stream_of(table: object) -> Any:
    """Return a ``pyarrow.RecordBatchReader`` of a table; raises `BagError` if the object is not a table."""
    if isinstance(table, pa.RecordBatchReader):
        return table
    if not hasattr(table, "__arrow_c_stream__"):
        raise BagError(f"expected a table (something with __arrow_c_stream__), found {type(table).__name__}")
    try:
        return pa.RecordBatchReader.from_stream(table)
    except (pa.ArrowException, ValueError, TypeError) as error:
        raise BagError(f"Arrow cannot read the table: {error}") from None


def topic_of_schema(table_schema: Any, topic: str | None) -> tuple[BagTopic, type[Any]]:
    """Return topic and message class from the metadata of a table; raises `BagError` if these do not define them."""
    metadata = {key: value.decode(errors="replace") for key, value in (table_schema.metadata or {}).items()}
    topic = topic or metadata.get(schema.TOPIC)
    name, definition, table_hash = (metadata.get(key, "") for key in (schema.TYPE, schema.DEFINITION, schema.HASH))
    if len(name) > _MAX_NAME:
        raise BagError(f"{schema.TYPE.decode()}: found a name of {len(name)} characters; expected at most {_MAX_NAME}")
    if not topic:
        raise BagError("table has no ros.topic in its schema metadata; pass topic=")
    quoted = values.short_text(topic)
    if not name:
        raise BagError(f"{quoted}: table has no ros.type in its schema metadata; pass msg_type=")
    cls: type[Any] = compile_definition(name, definition) if schema.DEFINITION in metadata else get_message(name)
    if not definition and table_hash and table_hash != type_hash(cls):  # an unknown definition, not an empty message
        cls = get_message(name)
    if not hasattr(cls, "_TYPE") or not hasattr(cls._TYPE, "fields"):
        raise BagError(f"{quoted}: {name} is not a message")
    if table_hash and table_hash != type_hash(cls):
        raise BagError(
            f"{quoted}: the table was made of {name} {values.short_text(table_hash)}, but {name} is {type_hash(cls)}"
        )
    encoding, qos = metadata.get(schema.ENCODING, "ros2msg"), metadata.get(schema.QOS, "")
    return BagTopic(topic, name, definition, encoding, type_hash=type_hash(cls), offered_qos=qos), cls


def messages_of(stream: Any, cls: type[Any], topic: str) -> Iterator[tuple[Any, int, int]]:
    """Yield each row as a message, with log time and publish time; raises `BagError` for a wrong column."""
    nodes = nodes_of(cls)
    count = 0
    while (batch := _next(stream, topic)) is not None:
        for begin in range(0, batch.num_rows, _PORTION_ROWS):
            portion = batch.slice(begin, _PORTION_ROWS)
            try:
                times, messages = _portion(portion, cls, nodes)
            except (BagError, pa.ArrowException, ValueError, TypeError, OverflowError) as error:
                raise BagError(f"{values.short_text(topic)}: rows from {count}: {error}") from None
            yield from zip(messages, *times, strict=True)
            count += portion.num_rows


def _next(stream: Any, topic: str) -> Any:
    try:
        return stream.read_next_batch()
    except StopIteration:
        return None
    except RosidlError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:  # of a stream of another library
        raise BagError(f"{values.short_text(topic)}: the table cannot be read: {error}") from None


def _portion(batch: Any, cls: type[Any], nodes: tuple[ColumnNode, ...]) -> tuple[list[list[int]], list[Any]]:
    tree: Tree = {}
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        _insert(tree, name, column)
    if LOG_TIME not in tree:
        raise BagError(f"there is no column {LOG_TIME}{did_you_mean(LOG_TIME, tree)}")
    log_times = _times(LOG_TIME, tree.pop(LOG_TIME))
    publish = tree.pop(PUBLISH_TIME, None)
    publish_times = log_times if publish is None else _times(PUBLISH_TIME, publish)
    return [log_times, publish_times], _structs(cls, nodes, tree, batch.num_rows, "")


def _times(name: str, column: Any) -> list[int]:
    if isinstance(column, dict):
        raise BagError(f"{name}: expected a column, found columns inside of it")
    column = values.plain(column)
    values.require_values(column, name)
    return values.nanoseconds(column, name, Kind.TIME).tolist()  # type: ignore[no-any-return]


def _insert(tree: Tree, name: str, column: Any) -> None:
    """Insert a column under its name, nested by the dots in it."""
    *parents, last = name.split(".")
    node = tree
    for parent in parents:
        node = node.setdefault(parent, {})
        if not isinstance(node, dict):
            raise BagError(f"there is a column {values.short_text(name)}, and another one that contains it")
    if last in node:
        raise BagError(f"there are two columns {values.short_text(name)}, or another one contains it")
    node[last] = column


# -------------------------------------------------------------------------------------------------------------- values


def _structs(cls: type[Any], nodes: Sequence[ColumnNode], tree: Tree, count: int, path: str) -> list[Any]:
    known = {node.name: node for node in nodes}
    for name in tree:
        if name not in known:
            field = f"{path}{values.short_text(name)}"
            raise BagError(f"{values.short_text(cls._TYPE.name)} has no field {field}{did_you_mean(name, known)}")
    names = [known[name].field.py_name for name in tree]
    columns = [_values(known[name], column, f"{path}{name}", count) for name, column in tree.items()]
    if not columns:
        return [cls() for _ in range(count)]
    return [cls(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)]


def _values(node: ColumnNode, column: Any, path: str, count: int) -> Sequence[Any]:
    if isinstance(column, dict):
        if node.kind is not Kind.STRUCT or node.length is not None:
            raise BagError(f"{path} is {node.field.type}; its fields cannot be columns")
        return _structs(_class(node), node.children, column, count, f"{path}.")
    column = values.plain(column)
    if node.length is None:
        return _elements(node, column, path)
    values.require_values(column, path)
    if node.is_binary and values.is_octets(column.type):
        return column.to_pylist()  # type: ignore[no-any-return]
    sizes, inside = values.lists(column, path, node.field.type)
    ends = sizes.cumsum().tolist()
    if node.kind is Kind.NUMBER:
        values.require_values(inside, path)
        items: Any = values.numbers(inside, node.code, path)
    else:
        items = _elements(node, inside, path)
    return [items[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]


def _elements(node: ColumnNode, column: Any, path: str) -> Sequence[Any]:
    if node.kind is Kind.EMPTY:
        if column.null_count != len(column) and not (pa.types.is_struct(column.type) and not column.type.num_fields):
            kind = values.short_text(column.type)
            raise BagError(f"{path}: expected nulls for {node.field.type}, which has no fields, found {kind}")
        return [_class(node)() for _ in range(len(column))]
    values.require_values(column, path)
    if node.kind is Kind.NUMBER:
        return values.numbers(column, node.code, path).tolist()  # type: ignore[no-any-return]
    if node.kind is Kind.STRING:
        return values.texts(column, path)
    if node.kind is Kind.STRUCT:
        return _structs(_class(node), node.children, _fields_of(node, column, path), len(column), f"{path}.")
    seconds, rest = np.divmod(values.nanoseconds(column, path, node.kind), NS_PER_S)
    cls = _class(node)
    return [cls(sec, nanosec) for sec, nanosec in zip(seconds.tolist(), rest.tolist(), strict=True)]


def _fields_of(node: ColumnNode, column: Any, path: str) -> Tree:
    if pa.types.is_null(column.type):  # the elements of lists that are all empty
        return {}
    if not pa.types.is_struct(column.type):
        raise BagError(f"{path}: expected a struct for {node.field.type}, found {values.short_text(column.type)}")
    tree: Tree = {}
    for field, inner in zip(column.type, column.flatten(), strict=True):
        if field.name in tree:
            raise BagError(f"{path}: there are two fields {values.short_text(field.name)}")
        tree[field.name] = inner
    return tree


def _class(node: ColumnNode) -> type[Any]:
    assert node.field.cls is not None
    return node.field.cls


def located(error: EncodeError, topic: str, log_time: int) -> EncodeError:
    """Return the error of a message with the topic and the time of its row."""
    path = f"{values.short_text(topic)} at {log_time} ns: {printable(error.path, _MAX_NAME)}"
    return EncodeError(path, printable(error.reason, _MAX_NAME))
