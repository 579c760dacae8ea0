"""Numpy dtypes of fixed-size messages in CDR: the rules of `layout`, applied for `records`.

Elements of a sequence are not padded to a common size: each begins where its first member is aligned. So the first
element may lie otherwise than those behind it: ``{uint8 a; float64 b}`` takes 12 bytes behind a count, then 16 each.
But all behind the first lie alike, because an element's end is known modulo its largest alignment whatever its start:
it contains a member of that alignment. The dtype of a message is the layout of these, trailing padding included.

Source: docs/internals/protocol.md 2.2.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError
from rosidl_py_gen.cdr.layout import (
    EMPTY_MESSAGE,
    MAX_ALIGN,
    align_up,
    element_alignment,
    fixed_count,
    has_fixed_size,
    sequence_end,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.cdr.message import Field, Message

    MessageClass = type[Message]

P = ParamSpec("P")
R = TypeVar("R")


class CopySpan(NamedTuple):
    """Bytes that lie together both on the wire and in memory, as offsets into one element."""

    wire: int
    memory: int
    size: int


def cached_per_class(function: Callable[P, R]) -> Callable[P, R]:
    """`lru_cache` over classes, which type checkers take for unhashable because messages are."""
    return cast("Callable[P, R]", lru_cache(1 << 15)(function))


@cached_per_class
def varying_field(cls: MessageClass) -> str:
    """The path and type of the first field that makes messages of this class vary in size; empty when none does."""
    for field in cls._TYPE.fields:
        kind = field.type
        if not has_fixed_size(kind):
            return f"{field.ros_name} ({kind})"
        inside = varying_field(field.cls) if field.cls is not None else ""
        if inside:
            return f"{field.ros_name}.{inside}"
    return ""


@cached_per_class
def alignments(cls: MessageClass) -> tuple[int, int]:
    """The alignment of the first member, and the largest of all, of a fixed-size message."""
    each = [
        alignments(field.cls) if field.cls is not None else (element_alignment(field.type),) * 2
        for field in cls._TYPE.fields
    ]
    return (each[0][0], max(largest for _, largest in each)) if each else (1, 1)


@cached_per_class
def content_size(cls: MessageClass) -> int:
    """The bytes of all values, without padding."""
    return sum(
        (content_size(field.cls) if field.cls is not None else _size(field.type)) * fixed_count(field.type)
        for field in cls._TYPE.fields
    )


def _size(kind: FieldType) -> int:
    primitive = kind.primitive
    assert primitive is not None
    return primitive.size


def end_offset(cls: MessageClass, position: int) -> int:
    """The end of a message that begins at `position`, both counted from the alignment origin."""
    return position + _length(cls, position % MAX_ALIGN)


@cached_per_class
def _length(cls: MessageClass, position: int) -> int:
    ends = [end for _, _, end in _members(cls, position)] or [position + len(EMPTY_MESSAGE)]
    return ends[-1] - position


def sequence_end_offset(cls: MessageClass, position: int, count: int) -> int:
    """Return the end of `count` messages of a sequence, of which the first begins at `position`."""
    return sequence_end(position, count, partial(end_offset, cls))


def _members(cls: MessageClass, position: int) -> Iterator[tuple[Field, int, int]]:
    """Each field of a message with the positions where its values begin and end."""
    for field in cls._TYPE.fields:
        count = fixed_count(field.type)
        if field.cls is None:
            size = _size(field.type)
            begin = align_up(position, size)
            position = begin + size * count
        else:
            begin = align_up(position, alignments(field.cls)[0])
            position = sequence_end_offset(field.cls, begin, count)
        yield field, begin, position


def wire_dtype(cls: MessageClass, position: int, itemsize: int = 0) -> np.dtype[np.void] | None:
    """The dtype of one message as it lies at an aligned position; `itemsize` 0 is its own size.

    None when it holds an array of messages of which the first lies otherwise than the rest, or that have padding
    between them: numpy would take that padding, and what follows the array, for a part of the last.
    """
    return _exact_dtype(cls, position % MAX_ALIGN, itemsize or end_offset(cls, position) - position)


@cached_per_class
def _exact_dtype(cls: MessageClass, position: int, itemsize: int) -> np.dtype[np.void] | None:
    formats: list[Any] = []
    offsets: list[int] = []
    for field, begin, _ in _members(cls, position):
        one = _exact_element(field, begin)
        if one is None:
            return None
        formats.append(_shaped(one, field.type))
        offsets.append(begin - position)
    return _struct(cls, formats, offsets, itemsize)


def _exact_element(field: Field, begin: int) -> np.dtype[Any] | None:
    if field.cls is None:
        assert field.type.primitive is not None
        return DTYPES[field.type.primitive.code]
    first, largest = alignments(field.cls)
    end = end_offset(field.cls, begin)
    if fixed_count(field.type) > 1 and ((end - begin) % largest or end % first):
        return None
    return wire_dtype(field.cls, begin)


def packed_dtype(cls: MessageClass) -> np.dtype[np.void]:
    """A dtype with the same fields and without padding, for messages that have no exact one."""
    formats: list[Any] = []
    offsets: list[int] = []
    size = 0
    for field in cls._TYPE.fields:
        primitive = field.type.primitive
        one = DTYPES[primitive.code] if primitive is not None else record_dtype(_nested(field))
        formats.append(_shaped(one, field.type))
        offsets.append(size)
        size += one.itemsize * fixed_count(field.type)
    return _struct(cls, formats, offsets, size)


def _nested(field: Field) -> MessageClass:
    assert field.cls is not None
    return field.cls


def _shaped(one: np.dtype[Any], kind: FieldType) -> Any:
    return (one, (kind.capacity,)) if kind.arity is Arity.ARRAY else one


def _struct(cls: MessageClass, formats: list[Any], offsets: list[int], itemsize: int) -> np.dtype[np.void]:
    names = [field.ros_name for field in cls._TYPE.fields]
    try:
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})
    except (ValueError, OverflowError) as error:
        raise FieldValueError(f"{cls._TYPE.name} is too large for a numpy dtype ({error})") from error


class ElementStride(NamedTuple):
    """How the elements behind the first lie.

    Attributes:
        phase: where they begin, modulo the largest alignment.
        stride: from one to the next.
        size: of one, without the padding behind it.
    """

    phase: int
    stride: int
    size: int


def element_stride(cls: MessageClass) -> ElementStride:
    first, largest = alignments(cls)
    phase = align_up(end_offset(cls, 0), first) % largest
    end = end_offset(cls, phase)
    return ElementStride(phase, align_up(end, first) - phase, end - phase)


@cached_per_class
def record_dtype(cls: MessageClass) -> np.dtype[np.void]:
    """The dtype of a fixed-size message: its exact one, padded to the stride, or the loose one.

    Raises:
        FieldValueError: it is too large for numpy.
    """
    phase, stride, _ = element_stride(cls)
    exact = wire_dtype(cls, phase, stride)
    return packed_dtype(cls) if exact is None else exact


def copy_spans(cls: MessageClass, position: int, memory: np.dtype[Any]) -> list[CopySpan]:
    """What to copy between one message at an aligned position of the wire and one element of a dtype in memory."""
    found: list[CopySpan] = []
    for field, begin, _ in _members(cls, position):
        assert memory.fields is not None
        form, offset = memory.fields[field.ros_name][:2]
        if field.cls is None:
            parts = [CopySpan(0, 0, _size(field.type) * fixed_count(field.type))]
        else:
            parts = _pieces_of_many(field.cls, begin, form.base, fixed_count(field.type))
        for wire, inside, size in parts:
            _add(found, CopySpan(wire + begin - position, inside + offset, size))
    return found


def _pieces_of_many(cls: MessageClass, begin: int, memory: np.dtype[Any], count: int) -> list[CopySpan]:
    found = copy_spans(cls, begin, memory)
    if count == 1:
        return found
    align = alignments(cls)[0]
    second = align_up(end_offset(cls, begin), align)
    rest = copy_spans(cls, second, memory)
    step = align_up(end_offset(cls, second), align) - second
    if len(rest) == 1 and rest[0].size == step == memory.itemsize:  # without gaps, so the rest is one piece
        _add(found, CopySpan(second - begin, memory.itemsize, step * (count - 1)))
        return found
    for index in range(count - 1):
        for wire, inside, size in rest:
            _add(found, CopySpan(second - begin + index * step + wire, (index + 1) * memory.itemsize + inside, size))
    return found


def _add(found: list[CopySpan], piece: CopySpan) -> None:
    """Append a piece, or lengthen the last one by it."""
    if found and found[-1].wire + found[-1].size == piece.wire and found[-1].memory + found[-1].size == piece.memory:
        found[-1] = CopySpan(found[-1].wire, found[-1].memory, found[-1].size + piece.size)
    else:
        found.append(piece)
