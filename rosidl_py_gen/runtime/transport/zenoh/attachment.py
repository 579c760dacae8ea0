"""What accompanies every sample, request and reply: a number, a time and who sent it, in 33 bytes.

Decides nothing but the layout; a reply carries the number and the GID of its request. Peers on rmw_zenoh_cpp may end
when they get anything else, so only `pack` makes attachments.

Source: docs/internals/zenoh.md 4.2 to 4.4 (rmw_zenoh_cpp, attachment_helpers.cpp).
"""

from __future__ import annotations

import struct

from rosidl_py_gen.errors import RosidlError

SIZE = 33
GID_BYTES = 16
_LAYOUT = struct.Struct("<qqB16s")
_NAMED_SIZE = 77


class AttachmentError(RosidlError, ValueError):
    """What a peer sent beside a sample is not what rmw_zenoh_cpp sends."""


def pack(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """The attachment of a sample.

    Args:
        sequence: of this publisher or client, beginning with 1.
        stamp_ns: since the Unix epoch.
        gid: 16 bytes, as `tokens.gid_of` gives it.
    """
    return _LAYOUT.pack(sequence, stamp_ns, GID_BYTES, gid)


def unpack(data: bytes) -> tuple[int, int, bytes]:
    """Sequence number, time in ns and GID; raises `AttachmentError`."""
    if len(data) != SIZE:
        old = "; that of rmw_zenoh_cpp before Jazzy's 0.2.4: update the peer" if len(data) == _NAMED_SIZE else ""
        raise AttachmentError(f"expected an attachment of {SIZE} bytes, found {len(data)} bytes{old}")
    sequence, stamp_ns, size, gid = _LAYOUT.unpack(data)
    if size != GID_BYTES:
        raise AttachmentError(f"attachment: byte 16: expected {GID_BYTES}, the length of a GID, found {size}")
    if sequence < 0 or stamp_ns < 0:
        what, offset_bytes, found = ("sequence number", 0, sequence) if sequence < 0 else ("time", 8, stamp_ns)
        raise AttachmentError(f"attachment: byte {offset_bytes}: expected a {what} of 0 or more, found {found}")
    return sequence, stamp_ns, gid
