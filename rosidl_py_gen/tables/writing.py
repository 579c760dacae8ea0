"""Conversion of tables to messages.

A table is any object with ``__arrow_c_stream__``, such as a table of polars, pandas or DuckDB. Columns are matched with
fields by name. Columns of nested messages are structs, or have names such as ``header.stamp``. Lists, texts and bytes
may have any layout of Arrow; times may have any unit, or be integers of nanoseconds. Fields without a column have the
default of their definition. A null, an unknown column, and a value that does not fit are errors with the column's name.
Values are read and compared, never cast: casts of Arrow parse texts as numbers, make values that do not fit infinite,
and lose elements of list views.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen import compile_definition, encode, get_message, type_hash
from rosidl_py_gen.bags import BagError, BagTopic
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import EncodeError, RosidlError, printable
from rosidl_py_gen.tables import arrow_columns as schema
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.arrow_columns import LOG_TIME, PUBLISH_TIME, Kind, nodes_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.tables.arrow_columns import ColumnNode

Tree: TypeAlias = "dict[str, Any]"
"""Arrow arrays by column name. If column names have dots, the columns below a name are a tree of the same kind."""
_MAX_NAME = 1000
_PORTION_ROWS = 4096
"""Number of table rows that are converted to messages at a time."""
_UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_MAX_TEXT = 200
"""Maximum characters of a name, type or value that an error text quotes."""


class MessageTable:
    """Table whose rows are converted to messages. Raises `BagError` if the object `table` is not a table."""

    def __init__(self, table: object) -> None:
        self._stream = _stream_of(table)

    def topic_and_class(self, topic: str | None) -> tuple[BagTopic, type[Any]]:
        """Return topic and message class from the table's schema metadata; raises `BagError` if these are missing.

        `topic` replaces the topic of the metadata.
        """
        return _topic_of_schema(self._stream.schema, topic)

    def encoded(self, cls: type[Any], topic: str) -> Iterator[tuple[bytes, int, int]]:
        """Yield each row as an encoded message of a class, with log time and publish time; errors name `topic`.

        Raises:
            BagError: a column is wrong, or the table cannot be read.
            EncodeError: a value is out of range; names the topic, the time and the field.
        """
        for message, log_time, publish_time in _messages_of(self._stream, cls, topic):
            try:
                data = encode(message)
            except EncodeError as error:
                path = f"{_short_text(topic)} at {log_time} ns: {printable(error.path, _MAX_NAME)}"
                raise EncodeError(path, printable(error.reason, _MAX_NAME)) from None
            yield data, log_time, publish_time


def _stream_of(table: object) -> Any:
    if isinstance(table, pa.RecordBatchReader):
        return table
    if not hasattr(table, "__arrow_c_stream__"):
        raise BagError(f"expected a table (something with __arrow_c_stream__), found {type(table).__name__}")
    try:
        return pa.RecordBatchReader.from_stream(table)
    except (pa.ArrowException, ValueError, TypeError) as error:
        raise BagError(f"Arrow cannot read the table: {error}") from None


def _topic_of_schema(table_schema: Any, topic: str | None) -> tuple[BagTopic, type[Any]]:
    metadata = {key: value.decode(errors="replace") for key, value in (table_schema.metadata or {}).items()}
    topic = topic or metadata.get(schema.TOPIC)
    name, definition, table_hash = (metadata.get(key, "") for key in (schema.TYPE, schema.DEFINITION, schema.HASH))
    if len(name) > _MAX_NAME:
        raise BagError(f"{schema.TYPE.decode()}: found a name of {len(name)} characters; expected at most {_MAX_NAME}")
    if not topic:
        raise BagError("table has no ros.topic in its schema metadata; pass topic=")
    quoted = _short_text(topic)
    if not name:
        raise BagError(f"{quoted}: table has no ros.type in its schema metadata; pass msg_type=")
    cls: type[Any] = compile_definition(name, definition) if schema.DEFINITION in metadata else get_message(name)
    if not definition and table_hash and table_hash != type_hash(cls):  # an unknown definition, not an empty message
        cls = get_message(name)
    if not hasattr(cls, "_TYPE") or not hasattr(cls._TYPE, "fields"):
        raise BagError(f"{quoted}: {name} is not a message")
    if table_hash and table_hash != type_hash(cls):
        raise BagError(
            f"{quoted}: the table was made of {name} {_short_text(table_hash)}, but {name} is {type_hash(cls)}"
        )
    encoding, qos = metadata.get(schema.ENCODING, "ros2msg"), metadata.get(schema.QOS, "")
    return BagTopic(topic, name, definition, encoding, type_hash=type_hash(cls), offered_qos=qos), cls


def _messages_of(stream: Any, cls: type[Any], topic: str) -> Iterator[tuple[Any, int, int]]:
    """Yield each row of a table as a message with log time and publish time; raises `BagError` for a wrong column."""
    nodes = nodes_of(cls)
    count = 0
    while (batch := _next(stream, topic)) is not None:
        for begin in range(0, batch.num_rows, _PORTION_ROWS):
            portion = batch.slice(begin, _PORTION_ROWS)
            try:
                times, messages = _portion(portion, cls, nodes)
            except (BagError, pa.ArrowException, ValueError, TypeError, OverflowError) as error:
                raise BagError(f"{_short_text(topic)}: rows from {count}: {error}") from None
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
        raise BagError(f"{_short_text(topic)}: the table cannot be read: {error}") from None


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
    column = _plain(column)
    _require_values(column, name)
    return _nanoseconds(column, name, Kind.TIME).tolist()  # type: ignore[no-any-return]


def _insert(tree: Tree, name: str, column: Any) -> None:
    """Insert a column into the tree of columns at the place that its name states, in which dots separate levels.

    Raises `BagError` if another column is at this place.
    """
    *parents, last = name.split(".")
    node = tree
    for parent in parents:
        node = node.setdefault(parent, {})
        if not isinstance(node, dict):
            raise BagError(f"there is a column {_short_text(name)}, and another one that contains it")
    if last in node:
        raise BagError(f"there are two columns {_short_text(name)}, or another one contains it")
    node[last] = column


# ------------------------------------------------------------------------------------------------------------ messages


def _structs(cls: type[Any], nodes: Sequence[ColumnNode], tree: Tree, count: int, path: str) -> list[Any]:
    known = {node.name: node for node in nodes}
    for name in tree:
        if name not in known:
            field = f"{path}{_short_text(name)}"
            raise BagError(f"{_short_text(cls._TYPE.name)} has no field {field}{did_you_mean(name, known)}")
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
    column = _plain(column)
    if node.length is None:
        return _elements(node, column, path)
    _require_values(column, path)
    kind, types = column.type, pa.types
    if node.is_binary and (types.is_binary(kind) or types.is_large_binary(kind) or types.is_fixed_size_binary(kind)):
        return column.to_pylist()  # type: ignore[no-any-return]
    sizes, inside = _lists(column, path, node.field.type)
    ends = sizes.cumsum().tolist()
    if node.kind is Kind.NUMBER:
        _require_values(inside, path)
        items: Any = _numbers(inside, node.code, path)
    else:
        items = _elements(node, inside, path)
    return [items[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]


def _elements(node: ColumnNode, column: Any, path: str) -> Sequence[Any]:
    if node.kind is Kind.EMPTY:
        if column.null_count != len(column) and not (pa.types.is_struct(column.type) and not column.type.num_fields):
            kind = _short_text(column.type)
            raise BagError(f"{path}: expected nulls for {node.field.type}, which has no fields, found {kind}")
        return [_class(node)() for _ in range(len(column))]
    _require_values(column, path)
    if node.kind is Kind.NUMBER:
        return _numbers(column, node.code, path).tolist()  # type: ignore[no-any-return]
    if node.kind is Kind.STRING:
        return _texts(column, path)
    if node.kind is Kind.STRUCT:
        return _structs(_class(node), node.children, _fields_of(node, column, path), len(column), f"{path}.")
    seconds, rest = np.divmod(_nanoseconds(column, path, node.kind), NS_PER_S)
    cls = _class(node)
    return [cls(sec, nanosec) for sec, nanosec in zip(seconds.tolist(), rest.tolist(), strict=True)]


def _fields_of(node: ColumnNode, column: Any, path: str) -> Tree:
    if pa.types.is_null(column.type):  # the elements of lists that are all empty
        return {}
    if not pa.types.is_struct(column.type):
        raise BagError(f"{path}: expected a struct for {node.field.type}, found {_short_text(column.type)}")
    tree: Tree = {}
    for field, inner in zip(column.type, column.flatten(), strict=True):
        if field.name in tree:
            raise BagError(f"{path}: there are two fields {_short_text(field.name)}")
        tree[field.name] = inner
    return tree


def _class(node: ColumnNode) -> type[Any]:
    assert node.field.cls is not None
    return node.field.cls


# -------------------------------------------------------------------------------------------------------------- values


def _plain(column: Any) -> Any:
    """Return an Arrow array with the same values in plain encoding: without dictionaries, run ends, extension types and
    string views.

    List views stay, as `_lists` reads them.
    """
    kind, types = column.type, pa.types
    if isinstance(kind, pa.BaseExtensionType):
        return _plain(column.storage)
    result = column
    if types.is_dictionary(kind):
        result = _plain(_take(_plain(column.dictionary), column.indices))
    elif types.is_run_end_encoded(kind):
        rows = column.offset + np.arange(len(column))
        runs = np.searchsorted(column.run_ends.to_numpy(), rows, side="right")
        result = _plain(_take(_plain(column.values), pa.array(runs)))
    elif types.is_string_view(kind):
        result = pa.array(column.to_pylist(), pa.large_string())
    elif types.is_binary_view(kind):
        result = pa.array(column.to_pylist(), pa.large_binary())
    if len(result) != len(column):
        raise BagError(f"Arrow has read {len(result)} of {len(column)} values of {_short_text(kind)}")
    return result


def _take(column: Any, indices: Any) -> Any:
    try:
        return column.take(indices)
    except pa.ArrowNotImplementedError:  # for example structs with string views
        rows = (pa.nulls(1, column.type) if at is None else column.slice(at, 1) for at in indices.to_pylist())
        return pa.concat_arrays([column.slice(0, 0), *rows])


def _require_values(column: Any, path: str) -> None:
    """Raise `BagError` if a value of a column is null."""
    if column.null_count:
        row = column.is_null().index(True).as_py()
        raise BagError(f"{path}: no value in row {row}; messages have a value for every field")


def _lists(column: Any, path: str, expected: object) -> tuple[NDArray[np.int64], Any]:
    """Return the length of each list of an Arrow array, and an array of all elements, one list after the other.

    `expected` is the ROS type for the error: `BagError` if the array has no lists.
    """
    kind, types = column.type, pa.types
    if types.is_list_view(kind) or types.is_large_list_view(kind):
        return _view_lists(column, path)
    if types.is_fixed_size_list(kind):
        sizes = np.full(len(column), kind.list_size, np.int64)
    elif types.is_list(kind) or types.is_large_list(kind):
        sizes = column.value_lengths().to_numpy(zero_copy_only=False).astype(np.int64)
    else:
        raise BagError(f"{path}: expected a list for {expected}, found {_short_text(kind)}")
    return sizes, _require_count(column.flatten(), int(sizes.sum()), path)


def _view_lists(column: Any, path: str) -> tuple[NDArray[np.int64], Any]:
    sizes = column.sizes.to_numpy(zero_copy_only=False).astype(np.int64)
    offsets = column.offsets.to_numpy(zero_copy_only=False).astype(np.int64)
    inside = _plain(column.values)
    if len(sizes) and (min(offsets.min(), sizes.min()) < 0 or (offsets + sizes).max() > len(inside)):
        raise BagError(f"{path}: a list refers to elements beyond the {len(inside)} stored")
    total = int(sizes.sum())
    indices = np.repeat(offsets - (sizes.cumsum() - sizes), sizes) + np.arange(total)
    return sizes, _require_count(_take(inside, pa.array(indices)), total, path)


def _require_count(elements: Any, count: int, path: str) -> Any:
    if len(elements) != count:
        raise BagError(f"{path}: found {len(elements)} elements in lists of {count}")
    return _plain(elements)


def _texts(column: Any, path: str) -> list[str]:
    """Return the values of an Arrow array of texts; raises `BagError` for another type."""
    kind, types = column.type, pa.types
    if not (types.is_string(kind) or types.is_large_string(kind) or _is_empty_null(column)):
        raise BagError(f"{path}: expected text, found {_short_text(kind)}")
    return column.to_pylist()  # type: ignore[no-any-return]


def _numbers(column: Any, code: str, path: str) -> NDArray[Any]:
    """Return the values of an Arrow array of numbers in the numpy type of a struct code.

    Raises `BagError` if the array has other values, or a value does not fit: it is out of range, has a fraction where
    integers are expected, or is an integer without exact floating point number.
    """
    target, kind, types = schema.NUMBERS[code], column.type, pa.types
    dtype = np.dtype(target.to_pandas_dtype())
    if _is_empty_null(column):
        return np.empty(0, dtype)
    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    if not (types.is_boolean(kind) if code == "?" else is_number):
        raise BagError(f"{path}: expected {target}, found {_short_text(kind)}")
    values = np.asarray(column.to_pylist(), object) if types.is_decimal(kind) else column.to_numpy(zero_copy_only=False)
    if values.dtype == dtype:
        return values
    wrong, result = (_to_floats if dtype.kind == "f" else _to_integers)(values, dtype)
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {_short_text(values[row])} in row {row} does not fit {target}")
    return result


def _to_integers(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return a mask of the values that do not fit an integer type, and the values converted to the type."""
    limits = np.iinfo(dtype)
    if values.dtype.kind in "iu":
        own = np.iinfo(values.dtype)
        wrong = (values < max(limits.min, own.min)) | (values > min(limits.max, own.max))  # exact comparisons
    elif values.dtype.kind == "f":
        double = values.astype(np.float64)  # the limits, powers of 2, are exact
        wrong = ~((double >= float(limits.min)) & (double < float(limits.max + 1)) & (np.trunc(double) == double))
    else:
        wrong = np.array([one != one.to_integral_value() or not limits.min <= one <= limits.max for one in values])
    return wrong, np.where(wrong, 0, values).astype(dtype)


def _to_floats(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return a mask of the values that do not fit a float type, and the converted values; fractions are rounded."""
    with np.errstate(over="ignore"):
        result = values.astype(dtype)
    if values.dtype.kind == "f":
        return np.isinf(result) & ~np.isinf(values), result
    wrong = np.isinf(result)
    for row in np.flatnonzero(np.abs(result) > 2 ** np.finfo(dtype).nmant).tolist():
        whole = int(values[row])
        wrong[row] = wrong[row] or (values[row] == whole and int(result[row]) != whole)
    return wrong, result


def _nanoseconds(column: Any, path: str, time_kind: Kind) -> NDArray[np.int64]:
    """Return an Arrow array of times, durations or integers as nanoseconds; raises `BagError` for another type."""
    kind, types = column.type, pa.types
    if _is_empty_null(column) or types.is_integer(kind):
        return _numbers(column, "q", path)
    is_time = time_kind is Kind.TIME
    if not (types.is_timestamp(kind) if is_time else types.is_duration(kind)):
        name = "a time" if is_time else "a duration"
        raise BagError(f"{path}: expected {name}, or nanoseconds as integers, found {_short_text(kind)}")
    values: NDArray[np.int64] = column.view(pa.int64()).to_numpy(zero_copy_only=False)
    factor = _UNITS_NS[kind.unit]
    limits = np.iinfo(np.int64)
    wrong = (values > limits.max // factor) | (values < -(limits.max // factor))
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {values[row]} {kind.unit} in row {row} does not fit 64 bits of nanoseconds")
    return values * factor


def _is_empty_null(column: Any) -> bool:
    """Return True for an Arrow array without type and length, which is the array of elements if all lists of a column
    are empty.
    """
    return pa.types.is_null(column.type) and not len(column)


def _short_text(value: object) -> str:
    """Return a name, type or value as text for an error: printable, and cut to a maximum length."""
    return printable(str(value), _MAX_TEXT)
