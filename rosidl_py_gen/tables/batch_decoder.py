"""Many messages of one class read at once: each step of their program for all of them, with numpy.

A cursor has a position in every message; a step moves all of them. Whatever is not as it should be in any of the
messages ends the reading with `BatchUnsupportedError`, and they are read one by one instead, which names the wrong
byte. So this knows what is right, and no errors; it may refuse what is right but unusual, such as big-endian data.

Positions are offsets into the data of all messages, each of which begins at a multiple of 8, so that alignment counts
from offset 4 as it does in one message.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.cdr.arrays import FieldValueError
from rosidl_py_gen.cdr.layout import (
    COUNT_BYTES,
    HEADER_BYTES,
    HEADER_VALUE,
    MAX_ALIGN,
    MAX_WSTRING_UNIT,
    PADDING,
    WSTRING_UNIT_BYTES,
    align_offset,
    align_up,
)
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import arrow_builders
from rosidl_py_gen.tables.columns import VARIABLE_LENGTH
from rosidl_py_gen.tables.read_program import (
    FixedMessageSequence,
    FixedRun,
    NumberSequence,
    ReadStep,
    StringField,
    VariableSequence,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.tables.arrow_builders import Built
    from rosidl_py_gen.tables.columns import ColumnNode

    Ints: TypeAlias = NDArray[np.int64]
    Program: TypeAlias = Sequence[ReadStep]

_WORD_SHIFT = COUNT_BYTES.bit_length() - 1
"""Turns an offset into an index of 4-byte words; a shift of int64 arrays takes a fraction of the time of a division."""
_SHORT_RANGE_BYTES = 24
"""Parts of up to so many bytes on average are gathered byte by byte."""
_MAX_SEQUENTIAL_ELEMENTS, _MIN_PARALLEL_LISTS = 8, 32
"""Elements that vary in size are found one behind the other, in lists of few or in many lists at once."""


class BatchUnsupportedError(RosidlError):
    """Read them one by one."""


class BatchCursor:
    """A position in each of several messages, or of several elements of messages.

    Attributes:
        pos: where each is.
        limit: where the message ends that each is in.
    """

    __slots__ = ("data", "limit", "octets", "pos", "words")

    def __init__(self, data: bytes | memoryview, pos: Ints, limit: Ints) -> None:
        self.data = data
        self.pos = pos
        self.limit = limit
        self.octets: NDArray[np.uint8] = np.frombuffer(data, np.uint8)
        self.words: NDArray[np.uint32] = np.frombuffer(data, "<u4", len(data) // 4)

    def at(self, pos: Ints, limit: Ints) -> BatchCursor:
        """The same data at other positions."""
        made = object.__new__(BatchCursor)
        made.data, made.octets, made.words = self.data, self.octets, self.words
        made.pos, made.limit = pos, limit
        return made

    def take(self, size: Ints | int, align: int) -> Ints:
        """Claim bytes in each, and return where they begin."""
        start: Ints = align_offset(self.pos, align) if align > 1 else self.pos
        self.pos = start + size
        if (self.pos > self.limit).any():
            raise BatchUnsupportedError
        return start

    def counts(self) -> Ints:
        """An unsigned number of four bytes from each."""
        counts: Ints = self.words[self.take(COUNT_BYTES, COUNT_BYTES) >> _WORD_SHIFT].astype(np.int64)
        return counts


def concatenate(messages: Sequence[bytes | memoryview]) -> BatchCursor:
    """A cursor behind the header of each message. Raises `BatchUnsupportedError`."""
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    if len(messages) == 1:
        data: bytes | memoryview = messages[0]
    elif (sizes & MAX_ALIGN - 1).any():
        parts: list[bytes | memoryview] = [b""] * (2 * len(messages))
        parts[::2] = messages
        pads = PADDING[MAX_ALIGN]
        parts[1::2] = [pads[size] for size in (sizes & MAX_ALIGN - 1).tolist()]
        data = b"".join(parts)
    else:
        data = b"".join(messages)
    start = np.zeros(len(messages), np.int64)
    np.cumsum(align_up(sizes[:-1], MAX_ALIGN), out=start[1:])
    return cursor_at(data, start, sizes)


def cursor_at(data: bytes | memoryview, start: Ints, sizes: Ints) -> BatchCursor:
    """A cursor behind the header of each message, which begin at multiples of 8. Raises `BatchUnsupportedError`."""
    if (sizes < HEADER_BYTES).any():
        raise BatchUnsupportedError
    cursor = BatchCursor(data, start + HEADER_BYTES, start + sizes)
    if ((cursor.words[start >> _WORD_SHIFT] & 0xFFFF) != HEADER_VALUE).any():
        raise BatchUnsupportedError
    return cursor


def run(cursor: BatchCursor, program: Program, wanted: Collection[ColumnNode]) -> Built:
    """Move the cursor behind all steps, and return the columns of the wanted nodes.

    Raises:
        BatchUnsupportedError: something is wrong or unusual. BagError: a column is too large for Arrow.
    """
    found: Built = {}
    for step in program:
        if isinstance(step, FixedRun):
            _run(cursor, step, wanted, found)
        elif isinstance(step, StringField):
            _text(cursor, step, wanted, found)
        elif isinstance(step, NumberSequence):
            _many(cursor, step, wanted, found)
        elif isinstance(step, FixedMessageSequence):
            _records(cursor, step, wanted, found)
        else:
            _each(cursor, step, wanted, found)
    return found


# ------------------------------------------------------------------------------------------------------- of fixed size


def _run(cursor: BatchCursor, step: FixedRun, wanted: Collection[ColumnNode], found: Built) -> None:
    start = cursor.take(0, step.leaves[0].align)
    if not len(start):
        for leaf in step.leaves:
            if leaf.node in wanted:
                found[leaf.node] = arrow_builders.fixed(leaf.node, np.empty((0, leaf.count), leaf.dtype))
        return
    phases = (start - HEADER_BYTES) & MAX_ALIGN - 1
    first = int(phases[0])
    if (phases == first).all():
        layout = step.layout(first)
        cursor.take(layout.size, 1)
        leaves = [leaf.node in wanted for leaf in step.leaves]
        if not any(leaves):
            return
        rows = gather_fixed(cursor, start, layout.size).view(layout.dtype)
        for number, leaf in enumerate(step.leaves):
            if leaves[number]:
                found[leaf.node] = arrow_builders.fixed(leaf.node, np.ascontiguousarray(rows[f"f{number}"]))
        return
    groups = [(np.flatnonzero(phases == phase), step.layout(int(phase))) for phase in np.unique(phases)]
    size = np.empty(len(start), np.int64)
    for rows_of, layout in groups:
        size[rows_of] = layout.size
    cursor.take(size, 1)
    for number, leaf in enumerate(step.leaves):
        if leaf.node not in wanted:
            continue
        values = np.empty((len(start), leaf.count), leaf.dtype)
        for rows_of, layout in groups:
            offset = layout.dtype.fields[f"f{number}"][1]  # type: ignore[index]
            taken = gather_fixed(cursor, start[rows_of] + offset, leaf.count * leaf.dtype.itemsize)
            values[rows_of] = taken.view(leaf.dtype).reshape(len(rows_of), leaf.count)
        found[leaf.node] = arrow_builders.fixed(leaf.node, values)


def gather_fixed(cursor: BatchCursor, start: Ints, size: int) -> NDArray[np.void]:
    """So many bytes from each place, which are known to be there."""
    every: NDArray[np.void] = np.ndarray((len(cursor.data) - size + 1,), f"V{size}", cursor.data, 0, (1,))
    return every[start]


def _records(cursor: BatchCursor, step: FixedMessageSequence, wanted: Collection[ColumnNode], found: Built) -> None:
    node, known, data = step.node, step.known, cursor.data
    counts = _element_counts(cursor, node)
    pos, ends, parts = cursor.pos.tolist(), cursor.limit.tolist(), []
    is_wanted = node in wanted
    try:
        for row, count in enumerate(counts.tolist()):
            if count:
                begin, end = known.element_range(pos[row], count)
                if end > ends[row]:
                    raise BatchUnsupportedError
                if is_wanted:
                    parts.append(known.read_elements(data, begin, count, "<"))
                pos[row] = end
    except (FieldValueError, MemoryError):
        raise BatchUnsupportedError from None
    cursor.pos = np.array(pos, np.int64)
    if is_wanted:
        whole = parts[0] if len(parts) == 1 else np.frombuffer(b"".join([one.tobytes() for one in parts]), known.dtype)
        found[node] = arrow_builders.lists(node, counts, arrow_builders.from_records(node, whole))


# -------------------------------------------------------------------------------------------------------- that vary


def _element_counts(cursor: BatchCursor, node: ColumnNode) -> Ints:
    """How many elements each list has; not more than there are bytes left, as each takes one at least."""
    if node.length != VARIABLE_LENGTH:
        assert node.length is not None
        counts = np.full(len(cursor.pos), node.length, np.int64)
    else:
        counts = cursor.counts()
        if node.field.type.capacity and (counts > node.field.type.capacity).any():
            raise BatchUnsupportedError
    if (counts > cursor.limit - cursor.pos).any():
        raise BatchUnsupportedError
    return counts


def _many(cursor: BatchCursor, step: NumberSequence, wanted: Collection[ColumnNode], found: Built) -> None:
    counts = _element_counts(cursor, step.node)
    size = counts * step.dtype.itemsize
    if step.align > COUNT_BYTES:  # padding is before the first element, and without one there is none
        cursor.pos = np.where(counts > 0, align_offset(cursor.pos, step.align), cursor.pos)
    start = cursor.take(size, 1)
    if step.node in wanted:
        octets = gather_ranges(cursor, start, size)
        found[step.node] = arrow_builders.sequences(step.node, counts, octets.view(step.dtype))


def _text(cursor: BatchCursor, step: StringField, wanted: Collection[ColumnNode], found: Built) -> None:
    counts = cursor.counts()
    is_wide = step.node.field.type.base == "wstring"
    start = cursor.take(WSTRING_UNIT_BYTES * counts if is_wide else counts, 1)
    if is_wide:
        if step.node in wanted:
            texts = [
                _utf16_to_utf8(cursor, at, count) for at, count in zip(start.tolist(), counts.tolist(), strict=True)
            ]
            octets = np.frombuffer(b"".join(texts), np.uint8)
            found[step.node] = arrow_builders.texts(
                step.node, np.fromiter(map(len, texts), np.int64, len(texts)), octets
            )
        return
    last = cursor.octets[cursor.pos - 1]
    if last[counts > 0].any():  # no NUL
        raise BatchUnsupportedError
    if step.node in wanted:
        size = np.maximum(counts - 1, 0)
        try:
            found[step.node] = arrow_builders.texts(step.node, size, gather_ranges(cursor, start, size))
        except ValueError as error:
            if isinstance(error, BagError):
                raise
            raise BatchUnsupportedError from None  # no UTF-8


def _utf16_to_utf8(cursor: BatchCursor, start: int, count: int) -> bytes:
    first = start >> _WORD_SHIFT
    units = cursor.words[first : first + count]
    if count and units.max() > MAX_WSTRING_UNIT:
        raise BatchUnsupportedError
    try:
        return units.astype("<u2").tobytes().decode("utf-16-le").encode()
    except UnicodeError:
        raise BatchUnsupportedError from None


def gather_ranges(cursor: BatchCursor, start: Ints, size: Ints) -> NDArray[np.uint8]:
    """The bytes of several parts, which are known to be there, behind each other."""
    total, count = int(size.sum()), len(size)
    if not total:
        return np.empty(0, np.uint8)
    longest = int(size.max())
    if longest * count == total:  # all alike, as names of frames are
        return gather_fixed(cursor, start, longest).view(np.uint8)
    if total <= _SHORT_RANGE_BYTES * count:
        shift = start - (np.cumsum(size) - size)
        return cursor.octets[np.repeat(shift, size) + np.arange(total)]
    view = memoryview(cursor.data)
    ends = (start + size).tolist()
    return np.frombuffer(b"".join([view[at:end] for at, end in zip(start.tolist(), ends, strict=True)]), np.uint8)


def _each(cursor: BatchCursor, step: VariableSequence, wanted: Collection[ColumnNode], found: Built) -> None:
    node = step.node
    counts = _element_counts(cursor, node)
    starts = _element_starts(cursor, step.steps, counts)
    if node not in wanted:
        return
    inside = cursor.at(starts, np.repeat(cursor.limit, counts))
    built = run(inside, step.steps, _Everything())
    children = built[node] if isinstance(step.steps[0], StringField) and step.steps[0].node is node else None
    if children is None:
        children = arrow_builders.struct(
            node, [arrow_builders.assembled(child, built, len(starts)) for child in node.children]
        )
    found[node] = arrow_builders.lists(node, counts, children)


class _Everything:
    """Holds every node: of elements, all fields are wanted."""

    def __contains__(self, node: object) -> bool:
        return True

    def __iter__(self) -> Iterator[ColumnNode]:
        return iter(())

    def __len__(self) -> int:
        return 0


def _element_starts(cursor: BatchCursor, steps: Program, counts: Ints) -> Ints:
    """Where all elements begin; moves the cursor behind the last."""
    total, longest = int(counts.sum()), int(counts.max(initial=0))
    if longest > 2:
        found = _uniform_element_starts(cursor, steps, counts)
        if found is not None:
            return found
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
    """The ends of elements that begin there."""
    inside = cursor.at(pos, limit)
    run(inside, steps, ())
    return inside.pos


def _uniform_element_starts(cursor: BatchCursor, steps: Program, counts: Ints) -> Ints | None:
    """The same where the elements of a list, all but the first, are equally long: guessed of two, and then proved.

    None when they are not. It is proved, as each element begins where that before it ends.
    """
    some = np.flatnonzero(counts)
    limit = cursor.limit[some]
    try:
        one = _end_positions(cursor, steps, cursor.pos[some], limit)
        two = one.copy()
        longer = counts[some] > 1
        two[longer] = _end_positions(cursor, steps, one[longer], limit[longer])
        each = counts[some]
        first = np.cumsum(each) - each
        number = np.arange(int(each.sum())) - np.repeat(first, each)
        starts: Ints = np.repeat(one, each) + (number - 1) * np.repeat(two - one, each)
        starts[first] = cursor.pos[some]
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
    cursor.pos[some] = ends[is_last]
    return starts
