"""Structured arrays for sequences of fixed-size messages: numpy dtypes by the rules of `layout`, and the codec.

Elements of a CDR sequence are not padded to a common size; each begins where its first member is aligned. The first
element's offset depends on what precedes the sequence: ``{uint8 a; float64 b}`` takes 12 bytes after a length prefix,
and each later element takes 16. But every element contains a member of the largest alignment, so its end is known
modulo that alignment, wherever it began. Therefore all elements after the first have the same layout and the same
distance, and one numpy dtype describes them, including the padding at their end. The first element is handled
separately.

The codec makes no object for each element. If the data has exactly the layout of the dtype, a decoded array shares the
memory of the data, and encoding appends the array's bytes. Otherwise bytes are copied, one column of all elements at a
time. Arrays of users may have their fields in any order and byte order, and are converted as strictly as numeric
arrays.

Source: docs/internals/protocol.md 2.2.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, ParamSpec, TypeAlias, TypeVar, cast

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, cast_array
from rosidl_py_gen.cdr.layout import EMPTY_MESSAGE, Alignment, Header
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rosidl_py_gen.cdr.arrays import Array, Buffer
    from rosidl_py_gen.cdr.message import Field, Message

MessageClass: TypeAlias = "type[Message]"
P = ParamSpec("P")
R = TypeVar("R")

_MAX_ALIGN = Alignment.MAX  # an attribute of a class takes 12 ns more


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
        if not kind.has_fixed_size:
            return f"{field.ros_name} ({kind})"
        inside = varying_field(field.cls) if field.cls is not None else ""
        if inside:
            return f"{field.ros_name}.{inside}"
    return ""


@cached_per_class
def alignments(cls: MessageClass) -> tuple[int, int]:
    """Return two alignments of a fixed-size message in bytes: of its first member, and the largest of all members."""
    each = [
        alignments(field.cls) if field.cls is not None else (Alignment.of_element(field.type),) * 2
        for field in cls._TYPE.fields
    ]
    return (each[0][0], max(largest for _, largest in each)) if each else (1, 1)


@cached_per_class
def content_size(cls: MessageClass) -> int:
    """Return the number of bytes of all values in a fixed-size message, without padding."""
    return sum(
        (content_size(field.cls) if field.cls is not None else Alignment.of_element(field.type))
        * field.type.fixed_count
        for field in cls._TYPE.fields
    )


def end_offset(cls: MessageClass, position: int) -> int:
    """Return the position after a fixed-size message that begins at `position`.

    Both count from the byte after the CDR header.
    """
    return position + _length(cls, position % _MAX_ALIGN)


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
        count = field.type.fixed_count
        if field.cls is None:
            size = Alignment.of_element(field.type)  # of a primitive, also its size
            begin = Alignment.up(position, size)
            position = begin + size * count
        else:
            begin = Alignment.up(position, alignments(field.cls)[0])
            position = sequence_end_offset(field.cls, begin, count)
        yield field, begin, position


def wire_dtype(cls: MessageClass, position: int, itemsize: int = 0) -> np.dtype[np.void] | None:
    """Return the numpy dtype of a fixed-size message at an aligned position; `itemsize` 0 means the message's size.

    Returns None for a message with an array of messages whose first element has another layout than the others, or that
    have padding between them. Numpy would count that padding, and what follows the array, as a part of the last
    element.
    """
    return _exact_dtype(cls, position % _MAX_ALIGN, itemsize or end_offset(cls, position) - position)


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
            if field.type.fixed_count > 1 and ((end - begin) % largest or end % first):
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
        size += element.itemsize * field.type.fixed_count
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
    phase = Alignment.up(end_offset(cls, 0), first) % largest
    end = end_offset(cls, phase)
    return ElementStride(phase, Alignment.up(end, first) - phase, end - phase)


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
            inner = _array_spans(field.cls, begin, form.base, field.type.fixed_count)
        for wire, inside, size in inner:
            _append(spans, CopySpan(wire + begin - position, inside + offset, size))
    return spans


def _array_spans(cls: MessageClass, begin: int, memory: np.dtype[Any], count: int) -> list[CopySpan]:
    spans = copy_spans(cls, begin, memory)
    if count == 1:
        return spans
    align = alignments(cls)[0]
    second = Alignment.up(end_offset(cls, begin), align)
    rest = copy_spans(cls, second, memory)
    step = Alignment.up(end_offset(cls, second), align) - second
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


class StructuredCodec:
    """Codec for structured arrays of one fixed-size message class.

    Attributes:
        align, largest: alignment of the first byte of every element, and largest alignment of a member.
        phase: position modulo `largest` at which elements have the layout of `dtype`.
        exact: True if elements that begin at `phase` have the layout of `dtype`.
        plain: True if `exact` is True and `dtype` has no padding.

    Thread: any. Only `_spans` changes after the constructor; threads that compute the same spans store equal lists.
    """

    def __init__(self, cls: type[Message]) -> None:
        self.cls = cls
        self.dtype = record_dtype(cls)
        self.align, self.largest = alignments(cls)
        self.phase, self.stride, self.size = element_stride(cls)
        self.exact = wire_dtype(cls, self.phase, self.stride) is not None
        self.plain = self.exact and content_size(cls) == self.stride
        self.bools = _bool_paths(self.dtype)
        self.empty = np.empty(0, self.dtype)
        self.empty.flags.writeable = False
        self._spans: dict[int, list[CopySpan]] = {}

    # --- reading ------------------------------------------------------------------------------------------------------

    @classmethod
    def find(cls, message: type[Message]) -> StructuredCodec | None:
        """Return the codec of a message class; None if messages vary in size or are too large for numpy."""
        try:
            return None if varying_field(message) else structured_codec(message)
        except FieldValueError:
            return None

    def element_range(self, pos: int, count: int) -> tuple[int, int]:
        """Return the offsets of the first byte and after the last byte of `count` >= 1 elements of a sequence, which
        follow the offset `pos`.
        """
        begin = Alignment.up(pos - Header.SIZE, self.align)
        return begin + Header.SIZE, sequence_end_offset(self.cls, begin, count) + Header.SIZE

    def read(self, data: Buffer, pos: int, count: int) -> tuple[Array, int]:
        """Return `count` elements of a sequence, which follow the offset `pos`, and the offset after the elements.

        If possible, the elements share the memory of `data`; they are writable if `data` is a bytearray. Raises
        `FieldValueError` if the data ends before.
        """
        if not count:
            return self.empty, pos
        begin = Header.align(pos, self.align)
        in_place = self.plain and (begin - Header.SIZE - self.phase) % self.largest == 0
        if in_place:
            end = begin + count * self.stride
        else:
            begin, end = self.element_range(pos, count)
        if end > len(data):
            raise FieldValueError("the data end inside a sequence")
        if in_place and not self.bools:
            return np.frombuffer(data, self.dtype, count, begin), end
        return self.read_elements(data, begin, count, "<"), end

    def read_elements(self, data: Buffer, begin: int, count: int, order: Literal["<", ">"]) -> Array:
        """Return `count` elements that begin at an offset within the data; numbers of big-endian data are converted."""
        dtype = self.dtype if order == "<" else self.dtype.newbyteorder(order)
        if self._can_view(data, begin, count):
            values = np.frombuffer(data, dtype, count, begin)
        else:
            values = np.zeros(count, dtype)
            memory = values.view(DTYPES["B"]).reshape(count, dtype.itemsize)
            self._copy(data, begin, begin - Header.SIZE, memory, inward=True)
            values.flags.writeable = isinstance(data, bytearray)
        for path in self.bools:
            values = _with_true_bools(values, path)
        if order != "<":
            values = values.astype(self.dtype)
            values.flags.writeable = isinstance(data, bytearray)
        return values

    def _can_view(self, data: Buffer, begin: int, count: int) -> bool:
        if not self.exact or (begin - Header.SIZE - self.phase) % self.largest:
            return False
        # The last element has no padding: numpy must neither read beyond the data nor write into the bytes after it.
        return self.size == self.stride or (type(data) is not bytearray and begin + count * self.stride <= len(data))

    def _copy(self, data: Any, begin: int, position: int, memory: Array, *, inward: bool) -> None:
        """Copy all elements from an encoded buffer to the memory of an array, or in the other direction if `inward` is
        False.

        The elements begin at the offset `begin` of the buffer; `memory` has one row of bytes for each element.
        """
        second = Alignment.up(end_offset(self.cls, position), self.align)
        self._copy_rows(data, begin, position, 0, memory[:1], inward)
        if len(memory) > 1:
            self._copy_rows(data, begin + second - position, second, self.stride, memory[1:], inward)

    def _copy_rows(self, data: Any, begin: int, position: int, stride: int, memory: Array, inward: bool) -> None:
        if not len(memory):
            return
        phase = position % self.largest
        if phase not in self._spans:
            self._spans[phase] = copy_spans(self.cls, phase, self.dtype)
        for wire, inside, size in self._spans[phase]:
            outside: Array = np.ndarray((len(memory), size), DTYPES["B"], data, begin + wire, (stride, 1))
            if inward:
                memory[:, inside : inside + size] = outside
            else:
                outside[:] = memory[:, inside : inside + size]

    # --- writing ------------------------------------------------------------------------------------------------------

    def write(self, values: Array, append: Callable[[Any], object], pos: int) -> int:
        """Append the padding and the encoded elements to the segments of a message, and return the position after them.

        Positions count from the byte after the 4-byte header. Raises `FieldValueError` if the array has other fields,
        or values that do not fit.
        """
        values = self.to_wire_dtype(values)
        count = len(values)
        if not count:
            return pos
        begin = Alignment.up(pos, self.align)
        if begin > pos:
            append(bytes(begin - pos))
        if self.plain and (begin - self.phase) % self.largest == 0:
            append(values)
            return begin + count * self.stride
        end = sequence_end_offset(self.cls, begin, count)
        out = bytearray(end - begin)  # padding must be zero
        self._copy(out, 0, begin, self._rows(values), inward=False)
        append(out)
        return end

    def _rows(self, values: Array) -> Array:
        return values.view(DTYPES["B"]).reshape(len(values), self.dtype.itemsize)

    def to_wire_dtype(self, values: Array) -> Array:
        """Convert a user's array to a contiguous array of the dtype that is encoded.

        Raises `FieldValueError` if it does not fit.
        """
        if values.ndim != 1:
            raise FieldValueError(f"expected one dimension, found shape {values.shape}; use .ravel()")
        if values.dtype is self.dtype and values.flags.c_contiguous:
            return values
        if values.dtype == self.dtype:
            return np.ascontiguousarray(values, self.dtype)
        converted = np.zeros(len(values), self.dtype)
        _assign(converted, values, "")
        return converted

    # --- messages -----------------------------------------------------------------------------------------------------

    def from_messages(self, values: Sequence[Message]) -> Array:
        """Return messages as a structured array; raises `EncodeError` for the first message with a wrong value."""
        raw = b"".join([_encoded(message, index) for index, message in enumerate(values)])
        array = np.zeros(len(values), self.dtype)
        size = end_offset(self.cls, 0)
        self._copy_rows(raw, Header.SIZE, 0, Header.SIZE + size, self._rows(array), True)
        return array

    def to_messages(self, values: Array) -> list[Any]:
        """Return one message for each element of an array; arrays inside the messages are copies."""
        values = self.to_wire_dtype(values)
        size = Header.SIZE + end_offset(self.cls, 0)
        raw = bytearray(Header.BYTES.ljust(size, b"\0") * len(values))
        self._copy_rows(raw, Header.SIZE, 0, size, self._rows(values), False)
        decode, data = self.cls._decode, bytes(raw)
        copy = _has_arrays(self.dtype)
        return [decode(data[at : at + size], copy) for at in range(0, len(data), size)]

    def equal(self, left: Array, right: Array) -> bool:
        """Return True if two structured arrays have equal values; False if one has other fields than the
        message class.
        """
        try:
            return _equal(self.to_wire_dtype(left), self.to_wire_dtype(right))
        except FieldValueError:
            return False


def _encoded(message: Message, index: int) -> bytes:
    try:
        return message._encode()
    except EncodeError as error:
        name = message._TYPE.name
        raise EncodeError(f"{name}[{index}]{error.path.removeprefix(name)}", error.reason) from None


structured_codec = cached_per_class(StructuredCodec)


def read_records(cls: type[Message], data: Buffer, pos: int, count: int) -> tuple[Any, int]:
    """Return a sequence of fixed-size messages as a structured array, and the offset after the sequence.

    Called by generated decoders. The sequence has `count` elements and follows the offset `pos`. Raises
    `FieldValueError` if the data ends before.
    """
    return structured_codec(cls).read(data, pos, count)


def write_records(cls: type[Message], values: Any, append: Callable[[Any], object], pos: int) -> int:
    """Append the bytes of a structured array, which the user has assigned instead of a list of messages, to the
    segments of a message.

    Called by generated encoders. Returns the position after the elements.
    """
    return structured_codec(cls).write(values, append, pos)


# --- fields, one by one -----------------------------------------------------------------------------------------------


def _bool_paths(dtype: np.dtype[Any]) -> tuple[tuple[str, ...], ...]:
    paths: list[tuple[str, ...]] = []
    for name in dtype.names or ():
        assert dtype.fields is not None
        base = dtype.fields[name][0].base
        paths += [(name,)] if base.kind == "b" else [(name, *path) for path in _bool_paths(base)]
    return tuple(paths)


def _has_arrays(dtype: np.dtype[Any]) -> bool:
    return any(form.subdtype is not None or _has_arrays(form) for form, *_ in (dtype.fields or {}).values())


def _with_true_bools(values: Array, path: tuple[str, ...]) -> Array:
    """Return the array with 1 for every nonzero byte of a bool field, as numpy requires.

    Copies the array only if a byte differs.
    """
    if _bytes_of(values, path).max() > 1:
        writeable = values.flags.writeable
        values = values.copy()
        column = _bytes_of(values, path)
        column[...] = column != 0
        values.flags.writeable = writeable
    return values


def _bytes_of(values: Array, path: tuple[str, ...]) -> Array:
    for name in path:
        values = values[name]
    return values.view(DTYPES["B"])


def _assign(target: Array, source: Array, where: str) -> None:
    """Copy the fields of one structured array to another by name, regardless of field order and byte order.

    Raises `FieldValueError` if fields are missing or unknown, or a value does not fit; `where` is the field's path.
    """
    names = target.dtype.names
    prefix = f"field {where}: " if where else ""
    if target.shape != source.shape:
        raise FieldValueError(f"{prefix}expected shape {target.shape[1:]}, found {source.shape[1:]}")
    if names is None:
        _assign_numbers(target, source, prefix)
        return
    if source.dtype.names is None:
        raise FieldValueError(
            f"{prefix}expected a structured array with {_field_list(names)}, found one of {source.dtype.name}"
        )
    missing = [name for name in names if name not in source.dtype.names]
    unknown = [name for name in source.dtype.names if name not in names]
    if missing or unknown:
        lists = (missing, "missing"), (unknown, "unknown")
        wrong = [f"{_field_list(fields)} {problem}" for fields, problem in lists if fields]
        raise FieldValueError(
            f"{prefix}expected a structured array with {_field_list(names)}, found {' and '.join(wrong)}"
        )
    for name in names:
        _assign(target[name], source[name], f"{where}.{name}" if where else name)


def _code(dtype: np.dtype[Any]) -> str:
    return next(code for code, one in DTYPES.items() if one == dtype)


def _field_list(names: Sequence[str]) -> str:
    text = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return f"the field {text}" if len(names) == 1 else f"the fields {text}" if names else "no fields"


def _assign_numbers(target: Array, source: Array, prefix: str) -> None:
    try:
        target[...] = cast_array(source.ravel(), _code(target.dtype)).reshape(target.shape)
    except FieldValueError as error:
        index = None if error.index is None else error.index // (target.size // len(target))
        raise FieldValueError(prefix + error.reason, index) from None


def _equal(left: Array, right: Array) -> bool:
    if left.dtype.names is None:
        return bool(np.array_equal(left, right))
    return len(left) == len(right) and all(_equal(left[name], right[name]) for name in left.dtype.names)
