"""In which steps the messages of a class are read, many messages at a time.

A step deals with one thing whose size varies, or with a run of all between two such. Decides what is one run, and
where its values lie for each of the positions it may begin at; `rows` does the reading. Messages in messages are read
in line, as CDR has no boundary there.

Source: docs/internals/protocol.md 2.2.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.cdr.layout import align_up
from rosidl_py_gen.cdr.structured_arrays import find_structured_codec
from rosidl_py_gen.cdr.structured_layout import cached_per_class
from rosidl_py_gen.tables.columns import VARIABLE_LENGTH, Kind, nodes_of

if TYPE_CHECKING:
    from rosidl_py_gen.cdr.structured_arrays import StructuredCodec
    from rosidl_py_gen.tables.columns import ColumnNode

TIME = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_BYTE = np.dtype("u1")


@dataclass(frozen=True, slots=True)
class RunField:
    """Values of one field that lie in a run."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int
    count: int


@dataclass(frozen=True, slots=True)
class RunLayout:
    """A run at one position: where it ends, and the dtype of all its values."""

    size: int
    dtype: np.dtype[np.void]


@dataclass(frozen=True, slots=True)
class FixedRun:
    """Values of fixed size."""

    leaves: tuple[RunField, ...]
    layouts: dict[int, RunLayout] = field(default_factory=dict)

    def layout(self, position: int) -> RunLayout:
        """At a position modulo 8 that the first value is aligned at."""
        found = self.layouts.get(position)
        if found is None:
            found = self.layouts[position] = self._layout(position)
        return found

    def _layout(self, position: int) -> RunLayout:
        offsets, at = [], position
        for leaf in self.leaves:
            at = align_up(at, leaf.align)
            offsets.append(at - position)
            at += leaf.dtype.itemsize * leaf.count
        names = [f"f{number}" for number in range(len(offsets))]
        formats: list[Any] = [(leaf.dtype, (leaf.count,)) for leaf in self.leaves]
        size = at - position
        return RunLayout(size, np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size}))


@dataclass(frozen=True, slots=True)
class StringField:
    """A string or wstring; of an element of a list where `node` is that of the list."""

    node: ColumnNode


@dataclass(frozen=True, slots=True)
class NumberSequence:
    """A sequence of what has no gaps: numbers, times, messages without fields."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int


@dataclass(frozen=True, slots=True)
class FixedMessageSequence:
    """An array or sequence of messages of fixed size."""

    node: ColumnNode
    known: StructuredCodec


@dataclass(frozen=True, slots=True)
class VariableSequence:
    """An array or sequence of strings, or of messages that vary in size."""

    node: ColumnNode
    steps: tuple[ReadStep, ...]


ReadStep: TypeAlias = "FixedRun | StringField | NumberSequence | FixedMessageSequence | VariableSequence"


@cached_per_class
def read_program_for(cls: type[Any]) -> tuple[ReadStep, ...] | None:
    """The steps for a class; None when it has to be read message by message."""
    try:
        found = tuple(_joined(_steps(nodes_of(cls))))
        for step in found:
            if isinstance(step, FixedRun):
                step.layout(0)
    except (_UnsuitedError, ValueError, OverflowError):  # too large for numpy
        return None
    return found or None


class _UnsuitedError(Exception):
    pass


def _steps(nodes: tuple[ColumnNode, ...]) -> list[ReadStep]:
    found: list[ReadStep] = []
    for node in nodes:
        if node.kind is Kind.STRUCT and node.length is None:
            found += _steps(node.children)
        elif node.kind is Kind.STRING:
            found.append(StringField(node) if node.length is None else VariableSequence(node, (StringField(node),)))
        elif node.kind is Kind.STRUCT:
            found.append(_of_messages(node))
        else:
            dtype = _dtype(node)
            align = TIME["sec"].itemsize if dtype is TIME else dtype.itemsize
            if node.length == VARIABLE_LENGTH:
                found.append(NumberSequence(node, dtype, align))
            else:
                found.append(FixedRun((RunField(node, dtype, align, node.length or 1),)))
    return found


def _of_messages(node: ColumnNode) -> ReadStep:
    cls = node.field.cls
    assert cls is not None
    known = find_structured_codec(cls)
    if known is not None:
        return FixedMessageSequence(node, known)
    steps = tuple(_joined(_steps(node.children)))
    if all(isinstance(step, FixedRun) for step in steps):  # of fixed size, and too large for numpy
        raise _UnsuitedError
    return VariableSequence(node, steps)


def _dtype(node: ColumnNode) -> np.dtype[Any]:
    if node.kind is Kind.NUMBER:
        return _BYTE if node.code == "?" else DTYPES[node.code]  # bools may be any byte
    return _BYTE if node.kind is Kind.EMPTY else TIME


def _joined(steps: list[ReadStep]) -> list[ReadStep]:
    """Runs that follow each other as one."""
    found: list[ReadStep] = []
    for step in steps:
        if found and isinstance(step, FixedRun) and isinstance(found[-1], FixedRun):
            found[-1] = FixedRun(found[-1].leaves + step.leaves)
        else:
            found.append(step)
    return found
