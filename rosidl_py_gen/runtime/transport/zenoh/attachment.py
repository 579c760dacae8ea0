"""Attachment of each sample, request and reply: sequence number, time and GID of the sender, in 33 bytes.

The attachment of a reply has the number and the GID of its request. Peers on rmw_zenoh_cpp may crash if they receive
any other bytes, so only `pack` creates attachments.

Source: docs/internals/zenoh.md 4.2 to 4.4 (rmw_zenoh_cpp, attachment_helpers.cpp).
"""

from __future__ import annotations

import struct

from rosidl_py_gen.errors import RosidlError

SIZE = 33
GID_BYTES = 16
_LAYOUT = struct.Struct("<qqB16s")
_LEGACY_SIZE = 77


class AttachmentError(RosidlError, ValueError):
    """An attachment does not have the format of rmw_zenoh_cpp."""


def pack(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Encode an attachment.

    Args:
        sequence: number of the sample at its publisher or client, from 1.
        stamp_ns: time since the Unix epoch.
        gid: 16 bytes, a result of `liveliness_tokens.gid_of`.
    """
    return _LAYOUT.pack(sequence, stamp_ns, GID_BYTES, gid)


def unpack(data: bytes) -> tuple[int, int, bytes]:
    """Return sequence number, time in ns and GID; raise `AttachmentError`."""
    if len(data) != SIZE:
        legacy = "; that of rmw_zenoh_cpp before Jazzy's 0.2.4: update the peer" if len(data) == _LEGACY_SIZE else ""
        raise AttachmentError(f"expected an attachment of {SIZE} bytes, found {len(data)} bytes{legacy}")
    sequence, stamp_ns, size, gid = _LAYOUT.unpack(data)
    if size != GID_BYTES:
        raise AttachmentError(f"attachment: byte 16: expected {GID_BYTES}, the length of a GID, found {size}")
    if sequence < 0:
        raise AttachmentError(f"attachment: byte 0: expected a sequence number of 0 or more, found {sequence}")
    if stamp_ns < 0:
        raise AttachmentError(f"attachment: byte 8: expected a time of 0 or more, found {stamp_ns}")
    return sequence, stamp_ns, gid
