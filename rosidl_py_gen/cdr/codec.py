"""Public functions `encode` and `decode`, conversion of structured arrays, and the slow paths of generated code.

The public functions work for messages with any field names.

The slow paths encode and decode a message field by field, by the class's table of fields. Generated code is flat and
does not know at which field it failed. Only after a failure these functions run: `validate` names the wrong value,
`decode_slow` names the wrong byte and also reads big-endian data, which no officially supported platform of ROS 2
writes. The layout rules are in `layout`.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, coerce, scalar_problem, short_repr, view_of_bools
from rosidl_py_gen.cdr.layout import EMPTY_MESSAGE, Count, Header, WStringUnit, min_element_size
from rosidl_py_gen.cdr.message import Field, Message, is_of_type, require_message
from rosidl_py_gen.cdr.structured_arrays import StructuredCodec, structured_codec, varying_field
from rosidl_py_gen.cdr.support import readable
from rosidl_py_gen.errors import DecodeError, EncodeError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.cdr.arrays import Buffer
    from rosidl_py_gen.cdr.support import Readable, Records

M = TypeVar("M", bound=Message)


# --- encode: name the wrong value -----------------------------------------------------------------------------------


def validate(message: Message) -> None:
    """Raise `EncodeError` if a value of a message does not fit the type of its field.

    Raises:
        EncodeError: the first wrong value in definition order; `path` begins with the message type.
        TypeNotFoundError: the argument is not a generated message.
    """
    require_message(message)
    _check_message(message, message._TYPE.name)


def _check_message(message: Message, path: str) -> None:
    for field in message._TYPE.fields:
        try:
            value = message._get_plain(field)
        except AttributeError:
            raise EncodeError(f"{path}.{field.ros_name}", "the field is not set") from None
        except FieldValueError as error:
            raise EncodeError(f"{path}.{field.ros_name}{error.suffix}", error.reason) from None
        _check_field(value, field, f"{path}.{field.ros_name}")


def _check_field(value: Any, field: Field, path: str) -> None:
    kind = field.type
    if kind.arity is Arity.SCALAR:
        _check_element(value, field, path)
        return
    try:
        if kind.primitive is not None:
            value = coerce(value, kind.primitive.code)
        elif isinstance(value, np.ndarray) and field.cls is not None and not varying_field(field.cls):
            value = structured_codec(field.cls).to_wire_dtype(value)
        elif not isinstance(value, (list, tuple)):
            raise FieldValueError(f"expected a list of {kind.base}, found {short_repr(value)}")
    except FieldValueError as error:
        raise EncodeError(path + error.suffix, error.reason) from None
    if kind.arity is Arity.ARRAY and len(value) != kind.capacity:
        raise EncodeError(path, f"expected exactly {kind.capacity} elements, found {len(value)}")
    if kind.arity is Arity.BOUNDED and len(value) > kind.capacity:
        raise EncodeError(path, f"expected at most {kind.capacity} elements, found {len(value)}")
    if len(value) > Count.MAX:
        raise EncodeError(path, f"expected at most {Count.MAX} elements, found {len(value)}")
    if not isinstance(value, np.ndarray):
        for index, item in enumerate(value):
            _check_element(item, field, f"{path}[{index}]")


def _check_element(value: Any, field: Field, path: str) -> None:
    kind = field.type
    if field.cls is not None:
        if not is_of_type(value, field.cls):
            raise EncodeError(path, f"expected {field.cls._TYPE.name}, found {short_repr(value)}")
        _check_message(value, path)
        return
    primitive = kind.primitive
    reason = _string_problem(value, kind) if primitive is None else scalar_problem(value, primitive.code)
    if reason:
        raise EncodeError(path, reason)


def _string_problem(value: Any, kind: FieldType) -> str:
    if not isinstance(value, str):
        return f"expected str, found {short_repr(value)}"
    if kind.string_bound and len(value) > kind.string_bound:
        return f"expected at most {kind.string_bound} characters, found {len(value)}"
    try:
        str.encode(value, "utf-16-le" if kind.base == "wstring" else "utf-8")
    except UnicodeEncodeError as error:
        return f"expected text without lone surrogates, found one at character {error.start}"
    return ""


def encode_slow(message: Message, error: Exception) -> bytes:
    """Return the encoding of a message whose generated encoder failed, with non-contiguous arrays copied first.

    Raises:
        EncodeError: a value does not fit its type; names the field path.
    """
    validate(message)
    strided: list[str] = []
    clone = _contiguous(message, strided)
    if strided:
        return clone._encode()
    raise EncodeError(message._TYPE.name, f"cannot be encoded: {error}") from error


def _contiguous(message: M, strided: list[str]) -> M:
    """Return a copy of a message in which non-contiguous arrays are replaced by contiguous copies.

    Other values are shared. The names of the replaced fields are appended to `strided`.
    """
    clone = object.__new__(type(message))
    for field in message._TYPE.fields:
        value = message._get_plain(field)
        if field.cls is not None and isinstance(value, np.ndarray):
            pass
        elif isinstance(value, np.ndarray) and not value.flags.c_contiguous:
            strided.append(field.ros_name)
            value = np.ascontiguousarray(value)
        elif field.cls is not None:
            scalar = field.type.arity is Arity.SCALAR
            value = _contiguous(value, strided) if scalar else [_contiguous(item, strided) for item in value]
        clone._set_plain(field, value)
    return clone


# --- decode: name the wrong byte, read the other byte order ---------------------------------------------------------


def decode_slow(cls: type[M], data: Readable, copy: bool, error: Exception | None = None, arrays: bool = False) -> M:
    """Return the message in data that the generated decoder cannot read: invalid or big-endian data.

    Raises:
        DecodeError: the data is not valid; names field path and byte offset.
    """
    name = cls._TYPE.name
    reader = _open(name, data, copy, arrays)
    message = reader.message(cls, name)
    if error is not None and reader.order == "<":
        raise DecodeError(name, Header.SIZE, f"cannot be decoded: {error}") from error
    return message


def encoded_length(cls: type[Message], data: Readable) -> int:
    """Return the size of the message at the start of data, with the header and without padding at the end.

    Raises:
        DecodeError: the data is not a message of the class.
    """
    reader = _open(cls._TYPE.name, data, copy=False, arrays=True)
    reader.message(cls, cls._TYPE.name)
    return reader.pos


def _open(name: str, data: Readable, copy: bool, arrays: bool) -> _CdrReader:
    try:
        raw, view = readable(data, copy)
    except TypeError as error:
        raise DecodeError(name, 0, str(error)) from None
    if len(raw) < Header.SIZE:
        raise DecodeError(name, len(raw), f"expected a 4-byte encapsulation header, found {len(raw)} bytes")
    if raw[0] != 0 or raw[1] > 1:
        raise DecodeError(name, 0, f"expected encapsulation 0000 or 0001 (plain CDR), found {bytes(raw[:2]).hex()}")
    return _CdrReader(raw, view, big_endian=raw[1] == 0, arrays=arrays)


class _CdrReader:
    """Reader of the data of one message, field by field; `pos` is an offset from the start of the header."""

    def __init__(self, data: Buffer, view: Buffer, big_endian: bool, arrays: bool) -> None:
        self.data = data
        self.view = view
        self.order: Literal["<", ">"] = ">" if big_endian else "<"
        self.arrays = arrays
        self.pos = Header.SIZE

    def take(self, size: int, align: int, path: str, what: str) -> int:
        """Skip the padding before a value and the `size` bytes of the value, and return the offset of the value.

        Raises `DecodeError` if the data ends before; `what` is the name of the value in the error text.
        """
        start = Header.align(self.pos, align)
        left = max(0, len(self.data) - start)
        if size > left:
            raise DecodeError(path, start, f"expected {size} bytes of {what}, found {left}")
        self.pos = start + size
        return start

    def scalar(self, code: str, size: int, path: str) -> Any:
        start = self.take(size, size, path, DTYPES[code].name)
        (value,) = struct.unpack_from(self.order + code, self.data, start)
        return value

    def count(self, path: str, what: str) -> int:
        start = self.take(Count.SIZE, Count.SIZE, path, what)
        (value,) = struct.unpack_from(self.order + Count.CODE, self.data, start)
        return int(value)

    def message(self, cls: type[M], path: str) -> M:
        result = object.__new__(cls)
        if not cls._TYPE.fields:
            self.take(len(EMPTY_MESSAGE), 1, path, "an empty message")
        for field in cls._TYPE.fields:
            result._set_plain(field, self.field(field, f"{path}.{field.ros_name}"))
        return result

    def field(self, field: Field, path: str) -> Any:
        kind = field.type
        if kind.arity is Arity.SCALAR:
            return self.element(field, path)
        count = self.count(path, "an element count") if kind.is_sequence else kind.capacity
        if kind.arity is Arity.BOUNDED and count > kind.capacity:
            raise DecodeError(path, self.pos - Count.SIZE, f"expected at most {kind.capacity} elements, found {count}")
        if kind.primitive is not None:
            return self.numbers(kind.primitive.code, count, path)
        if self.arrays and field.cls is not None and not varying_field(field.cls):
            return self.records(field.cls, count, path)
        if count * min_element_size(kind) > len(self.data) - self.pos:
            left = len(self.data) - self.pos
            raise DecodeError(path, self.pos, f"expected {count} elements, found {left} bytes")
        return [self.element(field, f"{path}[{index}]") for index in range(count)]

    def numbers(self, code: str, count: int, path: str) -> Any:
        dtype = DTYPES[code]
        if count == 0:
            return np.frombuffer(b"", dtype)
        start = self.take(count * dtype.itemsize, dtype.itemsize, path, f"{count} {dtype.name}")
        if code == "?":
            return view_of_bools(self.view, count, start)
        values = np.frombuffer(self.view, dtype.newbyteorder(">" if self.order == ">" else "<"), count, start)
        if self.order == ">" and dtype.itemsize > 1:
            values = values.astype(dtype)
            values.flags.writeable = isinstance(self.view, bytearray)
        return values

    def records(self, cls: type[Message], count: int, path: str) -> Any:
        try:
            codec = structured_codec(cls)
        except FieldValueError as error:
            raise DecodeError(path, self.pos, error.reason) from None
        if count == 0:
            return codec.empty
        begin, end = codec.element_range(self.pos, count)
        begin = self.take(end - begin, codec.align, path, f"{count} {cls._TYPE.name}")
        return codec.read_elements(self.view, begin, count, self.order)

    def element(self, field: Field, path: str) -> Any:
        kind = field.type
        if field.cls is not None:
            return self.message(field.cls, path)
        if kind.base == "string":
            return self.string(path)
        if kind.base == "wstring":
            return self.wstring(path)
        assert kind.primitive is not None
        return self.scalar(kind.primitive.code, kind.primitive.size, path)

    def string(self, path: str) -> str:
        length = self.count(path, "a string length")
        if length == 0:
            return ""
        start = self.take(length, 1, path, "a string")
        if self.data[start + length - 1]:
            raise DecodeError(path, start + length - 1, f"expected NUL, found {self.data[start + length - 1]:#04x}")
        try:
            return str(self.data[start : start + length - 1], "utf-8")
        except UnicodeDecodeError as error:
            raise DecodeError(path, start + error.start, f"expected UTF-8, found {error.reason}") from None

    def wstring(self, path: str) -> str:
        count = self.count(path, "a wstring length")
        start = self.take(WStringUnit.SIZE * count, WStringUnit.SIZE, path, f"{count} wstring units")
        units = np.frombuffer(self.data, self.order + "u4", count, start)
        if count and units.max() > WStringUnit.MAX:
            index = int((units > WStringUnit.MAX).argmax())
            offset = start + WStringUnit.SIZE * index
            raise DecodeError(path, offset, f"expected a UTF-16 unit, found {int(units[index]):#x}")
        try:
            return units.astype("<u2").tobytes().decode("utf-16-le")
        except UnicodeDecodeError as error:
            raise DecodeError(path, start + 2 * error.start, f"expected UTF-16, found {error.reason}") from None


def encode(message: Message) -> bytes:
    """Return the message as XCDR1 little endian with its 4-byte header, without padding at the end.

    ``rclpy.serialization`` on rmw_cyclonedds returns the same bytes.

    Raises:
        EncodeError: a value does not fit its type; names the field path. The message is not changed.
        TypeNotFoundError: the argument is not a generated message.
    """
    # Source: docs/internals/protocol.md 2.
    try:
        return message._encode()
    except AttributeError:
        require_message(message)
        raise


def decode(cls: type[M], data: Readable, *, copy: bool = False, arrays: bool = False) -> M:
    """Return the message that CDR data encodes; ignore bytes after the message.

    The data has its 4-byte header, and may have either byte order.

    Args:
        cls: a generated message class.
        data: bytes, bytearray, memoryview or another contiguous buffer.
        copy: False makes arrays read-only views of `data`; True makes them writable copies.
        arrays: True makes sequences and arrays of fixed-size messages structured arrays, whose dtype `dtype` returns.

    Raises:
        DecodeError: the data is not valid; names field path and byte offset.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    # Source: docs/internals/protocol.md 2.
    try:
        return cls._decode(data, copy, arrays)
    except AttributeError:
        require_message(cls)
        raise


def dtype(cls: type[Message]) -> np.dtype[np.void]:
    """Return the numpy dtype of structured arrays of a fixed-size message, with ROS names and native byte order.

    Offsets and item size follow CDR, so that such arrays are views of encoded messages and are encoded by copying
    bytes. If the first element of a sequence is laid out differently from the others, arrays are copies with the same
    dtype.

    Raises:
        TypeError: the size of messages varies, because of the field that is named; or it is too large for numpy.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    return _require_codec(cls).dtype


def records(values: Sequence[Message] | Records, cls: type[Message] | None = None) -> Records:
    """Return messages of one fixed-size class as a structured array with the dtype that `dtype` returns.

    Args:
        values: a list of messages, or a structured array, which is converted to the dtype of `cls` if that is given.
        cls: class of the messages; required for an empty list, otherwise by default the class of the first message.

    Raises:
        EncodeError: an element has another class, or a value that does not fit; names index and field. Or an array has
            other fields than `cls`.
        TypeError: the list is empty and `cls` missing, or messages of the class are not of fixed size or too large.
        TypeNotFoundError: the class is not a generated message class.
    """
    if isinstance(values, np.ndarray):
        return values if cls is None else _to_wire_dtype(_require_codec(cls), values)
    if cls is None:
        if not len(values):
            raise TypeError("the class of an empty sequence is not known: pass records(values, cls)")
        cls = type(values[0])
    codec = _require_codec(cls)
    for index, value in enumerate(values):
        if not is_of_type(value, cls):
            raise EncodeError(f"{cls._TYPE.name}[{index}]", f"expected {cls._TYPE.name}, found {short_repr(value)}")
    return codec.from_messages(values)


def messages(cls: type[M], values: Sequence[M] | Records) -> list[M]:
    """Return the elements of a structured array as message objects; a list of messages is copied.

    Raises:
        EncodeError: the array has other fields than `cls`; names them.
        TypeError: messages of the class are not of fixed size or too large for numpy.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    if not isinstance(values, np.ndarray):
        return list(values)
    codec = _require_codec(cls)
    return codec.to_messages(_to_wire_dtype(codec, values))


def _require_codec(cls: type[Message]) -> StructuredCodec:
    require_message(cls)
    field = varying_field(cls)
    if field:
        raise TypeError(f"{cls._TYPE.name} is not of fixed size, because of its field {field}")
    try:
        return structured_codec(cls)
    except FieldValueError as error:
        raise TypeError(error.reason) from error


def _to_wire_dtype(codec: StructuredCodec, values: Records) -> Records:
    try:
        return codec.to_wire_dtype(values)
    except FieldValueError as error:
        raise EncodeError(codec.cls._TYPE.name + error.suffix, error.reason) from None
