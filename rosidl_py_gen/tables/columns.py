"""Columns of a message class: the tree that schema, reading and writing share.

Columns have the names of fields. `log_time` and `publish_time` are the times of the bag: a field of that name gets a
trailing underscore, which ROS does not allow in names. The number of columns is limited, because definitions in bags
are not trusted, and a few lines of them can mean any number of fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.field_columns import MAX_COLUMNS, VARIABLE_LENGTH, is_time
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.cdr.structured_layout import cached_per_class

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from rosidl_py_gen.cdr.message import Field


class Kind(Enum):
    """Kind of a single value of a column."""

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
    """Field of a message as a column.

    Attributes:
        name: name of the column.
        length: None for a single value, number of elements of a fixed array, `VARIABLE_LENGTH` for sequences.
        children: fields of a nested message.
    """

    name: str
    field: Field
    kind: Kind
    length: int | None
    children: tuple[ColumnNode, ...] = ()

    @property
    def code(self) -> str:
        """Struct code of numbers."""
        primitive = self.field.type.primitive
        assert primitive is not None
        return primitive.code

    @property
    def is_binary(self) -> bool:
        """True for bytes, which are one value, not a list of numbers."""
        return self.kind is Kind.NUMBER and self.length is not None and self.code == "B"


def kind_of(field: Field) -> Kind:
    """Return the kind of a single element."""
    if field.cls is None:
        return Kind.STRING if field.type.is_string else Kind.NUMBER
    if not field.cls._TYPE.fields:
        return Kind.EMPTY
    return _TIME_KINDS[field.type.base] if is_time(field.cls) else Kind.STRUCT


@cached_per_class
def column_count(cls: type[Any], depth: int = 0) -> int:
    """Return the number of columns of a class, those of elements included, without making them."""
    if depth > _MAX_DEPTH:
        raise BagError(f"{cls._TYPE.name} is nested too deeply for a table; expected at most {_MAX_DEPTH} levels")
    return sum(
        column_count(field.cls, depth + 1) if field.cls is not None and kind_of(field) is Kind.STRUCT else 1
        for field in cls._TYPE.fields
    )


@cached_per_class
def nodes_of(cls: type[Any]) -> tuple[ColumnNode, ...]:
    """Return the columns of a message class; raises `BagError` for too many, or if they are nested too deeply."""
    count = column_count(cls)
    if count > MAX_COLUMNS:
        raise BagError(f"{cls._TYPE.name} has {count} columns; expected at most {MAX_COLUMNS}")
    names = {field.ros_name for field in cls._TYPE.fields}
    reserved = LOG_TIME, PUBLISH_TIME
    return tuple(_node(field, free_name(field.ros_name, names, reserved)) for field in cls._TYPE.fields)


def free_name(name: str, names: Collection[str], reserved: Collection[str]) -> str:
    """Return the name of a column, with underscores appended while it is reserved or used."""
    result = name
    while result in reserved or (result != name and result in names):
        result += "_"
    return result


def _node(field: Field, name: str) -> ColumnNode:
    kind, arity = kind_of(field), field.type.arity
    length = None if arity is Arity.SCALAR else field.type.capacity if arity is Arity.ARRAY else VARIABLE_LENGTH
    inner = field.cls._TYPE.fields if field.cls is not None and kind is Kind.STRUCT else ()
    return ColumnNode(name, field, kind, length, tuple(_node(one, one.ros_name) for one in inner))


# ----------------------------------------------------------------------------------------------------------- selection


@dataclass(frozen=True, slots=True)
class SelectedColumn:
    """Column of a table: its name, and the nodes on its path."""

    name: str
    path: tuple[ColumnNode, ...]

    @property
    def node(self) -> ColumnNode:
        return self.path[-1]


def select_columns(cls: type[Any], columns: Iterable[str] | str | None) -> list[SelectedColumn]:
    """Return the columns that paths such as ``header.stamp`` select, named like the paths; None selects the fields.

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
