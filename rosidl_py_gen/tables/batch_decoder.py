"""Decoder for many messages of one class at once, which applies numpy to all messages together.

The fields of a class are divided into steps. A step reads one field of variable size, or all fixed-size fields between
two such fields. Nested messages are read inline, as CDR has no boundary there (docs/internals/protocol.md 2.2).

A cursor has a position in every message, and a step moves all positions. Anything unexpected in one message raises
`BatchUnsupportedError`; the messages are then decoded one by one, which names the wrong byte. Valid but unusual data,
such as big-endian messages, may raise it too.

Positions are offsets into the joined data of all messages. Each message begins at a multiple of 8, so that alignment
counts from offset 4 as in a single message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rosidl_py_gen.bags import BagError
from rosidl_py_gen.base.field_columns import Column
from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.cdr.layout import Alignment, Count, Header, WStringUnit
from rosidl_py_gen.cdr.structured_arrays import StructuredCodec, cached_per_class
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import arrow_columns
from rosidl_py_gen.tables.arrow_columns import Kind, nodes_of

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.tables.arrow_columns import ColumnArrays, ColumnNode

    Ints: TypeAlias = NDArray[np.int64]
    Program: TypeAlias = Sequence["ReadStep"]
    Selected: TypeAlias = Collection[ColumnNode]

_TIME = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_BYTE = np.dtype("u1")
_WORD_SHIFT = Count.SIZE.bit_length() - 1
"""Number of bits by which a byte offset is shifted to get the index of its 4-byte word; a division of int64 arrays is
much slower."""
_SHORT_RANGE_BYTES = 24
"""Maximum average size in bytes of ranges that are collected from the data byte by byte, with an array of indices."""
_MAX_SEQUENTIAL_ELEMENTS = 8
"""Maximum length of lists with elements of varying size that are decoded although there are few such lists; with longer
lists the messages are decoded one by one."""
_MIN_PARALLEL_LISTS = 32
"""Minimum average number of lists for decoding longer lists: the n-th elements of all lists are then parsed together.
"""


class BatchUnsupportedError(RosidlError):
    """Error of messages that cannot be decoded together; the caller decodes them one by one."""


class BatchCursor:
    """Read positions `pos` in several messages, or in several elements of messages, each with the end `limit` of its
    data.
    """

    __slots__ = ("data", "limit", "octets", "pos", "words")

    def __init__(self, data: bytes | memoryview, pos: Ints, limit: Ints) -> None:
        self.data = data
        self.pos = pos
        self.limit = limit
        self.octets: NDArray[np.uint8] = np.frombuffer(data, np.uint8)
        self.words: NDArray[np.uint32] = np.frombuffer(data, "<u4", len(data) // 4)

    def at(self, pos: Ints, limit: Ints) -> BatchCursor:
        """Return a cursor in the same data with other positions and limits."""
        cursor = object.__new__(BatchCursor)
        cursor.data, cursor.octets, cursor.words = self.data, self.octets, self.words
        cursor.pos, cursor.limit = pos, limit
        return cursor

    def take(self, size: Ints | int, align: int) -> Ints:
        """Align all positions, return them, and move the cursor by `size` bytes.

        The returned positions are the offsets of the `size` bytes. Raises `BatchUnsupportedError` if a position exceeds
        its limit.
        """
        start: Ints = Header.align(self.pos, align) if align > 1 else self.pos
        self.pos = start + size
        if (self.pos > self.limit).any():
            raise BatchUnsupportedError
        return start

    def counts(self) -> Ints:
        """Return the unsigned 4-byte number at each position, and move each position to the byte after its number."""
        counts: Ints = self.words[self.take(Count.SIZE, Count.SIZE) >> _WORD_SHIFT].astype(np.int64)
        return counts


def concatenate(messages: Sequence[bytes | memoryview]) -> BatchCursor:
    """Join encoded messages, and return a cursor with the position after the header of each message.

    Raises `BatchUnsupportedError` for an unusual header.
    """
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    if len(messages) == 1:
        data: bytes | memoryview = messages[0]
    elif (sizes & Alignment.MAX - 1).any():
        pieces: list[bytes | memoryview] = [b""] * (2 * len(messages))
        pieces[::2] = messages
        pads = Alignment.PADDING[Alignment.MAX]
        pieces[1::2] = [pads[size] for size in (sizes & Alignment.MAX - 1).tolist()]
        data = b"".join(pieces)
    else:
        data = b"".join(messages)
    start = np.zeros(len(messages), np.int64)
    np.cumsum(Alignment.up(sizes[:-1], Alignment.MAX), out=start[1:])
    return cursor_at(data, start, sizes)


def cursor_at(data: bytes | memoryview, start: Ints, sizes: Ints) -> BatchCursor:
    """Return a cursor with the position after the header of each message in `data`.

    The messages start at multiples of 8. Raises `BatchUnsupportedError` for an unsupported header.
    """
    if (sizes < Header.SIZE).any():
        raise BatchUnsupportedError
    cursor = BatchCursor(data, start + Header.SIZE, start + sizes)
    if ((cursor.words[start >> _WORD_SHIFT] & 0xFFFF) != Header.VALUE).any():
        raise BatchUnsupportedError
    return cursor


def run(cursor: BatchCursor, program: Program, selected: Selected) -> ColumnArrays:
    """Decode all messages of a cursor with the steps of their class, and return the Arrow columns of the selected
    fields.

    Raises `BatchUnsupportedError` if the data is invalid or unusual, `BagError` if a column is too large for Arrow.
    """
    columns: ColumnArrays = {}
    for step in program:
        step.decode(cursor, selected, columns)
    return columns


# ---------------------------------------------------------------------------------------------------------------- steps


@dataclass(frozen=True, slots=True)
class RunField:
    """Field of fixed size that a `FixedRun` reads: its column, numpy type, alignment and number of values."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int
    count: int


@dataclass(frozen=True, slots=True)
class FixedRun:
    """Decoding step that reads consecutive fields of fixed size."""

    fields: tuple[RunField, ...]
    layouts: dict[int, np.dtype[np.void]] = field(default_factory=dict)

    def layout(self, position: int) -> np.dtype[np.void]:
        """Return the numpy type of the consecutive fields if they start at `position` modulo 8, where the first value
        is aligned.
        """
        if position not in self.layouts:
            offsets, end = [], position
            for one in self.fields:
                end = Alignment.up(end, one.align)
                offsets.append(end - position)
                end += one.dtype.itemsize * one.count
            names = [f"f{number}" for number in range(len(offsets))]
            formats: list[Any] = [(one.dtype, (one.count,)) for one in self.fields]
            form: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": end - position}
            self.layouts[position] = np.dtype(form)
        return self.layouts[position]

    def decode(self, cursor: BatchCursor, selected: Selected, columns: ColumnArrays) -> None:
        start = cursor.take(0, self.fields[0].align)
        phases = start - Header.SIZE & Alignment.MAX - 1
        phase = int(phases[0]) if len(phases) else 0
        groups: list[tuple[Any, np.dtype[np.void]]]
        if (phases == phase).all():
            groups = [(slice(None), self.layout(phase))]
            cursor.take(groups[0][1].itemsize, 1)
        else:
            groups = [(np.flatnonzero(phases == phase), self.layout(int(phase))) for phase in np.unique(phases)]
            size = np.empty(len(start), np.int64)
            for rows, layout in groups:
                size[rows] = layout.itemsize
            cursor.take(size, 1)
        fields = [(f"f{number}", one) for number, one in enumerate(self.fields) if one.node in selected]
        if not fields:
            return
        records = [gather_fixed(cursor, start[rows], layout.itemsize).view(layout) for rows, layout in groups]
        for name, one in fields:
            if len(groups) == 1:
                values = np.ascontiguousarray(records[0][name])
            else:
                values = np.empty((len(start), one.count), one.dtype)
                for (rows, _), group in zip(groups, records, strict=True):
                    values[rows] = group[name]
            columns[one.node] = arrow_columns.fixed(one.node, values)


@dataclass(frozen=True, slots=True)
class StringField:
    """Decoding step that reads a string or wstring; inside of a list, `node` is the column of the list."""

    node: ColumnNode

    def decode(self, cursor: BatchCursor, selected: Selected, columns: ColumnArrays) -> None:
        node, counts = self.node, cursor.counts()
        if node.field.type.base == "wstring":
            start = cursor.take(WStringUnit.SIZE * counts, 1)
            if node in selected:
                ranges = zip(start.tolist(), counts.tolist(), strict=True)
                texts = [_utf16_to_utf8(cursor, begin, count) for begin, count in ranges]
                octets = np.frombuffer(b"".join(texts), np.uint8)
                columns[node] = arrow_columns.texts(node, np.fromiter(map(len, texts), np.int64, len(texts)), octets)
            return
        start = cursor.take(counts, 1)
        last = cursor.octets[cursor.pos - 1]
        if last[counts > 0].any():  # no NUL
            raise BatchUnsupportedError
        if node in selected:
            size = np.maximum(counts - 1, 0)
            try:
                columns[node] = arrow_columns.texts(node, size, gather_ranges(cursor, start, size))
            except ValueError as error:
                if isinstance(error, BagError):
                    raise
                raise BatchUnsupportedError from None  # not UTF-8


@dataclass(frozen=True, slots=True)
class NumberSequence:
    """Decoding step that reads a sequence whose elements have no padding: numbers, times, messages without fields."""

    node: ColumnNode
    dtype: np.dtype[Any]
    align: int

    def decode(self, cursor: BatchCursor, selected: Selected, columns: ColumnArrays) -> None:
        counts = _element_counts(cursor, self.node)
        size = counts * self.dtype.itemsize
        if self.align > Count.SIZE:  # padding precedes the first element; an empty sequence has none
            cursor.pos = np.where(counts > 0, Header.align(cursor.pos, self.align), cursor.pos)
        start = cursor.take(size, 1)
        if self.node in selected:
            octets = gather_ranges(cursor, start, size)
            columns[self.node] = arrow_columns.sequences(self.node, counts, octets.view(self.dtype))


@dataclass(frozen=True, slots=True)
class FixedMessageSequence:
    """Decoding step that reads an array or sequence of messages of fixed size."""

    node: ColumnNode
    codec: StructuredCodec

    def decode(self, cursor: BatchCursor, selected: Selected, columns: ColumnArrays) -> None:
        node, codec, data = self.node, self.codec, cursor.data
        counts = _element_counts(cursor, node)
        pos, ends, pieces = cursor.pos.tolist(), cursor.limit.tolist(), []
        is_selected = node in selected
        try:
            for row, count in enumerate(counts.tolist()):
                if count:
                    begin, end = codec.element_range(pos[row], count)
                    if end > ends[row]:
                        raise BatchUnsupportedError
                    if is_selected:
                        pieces.append(codec.read_elements(data, begin, count, "<"))
                    pos[row] = end
        except (RosidlError, MemoryError):  # decoding one by one finds the wrong byte
            raise BatchUnsupportedError from None
        cursor.pos = np.array(pos, np.int64)
        if is_selected:
            if len(pieces) == 1:
                records = pieces[0]
            else:
                records = np.frombuffer(b"".join([piece.tobytes() for piece in pieces]), codec.dtype)
            columns[node] = arrow_columns.lists(node, counts, arrow_columns.from_records(node, records))


@dataclass(frozen=True, slots=True)
class VariableSequence:
    """Decoding step that reads an array or sequence of strings, or of messages that vary in size."""

    node: ColumnNode
    steps: tuple[ReadStep, ...]

    def decode(self, cursor: BatchCursor, selected: Selected, columns: ColumnArrays) -> None:
        node = self.node
        counts = _element_counts(cursor, node)
        starts = _element_starts(cursor, self.steps, counts)
        if node in selected:
            elements = run(cursor.at(starts, np.repeat(cursor.limit, counts)), self.steps, selected)
            columns[node] = arrow_columns.lists(node, counts, arrow_columns.assembled(node, elements, len(starts)))


ReadStep: TypeAlias = "FixedRun | StringField | NumberSequence | FixedMessageSequence | VariableSequence"


def _element_counts(cursor: BatchCursor, node: ColumnNode) -> Ints:
    """Return the number of elements of the list at each position, which sequences store before their elements.

    Raises `BatchUnsupportedError` for more elements than remaining bytes, as each element has at least one byte.
    """
    if node.length != Column.VARIABLE_LENGTH:
        assert node.length is not None
        counts = np.full(len(cursor.pos), node.length, np.int64)
    else:
        counts = cursor.counts()
        if node.field.type.capacity and (counts > node.field.type.capacity).any():
            raise BatchUnsupportedError
    if (counts > cursor.limit - cursor.pos).any():
        raise BatchUnsupportedError
    return counts


def gather_fixed(cursor: BatchCursor, start: Ints, size: int) -> NDArray[np.void]:
    """Return the `size` bytes at each start position; all bytes must be within the data."""
    count = max(0, len(cursor.data) - size + 1)
    windows: NDArray[np.void] = np.ndarray((count,), f"V{size}", cursor.data if count else None, 0, (1,))
    return windows[start]


def gather_ranges(cursor: BatchCursor, start: Ints, size: Ints) -> NDArray[np.uint8]:
    """Return the bytes of several ranges of the cursor's data, joined; all ranges must be within the data."""
    total, count = int(size.sum()), len(size)
    if not total:
        return np.empty(0, np.uint8)
    longest = int(size.max())
    if longest * count == total:  # equal sizes, as of frame names
        return gather_fixed(cursor, start, longest).view(np.uint8)
    if total <= _SHORT_RANGE_BYTES * count:
        shift = start - (np.cumsum(size) - size)
        return cursor.octets[np.repeat(shift, size) + np.arange(total)]
    view = memoryview(cursor.data)
    ends = (start + size).tolist()
    return np.frombuffer(b"".join([view[at:end] for at, end in zip(start.tolist(), ends, strict=True)]), np.uint8)


def _utf16_to_utf8(cursor: BatchCursor, start: int, count: int) -> bytes:
    first = start >> _WORD_SHIFT
    units = cursor.words[first : first + count]
    if count and units.max() > WStringUnit.MAX:
        raise BatchUnsupportedError
    try:
        return units.astype("<u2").tobytes().decode("utf-16-le").encode()
    except UnicodeError:
        raise BatchUnsupportedError from None


def _element_starts(cursor: BatchCursor, steps: Program, counts: Ints) -> Ints:
    """Return the start positions of all elements of the lists, and move the cursor to the end of each list."""
    total, longest = int(counts.sum()), int(counts.max(initial=0))
    if longest > 2:
        uniform = _uniform_element_starts(cursor, steps, counts)
        if uniform is not None:
            return uniform
        if longest > _MAX_SEQUENTIAL_ELEMENTS and total < _MIN_PARALLEL_LISTS * longest:
            raise BatchUnsupportedError
    starts = np.empty(total, np.int64)
    first = np.cumsum(counts) - counts
    pos = cursor.pos.copy()
    active = np.flatnonzero(counts)
    for number in range(longest):
        starts[first[active] + number] = pos[active]
        pos[active] = _end_positions(cursor, steps, pos[active], cursor.limit[active])
        active = active[counts[active] > number + 1]
    cursor.pos = pos
    return starts


def _end_positions(cursor: BatchCursor, steps: Program, pos: Ints, limit: Ints) -> Ints:
    inside = cursor.at(pos, limit)
    run(inside, steps, ())
    return inside.pos


def _uniform_element_starts(cursor: BatchCursor, steps: Program, counts: Ints) -> Ints | None:
    """Return the starts of all elements if all elements of a list, except for the first, have the same length.

    Returns None otherwise. The first two elements of every list are parsed, the starts of all others follow by
    arithmetic, and then all elements of all lists are parsed in one vectorized pass. The guess is right if each element
    ends where the next one starts.
    """
    rows = np.flatnonzero(counts)
    limit, each = cursor.limit[rows], counts[rows]
    try:
        first_end = _end_positions(cursor, steps, cursor.pos[rows], limit)
        second_end = first_end.copy()
        longer = each > 1
        second_end[longer] = _end_positions(cursor, steps, first_end[longer], limit[longer])
        first = np.cumsum(each) - each
        number = np.arange(int(each.sum())) - np.repeat(first, each)
        starts: Ints = np.repeat(first_end, each) + (number - 1) * np.repeat(second_end - first_end, each)
        starts[first] = cursor.pos[rows]
        limits = np.repeat(limit, each)
        if (starts > limits).any():
            return None
        ends = _end_positions(cursor, steps, starts, limits)
    except BatchUnsupportedError:
        return None
    is_last = np.zeros(len(starts), bool)
    is_last[first + each - 1] = True
    if (ends[:-1] != starts[1:])[~is_last[:-1]].any():
        return None
    cursor.pos = cursor.pos.copy()
    cursor.pos[rows] = ends[is_last]
    return starts


# ------------------------------------------------------------------------------------------------------------- programs


@cached_per_class
def read_program_for(cls: type[Any]) -> tuple[ReadStep, ...] | None:
    """Return the steps that decode many messages of a class together.

    Returns None if such messages must be decoded one by one.
    """
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
            align = _TIME["sec"].itemsize if dtype is _TIME else dtype.itemsize
            if node.length == Column.VARIABLE_LENGTH:
                steps.append(NumberSequence(node, dtype, align))
            else:
                steps.append(FixedRun((RunField(node, dtype, align, node.length or 1),)))
    return steps


def _message_sequence(node: ColumnNode) -> ReadStep:
    assert node.field.cls is not None
    codec = StructuredCodec.find(node.field.cls)
    if codec is not None:
        return FixedMessageSequence(node, codec)
    steps = tuple(_merge_runs(_steps(node.children)))
    if all(isinstance(step, FixedRun) for step in steps):
        raise OverflowError("messages of fixed size are too large for numpy")
    return VariableSequence(node, steps)


def _dtype(node: ColumnNode) -> np.dtype[Any]:
    if node.kind is Kind.NUMBER:
        return _BYTE if node.code == "?" else DTYPES[node.code]  # the byte of a bool may have any value
    return _BYTE if node.kind is Kind.EMPTY else _TIME


def _merge_runs(steps: list[ReadStep]) -> list[ReadStep]:
    merged: list[ReadStep] = []
    for step in steps:
        if merged and isinstance(step, FixedRun) and isinstance(merged[-1], FixedRun):
            merged[-1] = FixedRun(merged[-1].fields + step.fields)
        else:
            merged.append(step)
    return merged
