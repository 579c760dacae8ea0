"""Conversion of messages to a numpy structured array or pandas DataFrame, with a column for each field path."""

from __future__ import annotations

import re
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.field_columns import Column, FieldPathError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rosidl_py_gen.bags.common import BagMessage

_MAX_TIME_NS = (1 << 63) - 1
# One long value makes every row long, so a column may take at most this many times its contents, or this many bytes.
_MAX_PADDING_FACTOR = 16
_MIN_LIMITED_BYTES = 1 << 26
_PAD_ADVICE = "pass another pad, or read this field in another call"


def table(
    classes: Sequence[type[Any]],
    messages: Iterable[BagMessage],
    fields: Sequence[str] | None,
    where: str,
    pad: Any = None,
) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return messages as a structured array with a row for each message.

    Args:
        classes: classes of the messages, which must have equal columns.
        fields: field paths; None means all numbers and texts outside of arrays.
        where: path and topic, for errors.
        pad: value for elements that a message does not have; None raises `BagError`.
    """
    try:
        columns = Column.of_message(classes[0], fields)
        getters = {cls: _getters(columns, Column.of_message(cls, fields), pad) for cls in classes}
    except (BagError, FieldPathError) as error:
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


def _getters(expected: list[Column], columns: list[Column], pad: Any) -> list[Callable[[Any], Any]]:
    """Return one function for each column of a table; it returns the column's value for a message.

    Raises:
        BagError: the definitions of the topic have different columns.
    """
    for one, other in zip(expected, columns, strict=False):
        if (one.name, one.kind, one.length) != (other.name, other.kind, other.length):
            raise BagError(f"{one.name} has different types in the definitions of this topic; read `messages`")
    if len(expected) != len(columns):
        raise BagError("the definitions of this topic have different fields; pass fields=, or read `messages`")
    return [_copying_getter(column, pad) for column in columns]


def _copying_getter(column: Column, pad: Any) -> Callable[[Any], Any]:
    """Return a function that reads the value of a column from a message and copies sequences.

    A sequence of a decoded message shares the memory of the message, which would otherwise stay in memory.
    """
    get, kind, length = column.get, column.kind, column.length
    if length is None or (pad is not None and length != Column.VARIABLE_LENGTH):
        return get
    if length == Column.VARIABLE_LENGTH:
        return (lambda message: list(get(message))) if kind == "U" else (lambda message: np.array(get(message), kind))

    def fixed(message: Any) -> Any:
        value = get(message)
        if len(value) < length:
            raise IndexError(len(value))
        return value

    return fixed


def _value_or_pad(column: Column, get: Callable[[Any], Any], message: Any, pad: Any, place: str) -> Any:
    try:
        return get(message)
    except IndexError as error:
        if pad is None:
            text = f"has {error.args[0]} elements; pass pad= to fill missing elements"
            raise BagError(f"{place}: {column.name}: {text}") from None
        return None if column.length is None else []


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
    if length == Column.VARIABLE_LENGTH:
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
    """Return the numpy type for a column of texts: fixed-length text, or objects if a few texts are far longer than the
    others.
    """
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
    """Return the padding value converted to the type of its column.

    Raises ValueError if the conversion changes the value.
    """
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
    """Return a structured array with log times as a `pandas.DataFrame` whose index is the log time in UTC.

    Raises:
        ModuleNotFoundError: pandas is not installed.
    """
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
    """Return a name for each element of an array column: ``x[2]`` and ``x[3]`` for ``x[2:4]``, ``x[0]`` and so on for
    ``x``.
    """
    match = re.search(r"\[\s*(-?\d*)\s*:[^\]]*\]", name)
    start = int(match[1] or 0) if match else 0
    before, after = (name[: match.start()], name[match.end() :]) if match else (name, "")
    return [f"{before}[{start + number}]{after}" for number in range(count)]
