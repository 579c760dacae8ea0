"""Messages as a table: which columns a path of fields means, and the rows.

Decides the paths: ``pose.position.x``, ``position[1]``, a part ``ranges[0:10]``, all ``ranges[:]``, the same for lists
of messages, ``transforms[0].transform.translation.x``; and what a row has where a sequence is too short.
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
"""The name of an attribute, or what is done with a value."""
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_PART = re.compile(r"(\w+)(?:\[\s*(-?\d{1,9})\s*\]|\[\s*(-?\d{0,9})\s*:\s*(-?\d{0,9})\s*\])?", re.ASCII)
_OPEN = -1
_MAX_TIME_NS = (1 << 63) - 1
_MAX_COLUMNS = 10_000
_SHOWN_NAMES = 500
_SPARE, _LARGE = 16, 1 << 26
"""A column may take so many times what is in it, and so many bytes in any case: one long value makes every row long."""
_OTHER = "choose another, or name this field in another call"


@dataclass(frozen=True, slots=True)
class Column:
    """What a path means.

    Attributes:
        get: gives the value of a message; raises IndexError where a sequence is too short.
        kind: of numpy; ``U`` for text.
        length: of the values of a row: None for a single one, `_OPEN` where it varies.
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
    """A structured array; see `BagReader.to_arrays`. Messages are of `classes`, which have the columns of the first."""
    try:
        known = _columns(classes[0], fields)
        getters = {cls: _getters(known, _columns(cls, fields), pad) for cls in classes}
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
            pairs = zip(known, getters[type(message)], strict=True)
            rows.append([_present(column, get, message, pad, place) for column, get in pairs])
    values = [list(column) for column in zip(*rows, strict=True)] if rows else [[] for _ in known]
    return _filled(known, times, values, where, pad)


def _getters(known: list[Column], columns: list[Column], pad: Any) -> list[Get]:
    """How messages of one definition give what all have; raises `BagError` where they do not."""
    for one, other in zip(known, columns, strict=False):
        if (one.name, one.kind, one.length) != (other.name, other.kind, other.length):
            raise BagError(f"{one.name} is of another kind in another definition of this topic; read `messages`")
    if len(known) != len(columns):
        raise BagError("another definition of this topic has other fields; name those you want, or read `messages`")
    return [_kept(column, pad) for column in columns]


def _kept(column: Column, pad: Any) -> Get:
    """Gives a value as it is kept: sequences in objects are not views of the whole message."""
    get, kind, length = column.get, column.kind, column.length
    if length is None or (pad is not None and length != _OPEN):
        return get
    if length == _OPEN:
        return (lambda message: list(get(message))) if kind == "U" else (lambda message: np.array(get(message), kind))

    def fixed(message: Any) -> Any:
        value = get(message)
        if len(value) < length:
            raise IndexError(len(value))
        return value

    return fixed


def _present(column: Column, get: Get, message: Any, pad: Any, place: str) -> Any:
    """What there is in a message that misses something; raises `BagError` without `pad`."""
    try:
        return get(message)
    except IndexError as error:
        if pad is None:
            text = f"there are {error.args[0]} elements; pad= gives what is missing"
            raise BagError(f"{place}: {column.name}: {text}") from None
        return None if column.length is None else []


# ------------------------------------------------------------------------------------------------------------ columns


def _columns(cls: type[Any], fields: Sequence[str] | None) -> list[Column]:
    if fields is None:
        found = list(islice(_plain(cls, "", []), _MAX_COLUMNS + 1))
        if len(found) > _MAX_COLUMNS:
            raise BagError(f"more than {_MAX_COLUMNS} columns: name the fields you want")
        return found
    paths = [fields] if isinstance(fields, str) else fields
    return list({column.name: column for path in paths for column in _of_path(cls, path)}.values())


def _plain(cls: type[Any], path: str, ops: list[Op], length: int | None = None) -> Iterator[Column]:
    """All numbers, texts and times below, without those in arrays."""
    for field in cls._TYPE.fields:
        if field.type.arity is Arity.SCALAR:
            yield from _single(field, f"{path}{field.ros_name}", [*ops, field.py_name], length)


def _single(field: Field, name: str, ops: list[Op], length: int | None) -> Iterator[Column]:
    """The column of one value, or of one value of each element when there is a `length`."""
    if field.cls is None:
        primitive = PRIMITIVES.get(field.type.base)
        yield Column(name, _joined(ops), "U" if primitive is None else primitive.numpy, length)
    elif field.cls._TYPE.name in _TIMES:
        yield Column(name, _joined([*ops, stamp_ns]), "i8", length)
    else:
        yield from _plain(field.cls, f"{name}.", ops, length)


def _of_path(cls: type[Any], path: str) -> list[Column]:
    """Raises `BagError`, which says what there is."""
    ops: list[Op] = []
    length, at, done = None, cls, ""
    parts = path.split(".")
    for number, part in enumerate(parts, 1):
        match = _PART.fullmatch(part)
        field = next((one for one in at._TYPE.fields if match and one.ros_name == match[1]), None)
        if match is None or field is None:
            raise BagError(_unknown(cls, at, path, done))
        here = done + part
        ops.append(field.py_name)
        if field.type.arity is not Arity.SCALAR:
            if match[2] is None:
                if length is not None:
                    raise BagError(f"{here}: a path has one part with several elements at most: give an index")
                length = _slice(field, match, ops)
            else:
                ops.append(_index(field, int(match[2]), here))
        elif "[" in part:
            raise BagError(f"{here}: {done}{field.ros_name} is one {field.type.base}, and has no elements")
        if number == len(parts):
            return list(_single(field, path, ops, length))
        if field.cls is None:
            raise BagError(f"{path}: {here} is {field.type.base}, and has no fields")
        at, done = field.cls, f"{here}."
    raise AssertionError(path)  # split() gives one part at least


def _index(field: Field, index: int, here: str) -> Get:
    if field.type.arity is Arity.ARRAY and not -field.type.capacity <= index < field.type.capacity:
        raise BagError(f"{here}: there are {field.type.capacity} elements")

    def element(values: Any) -> Any:
        try:
            return values[index]
        except IndexError:
            raise IndexError(len(values)) from None

    return element


def _slice(field: Field, match: re.Match[str], ops: list[Op]) -> int:
    """Take a part of a sequence from now on; returns how many elements rows have, or `_OPEN`."""
    start, stop = (int(text) if text else None for text in (match[3], match[4]))
    if field.type.arity is Arity.ARRAY:
        begin, end, _ = slice(start, stop).indices(field.type.capacity)
        length = max(0, end - begin)
        if stop is not None and stop > field.type.capacity:
            raise BagError(f"{match[0]}: there are {field.type.capacity} elements")
    else:
        is_fixed = stop is not None and 0 <= (start or 0) <= stop
        length = (stop or 0) - (start or 0) if is_fixed else _OPEN
    ops.append(_SliceMarker(slice(start, stop)))
    return length


class _SliceMarker:
    """Marks where getters begin to be those of elements."""

    def __init__(self, part: slice) -> None:
        self.part = part

    def __call__(self, values: Any) -> Any:
        return values[self.part]


def _joined(ops: list[Op]) -> Get:
    """One getter of several; those behind a part are applied to each of its elements."""
    at = next((number for number, op in enumerate(ops, 1) if isinstance(op, _SliceMarker)), len(ops))
    before, behind = _chain(ops[:at]), ops[at:]
    if not behind:
        return before
    rest = _chain(behind)
    return lambda message: [rest(element) for element in before(message)]


def _chain(ops: list[Op]) -> Get:
    """One after the other; attributes of attributes at once, which is what most columns are."""
    steps: list[Get] = []
    for is_name, group in groupby(ops, lambda op: isinstance(op, str)):
        found: list[Any] = list(group)
        steps += [attrgetter(".".join(found))] if is_name else found
    first, others = steps[0], steps[1:]
    if not others:
        return first

    def get(message: Any) -> Any:
        value = first(message)
        for step in others:
            value = step(value)
        return value

    return get


def _unknown(cls: type[Any], at: type[Any], path: str, done: str) -> str:
    """What is wrong with a path, with the names that are right."""
    known = list(islice(_names(cls), _SHOWN_NAMES))
    plain = re.sub(r"\[[^\]]*\]", "[:]", path)
    below = [name for name in known if name.startswith(re.sub(r"\[[^\]]*\]", "[:]", done))] or known
    return f"no column {path}{did_you_mean(plain, known)}; there are {', '.join(below)[:500]}"


def _names(cls: type[Any], path: str = "", depth: int = 0) -> Iterator[str]:
    """All paths of a class, with ``[:]`` for arrays."""
    for field in cls._TYPE.fields:
        name = path + field.ros_name + ("" if field.type.arity is Arity.SCALAR else "[:]")
        if field.cls is None or field.cls._TYPE.name in _TIMES or depth > 20:
            yield name
        else:
            yield from _names(field.cls, f"{name}.", depth + 1)


# --------------------------------------------------------------------------------------------------------------- rows


def _filled(
    known: list[Column], times: list[int], values: list[list[Any]], where: str, pad: Any
) -> np.ndarray[Any, np.dtype[np.void]]:
    kinds: list[Any] = [("log_time", "i8")]
    rows = []
    for column, found in zip(known, values, strict=True):
        try:
            kind, shape, ready = _fitted(column, found, pad)
        except (ValueError, TypeError, OverflowError) as error:
            raise BagError(f"{where}: {column.name}: {error}") from None
        kinds.append((column.name, kind, shape))
        rows.append(ready)
    try:
        made = np.empty(len(times), kinds)
    except (ValueError, MemoryError) as error:
        raise BagError(f"{where}: no array has room for these columns: {error}") from None
    made["log_time"] = times
    for column, ready in zip(known, rows, strict=True):
        target = made[column.name]
        if target.dtype == object:
            for number, value in enumerate(ready):
                target[number] = value
        elif len(ready):
            target[...] = ready
    return made


def _fitted(column: Column, found: list[Any], pad: Any) -> tuple[str, tuple[int, ...], list[Any]]:
    """Dtype and shape of a column, and its values with what they are padded with; raises ValueError."""
    length = column.length
    if length is None:
        if any(value is None for value in found):
            pad = _pad(column, pad)
            found = [pad if value is None else value for value in found]
        return _text_kind(found) if column.kind == "U" else column.kind, (), found
    if length == _OPEN:
        if pad is None:
            return "O", (), found
        length = max(map(len, found), default=0)
    size, filled = len(found) * length, sum(map(len, found))
    if size > filled:
        if 8 * size > _LARGE and size > _SPARE * filled:
            raise ValueError(f"padded it has {size} elements, {filled} of them in the bag; take a part, as [0:100]")
        pad = _pad(column, pad)
        found = [_padded(value, length, column.kind, pad) for value in found]
    kind = _text_kind([text for row in found for text in row]) if column.kind == "U" else column.kind
    return kind, (length,), found


def _text_kind(texts: list[str]) -> str:
    """A kind as long as the longest text; Python's own texts where one long text would make all of them large."""
    longest = max(map(len, texts), default=1) or 1
    size = 4 * longest * len(texts)
    return "O" if size > _LARGE and size > 4 * _SPARE * sum(map(len, texts)) else f"U{longest}"


def _padded(value: Any, length: int, kind: str, pad: Any) -> Any:
    missing = length - len(value)
    if not missing:
        return value
    if kind == "U":
        return [*value, *([pad] * missing)]
    return np.concatenate((np.array(value, kind), np.full(missing, pad, kind)))


def _pad(column: Column, pad: Any) -> Any:
    """The filling as the type of the column; raises ValueError when it is another value there."""
    if isinstance(pad, str) != (column.kind == "U"):
        raise ValueError(f"pad={pad!r:.50} is no {'text' if column.kind == 'U' else 'number'}, {_OTHER}")
    if column.kind == "U":
        return pad
    kind = np.dtype(column.kind)
    with np.errstate(all="ignore"):
        try:
            made = np.asarray(pad).astype(kind)
        except (ValueError, TypeError, OverflowError):
            made = np.asarray(None)
    is_nan = kind.kind == "f" and pad != pad
    is_close = kind.kind == "f" and np.isfinite(made) if made.dtype == kind and not made.ndim else False
    if not (is_nan or is_close or made == pad):
        raise ValueError(f"pad={pad!r:.50} is no {kind}, {_OTHER}")
    return made[()]


# ------------------------------------------------------------------------------------------------------------- pandas


def frame(made: np.ndarray[Any, np.dtype[np.void]]) -> Any:
    """A table as a `pandas.DataFrame`; see `BagReader.to_pandas`."""
    try:
        pandas: Any = import_module("pandas")
    except ModuleNotFoundError:
        raise ModuleNotFoundError("to_pandas needs pandas: pip install pandas", name="pandas") from None
    columns: dict[str, Any] = {}
    for name in (made.dtype.names or ())[1:]:
        column = made[name]
        if column.ndim == 1:
            columns[name] = column.copy()  # in one piece
        else:
            for number, element in enumerate(_element_names(name, column.shape[1])):
                columns[element] = column[:, number].copy()
    index = pandas.DatetimeIndex(pandas.to_datetime(made["log_time"].copy(), unit="ns", utc=True), name="log_time")
    return pandas.DataFrame(columns, index=index)


def _element_names(name: str, count: int) -> list[str]:
    """``x[2:4]`` -> ``x[2]``, ``x[3]``; without brackets from 0."""
    match = re.search(r"\[\s*(-?\d*)\s*:[^\]]*\]", name)
    start = int(match[1] or 0) if match else 0
    before, after = (name[: match.start()], name[match.end() :]) if match else (name, "")
    return [f"{before}[{start + number}]{after}" for number in range(count)]
