"""Numpy dtypes of fixed-size messages in CDR: the rules of `layout` for structured arrays.

Elements of a CDR sequence are not padded to a common size; each begins where its first member is aligned. The first
element's offset depends on what precedes the sequence: ``{uint8 a; float64 b}`` takes 12 bytes after a length prefix,
and each later element takes 16. But every element contains a member of the largest alignment, so its end is known
modulo that alignment, wherever it began. Therefore all elements after the first have the same layout and the same
distance, and one numpy dtype describes them, including the padding at their end. The first element is handled
separately.

Source: docs/internals/protocol.md 2.2.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeAlias, TypeVar, cast

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError
from rosidl_py_gen.cdr.layout import (
    EMPTY_MESSAGE,
    MAX_ALIGN,
    align_up,
    element_alignment,
    fixed_count,
    has_fixed_size,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.cdr.message import Field, Message

MessageClass: TypeAlias = "type[Message]"
P = ParamSpec("P")
R = TypeVar("R")


class CopySpan(NamedTuple):
    """Range of bytes that is contiguous both in encoded data and in a structured array, as offsets into one element."""

    wire: int
    memory: int
    size: int


def cached_per_class(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function with a cache of its results, with the message class as key.

    Thread: any. Threads that need a result at the same time may each compute it. Results are equal and do not change,
    so no lock is needed.
    """
    return cast("Callable[P, R]", lru_cache(1 << 15)(function))


@cached_per_class
def varying_field(cls: MessageClass) -> str:
    """Return path and type of the first field that makes messages of a class vary in size; "" if none does."""
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
    """Return two alignments of a fixed-size message in bytes: of its first member, and the largest of all members."""
    each = [
        alignments(field.cls) if field.cls is not None else (element_alignment(field.type),) * 2
        for field in cls._TYPE.fields
    ]
    return (each[0][0], max(largest for _, largest in each)) if each else (1, 1)


@cached_per_class
def content_size(cls: MessageClass) -> int:
    """Return the number of bytes of all values in a fixed-size message, without padding."""
    return sum(
        (content_size(field.cls) if field.cls is not None else element_alignment(field.type)) * fixed_count(field.type)
        for field in cls._TYPE.fields
    )


def end_offset(cls: MessageClass, position: int) -> int:
    """Return the position after a fixed-size message that begins at `position`.

    Both count from the byte after the CDR header.
    """
    return position + _length(cls, position % MAX_ALIGN)


@cached_per_class
def _length(cls: MessageClass, position: int) -> int:
    ends = [end for _, _, end in _members(cls, position)] or [position + len(EMPTY_MESSAGE)]
    return ends[-1] - position


def sequence_end_offset(cls: MessageClass, position: int, count: int) -> int:
    """Return the position after a sequence of `count` fixed-size messages, of which the first begins at `position`."""
    first = end_offset(cls, position)
    return first + (count - 1) * (end_offset(cls, first) - first) if count > 1 else first


def _members(cls: MessageClass, position: int) -> Iterator[tuple[Field, int, int]]:
    """Yield each field of a fixed-size message with the positions where its values begin and end."""
    for field in cls._TYPE.fields:
        count = fixed_count(field.type)
        if field.cls is None:
            size = element_alignment(field.type)  # of a primitive, also its size
            begin = align_up(position, size)
            position = begin + size * count
        else:
            begin = align_up(position, alignments(field.cls)[0])
            position = sequence_end_offset(field.cls, begin, count)
        yield field, begin, position


def wire_dtype(cls: MessageClass, position: int, itemsize: int = 0) -> np.dtype[np.void] | None:
    """Return the numpy dtype of a fixed-size message at an aligned position; `itemsize` 0 means the message's size.

    Returns None for a message with an array of messages whose first element has another layout than the others, or that
    have padding between them. Numpy would count that padding, and what follows the array, as a part of the last
    element.
    """
    return _exact_dtype(cls, position % MAX_ALIGN, itemsize or end_offset(cls, position) - position)


@cached_per_class
def _exact_dtype(cls: MessageClass, position: int, itemsize: int) -> np.dtype[np.void] | None:
    formats: list[Any] = []
    offsets: list[int] = []
    for field, begin, _ in _members(cls, position):
        element: np.dtype[Any] | None
        if field.cls is None:
            element = _primitive_dtype(field.type)
        else:
            first, largest = alignments(field.cls)
            end = end_offset(field.cls, begin)
            if fixed_count(field.type) > 1 and ((end - begin) % largest or end % first):
                return None
            element = wire_dtype(field.cls, begin)
        if element is None:
            return None
        formats.append(_shaped(element, field.type))
        offsets.append(begin - position)
    return _struct(cls, formats, offsets, itemsize)


def packed_dtype(cls: MessageClass) -> np.dtype[np.void]:
    """Return a numpy dtype with the message's fields and without padding, for messages without a `wire_dtype`."""
    formats: list[Any] = []
    offsets: list[int] = []
    size = 0
    for field in cls._TYPE.fields:
        element = _primitive_dtype(field.type) if field.cls is None else record_dtype(field.cls)
        formats.append(_shaped(element, field.type))
        offsets.append(size)
        size += element.itemsize * fixed_count(field.type)
    return _struct(cls, formats, offsets, size)


def _primitive_dtype(kind: FieldType) -> np.dtype[Any]:
    assert kind.primitive is not None
    return DTYPES[kind.primitive.code]


def _shaped(element: np.dtype[Any], kind: FieldType) -> Any:
    return (element, (kind.capacity,)) if kind.arity is Arity.ARRAY else element


def _struct(cls: MessageClass, formats: list[Any], offsets: list[int], itemsize: int) -> np.dtype[np.void]:
    names = [field.ros_name for field in cls._TYPE.fields]
    try:
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})
    except (ValueError, OverflowError) as error:
        raise FieldValueError(f"{cls._TYPE.name} is too large for a numpy dtype ({error})") from error


class ElementStride(NamedTuple):
    """Layout of the elements after the first in a sequence of fixed-size messages.

    Attributes:
        phase: position of an element modulo the largest alignment.
        stride: distance between elements in bytes.
        size: bytes of an element without padding at its end.
    """

    phase: int
    stride: int
    size: int


def element_stride(cls: MessageClass) -> ElementStride:
    """Return the layout of the elements after the first in a sequence of fixed-size messages."""
    first, largest = alignments(cls)
    phase = align_up(end_offset(cls, 0), first) % largest
    end = end_offset(cls, phase)
    return ElementStride(phase, align_up(end, first) - phase, end - phase)


@cached_per_class
def record_dtype(cls: MessageClass) -> np.dtype[np.void]:
    """Return the numpy dtype of structured arrays of a message; raises `FieldValueError` if numpy cannot have it."""
    phase, stride, _ = element_stride(cls)
    exact = wire_dtype(cls, phase, stride)
    return packed_dtype(cls) if exact is None else exact


def copy_spans(cls: MessageClass, position: int, memory: np.dtype[Any]) -> list[CopySpan]:
    """Return the byte ranges to copy between a message encoded at an aligned position and an element of a dtype."""
    spans: list[CopySpan] = []
    for field, begin, end in _members(cls, position):
        assert memory.fields is not None
        form, offset = memory.fields[field.ros_name][:2]
        if field.cls is None:
            inner = [CopySpan(0, 0, end - begin)]
        else:
            inner = _array_spans(field.cls, begin, form.base, fixed_count(field.type))
        for wire, inside, size in inner:
            _append(spans, CopySpan(wire + begin - position, inside + offset, size))
    return spans


def _array_spans(cls: MessageClass, begin: int, memory: np.dtype[Any], count: int) -> list[CopySpan]:
    spans = copy_spans(cls, begin, memory)
    if count == 1:
        return spans
    align = alignments(cls)[0]
    second = align_up(end_offset(cls, begin), align)
    rest = copy_spans(cls, second, memory)
    step = align_up(end_offset(cls, second), align) - second
    if len(rest) == 1 and rest[0].size == step == memory.itemsize:  # without gaps, the rest is one span
        _append(spans, CopySpan(second - begin, memory.itemsize, step * (count - 1)))
        return spans
    for index in range(count - 1):
        for wire, inside, size in rest:
            _append(spans, CopySpan(second - begin + index * step + wire, (index + 1) * memory.itemsize + inside, size))
    return spans


def _append(spans: list[CopySpan], span: CopySpan) -> None:
    last = spans[-1] if spans else None
    if last is not None and (last.wire + last.size, last.memory + last.size) == (span.wire, span.memory):
        spans[-1] = CopySpan(last.wire, last.memory, last.size + span.size)
    else:
        spans.append(span)
