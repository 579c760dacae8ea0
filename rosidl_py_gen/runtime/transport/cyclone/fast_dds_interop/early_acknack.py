"""ACKNACK packets that request endpoints and early samples of Fast DDS participants.

When our participant appears, Fast DDS immediately sends a heartbeat with the number of its endpoints. Cyclone discovers
the Fast DDS participant a millisecond later, and has dropped the heartbeat as one of an unknown participant. The next
one comes after 1 s. Cyclone's own ACKNACK, which starts at number 1, does not make Fast DDS send one. An ACKNACK with
base 0 does, so we send one by a UDP socket. Then all endpoints are known after the 0.1 s that Fast DDS takes to repeat
them.

The same applies to reliable writers. A writer that knows our reader before Cyclone knows the writer announces that it
has written nothing, writes, and sends the next heartbeat after 3 s (`early_samples.py` makes the reader request the
samples then). A client that is created for one call often is such a writer.

Both packets have count 0. Fast DDS ignores ACKNACKs with a count that it has received: ours, if Cyclone's came first,
which it sends after 10 ms. Then nothing is gained or lost.

Source: OMG DDSI-RTPS 2.3, 8.3.7.1, 9.4.5.3 and 9.6.1.1; sources of Fast DDS 2.14, StatefulWriter::process_acknack.
"""

from __future__ import annotations

import contextlib
import re
import socket
import struct
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.discovery_events import GUID_PREFIX_BYTES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_HEADER = b"RTPS\x02\x01\x01\x10"
"""Version 2.1, vendor Cyclone DDS; the prefix of our GUID follows."""
_pack_info_dst = struct.Struct("<BBH12s").pack
_pack_acknack = struct.Struct("<BBH4s4siIII").pack
"""Kind, flags, length, reader, writer, base (two words), number of bits, count."""
_INFO_DST_KIND = 0x0E
_ACKNACK_KIND = 0x06
_LITTLE_ENDIAN = 1
_ENDPOINT_TOPICS = ((b"\0\0\3\xc7", b"\0\0\3\xc2"), (b"\0\0\4\xc7", b"\0\0\4\xc2"))
"""Builtin reader and writer of publications, and of subscriptions."""
_ENDPOINT_PORT_OFFSET = 1
"""Difference between a participant's port for its endpoints and its announced discovery port."""
_LOCATOR = re.compile(r"udp6?/\[?([0-9a-fA-F.:]+?)(?:%[^\]]*)?\]?:([0-9]{1,5})(?:@[0-9]+)?")
_MAX_LOCATORS = 8
_MAX_PACKET_WRITERS = 40
"""Maximum number of writers in a packet, which has 1.2 kB then."""
_MAX_PACKETS = 8
"""Maximum number of packets to an address; further writers get no request."""


def acknack_packet(own: bytes, peer: bytes, endpoints: Sequence[tuple[bytes, bytes]] = _ENDPOINT_TOPICS) -> bytes:
    """Build the packet from participant `own` to participant `peer`, each given by a GUID or its prefix.

    Args:
        endpoints: reader of ours and writer of the peer, by the last four bytes of their GUIDs.
    """
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
    """Request the endpoints of a new Fast DDS participant.

    Args:
        own: GUID of our participant.
        peer: GUID of the new participant.
        addresses: its addresses, see `parse_locators`.
        is_local: do not send packets to other machines.
    """
    _send(acknack_packet(own, peer), parse_locators(addresses), is_local=is_local)


def request_samples(pairs: Sequence[tuple[bytes, bytes]], addresses: str, *, is_local: bool) -> None:
    """Request the samples of writers of one Fast DDS participant.

    Args:
        pairs: GUIDs of a reader of ours and of a writer that is matched with it.
        addresses: addresses of the writers' participant, see `parse_locators`.
        is_local: do not send packets to other machines.
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
