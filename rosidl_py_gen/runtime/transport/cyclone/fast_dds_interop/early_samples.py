"""Requests for data that Fast DDS peers sent before Cyclone knew them: their endpoints, and samples of their writers.

Cyclone DDS drops the heartbeats of a participant or writer that it does not know yet, and the next ones arrive after 1
s or 3 s (docs/internals/dds.md 6). So this module sends an ACKNACK that requests a heartbeat, and makes readers request
the samples that the first heartbeat announces.

Source: OMG DDSI-RTPS 2.3, 8.3.7.1, 9.4.5.3 and 9.6.1.1; sources of Fast DDS 2.14, StatefulWriter::process_acknack.
"""

from __future__ import annotations

import contextlib
import ctypes as ct
import re
import socket
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import GUID_PREFIX_BYTES, TransportError
from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.support import FastDdsSupport

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
        self._on_matched = ct.CFUNCTYPE(None, ct.c_int32, c_api.DdsMatchedStatus, ct.c_void_p)(
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
        entity: int = c_api.call_with_sigint_deferred(create, self._during_creation)
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
