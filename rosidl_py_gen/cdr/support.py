"""Functions that generated encoders and decoders call in addition to `struct` and numpy.

Positions in generated encoders count from the byte after the 4-byte encapsulation header, from which CDR alignment
counts (docs/internals/protocol.md 2.1). Positions in decoders are offsets into the data and therefore higher by 4.
"""

from __future__ import annotations

import sys
from struct import Struct
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.cdr.arrays import BOOL_BYTE, DTYPES, FieldValueError, fixed_converter, sequence_converter, short_repr
from rosidl_py_gen.cdr.arrays import view_of_bools as view_of_bools
from rosidl_py_gen.cdr.layout import NUL, Alignment, Count, WStringUnit
from rosidl_py_gen.cdr.structured_arrays import read_records as read_records
from rosidl_py_gen.cdr.structured_arrays import write_records as write_records
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray
    from typing_extensions import Self as Self

    from rosidl_py_gen.cdr.arrays import Buffer

    Records = NDArray[np.void]  # or a list of messages of fixed size
    Append = Callable[[bytes], object]
    Readable = bytes | bytearray | memoryview | NDArray[Any]

    # Generated code imports these by the name of a numpy type. Each type has the type of constructor arguments whose
    # attribute is an array, the converter of sequences, the converter of arrays, and, unless it is bool, the dtype.
    SequenceConverter = Callable[[object], Any]
    FixedConverter = Callable[[object, int], bytes]
    Bools = NDArray[np.bool_] | Sequence[bool]
    bools: SequenceConverter
    fixed_bools: FixedConverter
    Int8s = NDArray[np.int8] | Sequence[int]
    int8s: SequenceConverter
    fixed_int8s: FixedConverter
    INT8: np.dtype[np.int8]
    Uint8s = NDArray[np.uint8] | Sequence[int]
    uint8s: SequenceConverter
    fixed_uint8s: FixedConverter
    UINT8: np.dtype[np.uint8]
    Int16s = NDArray[np.int16] | Sequence[int]
    int16s: SequenceConverter
    fixed_int16s: FixedConverter
    INT16: np.dtype[np.int16]
    Uint16s = NDArray[np.uint16] | Sequence[int]
    uint16s: SequenceConverter
    fixed_uint16s: FixedConverter
    UINT16: np.dtype[np.uint16]
    Int32s = NDArray[np.int32] | Sequence[int]
    int32s: SequenceConverter
    fixed_int32s: FixedConverter
    INT32: np.dtype[np.int32]
    Uint32s = NDArray[np.uint32] | Sequence[int]
    uint32s: SequenceConverter
    fixed_uint32s: FixedConverter
    UINT32: np.dtype[np.uint32]
    Int64s = NDArray[np.int64] | Sequence[int]
    int64s: SequenceConverter
    fixed_int64s: FixedConverter
    INT64: np.dtype[np.int64]
    Uint64s = NDArray[np.uint64] | Sequence[int]
    uint64s: SequenceConverter
    fixed_uint64s: FixedConverter
    UINT64: np.dtype[np.uint64]
    Float32s = NDArray[np.float32] | Sequence[float]
    float32s: SequenceConverter
    fixed_float32s: FixedConverter
    FLOAT32: np.dtype[np.float32]
    Float64s = NDArray[np.float64] | Sequence[float]
    float64s: SequenceConverter
    fixed_float64s: FixedConverter
    FLOAT64: np.dtype[np.float64]

T = TypeVar("T")
FastPathError = Exception  # objects of the caller may raise any exception from __index__

utf8 = str.encode  # not value.encode(): a message has an `encode` too
BOOL = BOOL_BYTE

_CODES = {one.numpy: one.code for one in PRIMITIVES.values()}
"""Struct codes by the name of a numpy type."""
# The converters, which are declared above for type checkers.
globals().update({f"{name.rstrip('_')}s": sequence_converter(code) for name, code in _CODES.items()})
globals().update({f"fixed_{name.rstrip('_')}s": fixed_converter(code) for name, code in _CODES.items()})
_DTYPE_CODES = {name.upper(): code for name, code in _CODES.items()}
NUMPY_NAMES = ("frombuffer", "ndarray", *_DTYPE_CODES)
"""Names in this module that need numpy, so their first use imports it."""

if TYPE_CHECKING:
    frombuffer = np.frombuffer
    ndarray = np.ndarray

    def new(cls: type[T]) -> T: ...
else:

    def __getattr__(name: str) -> Any:
        if name not in NUMPY_NAMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        dtypes = {key: DTYPES[code] for key, code in _DTYPE_CODES.items()}
        globals().update(dtypes, frombuffer=np.frombuffer, ndarray=np.ndarray)
        if np.HAS_GIL:  # as in `lazy_numpy`, and for the same reasons
            globals().pop("__getattr__", None)
        return globals()[name]

    # Stores into slots after this are faster than a call of the dataclass's __init__ (figures in CONTRIBUTING.md).
    new = object.__new__


PAD2, PAD4, PAD8 = Alignment.PADDING[2], Alignment.PADDING[4], Alignment.PADDING[8]
# An attribute of a class takes 12 ns more.
_COUNT_SIZE = Count.SIZE
_UNIT_SIZE = WStringUnit.SIZE

_PACK_U32 = Struct("<" + Count.CODE).pack
_UNPACK_U32 = Struct("<" + Count.CODE).unpack_from
# Terminating NUL of a string and padding before the next length prefix, by `length including NUL & 3`.
_NUL_PAD4 = tuple(NUL + zeros for zeros in PAD4)
# Length prefix, characters, NUL and padding in one call, for the usual short strings; by length without NUL.
_PACK_SHORT = tuple(Struct(f"<{Count.CODE}{n}s{Alignment.up(n + 1, _COUNT_SIZE) - n}x").pack for n in range(64))


def packers(code: str, align: int, nul: bool = False) -> tuple[Callable[..., bytes], ...]:
    """Return eight functions that pack a group of fields, one for each position modulo 8 at which the group can begin.

    The index is ``pos & 7``. Each function first writes the NUL of the preceding string (if `nul`) and the padding up
    to `align`.
    """
    packs: list[Callable[..., bytes]] = []
    for start in range(Alignment.MAX):
        lead = Alignment.up(start + nul * len(NUL), align) - start
        packs.append(Struct(f"<{lead}x{code}" if lead else "<" + code).pack)
    return tuple(packs)


def readable(data: Readable, copy: bool) -> tuple[bytes | bytearray, Buffer]:
    """Return data for a decoder in two forms: for reading scalars and strings, and for arrays that share its memory.

    With `copy`, both are one bytearray. Raises TypeError if the data is not a contiguous buffer.
    """
    if copy:
        owned = bytearray(_flat(data))
        return owned, owned
    if type(data) is bytes:
        return data, data
    view = _flat(data)
    if type(view.obj) is bytes and len(view.obj) == len(view):
        return view.obj, view.obj
    return bytes(view), view


def viewable(data: Readable, copy: bool) -> Buffer:
    """Return data for the decoder of a message with large sequences, in one form, which is copied only with `copy`.

    Raises TypeError if the data is not a contiguous buffer.
    """
    view = _flat(data)
    if copy:
        return bytearray(view)
    return view.obj if type(view.obj) is bytes and len(view.obj) == len(view) else view


def _flat(data: object) -> memoryview:
    try:
        view = memoryview(data)  # type: ignore[arg-type]
        if not view.c_contiguous:
            raise BufferError("it has gaps")
        if view.ndim != 1 or view.itemsize != 1 or view.format != "B":
            view = view.cast("B")
        return view.toreadonly()
    except (TypeError, ValueError, BufferError) as error:
        raise TypeError(f"expected contiguous bytes to decode, found {short_repr(data)}") from error


def coerce_message(value: object, cls: type[T]) -> T:
    """Return a value as a message of a class; convert a message of another class of the same ROS type.

    Raises `FieldValueError` if the value is not such a message.
    """
    if isinstance(value, cls):
        return value
    target: Any = cls
    message: Any = value
    info = getattr(type(value), "_TYPE", None)
    if info is None or (info.name, info.hash) != (target._TYPE.name, target._TYPE.hash):
        raise FieldValueError(f"expected {cls.__name__}, found {short_repr(value)}")
    try:
        return target._decode(message._encode())  # type: ignore[no-any-return]
    except EncodeError as error:  # without the path, which is relative to the value
        raise FieldValueError(error.reason) from error


def coerce_message_list(value: object) -> None:
    """Check that the value of a field of messages is a list or tuple; raise `FieldValueError` if it is not."""
    if not isinstance(value, (list, tuple)):
        raise FieldValueError(f"expected a list of messages, found {short_repr(value)}")


def list_or_records(value: object) -> Any:
    """Return the list or structured array that was assigned to a field of fixed-size messages.

    An array of a subclass becomes a plain array. Raises `FieldValueError` for other values.
    """
    kind = type(value)
    if kind is list or kind is np.ndarray:
        return value
    if isinstance(value, np.ndarray):
        return value.view(np.ndarray)
    coerce_message_list(value)
    return value


def check_max_length(count: int, maximum: int) -> None:
    """Raise `FieldValueError` if a sequence or string is longer than its bound.

    Encoder and decoder then call `codec.validate`, whose error names the field.
    """
    if count > maximum:
        raise FieldValueError(f"expected at most {maximum}, found {count}")


def check_length(count: int, expected: int) -> None:
    """Raise `FieldValueError` if an array does not have the expected number of elements."""
    if count != expected:
        raise FieldValueError(f"expected exactly {expected} elements, found {count}")


def check_remaining(end: int, data: Buffer) -> None:
    """Raise `FieldValueError` if `count` elements cannot fit in the remaining data, before memory is allocated for
    them.
    """
    if end > len(data):
        raise FieldValueError("the data end inside a sequence")


def pack_strings(values: Any) -> bytes:
    """Return the encoded elements of a string sequence, without padding at the end; they are placed at a
    multiple of 4.
    """
    if not isinstance(values, (list, tuple)):
        raise FieldValueError(f"expected a list of str, found {short_repr(values)}")
    if not values:
        return b""
    parts: list[bytes] = []
    append = parts.append
    length = -1
    for value in values:
        text = utf8(value)
        length = len(text)
        if length < 64:
            append(_PACK_SHORT[length](length + 1, text))
        else:
            append(_PACK_U32(length + 1) + text + _NUL_PAD4[length + 1 & _COUNT_SIZE - 1])
    packed = b"".join(parts)
    excess = len(PAD4[length + 1 & _COUNT_SIZE - 1])
    return packed[:-excess] if excess else packed


def unpack_strings(data: Buffer, pos: int, count: int) -> tuple[list[str], int]:
    """Return `count` strings that follow the offset `pos`, which may be unaligned, and the offset after the last
    string.
    """
    if not count:
        return [], pos
    if type(data) is memoryview:  # has no `decode`; messages with many strings are bytes
        data = bytes(data)
    size = _COUNT_SIZE
    check_remaining(pos + size * count, data)
    values: list[str] = []
    append = values.append
    pos -= 1
    for _ in range(count):  # `Alignment.up` inline, from the NUL of the previous string
        pos = pos + size & -size
        (length,) = _UNPACK_U32(data, pos)
        begin = pos + size
        pos = begin + length - 1
        if data[pos]:
            raise FieldValueError("a string does not end in NUL")
        append(data[begin:pos].decode())
    return values, pos + 1


def utf16(value: str) -> bytes:
    """Return the encoded content of a wstring: UTF-16 code units as u32, without terminator.

    Source: docs/internals/protocol.md 2.2.
    """
    units = np.frombuffer(str.encode(value, "utf-16-le"), "<u2")
    return units.astype("<u4").tobytes()


def from_utf16(data: Buffer, pos: int, count: int) -> str:
    """Return the text of `count` UTF-16 code units, each a u32, at the offset `pos`."""
    check_remaining(pos + _UNIT_SIZE * count, data)
    units = np.frombuffer(data, "<u4", count, pos)
    if count and units.max() > WStringUnit.MAX:
        raise FieldValueError("a wstring unit is above 0xFFFF")
    return units.astype("<u2").tobytes().decode("utf-16-le")


def pack_wstrings(values: Any) -> bytes:
    """Return the encoded elements of a sequence or array of wstrings; they are placed at a multiple of 4."""
    if not isinstance(values, (list, tuple)):
        raise FieldValueError(f"expected a list of str, found {short_repr(values)}")
    parts: list[bytes] = []
    for value in values:
        text = utf16(value)
        parts.append(_PACK_U32(len(text) // _UNIT_SIZE))
        parts.append(text)
    return b"".join(parts)


def unpack_wstrings(data: Buffer, pos: int, count: int) -> tuple[list[str], int]:
    """Return `count` wstrings that follow the offset `pos`, which may be unaligned, and the offset after the last
    wstring.
    """
    check_remaining(pos + _COUNT_SIZE * count, data)
    values: list[str] = []
    for _ in range(count):
        pos = Alignment.up(pos, _COUNT_SIZE)
        (length,) = _UNPACK_U32(data, pos)
        values.append(from_utf16(data, pos + _COUNT_SIZE, length))
        pos += _COUNT_SIZE + _UNIT_SIZE * length
    return values, pos


def check_max_lengths(values: Any, maximum: int) -> None:
    """Raise `FieldValueError` if one of the strings in a list is longer than `maximum` characters."""
    for value in values:
        if len(value) > maximum:
            raise FieldValueError(f"expected at most {maximum} characters, found {len(value)}")


if sys.byteorder != "little":  # pragma: no cover - ROS 2 officially supports no platform of this kind
    raise ImportError("rosidl_py_gen needs a little-endian host")
