"""Topic `ros_discovery_info`, on which DDS participants announce their nodes, and the codec of its message.

The codec is not generated, because one type name stands for two layouts: GIDs of Humble have 24 bytes, later ones 16.
The message begins with the GUID of its sender; decoding uses up the remaining bytes exactly only with the right layout.
Big-endian messages do not exist.

Source: docs/internals/protocol.md 6.2.
"""

from __future__ import annotations

import asyncio
import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.cdr.layout import NUL, Alignment, Count, Header
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.logs import internal_logger
from rosidl_py_gen.runtime.transport.api import (
    GUID_PREFIX_BYTES,
    DiscoveredEndpoint,
    DiscoveryEvent,
    EndpointSpec,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    Payload,
    Reader,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.qos import DEFAULT, QoSProfile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from rosidl_py_gen.runtime.transport.dds.services import ServiceParticipant


_TYPE = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_PARTICIPANT = bytes.fromhex("000001c1")
"""Entity id at the end of every participant's GUID; the GUID in a message may end with other bytes."""
GID_BYTES = 16
HUMBLE_GID_BYTES = 24
"""Size of a GID in Humble and earlier: a GUID, then zeros."""
_MAX_ITEMS = 1 << 20
"""Maximum number of nodes or endpoints in a message; a larger number means that the layout is wrong."""


def encode_message(participant_guid: bytes, nodes: Iterable[NodeEntities], *, is_humble: bool = False) -> bytes:
    """Encode the message by which a participant announces its nodes; with `is_humble`, in the layout of Humble."""
    gid_bytes = HUMBLE_GID_BYTES if is_humble else GID_BYTES
    out = bytearray(Header.BYTES)
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
    out += bytes(Header.align(len(out), Count.SIZE) - len(out))
    out += count.to_bytes(Count.SIZE, "little")


def decode_message(data: Payload, sender_prefix: bytes) -> NodesAnnounced:
    """Decode the message of the participant whose GUID begins with `sender_prefix` (12 bytes).

    `is_humble` of the result is True if the message has the layout of Humble.

    Raises:
        DecodeError: the bytes have neither the layout of Humble nor the later one.
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
    participant = raw[Header.SIZE : Header.SIZE + GUID_PREFIX_BYTES] + _PARTICIPANT
    return NodesAnnounced(participant, tuple(nodes), is_humble)


@dataclass(slots=True)
class _MessageCursor:
    """Position in a message while it is decoded in one of two layouts.

    `position` counts from the start of the header.
    """

    data: bytes
    gid_bytes: int
    sender_prefix: bytes
    position: int = Header.SIZE

    def message(self) -> list[NodeEntities]:
        if self._read(self.gid_bytes)[:GUID_PREFIX_BYTES] != self.sender_prefix:
            raise DecodeError(f"{_TYPE}.gid", Header.SIZE, "expected the GUID of the sender")
        nodes = [self._node() for _ in range(self._count("node_entities_info_seq"))]
        # The network pads to a multiple of 4 (docs/internals/protocol.md 2.4).
        left = len(self.data) - self.position
        if left >= Alignment.NETWORK or any(self.data[self.position :]):
            raise DecodeError(_TYPE, self.position, f"expected the end of the message, found {left} more bytes")
        return nodes

    def _node(self) -> NodeEntities:
        namespace, name = self._text(), self._text()
        readers = self._gids("reader_gid_seq")
        return NodeEntities(namespace, name, readers, self._gids("writer_gid_seq"))

    def _read(self, size: int) -> bytes:
        end = self.position + size
        if end > len(self.data):
            left = len(self.data) - self.position
            raise DecodeError(_TYPE, self.position, f"expected {size} bytes, found {left}")
        data = self.data[self.position : end]
        self.position = end
        return data

    def _number(self) -> int:
        self.position = Header.align(self.position, Count.SIZE)
        return int.from_bytes(self._read(Count.SIZE), "little")

    def _count(self, field: str) -> int:
        count = self._number()
        if count > _MAX_ITEMS:
            offset = self.position - Count.SIZE
            raise DecodeError(f"{_TYPE}.{field}", offset, f"expected at most {_MAX_ITEMS} elements, found {count}")
        return count

    def _text(self) -> str:
        return self._read(self._number()).rstrip(NUL).decode(errors="replace")

    def _gids(self, field: str) -> frozenset[bytes]:
        return frozenset(self._read(self.gid_bytes)[:16] for _ in range(self._count(field)))


# ---------------------------------------------------------------------------------------------------------------- topic

DISCOVERY_TOPIC = "ros_discovery_info"
_WRITER_QOS = DEFAULT.keep_last(1).transient_local()
_READER_QOS = DEFAULT.keep_all().transient_local()
_RETRY_DELAYS_S = (0.05, 0.2, 0.5)
"""Delays, in seconds, after which the reader of `ros_discovery_info` is recreated while a discovered writer has sent
nothing. The topic is transient local, and Cyclone often loses the first sample of a Fast DDS writer that it does not
know yet. Fast DDS would repeat the sample after 3 s, but sends its history to a new reader at once."""
_HUMBLE = "humble"
_MAX_UNDECIDED = 1000
_MAX_LOST_WRITERS = 1000
_HUMBLE_FOUND = (
    "a node of ROS 2 Humble is in this domain; on Fast DDS it may take all memory when it reads the node names of "
    "later distributions. "
)
_WARNINGS = {
    False: "So this process announces its nodes in the format of Humble, and tools of later distributions list none. "
    "Set ROS_DISTRO=humble to use that format from the start, or use another ROS_DOMAIN_ID",
    True: "Set ROS_DISTRO=humble to announce the nodes of this process in the format of Humble, or another "
    "ROS_DOMAIN_ID",
}
"""Second halves of the warning about a participant of Humble; the key states if another distribution is selected in
this process."""


class DiscoveryInfoTopic:
    """Writer and reader of the topic `ros_discovery_info` for one participant.

    A node of Humble on Fast DDS would read numbers from names and GIDs in the usual layout, and may allocate all
    memory. Later distributions read no nodes in the layout of Humble (docs/internals/protocol.md 6.5). So without a
    selected distribution, announcements have the layout of Humble until a participant of a later distribution is
    present, and while a participant of Humble is present: a new participant gets the last announcement before its own
    announcement arrives here.
    """

    def __init__(
        self,
        participant: ServiceParticipant,
        sink: Callable[[list[DiscoveryEvent]], None],
        ros_distro: str = "",
        report_lock: threading.RLock | None = None,
    ) -> None:
        """Create the writer and reader of the topic.

        `ros_distro` comes from `DomainSettings`; `report_lock` is held while discovery events are applied.
        """
        self._report_lock = threading.RLock() if report_lock is None else report_lock
        self._participant = participant
        self._sink = sink
        self._ros_distro = ros_distro
        self._nodes: tuple[NodeEntities, ...] = ()
        """Nodes of this participant that were announced last."""
        self._writer_has_hash: dict[bytes, bool] = {}
        """True for each discovered writer of the topic that announces a type hash, by GUID."""
        self._undecided: dict[bytes, NodesAnnounced] = {}
        """Announcements in the layout of Humble that arrived before the discovery of their writer, by the writer's
        GUID."""
        self._layouts: dict[bytes, bool | None] = {}
        """Layouts that peers' readers need, by GUID of the peer's writer: True for Humble's, False for the later one,
        None if the reader accepts both."""
        self._wrote_humble = False
        self._has_warned = False
        self._closed = False
        self._unheard_writers: set[bytes] = set()
        """GUIDs of writers from which no sample had been received when they were discovered."""
        self._heard_writers: set[bytes] = set()
        self._lost_writers: dict[bytes, None] = {}
        """GUIDs of lost writers of the topic, whose last samples may be read later; the oldest GUIDs are removed."""
        self._writer = participant.create_writer(_spec(_WRITER_QOS))
        self._reader = self._new_reader()

    def _new_reader(self) -> Reader:
        reader = self._participant.create_reader(_spec(_READER_QOS))
        reader.set_sink(self._on_messages)
        return reader

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """Announce all nodes of this participant, given by number, to peers."""
        self._nodes = tuple(nodes.values())
        self._write()

    def _is_humble_wanted(self) -> bool:
        if self._ros_distro:
            return self._ros_distro == _HUMBLE
        layouts = list(self._layouts.values())  # the loop may change them
        return True in layouts or False not in layouts

    def _write(self) -> None:
        is_humble = self._wrote_humble = self._is_humble_wanted()
        self._writer.write(encode_message(self._participant.guid, self._nodes, is_humble=is_humble))

    def read(self) -> None:
        """Pass the received announcements of peers' nodes to the discovery sink."""
        if self._reader.fetch() or self._reader.queue.items:  # a writer of this process may have fetched already
            self._on_messages()

    def forward_events(self, events: list[DiscoveryEvent]) -> None:
        """Pass discovery events to the sink.

        If a new writer of the topic sends no sample for a while, the reader is recreated.
        """
        writers = {
            event.guid: bool(event.type_hash)
            for event in events
            if isinstance(event, DiscoveredEndpoint) and event.is_writer and event.wire_name == DISCOVERY_TOPIC
        }
        for guid, has_hash in writers.items():
            self._add_writer(guid, has_hash)  # at once, because its reader gets our last message now
        self._sink(events)
        for event in events:
            if isinstance(event, EntityLost):
                if event.guid in self._writer_has_hash:
                    if len(self._lost_writers) >= _MAX_LOST_WRITERS:
                        del self._lost_writers[next(iter(self._lost_writers))]
                    self._lost_writers[event.guid] = None
                self._heard_writers.discard(event.guid)
                self._unheard_writers.discard(event.guid)
                self._writer_has_hash.pop(event.guid, None)
                self._undecided.pop(event.guid, None)
                self._layouts.pop(event.guid, None)
                self._write_if_changed()
            elif isinstance(event, DiscoveredEndpoint) and event.guid in writers:
                self._add_writer(event.guid, bool(event.type_hash))  # again: it may have been lost before
                if undecided := self._undecided.pop(event.guid, None):
                    self._set_layout(event.guid, None if event.type_hash else True)
                    self._warn_of(not event.type_hash)
                    self._sink([replace(undecided, is_humble=not event.type_hash)])
                self._expect_message(event.guid)

    def _add_writer(self, guid: bytes, has_hash: bool) -> None:
        self._writer_has_hash[guid] = has_hash
        self._lost_writers.pop(guid, None)
        # Those on Cyclone DDS may be of this package.
        if guid not in self._heard_writers and (not has_hash or self._participant.uses_sample_identity(guid)):
            self._set_layout(guid, not has_hash)

    def _is_humble(self, writer: bytes, message: NodesAnnounced) -> bool | None:
        """Return True if the participant that sent `message` is of Humble, None if that is unknown.

        Contexts of this package may use the layout of Humble, too, but their `writer` announces a type hash.
        """
        if not message.is_humble:
            return False
        return None if writer not in self._writer_has_hash else not self._writer_has_hash[writer]

    def _set_layout(self, writer: bytes, is_humble: bool | None) -> None:
        if self._layouts.get(writer, False) is not None:  # a context of this package may change its own layout
            self._layouts[writer] = is_humble
            self._write_if_changed()

    def _write_if_changed(self) -> None:
        if self._nodes and not self._closed and self._wrote_humble is not self._is_humble_wanted():
            self._write()

    def _warn_of(self, is_humble: bool | None) -> None:
        if is_humble and not (self._has_warned or self._closed or self._ros_distro == _HUMBLE):
            self._has_warned = True
            internal_logger().warning(_HUMBLE_FOUND + _WARNINGS[bool(self._ros_distro)])

    def _expect_message(self, writer: bytes) -> None:
        loop = current_loop()
        is_own = writer[:GUID_PREFIX_BYTES] == self._participant.guid[:GUID_PREFIX_BYTES]
        if loop is not None and not is_own and writer not in self._heard_writers:
            if not self._unheard_writers:
                loop.call_later(_RETRY_DELAYS_S[0], self._recreate_reader, 1)
            self._unheard_writers.add(writer)

    def _recreate_reader(self, attempt: int) -> None:
        self._unheard_writers -= self._heard_writers
        if self._closed or not self._unheard_writers:
            return
        old, self._reader = self._reader, self._new_reader()
        old.close()
        if attempt == len(_RETRY_DELAYS_S):
            self._unheard_writers.clear()
        else:
            asyncio.get_running_loop().call_later(_RETRY_DELAYS_S[attempt], self._recreate_reader, attempt + 1)

    def _on_messages(self) -> None:
        with self._report_lock:
            self._apply_messages()

    def _apply_messages(self) -> None:
        items = self._reader.queue.items
        events: list[DiscoveryEvent] = []
        while items:
            data, _, handle, _, _ = items.popleft()
            guid = self._reader.writer_guid(handle)
            if guid is None:
                continue
            is_lost = guid in self._lost_writers
            if not is_lost:
                self._heard_writers.add(guid)
            prefix = guid[:GUID_PREFIX_BYTES]
            try:
                message = decode_message(data, prefix)
            except DecodeError as err:
                text = f"ignored a graph message of participant {prefix.hex('.')}: {err}"
                internal_logger().warning(text, throttle_s=1.0)
                continue
            is_humble = self._is_humble(guid, message)
            if not is_lost:  # else nothing would forget the layout
                self._set_layout(guid, None if message.is_humble and is_humble is False else message.is_humble)
            self._warn_of(is_humble)
            announced = replace(message, is_humble=is_humble)
            events.append(announced)
            if message.is_humble and is_humble is None and not is_lost:
                if len(self._undecided) >= _MAX_UNDECIDED:
                    self._undecided.clear()
                self._undecided[guid] = announced
        self._sink(events)

    def close(self) -> None:
        """Delete the reader and the writer of the topic. May be called twice."""
        self._closed = True
        self._reader.close()
        self._writer.close()


def _spec(qos: QoSProfile) -> EndpointSpec:
    return EndpointSpec(TopicKey("unmangled", DISCOVERY_TOPIC), _TYPE, qos, HASHES[_TYPE], ignore_local=True)
