"""Steps to read the messages of a class, many messages at a time.

A step reads one field of variable size, or a run of all fixed-size fields between two such. This module determines the
runs and the layout of a run for each position where it may begin; `batch_decoder` executes the steps. Nested messages
are read inline, as CDR has no boundary there.

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
    """Values of one field in a run."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int
    count: int


@dataclass(frozen=True, slots=True)
class FixedRun:
    """Run of fields of fixed size."""

    fields: tuple[RunField, ...]
    layouts: dict[int, np.dtype[np.void]] = field(default_factory=dict)

    def layout(self, position: int) -> np.dtype[np.void]:
        """Return the type of the whole run at a position modulo 8, where the first value is aligned."""
        if position not in self.layouts:
            offsets, end = [], position
            for one in self.fields:
                end = align_up(end, one.align)
                offsets.append(end - position)
                end += one.dtype.itemsize * one.count
            names = [f"f{number}" for number in range(len(offsets))]
            formats: list[Any] = [(one.dtype, (one.count,)) for one in self.fields]
            form: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": end - position}
            self.layouts[position] = np.dtype(form)
        return self.layouts[position]


@dataclass(frozen=True, slots=True)
class StringField:
    """String or wstring; inside of a list, `node` is that of the list."""

    node: ColumnNode


@dataclass(frozen=True, slots=True)
class NumberSequence:
    """Sequence of values without gaps: numbers, times, messages without fields."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int


@dataclass(frozen=True, slots=True)
class FixedMessageSequence:
    """Array or sequence of messages of fixed size."""

    node: ColumnNode
    codec: StructuredCodec


@dataclass(frozen=True, slots=True)
class VariableSequence:
    """Array or sequence of strings, or of messages that vary in size."""

    node: ColumnNode
    steps: tuple[ReadStep, ...]


ReadStep: TypeAlias = "FixedRun | StringField | NumberSequence | FixedMessageSequence | VariableSequence"


@cached_per_class
def read_program_for(cls: type[Any]) -> tuple[ReadStep, ...] | None:
    """Return the steps for a class; None if its messages must be read one by one."""
    try:
        program = tuple(_merge_runs(_steps(nodes_of(cls))))
        for step in program:
            if isinstance(step, FixedRun):
                step.layout(0)
    except (ValueError, OverflowError):  # too large for numpy
        return None
    return program or None


def _steps(nodes: tuple[ColumnNode, ...]) -> list[ReadStep]:
    steps: list[ReadStep] = []
    for node in nodes:
        if node.kind is Kind.STRUCT and node.length is None:
            steps += _steps(node.children)
        elif node.kind is Kind.STRING:
            steps.append(StringField(node) if node.length is None else VariableSequence(node, (StringField(node),)))
        elif node.kind is Kind.STRUCT:
            steps.append(_message_sequence(node))
        else:
            dtype = _dtype(node)
            align = TIME["sec"].itemsize if dtype is TIME else dtype.itemsize
            if node.length == VARIABLE_LENGTH:
                steps.append(NumberSequence(node, dtype, align))
            else:
                steps.append(FixedRun((RunField(node, dtype, align, node.length or 1),)))
    return steps


def _message_sequence(node: ColumnNode) -> ReadStep:
    assert node.field.cls is not None
    codec = find_structured_codec(node.field.cls)
    if codec is not None:
        return FixedMessageSequence(node, codec)
    steps = tuple(_merge_runs(_steps(node.children)))
    if all(isinstance(step, FixedRun) for step in steps):
        raise OverflowError("messages of fixed size are too large for numpy")
    return VariableSequence(node, steps)


def _dtype(node: ColumnNode) -> np.dtype[Any]:
    if node.kind is Kind.NUMBER:
        return _BYTE if node.code == "?" else DTYPES[node.code]  # the byte of a bool may have any value
    return _BYTE if node.kind is Kind.EMPTY else TIME


def _merge_runs(steps: list[ReadStep]) -> list[ReadStep]:
    merged: list[ReadStep] = []
    for step in steps:
        if merged and isinstance(step, FixedRun) and isinstance(merged[-1], FixedRun):
            merged[-1] = FixedRun(merged[-1].fields + step.fields)
        else:
            merged.append(step)
    return merged
