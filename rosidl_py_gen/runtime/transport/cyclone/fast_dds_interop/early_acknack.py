"""Asks participants on Fast DDS for their endpoints as soon as they are found, and writers for what they have written.

When a participant of ours appears, one on Fast DDS says in a heartbeat at once how many endpoints it has. Cyclone hears
who that is a millisecond later, and has dropped the heartbeat as that of a stranger. The next one comes after a second:
the question for it that Cyclone sends, an ACKNACK for what follows the first sample, does not count as one in Fast DDS.
An ACKNACK that begins with number 0 does, and Fast DDS answers it at once, so we send one. Then all endpoints are known
after 0.1 s, which Fast DDS takes to repeat them.

It is the same with every reliable writer. One that knows our reader before Cyclone knows it, says that it wrote nothing
so far, and writes, does not speak of that again for 3 s; `catchup.py` makes the reader want it then. A client that was
made for one call is often such a writer.

Both have 0 for their count, of which Fast DDS takes the first one: ours, unless another thread has kept Python busy for
the 10 ms after which Cyclone sends its own. Later ones of ours are ignored, and everything is as without.

Source: OMG DDSI-RTPS 2.3, 8.3.7.1, 9.4.5.3 and 9.6.1.1; sources of Fast DDS 2.14, StatefulWriter::process_acknack.
"""

from __future__ import annotations

import contextlib
import re
import socket
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_HEADER = b"RTPS\x02\x01\x01\x10"
"""Version 2.1, vendor Cyclone DDS; the prefix of our GUID follows."""
_TO = struct.Struct("<BBH12s").pack
_ACKNACK = struct.Struct("<BBH4s4siIII").pack
"""Kind, flags, length; reader, writer, the first number (two parts), how many more are in a bitmap, count."""
_ENDPOINT_TOPICS = ((b"\0\0\3\xc7", b"\0\0\3\xc2"), (b"\0\0\4\xc7", b"\0\0\4\xc2"))
"""Reader and writer of publications, and of subscriptions."""
_INFO_DST_KIND, _ACKNACK_KIND, _LITTLE = 0x0E, 0x06, 1
_PREFIX_BYTES = 12
_OWN_PORT = 1
"""By how much the port for a participant's own endpoints is higher than that of discovery, which we are told."""
_ADDRESS = re.compile(r"udp6?/\[?([0-9a-fA-F.:]+?)(?:%[^\]]*)?\]?:([0-9]{1,5})(?:@[0-9]+)?")
_MOST_ADDRESSES = 8
_MOST_ASKED, _MOST_PACKETS = 40, 8
"""Writers in a packet, of 1.2 kB then, and packets to an address."""


def acknack_packet(own: bytes, peer: bytes, endpoints: Sequence[tuple[bytes, bytes]] = _ENDPOINT_TOPICS) -> bytes:
    """The packet that participant `own` asks `peer` with.

    Args:
        own: who asks, a GUID or its prefix.
        peer: who is asked, likewise.
        endpoints: a reader of ours and the writer it asks, each by the last four bytes of its GUID.
    """
    asked = b"".join(_ACKNACK(_ACKNACK_KIND, _LITTLE, 24, reader, writer, 0, 0, 0, 0) for reader, writer in endpoints)
    return _HEADER + own[:_PREFIX_BYTES] + _TO(_INFO_DST_KIND, _LITTLE, _PREFIX_BYTES, peer[:_PREFIX_BYTES]) + asked


def parse_locators(told: str) -> list[tuple[socket.AddressFamily, str, int]]:
    """The unicast addresses and ports in what Cyclone tells of a participant, such as ``udp/127.0.0.1:7412@1``."""
    found = []
    for part in told.split(",")[:_MOST_ADDRESSES]:
        match = _ADDRESS.fullmatch(part)
        if match is None:
            continue
        host, port = match[1], int(match[2])
        family, multicast = (socket.AF_INET6, 0xFF) if ":" in host else (socket.AF_INET, 0xE0)
        try:
            first = socket.inet_pton(family, host)[0]
        except OSError:
            continue
        if 0 < port < 65535 and first & multicast != multicast:
            found.append((family, host, port))
    return found


def request_endpoints(own: bytes, peer: bytes, told: str, *, is_local: bool) -> None:
    """Ask a participant on Fast DDS that was found; see the head.

    Args:
        own: GUID of ours. peer: that of the other one.
        told: its addresses, see `parse_locators`.
        is_local: nothing may leave this machine.
    """
    _send(acknack_packet(own, peer), parse_locators(told), is_local=is_local)


def request_samples(pairs: Sequence[tuple[bytes, bytes]], told: str, *, is_local: bool) -> None:
    """Ask writers of one participant on Fast DDS that readers of one of ours were connected with; see the head.

    Args:
        pairs: the GUIDs of a reader and a writer each. So many that they take more than 8 packets are not asked.
        told: the addresses of the writers' participant, see `parse_locators`.
        is_local: nothing may leave this machine.
    """
    to = [(family, host, port + _OWN_PORT) for family, host, port in parse_locators(told)]
    for begin in range(0, min(len(pairs), _MOST_PACKETS * _MOST_ASKED), _MOST_ASKED):
        some = pairs[begin : begin + _MOST_ASKED]
        ends = [(reader[_PREFIX_BYTES:], writer[_PREFIX_BYTES:]) for reader, writer in some]
        _send(acknack_packet(*some[0], ends), to, is_local=is_local)


def _send(packet: bytes, to: Iterable[tuple[socket.AddressFamily, str, int]], *, is_local: bool) -> None:
    for family, host, port in to:
        # Unreachable, or not from the loopback interface: then it finds us in its own time.
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            if is_local:
                sender.bind(("::1" if family is socket.AF_INET6 else "127.0.0.1", 0))
            sender.sendto(packet, (host, port))
