"""Sequences of fixed-size messages as structured arrays: read, written and converted without an object per element.

Where the bytes lie is decided by `record_layout`. When the wire has exactly the dtype's layout, reading is a view and
writing is one join; otherwise bytes are copied, a column of all elements at a time. Arrays that users pass may have
their fields in any order and any byte order; they are then converted as strictly as numeric arrays are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, cast
from rosidl_py_gen.cdr.layout import HEADER, HEADER_BYTES, align_offset, align_up
from rosidl_py_gen.cdr.structured_layout import (
    alignments,
    cached_per_class,
    content_size,
    copy_spans,
    element_stride,
    end_offset,
    record_dtype,
    sequence_end_offset,
    varying_field,
    wire_dtype,
)
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.cdr.message import Message
    from rosidl_py_gen.cdr.structured_layout import CopySpan

    Array = NDArray[Any]
    Buffer = bytes | bytearray | memoryview

_UINT8 = np.dtype(np.uint8)
_CODES = {dtype: code for code, dtype in DTYPES.items()}
_frombuffer = np.frombuffer


class StructuredCodec:
    """How the messages of one fixed-size class lie in arrays and on the wire.

    Attributes:
        dtype: of the arrays.
        align: the boundary that every element begins at.
        largest: the largest alignment inside.
        phase: where elements have to begin, modulo `largest`, to lie as in `dtype`.
        exact: elements that begin at `phase` lie as in `dtype`.
        plain: besides, no byte of `dtype` is padding.
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
        self._pieces: dict[int, list[CopySpan]] = {}

    # --- reading ------------------------------------------------------------------------------------------------------

    def element_range(self, pos: int, count: int) -> tuple[int, int]:
        """Where `count` elements, one at least, begin and end in data that were read up to the offset `pos`."""
        begin = align_up(pos - HEADER_BYTES, self.align)
        return begin + HEADER_BYTES, sequence_end_offset(self.cls, begin, count) + HEADER_BYTES

    def read(self, data: Buffer, pos: int, count: int) -> tuple[Array, int]:
        """`count` elements from offset `pos`, and the offset behind them.

        A read-only view where that is possible; writable if `data` is a bytearray, which is then nobody else's.

        Raises:
            FieldValueError: the data end before.
        """
        if not count:
            return self.empty, pos
        begin = align_offset(pos, self.align)
        in_place = self.plain and (begin - HEADER_BYTES - self.phase) % self.largest == 0
        if in_place:
            end = begin + count * self.stride
        else:
            begin, end = self.element_range(pos, count)
        if end > len(data):
            raise FieldValueError("the data end inside a sequence")
        if in_place and not self.bools:
            return _frombuffer(data, self.dtype, count, begin), end
        return self.read_elements(data, begin, count, "<"), end

    def read_elements(self, data: Buffer, begin: int, count: int, order: Literal["<", ">"]) -> Array:
        """The elements at `begin`, which are known to be there; big-endian ones are converted."""
        dtype = self.dtype if order == "<" else self.dtype.newbyteorder(order)
        if self._can_view(data, begin, count):
            found = _frombuffer(data, dtype, count, begin)
        else:
            found = self._gathered(data, begin, count, dtype)
        for path in self.bools:
            found = _with_true_bools(found, path)
        if order != "<":
            found = found.astype(self.dtype)
            found.flags.writeable = isinstance(data, bytearray)
        return found

    def _can_view(self, data: Buffer, begin: int, count: int) -> bool:
        if not self.exact or (begin - HEADER_BYTES - self.phase) % self.largest:
            return False
        # Behind the last element is no padding: numpy must neither read beyond the data nor write into what follows.
        return self.size == self.stride or (type(data) is not bytearray and begin + count * self.stride <= len(data))

    def _gathered(self, data: Buffer, begin: int, count: int, dtype: np.dtype[Any]) -> Array:
        found = np.zeros(count, dtype)
        memory = found.view(_UINT8).reshape(count, dtype.itemsize)
        self._copy(data, begin, begin - HEADER_BYTES, memory, inward=True)
        found.flags.writeable = isinstance(data, bytearray)
        return found

    def _copy(self, data: Any, begin: int, position: int, memory: Array, *, inward: bool) -> None:
        """Copy all elements between a buffer, where they begin at `begin`, and memory, one row of bytes for each."""
        second = align_up(end_offset(self.cls, position), self.align)
        self._copy_rows(data, begin, position, 0, memory[:1], inward)
        if len(memory) > 1:
            self._copy_rows(data, begin + second - position, second, self.stride, memory[1:], inward)

    def _copy_rows(self, data: Any, begin: int, position: int, stride: int, memory: Array, inward: bool) -> None:
        for wire, inside, size in self.pieces(position) if len(memory) else ():
            outside: Array = np.ndarray((len(memory), size), _UINT8, data, begin + wire, (stride, 1))
            if inward:
                memory[:, inside : inside + size] = outside
            else:
                outside[:] = memory[:, inside : inside + size]

    def pieces(self, position: int) -> list[CopySpan]:
        """What to copy for an element at this aligned position."""
        key = position % self.largest
        if key not in self._pieces:
            self._pieces[key] = copy_spans(self.cls, key, self.dtype)
        return self._pieces[key]

    # --- writing ------------------------------------------------------------------------------------------------------

    def write(self, values: Array, append: Callable[[Any], object], pos: int) -> int:
        """Append the elements and the padding before them, return the position behind; both count from the origin.

        Raises:
            FieldValueError: see `to_wire_dtype`.
        """
        values = self.to_wire_dtype(values)
        count = len(values)
        if not count:
            return pos
        begin = align_up(pos, self.align)
        if begin > pos:
            append(bytes(begin - pos))
        if self.plain and (begin - self.phase) % self.largest == 0:
            append(values)
            return begin + count * self.stride
        end = sequence_end_offset(self.cls, begin, count)
        out = bytearray(end - begin)  # padding is zero, whatever memory holds there
        self._copy(out, 0, begin, self._rows(values), inward=False)
        append(out)
        return end

    def _rows(self, values: Array) -> Array:
        return values.view(_UINT8).reshape(len(values), self.dtype.itemsize)

    def to_wire_dtype(self, values: Array) -> Array:
        """An array of users as a contiguous one of our dtype; as it is when it is that already.

        Raises:
            FieldValueError: other dimensions, field names or shapes, or a value that a field cannot hold.
        """
        if values.ndim != 1:
            raise FieldValueError(f"expected one dimension, found shape {values.shape}; use .ravel()")
        if values.dtype is self.dtype and values.flags.c_contiguous:
            return values
        if values.dtype == self.dtype:
            return np.ascontiguousarray(values, self.dtype)
        found = np.zeros(len(values), self.dtype)
        _assign(found, values, "")
        return found

    # --- messages -----------------------------------------------------------------------------------------------------

    def from_messages(self, values: Sequence[Message]) -> Array:
        """The elements of a list; raises EncodeError, of the first wrong element."""
        raw = b"".join([_encoded(message, index) for index, message in enumerate(values)])
        found = np.zeros(len(values), self.dtype)
        size = end_offset(self.cls, 0)
        self._copy_rows(raw, HEADER_BYTES, 0, HEADER_BYTES + size, self._rows(found), True)
        return found

    def to_messages(self, values: Array) -> list[Any]:
        """One message for each element, with arrays of its own."""
        values = self.to_wire_dtype(values)
        size = HEADER_BYTES + end_offset(self.cls, 0)
        raw = bytearray(HEADER.ljust(size, b"\0") * len(values))
        self._copy_rows(raw, HEADER_BYTES, 0, size, self._rows(values), False)
        decode, fixed = self.cls._decode, bytes(raw)
        copy = _has_arrays(self.dtype)
        return [decode(fixed[at : at + size], copy) for at in range(0, len(fixed), size)]

    def equal(self, left: Array, right: Array) -> bool:
        """Whether two arrays hold equal values; one that is not of this type is equal to nothing."""
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


def find_structured_codec(cls: type[Message]) -> StructuredCodec | None:
    """The record type of a class; None when its messages vary in size or are too large for numpy."""
    try:
        return None if varying_field(cls) else structured_codec(cls)
    except FieldValueError:
        return None


def read_records(cls: type[Message], data: Buffer, pos: int, count: int) -> tuple[Any, int]:
    """What generated code calls for a sequence of fixed-size messages: see `StructuredCodec.read`."""
    return structured_codec(cls).read(data, pos, count)


def write_records(cls: type[Message], values: Any, append: Callable[[Any], object], pos: int) -> int:
    """What generated code calls for an array in the place of a list of messages: see `StructuredCodec.write`."""
    return structured_codec(cls).write(values, append, pos)


# --- fields, one by one -----------------------------------------------------------------------------------------------


def _bool_paths(dtype: np.dtype[Any]) -> tuple[tuple[str, ...], ...]:
    found: list[tuple[str, ...]] = []
    for name in dtype.names or ():
        assert dtype.fields is not None
        base = dtype.fields[name][0].base
        found += [(name,)] if base.kind == "b" else [(name, *path) for path in _bool_paths(base)]
    return tuple(found)


def _has_arrays(dtype: np.dtype[Any]) -> bool:
    return any(form.subdtype is not None or _has_arrays(form) for form, *_ in (dtype.fields or {}).values())


def _with_true_bools(values: Array, path: tuple[str, ...]) -> Array:
    """The array itself when the bytes of a bool field are 0 or 1, else a copy; numpy must never see another byte."""
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
    return values.view(_UINT8)


def _assign(target: Array, source: Array, where: str) -> None:
    """Copy by field name what users call the same, whatever the order of fields and bytes."""
    names = target.dtype.names
    at = f"field {where}: " if where else ""
    if target.shape != source.shape:
        raise FieldValueError(f"{at}expected shape {target.shape[1:]}, found {source.shape[1:]}")
    if names is None:
        _assign_numbers(target, source, at)
        return
    if source.dtype.names is None:
        raise FieldValueError(
            f"{at}expected a structured array with {_listed(names)}, found one of {source.dtype.name}"
        )
    missing = [name for name in names if name not in source.dtype.names]
    unknown = [name for name in source.dtype.names if name not in names]
    if missing or unknown:
        wrong = [f"{_listed(missing)} missing"] * bool(missing) + [f"{_listed(unknown)} unknown"] * bool(unknown)
        raise FieldValueError(f"{at}expected a structured array with {_listed(names)}, found {' and '.join(wrong)}")
    for name in names:
        _assign(target[name], source[name], f"{where}.{name}" if where else name)


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return f"the field {shown}" if len(names) == 1 else f"the fields {shown}" if names else "no fields"


def _assign_numbers(target: Array, source: Array, at: str) -> None:
    try:
        target[...] = cast(source.ravel(), _CODES[target.dtype]).reshape(target.shape)
    except FieldValueError as problem:
        index = None if problem.index is None else problem.index // (target.size // len(target))
        raise FieldValueError(at + problem.reason, index) from None


def _equal(left: Array, right: Array) -> bool:
    if left.dtype.names is None:
        return bool(np.array_equal(left, right))
    return len(left) == len(right) and all(_equal(left[name], right[name]) for name in left.dtype.names)
