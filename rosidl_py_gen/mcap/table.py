"""Messages as a table: a column for each field that has a fixed size."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.fieldtype import PRIMITIVES, Arity
from rosidl_py_gen.mcap.common import BagError
from rosidl_py_gen.names import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rosidl_py_gen.cdr.message import Field
    from rosidl_py_gen.mcap.common import BagMessage

_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


def table(
    classes: Sequence[type[Any]], messages: Iterable[BagMessage], fields: Sequence[str] | None, where: str
) -> np.ndarray[Any, np.dtype[np.void]]:
    """A structured array; see `BagReader.to_arrays`."""
    known = dict(_columns(classes[0], "", ""))
    names = [name for name, (_, _, shape) in known.items() if not shape] if fields is None else list(fields)
    getters = {cls: _getters(dict(_columns(cls, "", "")), known, names, where) for cls in classes}
    rows = [(item.log_time, *(get(item.message) for get in getters[type(item.message)])) for item in messages]
    kinds: list[Any] = [("log_time", "i8")]
    for number, name in enumerate(names, 1):
        kind, shape = known[name][1:]
        if kind == "U":  # as long as the longest
            kind = f"U{max((len(row[number]) for row in rows), default=1) or 1}"
        kinds.append((name, kind, shape))
    return np.array(rows, dtype=kinds)


def _getters(
    columns: dict[str, Column], known: dict[str, Column], names: Sequence[str], where: str
) -> list[Callable[[Any], Any]]:
    """How messages of one definition give what all have; raises `BagError` where they do not."""
    for name in names:
        if name not in columns:
            raise BagError(
                f"{where}: no column {name}{did_you_mean(name, columns)}; there are {', '.join(columns)[:500]}"
            )
        if columns[name][1:] != known[name][1:]:
            raise BagError(f"{where}: {name} is of another kind in another definition of this topic; read `messages`")
    return [columns[name][0] for name in names]


Column = tuple["Callable[[Any], Any]", Any, tuple[int, ...]]


def _columns(cls: type[Any], path: str, attribute: str) -> Iterator[tuple[str, Column]]:
    """Path -> how to get it, its dtype and shape."""
    for field in cls._TYPE.fields:
        name, get = f"{path}{field.ros_name}", f"{attribute}{field.py_name}"
        if field.cls is not None:
            if field.type.arity is not Arity.SCALAR:
                continue
            if field.cls._TYPE.name in _TIMES:
                yield name, (_nanoseconds(get), "i8", ())
            else:
                yield from _columns(field.cls, f"{name}.", f"{get}.")
        elif (column := _plain(field, get)) is not None:
            yield name, column


def _plain(field: Field, get: str) -> Column | None:
    primitive = PRIMITIVES.get(field.type.base)
    if field.type.arity is Arity.SCALAR:
        return attrgetter(get), "U" if primitive is None else primitive.numpy, ()
    if field.type.arity is Arity.ARRAY and primitive is not None:
        return attrgetter(get), primitive.numpy, (field.type.capacity,)
    return None


def _nanoseconds(get: str) -> Callable[[Any], int]:
    stamp = attrgetter(get)

    def nanoseconds(message: Any) -> int:
        time = stamp(message)
        return int(time.sec) * 1_000_000_000 + int(time.nanosec)

    return nanoseconds
