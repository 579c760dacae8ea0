"""The statements of generated encoders and decoders: each function gives the lines of one, without indentation.

What they say is decided in the two views: names, offsets, conditions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


def load(var: str, expression: str, cls: str) -> list[str]:
    """Fetch a nested message or loop element and make sure of its class; `expression` empty: it is there already."""
    fetch = assign(var, expression) if expression else []
    return [*fetch, f"if type({var}) is not {cls}:", f"    expect({var}, {cls})"]


def load_list(var: str, expression: str) -> list[str]:
    """Fetch the messages of a sequence or array and make sure that they are in a list or tuple."""
    return [f"{var} = {expression}", f"if type({var}) is not list:", f"    expect_list({var})"]


def load_records(var: str, expression: str) -> list[str]:
    """The same for messages of fixed size, for which a structured array may stand too."""
    return [f"{var} = {expression}", f"if type({var}) is not list:", f"    {var} = list_or_records({var})"]


def either(condition: str, body: Sequence[str], otherwise: Sequence[str]) -> list[str]:
    """What is done when elements are, or shall be, a structured array, and what else."""
    return [*_block(f"if {condition}:", body), *_block("else:", otherwise)]


def loop(var: str, iterable: str, body: Sequence[str]) -> list[str]:
    """A body for each element."""
    return _block(f"for {var} in {iterable}:", body)


def assign(target: str, expression: str) -> list[str]:
    """An assignment."""
    return [f"{target} = {expression}"]


def limit(count: str, most: int) -> list[str]:
    """Refuse more than `most`."""
    return [f"if {count} > {most}:", f"    limit({count}, {most})"]


def exactly(count: str, wanted: int) -> list[str]:
    """Refuse another number than `wanted`."""
    return [f"if {count} != {wanted}:", f"    exactly({count}, {wanted})"]


def limit_each(values: str, most: int) -> list[str]:
    """Refuse elements longer than `most`."""
    return [f"limit_each({values}, {most})"]


def part(expression: str) -> list[str]:
    """Bytes that are appended now (in a function that collects parts)."""
    return [f"append({expression})"]


def write(cls: str, var: str) -> list[str]:
    """A heavy nested message writes itself."""
    return [f"pos = {cls}._write({var}, append, pos)"]


def move(operator: str, expression: str, var: str = "pos") -> list[str]:
    """A position becomes, or grows by, `expression`."""
    return [f"{var} {operator} {expression}"]


def align(var: str, expression: str, when: str) -> list[str]:
    """A position becomes `expression`, only `when` there is something to pad for (always if empty)."""
    return _block(f"if {when}:", assign(var, expression)) if when else assign(var, expression)


def create(target: str, var: str, cls: str) -> list[str]:
    """A nested message comes to be and is stored in its owner."""
    return [f"{target} = {var} = new({cls})"]


def unpack(targets: str, call: str) -> list[str]:
    """Read a run; no targets: only for what the call does, such as making sure that the bytes are there."""
    return [f"{targets} = {call}" if targets else call]


def read_text(target: str, start: str, nul: str, any_buffer: bool) -> list[str]:
    """Read a string whose characters begin at `start`; `nul` is the offset of its NUL, kept as `end`.

    `any_buffer`: `raw` may be a memoryview, which has no `decode`.
    """
    text = f'str(raw[{start}:end], "utf-8")' if any_buffer else f"raw[{start}:end].decode()"
    check = ["if raw[end]:", '    raise ValueError("a string does not end in NUL")']
    return [f"end = {nul}", *check, f"{target} = {text}"]


def check_header(records: bool) -> list[str]:
    """Leave the fast path when the encapsulation header, read as `head`, is not that of little endian plain CDR.

    `records`: the message has something to leave as a structured array when asked to.
    """
    arguments = "cls, data, copy, None, arrays" if records else "cls, data, copy"
    return ["if head != 256:  # the bytes 00 01", f"    return recover_decode({arguments})"]


def within(end: str) -> list[str]:
    """Refuse a count that the bytes left cannot hold."""
    return [f"within({end}, raw)"]


def new_list(target: str, var: str, cls: str) -> list[str]:
    """An empty list comes to be and is stored in its owner."""
    return [f"{var}: list[{cls}] = []", f"{target} = {var}"]


def read_heavy(target: str, pos: str, cls: str, records: bool) -> list[str]:
    """A heavy nested message reads itself; `records` as in `check_header`."""
    return [f"{target}, {pos} = {cls}._read(raw, view, pos{', arrays' if records else ''})"]


def store(values: str, var: str) -> list[str]:
    """Append the element to its list."""
    return [f"{values}.append({var})"]


def _block(head: str, body: Iterable[str]) -> list[str]:
    return [head, *(f"    {line}" for line in body)]


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
