"""Sample identities in RTPS packets, as Fast DDS sends them in the inline QoS of requests and replies.

`private_layout.py` knows how Cyclone stores packets. The bytes come from the network: any content is possible.

Source: docs/internals/protocol.md 5.3, docs/internals/dds.md 2; OMG DDSI-RTPS 2.3, 9.4 and 9.6.
"""

from __future__ import annotations

import struct

from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR, IDENTITY_BYTES, SampleIdentity

DATA = 0x15
"""Kind of a submessage, like the following three."""
DATA_FRAG = 0x16
INFO_SRC = 0x0C
INFO_DST = 0x0E
DATA_BYTES = 24
DATA_FRAG_BYTES = 36
INLINE_QOS_FLAG = 2
INLINE_QOS_BYTES = 2 * (4 + IDENTITY_BYTES) + 4
"""Length of the result of `encode_inline_qos`."""

_LITTLE = 1
_PID_END = 1
_PID_IDENTITY = 0x0083
_PID_LEGACY_IDENTITY = 0x800F
"""Parameter of Fast DDS up to 2.9; later versions send both."""
_LEGACY_VENDORS = (FAST_DDS_VENDOR, b"\x01\x01")
"""Vendors whose parameters above 0x8000 have the meaning of Fast DDS (itself and RTI)."""
_both = struct.Struct("<HH16siI HH16siI I")
_numbers = (struct.Struct(">HH").unpack_from, struct.Struct("<HH").unpack_from)
_sequence_numbers = (struct.Struct(">iI").unpack_from, struct.Struct("<iI").unpack_from)


def encode_inline_qos(identity: SampleIdentity) -> bytes:
    """Encode the identity as both parameters, little-endian, with the end of the list."""
    guid, sequence = identity
    high, low = sequence >> 32, sequence & 0xFFFFFFFF
    return _both.pack(
        *(_PID_IDENTITY, IDENTITY_BYTES, guid, high, low),
        *(_PID_LEGACY_IDENTITY, IDENTITY_BYTES, guid, high, low),
        _PID_END,
    )


def decode_inline_qos(inline_qos: bytes) -> SampleIdentity:
    """Return the identity that `encode_inline_qos` encoded."""
    _, _, guid, high, low, *_ = _both.unpack(inline_qos)
    return guid, high << 32 | low


def read_submessage(packet: bytes, submessage: bytes, *, is_reply: bool) -> SampleIdentity | None:
    """Return the sample identity of a request or reply.

    Args:
        packet: begins with the RTPS header of 20 bytes.
        submessage: DATA or DATA_FRAG with its inline QoS, up to the payload, as Cyclone stores it: the numbers of the
            header and the writer id in the byte order of this machine (little-endian).

    Returns:
        None if there is none: a sample of another middleware, or a reply to a request without identity.

    Raises:
        ValueError: the bytes are not a packet with such a submessage.
    """
    if packet[:4] != b"RTPS" or not submessage or submessage[0] not in (DATA, DATA_FRAG):
        raise ValueError(f"no RTPS data: {packet.hex()} {submessage[:DATA_BYTES].hex()}")
    if len(submessage) < DATA_BYTES:
        return None  # the payload of this peer begins inside the header
    flags, vendor = submessage[1], packet[6:8]
    identity = None
    if flags & INLINE_QOS_FLAG:
        after_header = 8 + int.from_bytes(submessage[6:8], "little")
        identity = _find_identity(submessage, after_header, flags & _LITTLE, vendor in _LEGACY_VENDORS)
    if is_reply:
        return identity
    high, low = _sequence_numbers[_LITTLE](submessage, 16)
    if identity is not None and any(identity[0]):
        return identity[0], high << 32 | low
    if vendor != FAST_DDS_VENDOR:
        return None
    return packet[8:20] + submessage[15:11:-1], high << 32 | low


def _find_identity(submessage: bytes, offset: int, order: int, knows_legacy: bool) -> SampleIdentity | None:
    unpack = _numbers[order]
    while offset + 4 <= len(submessage):
        pid, length = unpack(submessage, offset)
        offset += 4
        if pid == _PID_END:
            break
        is_identity = pid == _PID_IDENTITY or (pid == _PID_LEGACY_IDENTITY and knows_legacy)
        if is_identity and length >= IDENTITY_BYTES and offset + length <= len(submessage):
            high, low = _sequence_numbers[order](submessage, offset + 16)
            return submessage[offset : offset + 16], high << 32 | low
        offset += length
    return None
