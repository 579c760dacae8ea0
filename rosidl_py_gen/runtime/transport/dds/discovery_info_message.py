"""The `ros_discovery_info` message in both its shapes: with 16- and 24-byte GIDs.

Written by hand instead of generated because one type name stands for two layouts: Humble's GIDs have 24 bytes, later
ones 16 (docs/internals/protocol.md 6.2). It begins with the GUID of its sender, and only one reading of the rest
consumes it exactly. We write the 16-byte shape. Nobody sends big-endian ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.cdr.layout import COUNT_BYTES, HEADER, HEADER_BYTES, NETWORK_ALIGN, NUL, align_offset
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.transport.discovery_events import NodeEntities

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime.transport.samples import Payload

_NAME = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_PARTICIPANT = bytes.fromhex("000001c1")
"""The end of the GUID of every participant; a message with another one there is still its sender's."""
_MAX_ITEMS = 1 << 20
"""More nodes or endpoints than this in one participant is a wrong reading, not a big program."""


class DiscoveryInfoMessage(NamedTuple):
    """One participant's whole state."""

    participant_guid: bytes
    nodes: list[NodeEntities]


def encode(participant_guid: bytes, nodes: Iterable[NodeEntities]) -> bytes:
    """The message as we send it."""
    out = bytearray(HEADER)
    out += participant_guid
    listed = list(nodes)
    _put_count(out, len(listed))
    for node in listed:
        _put_text(out, node.namespace)
        _put_text(out, node.name)
        _put_gids(out, node.reader_gids)
        _put_gids(out, node.writer_gids)
    return bytes(out)


def _put_count(out: bytearray, count: int) -> None:
    out += bytes(align_offset(len(out), COUNT_BYTES) - len(out))
    out += count.to_bytes(COUNT_BYTES, "little")


def _put_text(out: bytearray, text: str) -> None:
    data = text.encode() + NUL
    _put_count(out, len(data))
    out += data


def _put_gids(out: bytearray, gids: frozenset[bytes]) -> None:
    _put_count(out, len(gids))
    for gid in sorted(gids):
        out += gid


def decode(data: Payload, sender_prefix: bytes) -> DiscoveryInfoMessage:
    """Read the message of the participant whose GUID begins with `sender_prefix` (12 bytes).

    The reading that fits is taken, 16-byte GIDs first.

    Raises:
        DecodeError: no reading fits.
    """
    raw = bytes(data)
    try:
        nodes = _MessageCursor(raw, 16, sender_prefix).message()
    except DecodeError as error:
        try:
            nodes = _MessageCursor(raw, 24, sender_prefix).message()
        except DecodeError:
            raise error from None
    return DiscoveryInfoMessage(raw[HEADER_BYTES : HEADER_BYTES + 12] + _PARTICIPANT, nodes)


@dataclass(slots=True)
class _MessageCursor:
    """One attempt to read the bytes in one shape; `position` counts from the start, header included."""

    data: bytes
    gid_bytes: int
    sender_prefix: bytes
    position: int = HEADER_BYTES

    def message(self) -> list[NodeEntities]:
        if self._take(self.gid_bytes)[:12] != self.sender_prefix:
            raise DecodeError(f"{_NAME}.gid", HEADER_BYTES, "expected the GUID of the sender")
        nodes = [self._node() for _ in range(self._count("node_entities_info_seq"))]
        # The network pads to a multiple of 4 (docs/internals/protocol.md 2.4).
        if len(self.data) - self.position >= NETWORK_ALIGN or any(self.data[self.position :]):
            raise DecodeError(_NAME, self.position, f"expected the end, {len(self.data) - self.position} bytes follow")
        return nodes

    def _node(self) -> NodeEntities:
        namespace, name = self._text(), self._text()
        readers = self._gids("reader_gid_seq")
        return NodeEntities(namespace, name, readers, self._gids("writer_gid_seq"))

    def _take(self, size: int) -> bytes:
        end = self.position + size
        if end > len(self.data):
            raise DecodeError(_NAME, self.position, f"expected {size} bytes, {len(self.data) - self.position} are left")
        found = self.data[self.position : end]
        self.position = end
        return found

    def _number(self) -> int:
        self.position = align_offset(self.position, COUNT_BYTES)
        return int.from_bytes(self._take(COUNT_BYTES), "little")

    def _count(self, field: str) -> int:
        count = self._number()
        if count > _MAX_ITEMS:
            raise DecodeError(f"{_NAME}.{field}", self.position - COUNT_BYTES, f"{count} elements cannot be right")
        return count

    def _text(self) -> str:
        data = self._take(self._number())
        return data.rstrip(NUL).decode(errors="replace")

    def _gids(self, field: str) -> frozenset[bytes]:
        return frozenset(self._take(self.gid_bytes)[:16] for _ in range(self._count(field)))
