"""Statements of generated encoders and decoders, as values; `templates/macros` has one macro for each `kind`.

Everything is decided here and in the two views: names, offsets, conditions. A macro only prints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple


class Load(NamedTuple):
    """Fetch a nested message or loop element and make sure of its class; `expression` empty: it is there already."""

    var: str
    expression: str
    cls: str
    kind: Literal["load"] = "load"


class LoadList(NamedTuple):
    """Fetch the messages of a sequence or array and make sure that they are in a list or tuple."""

    var: str
    expression: str
    kind: Literal["load_list"] = "load_list"


class LoadRecords(NamedTuple):
    """Fetch messages of fixed size, as `LoadList` does, or the structured array that may stand for them."""

    var: str
    expression: str
    kind: Literal["load_records"] = "load_records"


class IfElse(NamedTuple):
    """What is done when elements are, or shall be, a structured array, and what else."""

    condition: str
    body: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]
    kind: Literal["either"] = "either"


class Assign(NamedTuple):
    target: str
    expression: str
    kind: Literal["assign"] = "assign"


class CheckMaxLength(NamedTuple):
    """Refuse more than `most`."""

    number: str
    most: int
    kind: Literal["check_max_length"] = "check_max_length"


class CheckLength(NamedTuple):
    """Refuse another number than `wanted`."""

    number: str
    wanted: int
    kind: Literal["check_length"] = "check_length"


class CheckMaxLengths(NamedTuple):
    values: str
    most: int
    kind: Literal["check_max_lengths"] = "check_max_lengths"


class EmitBytes(NamedTuple):
    """Bytes that are appended now (in a function that collects parts)."""

    expression: str
    kind: Literal["part"] = "part"


class Write(NamedTuple):
    """A heavy nested message writes itself."""

    cls: str
    var: str
    kind: Literal["write"] = "write"


class Move(NamedTuple):
    """`pos` becomes, or grows by, `expression`."""

    operator: str
    expression: str
    var: str = "pos"
    kind: Literal["move"] = "move"


class Align(NamedTuple):
    """A position becomes `expression`, only `when` there is something to pad for (always if empty)."""

    var: str
    expression: str
    when: str
    kind: Literal["align"] = "align"


class Create(NamedTuple):
    """A nested message comes to be and is stored in its owner."""

    target: str
    var: str
    cls: str
    kind: Literal["create"] = "create"


class Unpack(NamedTuple):
    """Read a run; no targets: only for what the call does, such as making sure that the bytes are there."""

    targets: str
    call: str
    kind: Literal["unpack"] = "unpack"


class ReadText(NamedTuple):
    """Read a string whose characters begin at `start`; `nul` is the offset of its NUL, kept as `end`.

    `any_buffer`: `raw` may be a memoryview, which has no `decode`.
    """

    target: str
    start: str
    nul: str
    any_buffer: bool
    kind: Literal["read_text"] = "read_text"


class CheckHeader(NamedTuple):
    """Leave the fast path when the encapsulation header, read as `head`, is not that of little endian plain CDR.

    `value`: what `head` must be. `records`: the message has something to leave as a structured array when asked to.
    """

    value: int
    records: bool
    kind: Literal["check_header"] = "check_header"


class CheckRemaining(NamedTuple):
    """Refuse a count that the bytes left cannot hold."""

    end: str
    kind: Literal["check_remaining"] = "check_remaining"


class NewList(NamedTuple):
    target: str
    var: str
    cls: str
    list_type: str
    kind: Literal["new_list"] = "new_list"


class ReadHeavy(NamedTuple):
    """A heavy nested message reads itself; `records` as in `CheckHeader`."""

    target: str
    pos: str
    cls: str
    records: bool
    kind: Literal["read_outlined"] = "read_outlined"


class For(NamedTuple):
    var: str
    iterable: str
    body: tuple[Statement, ...]
    kind: Literal["loop"] = "loop"


class AppendElement(NamedTuple):
    """Append the element to its list."""

    values: str
    var: str
    kind: Literal["store"] = "store"


Statement = (
    Load | LoadList | LoadRecords | IfElse | Assign | CheckMaxLength | CheckLength | CheckMaxLengths | EmitBytes | Write
    | Move | Align | Create | Unpack | ReadText | CheckHeader | CheckRemaining | NewList | ReadHeavy | For
    | AppendElement
)  # fmt: skip


@dataclass(slots=True)
class Structs:
    """The precompiled struct functions of a module, each once."""

    entries: dict[tuple[str, str, int, bool], str]
    counts: dict[str, int]

    @staticmethod
    def new() -> Structs:
        return Structs({}, {})

    def name(self, role: str, code: str, align: int = 1, nul: bool = False) -> str:
        """`role` is pack, unpack_from or iter_unpack; align > 1 makes a table of eight, indexed by ``pos & 7``."""
        key = (role, code, align, nul)
        if key not in self.entries:
            prefix = {"pack": "_pack", "unpack_from": "_unpack", "iter_unpack": "_iter"}[role]
            number = self.counts.get(role, 0)
            self.counts[role] = number + 1
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
