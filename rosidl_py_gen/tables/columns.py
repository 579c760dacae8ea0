"""Which columns a message class has: the tree that schema, reading and writing share.

Decides the names. Fields keep theirs, but `log_time` and `publish_time` are the bag's: a field that is called so gets
an underscore behind it, which ROS allows in no name. Decides too how many columns there may be: definitions in bags
are not trusted, and a few lines of them can mean any number of fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.cdr.structured_layout import cached_per_class

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from rosidl_py_gen.cdr.message import Field

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
MAX_COLUMNS = 10_000
_MOST_DEPTH = 60
_SHOWN_NAMES = 200
_TIMES = {"builtin_interfaces/msg/Time": "i", "builtin_interfaces/msg/Duration": "i"}
VARIABLE_LENGTH = -1
"""The length of sequences."""


class Kind(Enum):
    """What one value of a column is."""

    NUMBER = "number"
    STRING = "string"
    TIME = "time"
    DURATION = "duration"
    EMPTY = "empty"  # a message without fields
    STRUCT = "struct"


@dataclass(frozen=True, slots=True, eq=False)
class ColumnNode:
    """A field of a message as a column.

    Attributes:
        name: of the column.
        length: None for one value, the number of elements of a fixed array, `VARIABLE_LENGTH` for sequences.
        children: the fields of messages.
    """

    name: str
    field: Field
    kind: Kind
    length: int | None
    children: tuple[ColumnNode, ...] = ()

    @property
    def code(self) -> str:
        """Of `struct`, for numbers."""
        primitive = self.field.type.primitive
        assert primitive is not None
        return primitive.code

    @property
    def is_binary(self) -> bool:
        """Bytes are one value, not a list of numbers."""
        return self.kind is Kind.NUMBER and self.length is not None and self.code == "B"


def kind_of(field: Field) -> Kind:
    """Of one element."""
    if field.cls is None:
        return Kind.STRING if field.type.is_string else Kind.NUMBER
    if not field.cls._TYPE.fields:
        return Kind.EMPTY
    if field.type.base in _TIMES and _is_time(field.cls):
        return Kind.TIME if field.type.base.endswith("Time") else Kind.DURATION
    return Kind.STRUCT


def _is_time(cls: type[Any]) -> bool:
    """A bag may have a definition of this name that is another."""
    return [(one.ros_name, str(one.type)) for one in cls._TYPE.fields] == [("sec", "int32"), ("nanosec", "uint32")]


@cached_per_class
def column_count(cls: type[Any], depth: int = 0) -> int:
    """How many columns a class has, those of elements included; counted without making them."""
    if depth > _MOST_DEPTH:
        raise BagError(f"{cls._TYPE.name} is nested in more than {_MOST_DEPTH} messages, too many for a table")
    return sum(
        column_count(field.cls, depth + 1) if field.cls is not None and kind_of(field) is Kind.STRUCT else 1
        for field in cls._TYPE.fields
    )


@cached_per_class
def nodes_of(cls: type[Any]) -> tuple[ColumnNode, ...]:
    """The columns of a message class.

    Raises:
        BagError: there are more than `MAX_COLUMNS`, or they are nested too deeply.
    """
    count = column_count(cls)
    if count > MAX_COLUMNS:
        raise BagError(f"{cls._TYPE.name} has {count} columns; expected at most {MAX_COLUMNS}")
    names = {field.ros_name for field in cls._TYPE.fields}
    taken = LOG_TIME, PUBLISH_TIME
    return tuple(_node(field, free_name(field.ros_name, names, taken)) for field in cls._TYPE.fields)


def free_name(name: str, names: Collection[str], taken: Collection[str]) -> str:
    """The name of a column among others, with underscores behind it where it is taken."""
    found = name
    while found in taken or (found != name and found in names):
        found += "_"
    return found


def _node(field: Field, name: str) -> ColumnNode:
    kind, arity = kind_of(field), field.type.arity
    length = None if arity is Arity.SCALAR else field.type.capacity if arity is Arity.ARRAY else VARIABLE_LENGTH
    inner = field.cls._TYPE.fields if field.cls is not None and kind is Kind.STRUCT else ()
    return ColumnNode(name, field, kind, length, tuple(_node(one, one.ros_name) for one in inner))


# ------------------------------------------------------------------------------------------------------------ choosing


@dataclass(frozen=True, slots=True)
class SelectedColumn:
    """A column of a table: its name, and the nodes that lead to it."""

    name: str
    path: tuple[ColumnNode, ...]

    @property
    def node(self) -> ColumnNode:
        return self.path[-1]


def select_columns(cls: type[Any], columns: Iterable[str] | str | None) -> list[SelectedColumn]:
    """The columns that paths such as ``header.stamp`` mean, called as these; None means the fields.

    Raises:
        BagError: there is no such field, or it is inside the elements of a list; and as `nodes_of`.
    """
    nodes = nodes_of(cls)
    if columns is None:
        return [SelectedColumn(node.name, (node,)) for node in nodes]
    paths = [columns] if isinstance(columns, str) else list(dict.fromkeys(columns))
    return [_chosen(cls, nodes, path) for path in paths if path not in (LOG_TIME, PUBLISH_TIME)]


def _chosen(cls: type[Any], nodes: tuple[ColumnNode, ...], path: str) -> SelectedColumn:
    found: list[ColumnNode] = []
    if not isinstance(path, str):
        raise BagError(f"columns are paths as text, such as header.stamp; found {path!r:.50}")
    for part in path.split("."):
        if found and found[-1].length is not None:
            where = ".".join(node.name for node in found)
            raise BagError(f"{path}: {where} is a list of messages; take it whole: {where}")
        node = next((one for one in nodes if one.name == part), None)
        if node is None:
            raise BagError(_unknown(cls, path))
        found.append(node)
        nodes = node.children
    return SelectedColumn(path, tuple(found))


def _unknown(cls: type[Any], path: str) -> str:
    known = [name for name, _ in zip(_names(nodes_of(cls)), range(_SHOWN_NAMES), strict=False)]
    return f"no column {path:.100}{did_you_mean(path, known)}; there are {', '.join(known)[:500]}"


def _names(nodes: Iterable[ColumnNode], before: str = "") -> Iterator[str]:
    for node in nodes:
        yield before + node.name
        if node.length is None:
            yield from _names(node.children, f"{before}{node.name}.")
