"""Peers on Fast DDS that one participant has discovered: which they are, their early samples, and warnings.

Cyclone DDS drops the heartbeats of a participant or writer that it does not know yet, and the next ones arrive after 1
s or 3 s (docs/internals/dds.md 6). So this module sends an ACKNACK that requests a heartbeat, and makes readers request
the samples that the first heartbeat announces.

Source: docs/internals/dds.md 6 and 12; OMG DDSI-RTPS 2.3, 8.3.7.1, 9.4.5.3 and 9.6.1.1; sources of Fast DDS 2.14,
StatefulWriter::process_acknack.
"""

from __future__ import annotations

import contextlib
import ctypes as ct
import re
import socket
import struct
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.transport.api import (
    GUID_PREFIX_BYTES,
    DiscoveredEndpoint,
    DiscoveryEvent,
    EntityLost,
    ParticipantDiscovered,
    TransportError,
)
from rosidl_py_gen.runtime.transport.cyclone import library, private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FAST_DDS_VENDOR
from rosidl_py_gen.runtime.transport.qos import Reliability

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FastDdsInterop, FastDdsSupport

_ADDRESSES = b"__NetworkAddresses"
"""Property in which Cyclone stores the network addresses of a discovered participant."""
_FAST_DDS = (b"PARTICIPANT_TYPE", b"fastdds.physical_data.host")
"""Properties that only participants on Fast DDS have."""
_HASHED_BIT = 0x80
"""Bit that is set in the first byte of a secured participant's GUID, which is a hash of the subject of its certificate
(docs/internals/dds.md 12)."""
_MATCH_DELAY_S = 0.002
"""Delay of the request for early samples after a Fast DDS writer was discovered, in seconds. Cyclone matches the writer
after some 50 us without notification, later on a busy machine. After 10 ms Cyclone sends a request of its own, and Fast
DDS ignores later requests."""
_NO_ENDPOINTS_DELAY_S = 6.0
"""Delay of the check whether a secured Fast DDS peer has announced endpoints, in seconds. The security handshake takes
a second, on a busy machine several."""
_NO_ENDPOINTS = (
    "security: a peer on Fast DDS was found, but no endpoints of it; probably a message of its handshake with Cyclone "
    "DDS was lost, which is sent once. Restart this process or the peer"
)
"""Warning about a secured Fast DDS peer without endpoints. Source: docs/internals/dds.md 12."""


class ReliableReader(Protocol):
    """Members of a reader that requests for early samples need; best effort readers are skipped."""

    is_reliable: bool
    topic: str
    type: str
    guid: bytes


class FastDdsPeers:
    """Peers on Fast DDS of one participant.

    The methods from `on_participants_pending` to `end_read` are called by the participant's builtin reader of
    participants, the first two in Cyclone's thread, too.

    Args:
        listener: Cyclone listener of readers that `create_reader` creates.
        is_local: requests for endpoints and samples are sent to this machine only.
        is_secured: the participant is secured.
    """

    def __init__(self, interop: FastDdsInterop, listener: int, *, is_local: bool, is_secured: bool) -> None:
        self._interop = interop
        self._is_local = is_local
        self._is_secured = is_secured
        self._guid = bytes(16)
        self._addresses: dict[bytes, str] = {}
        """Addresses of Fast DDS participants, by GUID prefix."""
        self._secured: set[bytes] = set()
        """GUID prefixes of secured participants on Fast DDS."""
        self._is_unread = False
        """True while the builtin reader has unread participants. Lock: `FastDdsInterop.lock` must be held."""
        self._participants: set[bytes] = set()
        """GUIDs of discovered participants on Fast DDS. Lock: `FastDdsInterop.lock` must be held."""
        self._early = EarlySampleReaders(interop.support, listener)
        with interop.lock:
            interop.members.add(self)

    def start(self, guid: bytes) -> None:
        """Set the GUID of the participant. Called before its builtin readers are created."""
        self._guid = guid

    # -------------------------------------------------------------------------------------- which peers are on Fast DDS

    def uses_sample_identity(self, guid: bytes) -> bool:
        """Return True if the participant or endpoint `guid` is on Fast DDS: it uses sample identities, not headers."""
        return guid.startswith(FAST_DDS_VENDOR) or (bool(self._secured) and self.is_secured_peer(guid))

    def is_secured_peer(self, guid: bytes) -> bool:
        """Return True if a GUID belongs to a secured participant on Fast DDS, or to an endpoint of one."""
        return guid[:GUID_PREFIX_BYTES] in self._secured

    def has_secured_peers(self) -> bool:
        """Return True if a secured participant on Fast DDS is known."""
        return bool(self._secured)

    def vendor_of(self, participant: bytes) -> bytes:
        """Return the RTPS vendor id of a participant; empty if it is secured, and not on Fast DDS."""
        if self.uses_sample_identity(participant):
            return FAST_DDS_VENDOR
        return b"" if has_hashed_guid(participant) else participant[:2]

    def may_exist(self) -> bool:
        """Return True if a participant on Fast DDS is known, or may be unread. Lock: `FastDdsInterop.lock`."""
        return self._is_unread or bool(self._participants)

    def new_warnings(self) -> list[str]:
        """Return warnings about what the library lacks that were not returned before; none without Fast DDS peers."""
        return self._interop.support.new_warnings() if self._participants else []

    # ------------------------------------------------------------------------------------------------------- discovery

    def on_participants_pending(self) -> None:
        """Activate the receive hooks, because participants are unread. Called by Cyclone; must not raise or log."""
        # Cyclone reports a new participant in its own thread, before it processes anything else of the participant.
        interop = self._interop
        with interop.lock:
            self._is_unread = True
            interop.enable_receive_hooks(True)

    def on_participant(self, guid: bytes, read_property: Callable[[bytes], str]) -> None:
        """Record a discovered participant, and request the endpoints of a new one on Fast DDS.

        `read_property` returns a property of the participant; empty if it has none. Called by Cyclone.
        """
        if guid.startswith(FAST_DDS_VENDOR):
            prefix = guid[:GUID_PREFIX_BYTES]
            is_new = prefix not in self._addresses
            self._addresses[prefix] = read_property(_ADDRESSES)
            if is_new:
                request_endpoints(self._guid, guid, self._addresses[prefix], is_local=self._is_local)
        elif has_hashed_guid(guid) and any(map(read_property, _FAST_DDS)):
            # Requests for its endpoints would be dropped, because they are not protected.
            self._secured.add(guid[:GUID_PREFIX_BYTES])

    def on_builtin_reader(self, entity: int) -> None:
        """Regard participants as unread, and measure the layout of readers with their builtin reader."""
        # A builtin reader is not announced to peers (docs/internals/cyclone_memory.md 8).
        self.on_participants_pending()
        self._early.probe_layout(entity)

    def begin_read(self) -> None:
        """Record that the caller now takes all new participants, and then calls `end_read`."""
        with self._interop.lock:
            self._is_unread = False

    def on_participant_lost(self, guid: bytes) -> None:
        """Forget address and security of a participant."""
        self._secured.discard(guid[:GUID_PREFIX_BYTES])
        self._addresses.pop(guid[:GUID_PREFIX_BYTES], None)

    def end_read(self, events: Iterable[DiscoveryEvent]) -> None:
        """Update the set of Fast DDS participants by the events that were read since `begin_read`.

        If no participant of this process in the domain has Fast DDS peers or unread participants, the receive hooks are
        deactivated.
        """
        interop = self._interop
        with interop.lock:
            for event in events:
                if isinstance(event, EntityLost):
                    self._participants.discard(event.guid)
                elif isinstance(event, ParticipantDiscovered) and self.uses_sample_identity(event.guid):
                    self._participants.add(event.guid)
            # Data that became unread since `begin_read` may be about a Fast DDS participant.
            if not any(peers.may_exist() for peers in interop.members):
                interop.enable_receive_hooks(False)

    # --------------------------------------------------------------------------------------------------- early samples

    def create_reader(self, create: Callable[[int], int], *, is_reliable: bool) -> int:
        """Create a reader that gets early samples of Fast DDS writers, and return its handle.

        `create` creates the reader with the Cyclone listener it is passed.
        """
        return self._early.create_reader(create, is_reliable=is_reliable)

    def on_events(
        self, events: list[DiscoveryEvent], readers: Mapping[int, ReliableReader], guids: Mapping[int, bytes]
    ) -> None:
        """Schedule what new Fast DDS peers need, on the running loop.

        After Cyclone had time to match new writers, early samples are requested for the readers. A secured participant
        is checked for endpoints later, and causes a warning if it has announced none.

        Args:
            events: new discovery events.
            readers: all readers of the participant, by handle.
            guids: GUIDs of all discovered endpoints.
        """
        loop = current_loop()
        if loop is None:
            return
        writers = [
            event
            for event in events
            if isinstance(event, DiscoveredEndpoint)
            and event.is_writer
            and event.qos.reliability is Reliability.RELIABLE
            and self._addresses.get(event.guid[:GUID_PREFIX_BYTES])
        ]
        if writers:
            loop.call_later(_MATCH_DELAY_S, self._request_samples, writers, readers)
        if self._is_secured:
            new = [one.guid for one in events if isinstance(one, ParticipantDiscovered)]
            secured = [guid for guid in new if self.is_secured_peer(guid)]
            if secured:
                loop.call_later(_NO_ENDPOINTS_DELAY_S, self.warn_without_endpoints, secured, guids)

    def _request_samples(self, writers: Iterable[DiscoveredEndpoint], readers: Mapping[int, ReliableReader]) -> None:
        of_topic: defaultdict[tuple[str, str], list[bytes]] = defaultdict(list)
        for reader in list(readers.values()):
            if reader.is_reliable:
                of_topic[reader.topic, reader.type].append(reader.guid)
        pairs: defaultdict[str, list[tuple[bytes, bytes]]] = defaultdict(list)
        for writer in writers:
            addresses = self._addresses.get(writer.guid[:GUID_PREFIX_BYTES])
            if addresses is not None:  # the writer may have disappeared
                matching = of_topic.get((writer.wire_name, writer.wire_type), ())
                pairs[addresses] += [(guid, writer.guid) for guid in matching]
        for addresses, of_participant in pairs.items():
            request_samples(of_participant, addresses, is_local=self._is_local)

    def warn_without_endpoints(self, participants: Iterable[bytes], guids: Mapping[int, bytes]) -> None:
        """Warn if one of some secured Fast DDS peers has announced no endpoints.

        `participants` are the GUIDs of the peers, `guids` the GUIDs of all discovered endpoints.
        """
        prefixes = {guid[:GUID_PREFIX_BYTES] for guid in [*guids.values()]}
        if any(self.is_secured_peer(one) and one[:GUID_PREFIX_BYTES] not in prefixes for one in participants):
            get_root_logger().warning(_NO_ENDPOINTS)

    def forget(self) -> None:
        """Forget all peers, so that timers neither send requests nor warn; also called in a forked child."""
        self._secured.clear()
        self._addresses.clear()

    def close(self) -> None:
        """Forget all peers and end the early readers. Called after the participant and its readers were deleted."""
        interop = self._interop
        with interop.lock:
            interop.members.discard(self)
            self._participants.clear()
            if not any(peers.may_exist() for peers in interop.members):
                interop.enable_receive_hooks(False)
        self.forget()
        self._early.close()


def has_hashed_guid(guid: bytes) -> bool:
    """Return True if a GUID belongs to a secured participant; such a GUID does not begin with the vendor id."""
    return bool(guid[0] & _HASHED_BIT)


# -------------------------------------------------------------------------------------------------------- early samples

_HEADER = b"RTPS\x02\x01\x01\x10"
"""RTPS header with version 2.1 and vendor Cyclone DDS; the GUID prefix of this participant follows after it."""
_pack_info_dst = struct.Struct("<BBH12s").pack
_pack_acknack = struct.Struct("<BBH4s4siIII").pack
"""Function that packs an ACKNACK submessage: kind, flags, length, reader, writer, base (two words), number of bits,
count."""
_INFO_DST_KIND = 0x0E
_ACKNACK_KIND = 0x06
_LITTLE_ENDIAN = 1
_ENDPOINT_TOPICS = ((b"\0\0\3\xc7", b"\0\0\3\xc2"), (b"\0\0\4\xc7", b"\0\0\4\xc2"))
"""Entity ids of the builtin readers and writers that exchange the announcements of publications and subscriptions."""
_ENDPOINT_PORT_OFFSET = 1
"""Difference between the port at which a participant receives announcements of endpoints, and its announced discovery
port."""
_LOCATOR = re.compile(r"udp6?/\[?([0-9a-fA-F.:]+?)(?:%[^\]]*)?\]?:([0-9]{1,5})(?:@[0-9]+)?")
_MAX_LOCATORS = 8
_MAX_PACKET_WRITERS = 40
"""Maximum number of ACKNACKs in a packet, one for each writer; such a packet has 1.2 kB."""
_MAX_PACKETS = 8
"""Maximum number of packets with ACKNACKs to one address; writers that would need further packets get none."""


def acknack_packet(own: bytes, peer: bytes, endpoints: Sequence[tuple[bytes, bytes]] = _ENDPOINT_TOPICS) -> bytes:
    """Return an RTPS packet with ACKNACKs, each of which makes a Fast DDS writer send a heartbeat.

    `own` and `peer` are GUIDs that begin with the prefixes of the sending and receiving participant. `endpoints` are
    pairs of a reader of this participant and a writer of the peer, by the last four bytes of their GUIDs.
    """
    # Base 0: Fast DDS then sends a heartbeat at once; the ACKNACKs of Cyclone begin with number 1. Count 0: Fast DDS
    # ignores ACKNACKs with a count that it has received, so nothing is lost if the ACKNACK of Cyclone, which is sent
    # after 10 ms, arrived before this one.
    requests = b"".join(
        _pack_acknack(_ACKNACK_KIND, _LITTLE_ENDIAN, 24, reader, writer, 0, 0, 0, 0) for reader, writer in endpoints
    )
    info_dst = _pack_info_dst(_INFO_DST_KIND, _LITTLE_ENDIAN, GUID_PREFIX_BYTES, peer[:GUID_PREFIX_BYTES])
    return _HEADER + own[:GUID_PREFIX_BYTES] + info_dst + requests


def parse_locators(text: str) -> list[tuple[socket.AddressFamily, str, int]]:
    """Return the unicast addresses and ports in Cyclone's text about a participant: ``udp/127.0.0.1:7412@1,...``."""
    locators = []
    for part in text.split(",")[:_MAX_LOCATORS]:
        match = _LOCATOR.fullmatch(part)
        if match is None:
            continue
        host, port = match[1], int(match[2])
        family, multicast = (socket.AF_INET6, 0xFF) if ":" in host else (socket.AF_INET, 0xE0)
        try:
            first = socket.inet_pton(family, host)[0]
        except OSError:
            continue
        if 0 < port < 65535 and first & multicast != multicast:
            locators.append((family, host, port))
    return locators


def request_endpoints(own: bytes, peer: bytes, addresses: str, *, is_local: bool) -> None:
    """Request that the Fast DDS participant `peer` announces its endpoints.

    `own` is the GUID of this participant, `addresses` is Cyclone's text about the peer; `is_local` sends nothing to
    other machines.
    """
    _send(acknack_packet(own, peer), parse_locators(addresses), is_local=is_local)


def request_samples(pairs: Sequence[tuple[bytes, bytes]], addresses: str, *, is_local: bool) -> None:
    """Request the earlier samples of writers of one Fast DDS participant.

    `pairs` are GUIDs of a reader of this participant and a writer of the peer; `is_local` sends nothing to other
    machines.
    """
    locators = [(family, host, port + _ENDPOINT_PORT_OFFSET) for family, host, port in parse_locators(addresses)]
    for begin in range(0, min(len(pairs), _MAX_PACKETS * _MAX_PACKET_WRITERS), _MAX_PACKET_WRITERS):
        batch = pairs[begin : begin + _MAX_PACKET_WRITERS]
        endpoints = [(reader[GUID_PREFIX_BYTES:], writer[GUID_PREFIX_BYTES:]) for reader, writer in batch]
        _send(acknack_packet(*batch[0], endpoints), locators, is_local=is_local)


def _send(packet: bytes, locators: Iterable[tuple[socket.AddressFamily, str, int]], *, is_local: bool) -> None:
    for family, host, port in locators:
        # An address that cannot be reached, or not from loopback: the peer is discovered at its own pace.
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            if is_local:
                sender.bind(("::1" if family is socket.AF_INET6 else "127.0.0.1", 0))
            sender.sendto(packet, (host, port))


class EarlySampleReaders:
    """Factory of Cyclone readers that request samples which Fast DDS writers have sent before the endpoints matched.

    The readers do so only if the memory layout of readers in the loaded library is known.
    """

    def __init__(self, support: FastDdsSupport, listener: int) -> None:
        self._api = api = support.api
        self._support = support
        self._listener = listener
        # Called by Cyclone; must not raise, block or log.
        self._on_matched = ct.CFUNCTYPE(None, ct.c_int32, library.DdsMatchedStatus, ct.c_void_p)(
            lambda entity, *_: self._request_history(entity, None)
        )
        self._during_creation: int = api.create_listener(None)
        api.copy_listener(self._during_creation, listener)
        api.lset_subscription_matched_arg(self._during_creation, ct.cast(self._on_matched, ct.c_void_p), None, True)

    def probe_layout(self, builtin_reader: int) -> None:
        """Find the memory layout of readers by examining a builtin reader, which is not announced to peers."""
        support = self._support
        if support.reader_offsets is None and not support.early_refusal:
            with self._api.locked_entity(builtin_reader) as address:  # docs/internals/cyclone_memory.md 8
                guid = self._api.guid_of(builtin_reader)
                support.reader_offsets = private_layout.probe_reader_offsets(address, guid)
            if support.reader_offsets is None:
                support.early_refusal = "the layout of readers is unknown in this library"

    def create_reader(self, create: Callable[[int], int], *, is_reliable: bool) -> int:
        """Create a reader and return its handle; `create` creates the reader with the Cyclone listener it is passed."""
        if self._support.early_refusal:
            return create(self._listener)
        # Known writers are matched while the reader is created. Cyclone calls this listener before the first match, in
        # the creating thread, and the listener sets the flag in time.
        entity: int = library.call_with_sigint_deferred(create, self._during_creation)
        self._api.set_listener(entity, self._listener)
        self._request_history(entity, is_reliable)
        return entity

    def _request_history(self, entity: int, is_reliable: bool | None) -> None:
        # For a volatile reader Cyclone treats samples announced by the first heartbeat as history and never requests
        # them: neither a request nor the missing fragments of a large message. The flag "transient local" of the
        # reader decides that during the match, and has no other use after creation. So it is set for all reliable
        # readers. No real history arrives: a writer retains none for volatile readers, and announces that.
        offsets, unexpected = self._support.reader_offsets, None
        if offsets is not None:
            with suppress(TransportError), self._api.locked_entity(entity) as address:  # the reader may be deleted
                guid = self._api.guid_of(entity)
                unexpected = private_layout.set_requests_history(address, offsets, guid, is_reliable)
        if unexpected is not None:
            self._support.early_refusal = f"unexpected data in Cyclone DDS: {unexpected}"

    def close(self) -> None:
        """Delete the listener of readers under creation. Called after the readers were deleted."""
        self._api.delete_listener(self._during_creation)
