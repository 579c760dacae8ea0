"""Bytes of RTPS, the protocol below DDS: what Fast DDS says of requests and replies beside the message.

Knows packets, not how Cyclone keeps them; that is `services.py`. What comes in here comes from the network.

Source: docs/internals/protocol.md 5.3, docs/internals/dds.md 2; OMG DDSI-RTPS 2.3, 9.4 and 9.6.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR, IDENTITY_BYTES

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.dds.correlation import SampleIdentity

DATA, DATA_FRAG, INFO_SRC, INFO_DST = 0x15, 0x16, 0x0C, 0x0E
DATA_BYTES, DATA_FRAG_BYTES = 24, 36
INLINE_QOS_FLAG = 2
PARAMETERS_BYTES = 2 * (4 + IDENTITY_BYTES) + 4
"""Length of what `encode_inline_qos` makes."""

_LITTLE = 1
_PID_END, _PID_IDENTITY, _PID_IDENTITY_EARLIER = 1, 0x0083, 0x800F
"""Fast DDS up to 2.9 knows the last only, later ones send both."""
_VENDORS_OF_EARLIER = (FAST_DDS_VENDOR, b"\x01\x01")
"""Whose parameters above 0x8000 mean what they mean to Fast DDS (itself and RTI)."""
_both = struct.Struct("<HH16siI HH16siI I")
_numbers = (struct.Struct(">HH").unpack_from, struct.Struct("<HH").unpack_from)
_sequence_numbers = (struct.Struct(">iI").unpack_from, struct.Struct("<iI").unpack_from)


def encode_inline_qos(identity: SampleIdentity) -> bytes:
    """Both forms of the identity, and the end of the list; little-endian as all we send."""
    guid, sequence = identity
    high, low = sequence >> 32, sequence & 0xFFFFFFFF
    return _both.pack(
        *(_PID_IDENTITY, IDENTITY_BYTES, guid, high, low),
        *(_PID_IDENTITY_EARLIER, IDENTITY_BYTES, guid, high, low),
        _PID_END,
    )


def decode_inline_qos(parameters: bytes) -> SampleIdentity:
    """What `encode_inline_qos` made them of."""
    _, _, guid, high, low, *_ = _both.unpack(parameters)
    return guid, high << 32 | low


def read_submessage(packet: bytes, submessage: bytes, *, is_reply: bool) -> SampleIdentity | None:
    """The identity of a sample: the request it is, or the request it answers.

    Args:
        packet: begins with the RTPS header of 20 bytes.
        submessage: DATA or DATA_FRAG with its parameters, up to the payload, as Cyclone leaves it: the numbers of the
            header in the byte order of this machine (little-endian), the id of the writer turned round with them.

    Returns:
        None when there is none: a sample of another middleware, or a reply nobody asked for that way.

    Raises:
        ValueError: these are no such bytes.
    """
    if packet[:4] != b"RTPS" or not submessage or submessage[0] not in (DATA, DATA_FRAG):
        raise ValueError(f"no RTPS data: {packet.hex()} {submessage[:DATA_BYTES].hex()}")
    if len(submessage) < DATA_BYTES:
        return None  # of a peer that lets its payload begin inside the header
    flags, vendor = submessage[1], packet[6:8]
    found = None
    if flags & INLINE_QOS_FLAG:
        after_header = 8 + int.from_bytes(submessage[6:8], "little")
        found = _find_identity(submessage, after_header, flags & _LITTLE, vendor in _VENDORS_OF_EARLIER)
    if is_reply:
        return found
    high, low = _sequence_numbers[_LITTLE](submessage, 16)
    if found is not None and any(found[0]):
        return found[0], high << 32 | low
    if vendor != FAST_DDS_VENDOR:
        return None
    return packet[8:20] + submessage[15:11:-1], high << 32 | low


def _find_identity(submessage: bytes, offset: int, order: int, knows_earlier: bool) -> SampleIdentity | None:
    unpack = _numbers[order]
    while offset + 4 <= len(submessage):
        pid, length = unpack(submessage, offset)
        offset += 4
        if pid == _PID_END:
            break
        is_identity = pid == _PID_IDENTITY or (pid == _PID_IDENTITY_EARLIER and knows_earlier)
        if is_identity and length >= IDENTITY_BYTES and offset + length <= len(submessage):
            high, low = _sequence_numbers[order](submessage, offset + 16)
            return submessage[offset : offset + 16], high << 32 | low
        offset += length
    return None
