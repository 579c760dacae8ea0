"""Messages as a numpy structured array or pandas DataFrame: a column for each path of fields.

Paths are ``pose.position.x``, ``position[1]``, a slice ``ranges[0:10]``, all ``ranges[:]``, and the same for lists of
messages: ``transforms[0].transform.translation.x``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from itertools import groupby, islice
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import stamp_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rosidl_py_gen.bags.common import BagMessage
    from rosidl_py_gen.cdr.message import Field

Get: TypeAlias = "Callable[[Any], Any]"
Op: TypeAlias = "str | Get"
"""Name of an attribute, or a function of a value."""
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_PART = re.compile(r"(\w+)(?:\[\s*(-?\d{1,9})\s*\]|\[\s*(-?\d{0,9})\s*:\s*(-?\d{0,9})\s*\])?", re.ASCII)
_VARIABLE_LENGTH = -1
_MAX_TIME_NS = (1 << 63) - 1
_MAX_COLUMNS = 10_000
_MAX_LISTED_NAMES = 500
# One long value makes every row long, so a column may take at most this many times its contents, or this many bytes.
_MAX_PADDING_FACTOR = 16
_MIN_LIMITED_BYTES = 1 << 26
_PAD_ADVICE = "pass another pad, or read this field in another call"


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a table.

    Attributes:
        get: returns the value of a message; raises IndexError if a sequence is too short.
        kind: numpy's letter; ``U`` for text.
        length: number of values in a row: None for a single value, `_VARIABLE_LENGTH` if it varies.
    """

    name: str
    get: Get
    kind: str
    length: int | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        return () if self.length is None else (self.length,)


def table(
    classes: Sequence[type[Any]],
    messages: Iterable[BagMessage],
    fields: Sequence[str] | None,
    where: str,
    pad: Any = None,
) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return a structured array of messages of `classes`, which have equal columns; see `BagReader.to_arrays`."""
    try:
        columns = _columns(classes[0], fields)
        getters = {cls: _getters(columns, _columns(cls, fields), pad) for cls in classes}
    except BagError as error:
        raise BagError(f"{where}: {error}") from None
    times, rows = [], []
    for item in messages:
        message = item.message
        times.append(item.log_time)
        if item.log_time > _MAX_TIME_NS:
            raise BagError(f"{where} at {item.log_time} ns: arrays have log times up to {_MAX_TIME_NS} ns")
        try:
            rows.append([get(message) for get in getters[type(message)]])
        except IndexError:
            place = f"{where} at {item.log_time} ns"
            pairs = zip(columns, getters[type(message)], strict=True)
            rows.append([_value_or_pad(column, get, message, pad, place) for column, get in pairs])
    values = [list(column) for column in zip(*rows, strict=True)] if rows else [[] for _ in columns]
    return _as_array(columns, times, values, where, pad)


def _getters(expected: list[Column], columns: list[Column], pad: Any) -> list[Get]:
    """Return functions for the values of a message; raises `BagError` if definitions have different columns."""
    for one, other in zip(expected, columns, strict=False):
        if (one.name, one.kind, one.length) != (other.name, other.kind, other.length):
            raise BagError(f"{one.name} has different types in the definitions of this topic; read `messages`")
    if len(expected) != len(columns):
        raise BagError("the definitions of this topic have different fields; pass fields=, or read `messages`")
    return [_copying_getter(column, pad) for column in columns]


def _copying_getter(column: Column, pad: Any) -> Get:
    """Return a function that copies sequences of variable length, as views would retain the whole message."""
    get, kind, length = column.get, column.kind, column.length
    if length is None or (pad is not None and length != _VARIABLE_LENGTH):
        return get
    if length == _VARIABLE_LENGTH:
        return (lambda message: list(get(message))) if kind == "U" else (lambda message: np.array(get(message), kind))

    def fixed(message: Any) -> Any:
        value = get(message)
        if len(value) < length:
            raise IndexError(len(value))
        return value

    return fixed


def _value_or_pad(column: Column, get: Get, message: Any, pad: Any, place: str) -> Any:
    try:
        return get(message)
    except IndexError as error:
        if pad is None:
            text = f"has {error.args[0]} elements; pass pad= to fill missing elements"
            raise BagError(f"{place}: {column.name}: {text}") from None
        return None if column.length is None else []


def _columns(cls: type[Any], fields: Sequence[str] | None) -> list[Column]:
    if fields is None:
        columns = list(islice(_scalar_columns(cls, "", []), _MAX_COLUMNS + 1))
        if len(columns) > _MAX_COLUMNS:
            raise BagError(f"more than {_MAX_COLUMNS} columns; pass fields=")
        return columns
    paths = [fields] if isinstance(fields, str) else fields
    return list({column.name: column for path in paths for column in _columns_of_path(cls, path)}.values())


def _scalar_columns(cls: type[Any], path: str, ops: list[Op], length: int | None = None) -> Iterator[Column]:
    """Yield columns of all numbers, texts and times, except those in arrays."""
    for field in cls._TYPE.fields:
        if field.type.arity is Arity.SCALAR:
            yield from _value_columns(field, f"{path}{field.ros_name}", [*ops, field.py_name], length)


def _value_columns(field: Field, name: str, ops: list[Op], length: int | None) -> Iterator[Column]:
    if field.cls is None:
        primitive = PRIMITIVES.get(field.type.base)
        yield Column(name, _combined(ops), "U" if primitive is None else primitive.numpy, length)
    elif field.cls._TYPE.name in _TIMES:
        yield Column(name, _combined([*ops, stamp_ns]), "i8", length)
    else:
        yield from _scalar_columns(field.cls, f"{name}.", ops, length)


def _columns_of_path(cls: type[Any], path: str) -> list[Column]:
    ops: list[Op] = []
    length, at, done = None, cls, ""
    parts = path.split(".")
    for number, part in enumerate(parts, 1):
        match = _PART.fullmatch(part)
        field = next((one for one in at._TYPE.fields if match and one.ros_name == match[1]), None)
        if match is None or field is None:
            raise BagError(_unknown_path_text(cls, at, path, done))
        here = done + part
        ops.append(field.py_name)
        if field.type.arity is not Arity.SCALAR:
            if match[2] is None:
                if length is not None:
                    raise BagError(f"{here}: a path must have at most one slice; pass an index")
                length = _slice(field, match, ops)
            else:
                ops.append(_index(field, int(match[2]), here))
        elif "[" in part:
            raise BagError(f"{here}: {done}{field.ros_name} is a single {field.type.base} without elements")
        if number == len(parts):
            return list(_value_columns(field, path, ops, length))
        if field.cls is None:
            raise BagError(f"{path}: {here} is {field.type.base}, which has no fields")
        at, done = field.cls, f"{here}."
    raise AssertionError(path)  # split() gives one part at least


def _index(field: Field, index: int, here: str) -> Get:
    if field.type.arity is Arity.ARRAY and not -field.type.capacity <= index < field.type.capacity:
        raise BagError(f"{here}: the array has {field.type.capacity} elements")

    def element(values: Any) -> Any:
        try:
            return values[index]
        except IndexError:
            raise IndexError(len(values)) from None

    return element


def _slice(field: Field, match: re.Match[str], ops: list[Op]) -> int:
    """Add a slice to `ops`; return the number of elements of a row, or `_VARIABLE_LENGTH`."""
    start, stop = (int(text) if text else None for text in (match[3], match[4]))
    if field.type.arity is Arity.ARRAY:
        begin, end, _ = slice(start, stop).indices(field.type.capacity)
        length = max(0, end - begin)
        if stop is not None and stop > field.type.capacity:
            raise BagError(f"{match[0]}: the array has {field.type.capacity} elements")
    else:
        is_fixed = stop is not None and 0 <= (start or 0) <= stop
        length = (stop or 0) - (start or 0) if is_fixed else _VARIABLE_LENGTH
    ops.append(_SliceMarker(slice(start, stop)))
    return length


class _SliceMarker:
    """Slice of a sequence; operations after it apply to each element."""

    def __init__(self, part: slice) -> None:
        self.part = part

    def __call__(self, values: Any) -> Any:
        return values[self.part]


def _combined(ops: list[Op]) -> Get:
    """Combine operations; those after a slice apply to each of its elements."""
    at = next((number for number, op in enumerate(ops, 1) if isinstance(op, _SliceMarker)), len(ops))
    before, behind = _chain(ops[:at]), ops[at:]
    if not behind:
        return before
    rest = _chain(behind)
    return lambda message: [rest(element) for element in before(message)]


def _chain(ops: list[Op]) -> Get:
    """Combine operations; consecutive attributes use one `attrgetter`, the most frequent case."""
    steps: list[Get] = []
    for is_name, group in groupby(ops, lambda op: isinstance(op, str)):
        names: list[Any] = list(group)
        steps += [attrgetter(".".join(names))] if is_name else names
    first, others = steps[0], steps[1:]
    if not others:
        return first

    def get(message: Any) -> Any:
        value = first(message)
        for step in others:
            value = step(value)
        return value

    return get


def _unknown_path_text(cls: type[Any], at: type[Any], path: str, done: str) -> str:
    columns = list(islice(_path_names(cls), _MAX_LISTED_NAMES))
    plain = re.sub(r"\[[^\]]*\]", "[:]", path)
    below = [name for name in columns if name.startswith(re.sub(r"\[[^\]]*\]", "[:]", done))] or columns
    return f"no column {path}{did_you_mean(plain, columns)}; columns are {', '.join(below)[:500]}"


def _path_names(cls: type[Any], path: str = "", depth: int = 0) -> Iterator[str]:
    for field in cls._TYPE.fields:
        name = path + field.ros_name + ("" if field.type.arity is Arity.SCALAR else "[:]")
        if field.cls is None or field.cls._TYPE.name in _TIMES or depth > 20:
            yield name
        else:
            yield from _path_names(field.cls, f"{name}.", depth + 1)


def _as_array(
    columns: list[Column], times: list[int], values: list[list[Any]], where: str, pad: Any
) -> np.ndarray[Any, np.dtype[np.void]]:
    kinds: list[Any] = [("log_time", "i8")]
    rows = []
    for column, column_values in zip(columns, values, strict=True):
        try:
            kind, shape, ready = _padded_column(column, column_values, pad)
        except (ValueError, TypeError, OverflowError) as error:
            raise BagError(f"{where}: {column.name}: {error}") from None
        kinds.append((column.name, kind, shape))
        rows.append(ready)
    try:
        array = np.empty(len(times), kinds)
    except (ValueError, MemoryError) as error:
        raise BagError(f"{where}: the columns are too large for an array: {error}") from None
    array["log_time"] = times
    for column, ready in zip(columns, rows, strict=True):
        target = array[column.name]
        if target.dtype == object:
            for number, value in enumerate(ready):
                target[number] = value
        elif len(ready):
            target[...] = ready
    return array


def _padded_column(column: Column, values: list[Any], pad: Any) -> tuple[str, tuple[int, ...], list[Any]]:
    length = column.length
    if length is None:
        if any(value is None for value in values):
            pad = _typed_pad(column, pad)
            values = [pad if value is None else value for value in values]
        return _text_kind(values) if column.kind == "U" else column.kind, (), values
    if length == _VARIABLE_LENGTH:
        if pad is None:
            return "O", (), values
        length = max(map(len, values), default=0)
    size, filled = len(values) * length, sum(map(len, values))
    if size > filled:
        if 8 * size > _MIN_LIMITED_BYTES and size > _MAX_PADDING_FACTOR * filled:
            raise ValueError(
                f"with padding it has {size} elements, {filled} of them in the bag; read a slice such as [0:100]"
            )
        pad = _typed_pad(column, pad)
        values = [_padded(value, length, column.kind, pad) for value in values]
    kind = _text_kind([text for row in values for text in row]) if column.kind == "U" else column.kind
    return kind, (length,), values


def _text_kind(texts: list[str]) -> str:
    """Return a type as long as the longest text, or objects if one long text would enlarge all rows."""
    longest = max(map(len, texts), default=1) or 1
    size = 4 * longest * len(texts)
    return "O" if size > _MIN_LIMITED_BYTES and size > 4 * _MAX_PADDING_FACTOR * sum(map(len, texts)) else f"U{longest}"


def _padded(value: Any, length: int, kind: str, pad: Any) -> Any:
    missing = length - len(value)
    if not missing:
        return value
    if kind == "U":
        return [*value, *([pad] * missing)]
    return np.concatenate((np.array(value, kind), np.full(missing, pad, kind)))


def _typed_pad(column: Column, pad: Any) -> Any:
    """Return the padding in the type of the column; raises ValueError if its value changes."""
    if isinstance(pad, str) != (column.kind == "U"):
        raise ValueError(f"pad={pad!r:.50} is not a {'text' if column.kind == 'U' else 'number'}; {_PAD_ADVICE}")
    if column.kind == "U":
        return pad
    kind = np.dtype(column.kind)
    with np.errstate(all="ignore"):
        try:
            array = np.asarray(pad).astype(kind)
        except (ValueError, TypeError, OverflowError):
            array = np.asarray(None)
    is_nan = kind.kind == "f" and pad != pad
    is_close = kind.kind == "f" and np.isfinite(array) if array.dtype == kind and not array.ndim else False
    if not (is_nan or is_close or array == pad):
        raise ValueError(f"pad={pad!r:.50} is not a {kind}; {_PAD_ADVICE}")
    return array[()]


def to_dataframe(array: np.ndarray[Any, np.dtype[np.void]]) -> Any:
    """Return a table as a `pandas.DataFrame`; see `BagReader.to_pandas`."""
    try:
        pandas: Any = import_module("pandas")
    except ModuleNotFoundError:
        raise ModuleNotFoundError("to_pandas needs pandas: pip install pandas", name="pandas") from None
    columns: dict[str, Any] = {}
    for name in (array.dtype.names or ())[1:]:
        column = array[name]
        if column.ndim == 1:
            columns[name] = column.copy()  # contiguous copy
        else:
            for number, element in enumerate(_element_names(name, column.shape[1])):
                columns[element] = column[:, number].copy()
    index = pandas.DatetimeIndex(pandas.to_datetime(array["log_time"].copy(), unit="ns", utc=True), name="log_time")
    return pandas.DataFrame(columns, index=index)


def _element_names(name: str, count: int) -> list[str]:
    """Return ``x[2]`` and ``x[3]`` for ``x[2:4]``; without brackets from 0."""
    match = re.search(r"\[\s*(-?\d*)\s*:[^\]]*\]", name)
    start = int(match[1] or 0) if match else 0
    before, after = (name[: match.start()], name[match.end() :]) if match else (name, "")
    return [f"{before}[{start + number}]{after}" for number in range(count)]
