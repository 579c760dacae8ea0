"""Sample identities of Fast DDS in the bytes of RTPS packets."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import (
    INLINE_QOS_BYTES,
    encode_inline_qos,
    read_submessage,
)
from rosidl_py_gen.runtime.transport.cyclone.private_layout import (
    DATA,
    DATA_BYTES,
    DATA_FRAG,
    DATA_FRAG_BYTES,
    INLINE_QOS_FLAG,
)

FAST, CYCLONE, RTI, OTHER = b"\x01\x0f", b"\x01\x10", b"\x01\x01", b"\x01\x12"
READER = bytes(range(12)) + b"\0\0\x13\x04"
WRITER_ID = b"\0\0\x14\x03"


def packet(vendor: bytes) -> bytes:
    return b"RTPS\2\3" + vendor + vendor + bytes(10)


def submessage(parameters: bytes = b"", *, big: bool = False, number: int = 7, kind: int = DATA) -> bytes:
    """Return DATA or DATA_FRAG up to the payload, as Cyclone stores it: the header in our byte order."""
    flags = (0 if big else 1) | (INLINE_QOS_FLAG if parameters else 0)
    length = DATA_BYTES if kind == DATA else DATA_FRAG_BYTES
    head = struct.pack("<BBHHH", kind, flags, 0, 0, length - 8)
    head += b"\0\0\0\0" + WRITER_ID[::-1] + struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)
    return head.ljust(length, b"\0") + parameters


def parameter(pid: int, guid: bytes, number: int, *, big: bool = False) -> bytes:
    """Return inline QoS of one identity."""
    order = ">" if big else "<"
    body = struct.pack(f"{order}HH16siI", pid, 24, guid, number >> 32, number & 0xFFFFFFFF)
    return body + struct.pack(f"{order}HH", 1, 0)


@pytest.mark.parametrize("kind", [DATA, DATA_FRAG])
@pytest.mark.parametrize("number", [1, 2**31, 2**40 + 5])
def test_encoded_inline_qos_contains_the_reader_in_both_forms(kind: int, number: int) -> None:
    parameters = encode_inline_qos((READER, number))
    assert len(parameters) == INLINE_QOS_BYTES
    assert read_submessage(packet(CYCLONE), submessage(parameters, kind=kind), is_reply=True) == (READER, number)
    assert parameters == (
        bytes.fromhex("8300 1800") + READER + struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)  # PID, 24 bytes
        + bytes.fromhex("0f80 1800") + READER + struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)
        + bytes.fromhex("0100 0000")  # end of list
    )  # fmt: skip


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    ("vendor", "pid", "is_known"),
    [(FAST, 0x83, True), (FAST, 0x800F, True), (RTI, 0x800F, True), (CYCLONE, 0x83, True), (CYCLONE, 0x800F, False)],
)
def test_reply_identity_is_read_from_inline_qos_by_vendor(vendor: bytes, pid: int, is_known: bool, big: bool) -> None:
    data = submessage(parameter(pid, READER, 3, big=big), big=big)
    assert read_submessage(packet(vendor), data, is_reply=True) == ((READER, 3) if is_known else None)


def test_request_identity_is_named_reader_and_rtps_sequence_number() -> None:
    unknown_number = parameter(0x800F, READER, -1 << 32)
    assert read_submessage(packet(FAST), submessage(unknown_number, number=9), is_reply=False) == (READER, 9)


@pytest.mark.parametrize("parameters", [b"", parameter(0x83, bytes(16), 0)])
def test_request_identity_without_reader_is_its_writer(parameters: bytes) -> None:
    head = packet(FAST)
    assert read_submessage(head, submessage(parameters), is_reply=False) == (head[8:20] + WRITER_ID, 7)


@pytest.mark.parametrize("vendor", [CYCLONE, OTHER])
@pytest.mark.parametrize("is_reply", [False, True])
def test_samples_of_other_vendors_have_no_identity(vendor: bytes, is_reply: bool) -> None:
    assert read_submessage(packet(vendor), submessage(), is_reply=is_reply) is None


@pytest.mark.parametrize("length", [1, 8, 20, 23])
def test_truncated_submessage_has_no_identity_and_raises_no_error(length: int) -> None:
    assert read_submessage(packet(FAST), submessage()[:length], is_reply=False) is None


def test_other_inline_qos_parameters_are_skipped() -> None:
    key_hash = struct.pack("<HH16s", 0x70, 16, bytes(16))
    data = submessage(key_hash + parameter(0x83, READER, 4))
    assert read_submessage(packet(FAST), data, is_reply=True) == (READER, 4)


@given(st.binary(max_size=20), st.binary(max_size=200), st.booleans())
def test_any_packet_bytes_are_parsed_or_raise_value_error(head: bytes, data: bytes, is_reply: bool) -> None:
    try:
        identity = read_submessage(head, data, is_reply=is_reply)
    except ValueError:
        return
    assert identity is None or len(identity[0]) == 16


@given(st.sampled_from([FAST, CYCLONE]), st.binary(max_size=120), st.booleans(), st.booleans())
def test_any_inline_qos_bytes_are_parsed_within_the_payload(
    vendor: bytes, parameters: bytes, big: bool, is_reply: bool
) -> None:
    data = bytearray(submessage(parameters, big=big))
    data[1] |= INLINE_QOS_FLAG
    identity = read_submessage(packet(vendor), bytes(data), is_reply=is_reply)
    assert identity is None or (len(identity[0]) == 16 and -(2**63) <= identity[1] < 2**63)
