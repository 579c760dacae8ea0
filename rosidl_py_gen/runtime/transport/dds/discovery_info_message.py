"""Codec of the `ros_discovery_info` message with GIDs of 16 and of 24 bytes.

Not generated, because one type name stands for two layouts: GIDs of Humble have 24 bytes, later ones 16
(docs/internals/protocol.md 6.2). The message begins with the GUID of its sender, and only the right layout consumes the
rest exactly. Big-endian messages do not exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.cdr.layout import COUNT_BYTES, HEADER, HEADER_BYTES, NETWORK_ALIGN, NUL, align_offset
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.transport.discovery_events import GUID_PREFIX_BYTES, NodeEntities

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime.transport.samples import Payload

_NAME = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_PARTICIPANT = bytes.fromhex("000001c1")
"""Entity id of every participant. The last bytes of the GUID in a message may be others."""
GID_BYTES = 16
HUMBLE_GID_BYTES = 24
"""Size of a GID in Humble and earlier: a GUID, then zeros."""
_MAX_ITEMS = 1 << 20
"""Maximum number of nodes or endpoints of a participant; a larger number means that the layout is wrong."""


class DiscoveryInfoMessage(NamedTuple):
    """All nodes of one participant; `is_humble` is True if GIDs have 24 bytes."""

    participant_guid: bytes
    nodes: list[NodeEntities]
    is_humble: bool = False


def encode(participant_guid: bytes, nodes: Iterable[NodeEntities], *, is_humble: bool = False) -> bytes:
    """Encode a message; with `is_humble`, in the layout of Humble."""
    gid_bytes = HUMBLE_GID_BYTES if is_humble else GID_BYTES
    out = bytearray(HEADER)
    out += participant_guid.ljust(gid_bytes, b"\0")
    entries = list(nodes)
    _append_count(out, len(entries))
    for node in entries:
        for text in (node.namespace, node.name):
            data = text.encode() + NUL
            _append_count(out, len(data))
            out += data
        for gids in (node.reader_gids, node.writer_gids):
            _append_count(out, len(gids))
            out += b"".join(gid.ljust(gid_bytes, b"\0") for gid in sorted(gids))
    return bytes(out)


def _append_count(out: bytearray, count: int) -> None:
    out += bytes(align_offset(len(out), COUNT_BYTES) - len(out))
    out += count.to_bytes(COUNT_BYTES, "little")


def decode(data: Payload, sender_prefix: bytes) -> DiscoveryInfoMessage:
    """Decode the message of the participant whose GUID begins with `sender_prefix` (12 bytes).

    Raises:
        DecodeError: the bytes have neither layout.
    """
    raw = bytes(data)
    is_humble = False
    try:
        nodes = _MessageCursor(raw, GID_BYTES, sender_prefix).message()
    except DecodeError as error:
        try:
            nodes = _MessageCursor(raw, HUMBLE_GID_BYTES, sender_prefix).message()
            is_humble = True
        except DecodeError:
            raise error from None
    participant = raw[HEADER_BYTES : HEADER_BYTES + GUID_PREFIX_BYTES] + _PARTICIPANT
    return DiscoveryInfoMessage(participant, nodes, is_humble)


@dataclass(slots=True)
class _MessageCursor:
    """Decoder of one layout; `position` counts from the start of the header."""

    data: bytes
    gid_bytes: int
    sender_prefix: bytes
    position: int = HEADER_BYTES

    def message(self) -> list[NodeEntities]:
        if self._read(self.gid_bytes)[:GUID_PREFIX_BYTES] != self.sender_prefix:
            raise DecodeError(f"{_NAME}.gid", HEADER_BYTES, "expected the GUID of the sender")
        nodes = [self._node() for _ in range(self._count("node_entities_info_seq"))]
        # The network pads to a multiple of 4 (docs/internals/protocol.md 2.4).
        left = len(self.data) - self.position
        if left >= NETWORK_ALIGN or any(self.data[self.position :]):
            raise DecodeError(_NAME, self.position, f"expected the end of the message, found {left} more bytes")
        return nodes

    def _node(self) -> NodeEntities:
        namespace, name = self._text(), self._text()
        readers = self._gids("reader_gid_seq")
        return NodeEntities(namespace, name, readers, self._gids("writer_gid_seq"))

    def _read(self, size: int) -> bytes:
        end = self.position + size
        if end > len(self.data):
            left = len(self.data) - self.position
            raise DecodeError(_NAME, self.position, f"expected {size} bytes, found {left}")
        data = self.data[self.position : end]
        self.position = end
        return data

    def _number(self) -> int:
        self.position = align_offset(self.position, COUNT_BYTES)
        return int.from_bytes(self._read(COUNT_BYTES), "little")

    def _count(self, field: str) -> int:
        count = self._number()
        if count > _MAX_ITEMS:
            offset = self.position - COUNT_BYTES
            raise DecodeError(f"{_NAME}.{field}", offset, f"expected at most {_MAX_ITEMS} elements, found {count}")
        return count

    def _text(self) -> str:
        return self._read(self._number()).rstrip(NUL).decode(errors="replace")

    def _gids(self, field: str) -> frozenset[bytes]:
        return frozenset(self._read(self.gid_bytes)[:16] for _ in range(self._count(field)))
