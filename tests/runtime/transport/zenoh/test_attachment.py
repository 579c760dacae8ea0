"""The 33 bytes beside each sample: docs/internals/zenoh.md 4.2 to 4.4."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.zenoh.wire_formats import AttachmentError, pack_attachment, unpack_attachment

GID = bytes.fromhex("eb85fa883b7846dc448a4501890ad062")
BYTES = bytes.fromhex(
    "0100000000000000"  # sequence number 1
    "15cd5b0700000000"  # 123456789 ns
    "10"  # length of the GID, a varint
    "eb85fa883b7846dc448a4501890ad062"
)
NUMBERS = st.integers(0, 2**63 - 1)


def test_an_attachment_has_number_time_and_gid() -> None:
    assert pack_attachment(1, 123456789, GID) == BYTES
    assert unpack_attachment(BYTES) == (1, 123456789, GID)


def test_zenoh_itself_writes_the_same_bytes() -> None:
    ext = pytest.importorskip("zenoh.ext")
    assert bytes(ext.z_serialize((ext.Int64(1), ext.Int64(123456789), GID))) == BYTES


@given(NUMBERS, NUMBERS, st.binary(min_size=16, max_size=16))
def test_what_was_packed_comes_back(sequence: int, stamp_ns: int, gid: bytes) -> None:
    assert unpack_attachment(pack_attachment(sequence, stamp_ns, gid)) == (sequence, stamp_ns, gid)


@given(st.binary(max_size=100))
def test_no_bytes_raise_anything_but_our_error(data: bytes) -> None:
    try:
        sequence, stamp_ns, gid = unpack_attachment(data)
    except AttachmentError:
        return
    assert pack_attachment(sequence, stamp_ns, gid) == data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected an attachment of 33 bytes, found 0 bytes"),
        (BYTES + b"\0", "expected an attachment of 33 bytes, found 34 bytes"),
        (bytes(77), "found 77 bytes; that of rmw_zenoh_cpp before Jazzy's 0.2.4"),
        (BYTES[:16] + b"\x0f" + GID, "byte 16: expected 16, the length of a GID, found 15"),
        (b"\xff" * 8 + BYTES[8:], "byte 0: expected a sequence number of 0 or more, found -1"),
        (BYTES[:8] + b"\xff" * 8 + BYTES[16:], "byte 8: expected a time of 0 or more, found -1"),
    ],
)
def test_an_error_names_the_byte(data: bytes, message: str) -> None:
    with pytest.raises(AttachmentError, match=re.escape(message)):
        unpack_attachment(data)
