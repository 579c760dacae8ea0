"""Columns of messages for tables: a function that returns the value of a field path, with the kind of its numbers.

Paths are ``pose.position.x``, ``position[1]``, a slice ``ranges[0:10]``, all ``ranges[:]``, and the same for lists of
messages: ``transforms[0].transform.translation.x``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby, islice
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Get: TypeAlias = "Callable[[Any], Any]"
Op: TypeAlias = "str | Get"
"""Operation that a column applies to a value: the name of an attribute to read, or a function."""
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_TIME_FIELDS = [("sec", "int32"), ("nanosec", "uint32")]
_PART = re.compile(r"(\w+)(?:\[\s*(-?\d{1,9})\s*\]|\[\s*(-?\d{0,9})\s*:\s*(-?\d{0,9})\s*\])?", re.ASCII)
_MAX_LISTED_NAMES = 500


class FieldPathError(RosidlError, ValueError):
    """Error for a field path that does not exist in a message class; the text names the valid columns."""


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a table, made from a field path.

    Attributes:
        get: returns the value in a message; raises IndexError if a sequence is too short.
        kind: type of the values: a numpy type name or code; ``U`` for text.
        length: number of values in a row: None for a single value, `VARIABLE_LENGTH` if it varies.
        is_time: the value is the nanoseconds of a Time or Duration.
    """

    VARIABLE_LENGTH: ClassVar[int] = -1
    """Value of `length` for sequences, whose length varies."""
    MAX_COLUMNS: ClassVar[int] = 10_000
    """Maximum number of columns that a table has."""

    name: str
    get: Get
    kind: str
    length: int | None = None
    is_time: bool = False

    @classmethod
    def of_message(cls, message: type[Any], fields: Sequence[str] | None) -> list[Column]:
        """Return the columns of field paths of a message class; None means all numbers, texts and times outside of
        arrays.

        Raises:
            FieldPathError: a path does not exist.
        """
        if fields is None:
            columns = list(islice(_scalar_columns(message, "", []), cls.MAX_COLUMNS + 1))
            if len(columns) > cls.MAX_COLUMNS:
                raise FieldPathError(f"more than {cls.MAX_COLUMNS} columns; pass fields=")
            return columns
        paths = [fields] if isinstance(fields, str) else fields
        return list({column.name: column for path in paths for column in _columns_of_path(message, path)}.values())

    @staticmethod
    def holds_time(message: type[Any]) -> bool:
        """Return True for the classes of Time and Duration messages, if they have the usual fields: a bag may define
        these names otherwise.
        """
        info = message._TYPE
        return info.name in _TIMES and [(one.ros_name, str(one.type)) for one in info.fields] == _TIME_FIELDS


def _scalar_columns(cls: type[Any], path: str, ops: list[Op], length: int | None = None) -> Iterator[Column]:
    """Yield the columns of all numbers, texts and times in a message class, except elements of arrays."""
    for field in cls._TYPE.fields:
        if field.type.arity is Arity.SCALAR:
            yield from _value_columns(field, f"{path}{field.ros_name}", [*ops, field.py_name], length)


def _value_columns(field: Any, name: str, ops: list[Op], length: int | None) -> Iterator[Column]:
    if field.cls is None:
        primitive = PRIMITIVES.get(field.type.base)
        yield Column(name, _combined(ops), "U" if primitive is None else primitive.numpy, length)
    elif Column.holds_time(field.cls):
        yield Column(name, _combined([*ops, stamp_ns]), "i8", length, True)
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
            raise FieldPathError(_unknown_path_text(cls, at, path, done))
        here = done + part
        ops.append(field.py_name)
        if field.type.arity is not Arity.SCALAR:
            if match[2] is None:
                if length is not None:
                    raise FieldPathError(f"{here}: a path must have at most one slice; pass an index")
                length = _slice(field, match, ops)
            else:
                ops.append(_index(field, int(match[2]), here))
        elif "[" in part:
            raise FieldPathError(f"{here}: {done}{field.ros_name} is a single {field.type.base} without elements")
        if number == len(parts):
            return list(_value_columns(field, path, ops, length))
        if field.cls is None:
            raise FieldPathError(f"{path}: {here} is {field.type.base}, which has no fields")
        at, done = field.cls, f"{here}."
    raise AssertionError(path)  # split() gives one part at least


def _index(field: Any, index: int, here: str) -> Get:
    if field.type.arity is Arity.ARRAY and not -field.type.capacity <= index < field.type.capacity:
        raise FieldPathError(f"{here}: the array has {field.type.capacity} elements")

    def element(values: Any) -> Any:
        try:
            return values[index]
        except IndexError:
            raise IndexError(len(values)) from None

    return element


def _slice(field: Any, match: re.Match[str], ops: list[Op]) -> int:
    """Append the operation for a slice of an array or sequence to `ops`.

    Returns the number of elements in the slice, or `VARIABLE_LENGTH`. Raises `FieldPathError` if the slice ends after a
    fixed array.
    """
    start, stop = (int(text) if text else None for text in (match[3], match[4]))
    if field.type.arity is Arity.ARRAY:
        begin, end, _ = slice(start, stop).indices(field.type.capacity)
        length = max(0, end - begin)
        if stop is not None and stop > field.type.capacity:
            raise FieldPathError(f"{match[0]}: the array has {field.type.capacity} elements")
    else:
        is_fixed = stop is not None and 0 <= (start or 0) <= stop
        length = (stop or 0) - (start or 0) if is_fixed else Column.VARIABLE_LENGTH
    ops.append(itemgetter(slice(start, stop)))
    return length


def _combined(ops: list[Op]) -> Get:
    """Return one function that applies a chain of operations.

    Operations after a slice (`itemgetter`) apply to each element.
    """
    at = next((number for number, op in enumerate(ops, 1) if isinstance(op, itemgetter)), len(ops))
    before, behind = _chain(ops[:at]), ops[at:]
    if not behind:
        return before
    rest = _chain(behind)
    return lambda message: [rest(element) for element in before(message)]


def _chain(ops: list[Op]) -> Get:
    """Return one function that applies a chain of operations without slices.

    Consecutive attributes use one `attrgetter`.
    """
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
        if field.cls is None or Column.holds_time(field.cls) or depth > 20:
            yield name
        else:
            yield from _path_names(field.cls, f"{name}.", depth + 1)
