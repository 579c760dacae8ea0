"""Values of numeric array fields: accepted and refused ones, and ownership of the memory."""

from __future__ import annotations

import mmap
import struct
from array import array
from typing import Any

import numpy as np
import pytest
from each_case import each_case

from rosidl_py_gen import DecodeError, EncodeError, compile_definition, decode, encode, type_name, validate

KINDS = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
ARITIES = ("[]", "[<=3]", "[3]")
MANY = "[200]"  # too large to be packed in a run


def box(kind: str) -> type[Any]:
    """Return a class with the field `v` between two other fields."""
    return compile_definition(f"arrays/msg/Box{kind.encode().hex()}", f"uint8 before\n{kind} v\nuint16 behind\n")


def wire(code: str, items: list[Any], *, counted: bool) -> bytes:
    """Return the encoded `box`, independent of the codec."""
    size = struct.calcsize(code)
    out = b"\7"
    if counted:
        out += b"\0\0\0" + struct.pack("<I", len(items))
    if items:
        out += bytes(-len(out) % size)
    out += struct.pack(f"<{len(items)}{code}", *items)
    out += bytes(len(out) % 2)
    return b"\0\1\0\0" + out + b"\x34\x12"


@each_case("arity", ARITIES)
@each_case("kind", KINDS)
def test_lists_tuples_buffers_and_arrays_are_encoded_equally(kind: str, arity: str) -> None:
    code = KINDS[kind]
    items: list[Any] = [True, False, True] if code == "?" else [1.5, 2.0, -3.25] if code in "fd" else [1, 2, 100]
    own = np.array(items, {"?": "bool"}.get(code, "<" + code))
    strided = np.repeat(own, 2)[::2]
    accepted = [
        items,
        tuple(items),
        own,
        strided,
        own[::-1].copy()[::-1],
        own.astype(object),
        memoryview(own.copy()),
        memoryview(strided),
    ]
    assert not strided.flags.c_contiguous
    if code != "?":
        accepted += [array(code, items), own.astype(own.dtype.newbyteorder(">")), items and _swapped_view(own)]
    if code in "fd":
        accepted += [own.astype("f2"), own.astype("f8"), own.astype("f4")]
    elif code != "?":
        accepted += [own.astype(other) for other in ("u1", "i2", "u4", "i8", "u8", ">i8", ">u8")]
        accepted += [range(1, 4)] if items == [1, 2, 3] else []
    if code == "B":
        accepted += [bytes(items), bytearray(items)]
    cls = box(kind + arity)
    for value in accepted:
        message = cls(7, value, 0x1234)
        validate(message)
        assert encode(message) == wire(code, items, counted=arity != "[3]"), repr(value)
        back = decode(cls, encode(message))
        assert back == message
        assert back.v.tolist() == items


def _swapped_view(own: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    swapped = np.empty(len(own), own.dtype.newbyteorder(">"))
    swapped[:] = own
    return swapped


@each_case("kind", KINDS)
def test_large_fixed_array_may_be_set_to_a_strided_array_or_list(kind: str) -> None:
    code = KINDS[kind]
    items = [n % 2 == 0 if code == "?" else n for n in range(100)] * 2
    own = np.array(items, {"?": "bool"}.get(code, "<" + code))
    cls = box(kind + "[200]")
    for value in (
        own,
        items,
        np.repeat(own, 3)[::3],
        own.astype("bool" if code == "?" else own.dtype.newbyteorder(">")),
    ):
        assert encode(cls(7, value, 0x1234)) == wire(code, items, counted=False)


@each_case("kind", KINDS)
@each_case("arity", [*ARITIES, MANY])
def test_array_values_that_do_not_fit_exactly_are_refused_with_path(kind: str, arity: str) -> None:
    code = KINDS[kind]
    cls = box(kind + arity)
    wrong: list[tuple[Any, str]] = [
        (None, ""),
        (5, ""),
        ("abc", ""),
        ({1: 2}, ""),
        ({1, 2}, ""),
        (object(), ""),
        (iter([1, 2, 3]), ""),
        (np.zeros((1, 3)), ""),
        (np.zeros((3, 2), code), ""),
        (np.array(1), ""),
        (np.array(["a", "b", "c"]), ""),
        (np.array([1j, 2, 3]), ""),
        (np.array(["2020", "2021", "2022"], "M8[Y]"), ""),
        ([1, "a", 1], "[1]"),
        ([1, 0, None], "[2]"),
        ([[1], 2, 3], "[0]"),
        (np.array([1, "a", None], object), "[1]"),
        ([1, 0, 10**400], "[2]"),
    ]
    if code != "?":
        wrong.append((memoryview(b"abc").cast("c"), ""))
    if code in "fd":
        wrong += [(b"abc", ""), (np.array([1, 2, 1e300]), "[2]")] if code == "f" else [(b"abc", "")]
        wrong += [([1, 2, 1e300], "[2]")] if code == "f" else []
    elif code == "?":
        wrong += [([True, 2, False], "[1]"), (np.array([1, 0, 1]), ""), (b"\1\0\1", "")]
    else:
        low, high = (-(2 ** (8 * struct.calcsize(code) - 1)), 2 ** (8 * struct.calcsize(code) - 1) - 1)
        if code in "BHIQ":
            low, high = 0, 2 * high + 1
        wrong += [
            ([1, high + 1, 1], "[1]"),
            ([low - 1, 1, 1], "[0]"),
            ([1, 1.0, 1], "[1]"),
            (np.array([1.0, 2, 3]), ""),
        ]
        if low < 0:
            wrong.append((np.array([1, high + 1, 1], ">u8"), "[1]"))
            wrong.append((np.array([1, high + 1, 1], "u8"), "[1]"))
        else:
            wrong.append((np.array([1, -1, 1], "i1"), "[1]"))
        if code not in "qQ":
            wrong.append((np.array([1, 1, high + 1], "i8"), "[2]"))
        if code not in "Bb":
            wrong.append((b"abc", ""))
    for value, index in wrong:
        message = cls(7, value, 0)
        for check in (encode, validate):
            with pytest.raises(EncodeError) as caught:
                check(message)
            assert caught.value.path == f"{type_name(cls)}.v{index}", repr(value)
            assert caught.value.reason.startswith("expected "), repr(value)
            assert "found " in caught.value.reason
        assert message.v is value


@each_case("kind", KINDS)
def test_array_lengths_and_bounds_are_enforced(kind: str) -> None:
    one = KINDS[kind] == "?" or 1
    for arity, count, text in (
        ("[3]", 2, "expected exactly 3 elements, found 2"),
        ("[3]", 4, "expected exactly 3 elements, found 4"),
        (MANY, 199, "expected exactly 200 elements, found 199"),
        ("[<=3]", 4, "expected at most 3 elements, found 4"),
    ):
        cls = box(kind + arity)
        for value in ([one] * count, np.full(count, one, {"?": "bool"}.get(KINDS[kind], KINDS[kind]))):
            for check in (encode, validate):
                with pytest.raises(EncodeError) as caught:
                    check(cls(7, value, 0))
                assert (caught.value.path, caught.value.reason) == (f"{type_name(cls)}.v", text)


# --- ownership of memory ----------------------------------------------------------------------------------------------


@each_case("kind", KINDS)
@each_case("arity", [*ARITIES, MANY])
def test_without_copy_arrays_are_read_only_views_of_the_input(kind: str, arity: str) -> None:
    cls = box(kind + arity)
    count = 200 if arity == MANY else 3
    data = encode(cls(7, [True if kind == "bool" else 1] * count, 2))
    buffers: list[Any] = [data, bytearray(data), memoryview(data), memoryview(bytearray(data))]
    buffers += [np.frombuffer(bytearray(data), np.uint8), memoryview(bytearray(b"x" + data))[1:], array("B", data)]
    buffers += [memoryview(b"x" + data)[1:]]
    for buffer in buffers:
        found = decode(cls, buffer).v
        assert np.shares_memory(found, np.frombuffer(buffer, np.uint8))
        assert not found.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            found[0] = 0


@each_case("kind", KINDS)
@each_case("arity", [*ARITIES, MANY])
@each_case("big_endian", [False, True])
def test_with_copy_arrays_are_writable_and_independent_of_the_input(kind: str, arity: str, big_endian: bool) -> None:
    cls = box(kind + arity)
    count = 200 if arity == MANY else 3
    data = bytearray(encode(cls(7, [True if kind == "bool" else 1] * count, 2)))
    if big_endian and kind in ("bool", "byte", "char", "int8", "uint8"):
        data[1] = 0
        if arity in ("[]", "[<=3]"):
            data[8:12] = data[8:12][::-1]
    for buffer in (bytes(data), data, memoryview(data)):
        message = decode(cls, buffer, copy=True)
        assert not np.shares_memory(message.v, np.frombuffer(buffer, np.uint8))
        assert message.v.flags.writeable
        before = bytes(data)
        message.v[0] = 0
        assert data == before
        assert message.v[0] == 0


def test_array_view_keeps_its_buffer_alive_and_reflects_changes_of_it() -> None:
    cls = box("uint8[]")
    data = bytearray(encode(cls(7, [1, 2, 3], 0)))
    message = decode(cls, data)
    data[12] = 99
    assert message.v.tolist() == [99, 2, 3]
    view = decode(cls, bytes(data)).v
    assert view.tolist() == [99, 2, 3]


def test_mapped_files_are_read_in_place() -> None:
    cls = box("float64[]")
    data = encode(cls(7, [1.0, 2.0], 0))
    with mmap.mmap(-1, 4096) as memory:
        memory[: len(data)] = data
        message = decode(cls, memory)
        assert message.v.tolist() == [1.0, 2.0]
        assert np.shares_memory(message.v, np.frombuffer(memory, np.uint8))
        del message


def test_bool_bytes_above_one_are_true_and_never_seen_by_numpy() -> None:
    for arity in ("[]", "[3]"):
        cls = box("bool" + arity)
        data = bytearray(encode(cls(7, [True, False, True], 0)))
        data[data.index(b"\1\0\1", 5)] = 0xFE
        for copy in (False, True):
            found = decode(cls, bytes(data), copy=copy).v
            assert found.view(np.uint8).tolist() == [1, 0, 1]
            assert found.flags.writeable == copy


def test_a_buffer_that_is_not_contiguous_is_refused_never_misread() -> None:
    cls = box("uint8[]")
    data = encode(cls(7, [1, 2, 3], 0))
    twice = bytes(byte for byte in data for _ in range(2))
    backwards = data[::-1]
    for buffer in (memoryview(twice)[::2], memoryview(backwards)[::-1], np.frombuffer(twice, np.uint8)[::2]):
        for copy in (False, True):
            with pytest.raises(DecodeError, match="contiguous"):
                decode(cls, buffer, copy=copy)


@pytest.mark.parametrize("data", [None, 5, "text", [0, 1, 0, 0], object()])
def test_decoding_an_object_that_is_not_bytes_is_refused(data: Any) -> None:
    with pytest.raises(DecodeError, match="expected contiguous bytes to decode, found"):
        decode(box("uint8[]"), data)


def test_encoding_does_not_modify_the_message() -> None:
    cls = box("float64[]")
    given = [1, 2, 3]
    message = cls(7, given, 0)
    encode(message)
    assert message.v is given
    strided = np.arange(6.0)[::2]
    message.v = strided
    encode(message)
    assert message.v is strided
