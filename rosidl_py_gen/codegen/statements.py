"""Statements of generated encoders and decoders, as values; `templates/macros` has one macro for each `kind`.

Everything is decided here and in the two views: names, offsets, conditions. A macro only prints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True, slots=True)
class Load:
    """Fetch a nested message or loop element and make sure of its class; `expression` empty: it is there already."""

    kind: ClassVar[str] = "load"
    var: str
    expression: str
    cls: str


@dataclass(frozen=True, slots=True)
class LoadList:
    """Fetch the messages of a sequence or array and make sure that they are in a list or tuple."""

    kind: ClassVar[str] = "load_list"
    var: str
    expression: str


@dataclass(frozen=True, slots=True)
class LoadRecords:
    """The same for messages of fixed size, for which a structured array may stand too."""

    kind: ClassVar[str] = "load_records"
    var: str
    expression: str


@dataclass(frozen=True, slots=True)
class Either:
    """What is done when elements are, or shall be, a structured array, and what else."""

    kind: ClassVar[str] = "either"
    condition: str
    body: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Assign:
    kind: ClassVar[str] = "assign"
    target: str
    expression: str


@dataclass(frozen=True, slots=True)
class Limit:
    """Refuse more than `most`."""

    kind: ClassVar[str] = "limit"
    count: str
    most: int


@dataclass(frozen=True, slots=True)
class Exactly:
    """Refuse another number than `wanted`."""

    kind: ClassVar[str] = "exactly"
    count: str
    wanted: int


@dataclass(frozen=True, slots=True)
class LimitEach:
    kind: ClassVar[str] = "limit_each"
    values: str
    most: int


@dataclass(frozen=True, slots=True)
class Part:
    """Bytes that are appended now (in a function that collects parts)."""

    kind: ClassVar[str] = "part"
    expression: str


@dataclass(frozen=True, slots=True)
class Write:
    """A heavy nested message writes itself."""

    kind: ClassVar[str] = "write"
    cls: str
    var: str


@dataclass(frozen=True, slots=True)
class Move:
    """`pos` becomes, or grows by, `expression`."""

    kind: ClassVar[str] = "move"
    operator: str
    expression: str
    var: str = "pos"


@dataclass(frozen=True, slots=True)
class Align:
    """A position becomes `expression`, only `when` there is something to pad for (always if empty)."""

    kind: ClassVar[str] = "align"
    var: str
    expression: str
    when: str


@dataclass(frozen=True, slots=True)
class Create:
    """A nested message comes to be and is stored in its owner."""

    kind: ClassVar[str] = "create"
    target: str
    var: str
    cls: str


@dataclass(frozen=True, slots=True)
class Unpack:
    """Read a run; no targets: only for what the call does, such as making sure that the bytes are there."""

    kind: ClassVar[str] = "unpack"
    targets: str
    call: str


@dataclass(frozen=True, slots=True)
class ReadText:
    """Read a string whose characters begin at `start`; `nul` is the offset of its NUL, kept as `end`.

    `any_buffer`: `raw` may be a memoryview, which has no `decode`.
    """

    kind: ClassVar[str] = "read_text"
    target: str
    start: str
    nul: str
    any_buffer: bool


@dataclass(frozen=True, slots=True)
class CheckHeader:
    """Leave the fast path when the encapsulation header, read as `head`, is not that of little endian plain CDR.

    `records`: the message has something to leave as a structured array when asked to.
    """

    kind: ClassVar[str] = "check_header"
    records: bool


@dataclass(frozen=True, slots=True)
class Within:
    """Refuse a count that the bytes left cannot hold."""

    kind: ClassVar[str] = "within"
    end: str


@dataclass(frozen=True, slots=True)
class NewList:
    kind: ClassVar[str] = "new_list"
    target: str
    var: str
    cls: str
    list_type: str


@dataclass(frozen=True, slots=True)
class ReadHeavy:
    """A heavy nested message reads itself; `records` as in `CheckHeader`."""

    kind: ClassVar[str] = "read_heavy"
    target: str
    pos: str
    cls: str
    records: bool


@dataclass(frozen=True, slots=True)
class For:
    kind: ClassVar[str] = "loop"
    var: str
    iterable: str
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Store:
    """Append the element to its list."""

    kind: ClassVar[str] = "store"
    values: str
    var: str


Statement = (
    Load | LoadList | LoadRecords | Either | Assign | Limit | Exactly | LimitEach | Part | Write | Move | Align
    | Create | Unpack | ReadText | CheckHeader | Within | NewList | ReadHeavy | For | Store
)  # fmt: skip


@dataclass(slots=True)
class Structs:
    """The precompiled struct functions of a module, each once."""

    entries: dict[tuple[str, str, int, bool], str]

    @staticmethod
    def new() -> Structs:
        return Structs({})

    def name(self, role: str, code: str, align: int = 1, nul: bool = False) -> str:
        """`role` is pack, unpack_from or iter_unpack; align > 1 makes a table of eight, indexed by ``pos & 7``."""
        key = (role, code, align, nul)
        if key not in self.entries:
            prefix = {"pack": "_pack", "unpack_from": "_unpack", "iter_unpack": "_iter"}[role]
            number = sum(1 for known in self.entries if known[0] == role)
            self.entries[key] = f"{prefix}_{number}"
        return self.entries[key]

    def __iter__(self) -> Iterator[tuple[str, str, str, int, bool]]:
        for (role, code, align, nul), name in self.entries.items():
            yield name, role, code, align, nul


NUMPY_FIXED = {
    "?": "fixed_bools", "b": "fixed_int8s", "B": "fixed_uint8s", "h": "fixed_int16s", "H": "fixed_uint16s",
    "i": "fixed_int32s", "I": "fixed_uint32s", "q": "fixed_int64s", "Q": "fixed_uint64s",
    "f": "fixed_float32s", "d": "fixed_float64s",
}  # fmt: skip
NUMPY_DTYPE = {
    "b": "INT8", "B": "UINT8", "h": "INT16", "H": "UINT16", "i": "INT32", "I": "UINT32", "q": "INT64", "Q": "UINT64",
    "f": "FLOAT32", "d": "FLOAT64",
}  # fmt: skip


def plus(expression: str, number: int) -> str:
    """``expression + number``, folded when both are known."""
    if number == 0:
        return expression
    return str(int(expression) + number) if expression.isdigit() else f"{expression} + {number}"
