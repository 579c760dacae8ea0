"""Errors of invalid bytes: field and offset, for every kind of field."""

from __future__ import annotations

import pickle
import tracemalloc

import pytest

from rosidl_py_gen import DecodeError, compile_definition, decode, encode, type_name

FIELDS = """uint8 first
{} v
"""
MORE = (
    "=" * 80 + "\nMSG: bytes/Part\nstring name\nuint16 number\n" + "=" * 80 + "\nMSG: bytes/Fixed\nfloat64 x\nuint8 y\n"
)
MORE += "=" * 80 + "\nMSG: bytes/Empty\n"
MORE += "=" * 80 + "\nMSG: bytes/Heavy\n" + "".join(f"uint8 b{n}\n" for n in range(60)) + "Part part\nPart[] parts\n"


def box(kind: str) -> type:
    return compile_definition(f"bytes/msg/Box{kind.encode().hex()}", FIELDS.format(kind) + MORE)


HEAD = "00010000 01"
# type of the field, bytes after the first field, path after `.v`, offset, error text
CASES = [
    ("uint8", "", "", 5, "expected 1 bytes of uint8, found 0"),
    ("float64", "00000000000000 000000000000f0", "", 12, "expected 8 bytes of float64, found 7"),
    ("int32", "000000 0102", "", 8, "expected 4 bytes of int32, found 2"),
    ("string", "000000 0600", "", 8, "expected 4 bytes of a string length, found 2"),
    ("string", "000000 06000000 68656c6c6f", "", 12, "expected 6 bytes of a string, found 5"),
    ("string", "000000 ffffffff 68656c6c6f00", "", 12, "expected 4294967295 bytes of a string, found 6"),
    ("string", "000000 06000000 68656c6c6f21", "", 17, "expected NUL, found 0x21"),
    ("string", "000000 03000000 68ff00", "", 13, "expected UTF-8, found invalid start byte"),
    ("string", "000000 04000000 eda08000", "", 12, "expected UTF-8, found invalid continuation byte"),
    ("wstring", "000000 02000000 61000000", "", 12, "expected 8 bytes of 2 wstring units, found 4"),
    ("wstring", "000000 ffffffff 61000000", "", 12, "expected 17179869180 bytes of 4294967295 wstring units, found 4"),
    ("wstring", "000000 02000000 61000000 00000100", "", 16, "expected a UTF-16 unit, found 0x10000"),
    ("wstring", "000000 02000000 61000000 00d80000", "", 16, "expected UTF-16, found unexpected end of data"),
    ("wstring", "000000 02000000 00dc0000 61000000", "", 12, "expected UTF-16, found illegal encoding"),
    ("uint8[]", "000000 03000000 0102", "", 12, "expected 3 bytes of 3 uint8, found 2"),
    ("uint8[]", "000000 ffffffff 0102", "", 12, "expected 4294967295 bytes of 4294967295 uint8, found 2"),
    ("float64[]", "000000 02000000 00000000 0000000000000000", "", 12, "expected 16 bytes of 2 float64, found 12"),
    ("uint8[<=2]", "000000 03000000 010203", "", 8, "expected at most 2 elements, found 3"),
    ("string<=2[<=2]", "000000 03000000 00000000 00000000 00000000", "", 8, "expected at most 2 elements, found 3"),
    ("Part[<=2]", "000000 03000000" + "00" * 30, "", 8, "expected at most 2 elements, found 3"),
    ("Fixed[<=2]", "000000 03000000" + "00" * 50, "", 8, "expected at most 2 elements, found 3"),
    ("int16[3]", "00 0100 0200 03", "", 6, "expected 6 bytes of 3 int16, found 5"),
    ("float64[200]", "00000000000000", "", 12, "expected 1600 bytes of 200 float64, found 0"),
    ("string[]", "000000 ffffffff 01000000 00", "", 12, "expected 4294967295 elements, found 5 bytes"),
    ("string[]", "000000 02000000 02000000 4100 0000 02000000 4142", "[1]", 25, "expected NUL, found 0x42"),
    ("string[2]", "000000 02000000 4100 0000 02000000 ff00", "[1]", 20, "expected UTF-8, found invalid start byte"),
    ("wstring[]", "000000 01000000 01000000 00dc0000", "[0]", 16, "expected UTF-16, found illegal encoding"),
    ("Empty", "", "", 5, "expected 1 bytes of an empty message, found 0"),
    ("Empty[]", "000000 03000000 0000", "", 12, "expected 3 elements, found 2 bytes"),
    ("Empty[2]", "00", "", 5, "expected 2 elements, found 1 bytes"),
    ("Fixed", "00000000000000 000000000000f03f", ".y", 20, "expected 1 bytes of uint8, found 0"),
    ("Fixed[]", "000000 02000000 000000000000f03f 07", "", 12, ""),
    ("Part", "000000 02000000 4100 07", ".number", 14, "expected 2 bytes of uint16, found 1"),
    ("Part[]", "000000 ffffffff 00000000", "", 12, "expected 4294967295 elements, found 4 bytes"),
    ("Part[]", "000000 02000000 02000000 4100 0700 02000000 4142 0000", "[1].name", 25, "expected NUL, found 0x42"),
    ("Part[2]", "000000 02000000 4100 0700 02000000 4100 07", "[1].number", 22, "expected 2 bytes of uint16, found 1"),
    ("Heavy", "00" * 59, ".b59", 64, "expected 1 bytes of uint8, found 0"),
    ("Heavy", "00" * 60 + "000000 02000000 4142", ".part.name", 73, "expected NUL, found 0x42"),
    ("Heavy[]", "000000 01000000" + "00" * 60 + "02000000 4142", "[0].part.name", 77, "expected NUL, found 0x42"),
    ("Heavy[]", "000000 ffffffff" + "00" * 60, "", 12, "expected 4294967295 elements, found 60 bytes"),
]


@pytest.mark.parametrize(("kind", "tail", "where", "offset", "text"), CASES)
def test_wrong_byte_is_reported_with_field_and_offset(kind: str, tail: str, where: str, offset: int, text: str) -> None:
    cls = box(kind)
    data = bytes.fromhex(HEAD + tail)
    for given in (data, bytearray(data), memoryview(data)):
        for copy in (False, True):
            with pytest.raises(DecodeError) as caught:
                decode(cls, given, copy=copy)
            error = caught.value
            if not text:  # where exactly an element ends early depends on the path taken
                continue
            assert (error.path, error.offset_bytes, error.reason) == (f"{type_name(cls)}.v{where}", offset, text)
            assert str(error) == f"{error.path}: at byte {offset}: {text}"
            again = pickle.loads(pickle.dumps(error))
            assert (again.path, again.offset_bytes, again.reason) == (error.path, error.offset_bytes, error.reason)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        ("", "expected a 4-byte encapsulation header, found 0 bytes"),
        ("000100", "expected a 4-byte encapsulation header, found 3 bytes"),
        ("00020000 07", "expected encapsulation 0000 or 0001 (plain CDR), found 0002"),
        ("01010000 07", "expected encapsulation 0000 or 0001 (plain CDR), found 0101"),
    ],
)
@pytest.mark.parametrize("text_of_type", ["uint8 x\n", "string x\n", "Heavy x\n" + MORE, ""])
def test_unsupported_encapsulation_header_is_refused(data: str, text: str, text_of_type: str) -> None:
    cls = compile_definition(f"bytes/msg/Head{len(text_of_type)}", text_of_type)
    for given in (bytes.fromhex(data), bytearray.fromhex(data)):
        with pytest.raises(DecodeError) as caught:
            decode(cls, given)
        assert caught.value.path == type_name(cls)
        assert caught.value.reason == text


@pytest.mark.parametrize("options", ["0000", "0001", "0003", "ffff"])
@pytest.mark.parametrize("behind", ["", "00", "000000", "ff" * 20])
def test_encapsulation_options_and_trailing_bytes_are_ignored(options: str, behind: str) -> None:
    """Peers may put the number of pad bytes into the low bits of byte 3 (docs/internals/protocol.md 2.1)."""
    cls = compile_definition("bytes/msg/Options", "uint8 x\nstring text\n")
    little = bytes.fromhex("0001" + options + "07 000000 02000000 4100" + behind)
    big = bytes.fromhex("0000" + options + "07 000000 00000002 4100" + behind)
    assert decode(cls, little) == decode(cls, big) == cls(7, "A")


def test_string_of_length_zero_decodes_to_empty_text() -> None:
    """Readers accept it though no ROS writer writes it (docs/internals/protocol.md 2.2)."""
    for kind, tail, wanted in (
        ("string", "000000 00000000", ""),
        ("string[]", "000000 03000000 00000000 02000000 4100 0000 00000000", ["", "A", ""]),
        ("string[2]", "000000 00000000 00000000", ["", ""]),
    ):
        assert decode(box(kind), bytes.fromhex(HEAD + tail)).v == wanted


def test_string_bounds_are_not_enforced_on_decode_but_on_encode() -> None:
    for kind in ("string<=2", "wstring<=2"):
        free, bound = box(kind.split("<")[0]), box(kind)
        message = decode(bound, encode(free(1, "abcdef")))
        assert message.v == "abcdef"
        with pytest.raises(ValueError, match="expected at most 2 characters, found 6"):
            encode(message)
    assert decode(box("string<=2[]"), encode(box("string[]")(1, ["abcdef"]))).v == ["abcdef"]


def test_nul_inside_a_string_is_preserved() -> None:
    cls = box("string")
    assert decode(cls, encode(cls(1, "a\0b\0"))).v == "a\0b\0"


@pytest.mark.parametrize(
    "kind", ["uint8[]", "float64[]", "string[]", "wstring[]", "Empty[]", "Fixed[]", "Part[]", "Heavy[]"]
)
@pytest.mark.parametrize("count", ["ffffffff", "ffffff7f", "00000040"])
def test_huge_element_count_is_refused_without_allocating_memory(kind: str, count: str) -> None:
    cls = box(kind)
    data = bytes.fromhex(HEAD + "000000" + count) + bytes(2000)
    with pytest.raises(DecodeError):
        decode(cls, data)
    tracemalloc.start()
    try:
        with pytest.raises(DecodeError):
            decode(cls, data)
        assert tracemalloc.get_traced_memory()[1] < 50_000
    finally:
        tracemalloc.stop()
