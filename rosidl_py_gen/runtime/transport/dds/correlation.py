"""Whose a request or a reply is on DDS, and which servers a client has: bytes and GUIDs in, bytes and GUIDs out.

Two kinds of peers know that differently. Cyclone's put a header of 16 bytes between the 4 encapsulation bytes and the
message: a number of the client and one of the request. Fast DDS has it beside the message: an `SampleIdentity`, which
`cyclone/fast_dds_interop/sample_identity.py` puts in the place of the header, marked as what it is. Up here both are
a client and a number, and the type of the client tells which kind it is.

Requests are numbered as the middleware numbers what a writer sends, from 1, because servers on Fast DDS count them.

Source: docs/internals/protocol.md 5.1 to 5.4, docs/internals/dds.md 3 and 4.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from rosidl_py_gen.cdr.layout import HEADER_BYTES, NETWORK_ALIGN, PADDING
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.service_endpoints import fair_queue_share

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.samples import Payload

SampleIdentity: TypeAlias = "tuple[bytes, int]"
"""Which request a sample is or answers, where that is said beside the message: a GUID of the client, and the number of
its request."""
ClientId: TypeAlias = "int | bytes"
"""Of a peer on Cyclone its number, of others a GUID: that of the client, its reply reader or its request writer."""

FAST_DDS_VENDOR = b"\x01\x0f"
"""First bytes of every GUID that Fast DDS makes (RTPS vendor id)."""
SERVICE_HEADER_BYTES = 16
IDENTITY_BYTES = 24
_PREFIX_BYTES = 12
"""The part of a GUID that all endpoints of a participant share."""
_READER_BIT = 0x04
"""In the last byte of a GUID: it is a reader's."""
_IDENTITY_OPTIONS = b"\xfd\x5d"
"""Stands in the two option bytes of the encapsulation header, which are zero otherwise."""
_LITTLE = struct.Struct("<Qq")
_BIG = struct.Struct(">Qq")
_identity = struct.Struct("<16sq")
_MASK = 2**64 - 1
_FILL = PADDING[NETWORK_ALIGN]
_LARGE_BYTES = 1024
"""From here on a view costs less than one more copy."""


# -------------------------------------------------------------------------------------------------------------- bytes


def uses_sample_identity(guid: bytes) -> bool:
    """Whether a service with that endpoint has an `SampleIdentity` beside its samples, and not a header in them."""
    return guid.startswith(FAST_DDS_VENDOR)


def embed_identity(data: Payload, identity: SampleIdentity) -> bytes:
    """A sample with the identity behind its encapsulation header. 24 is a multiple of 8, so all stays aligned."""
    return b"".join((data[:2], _IDENTITY_OPTIONS, _identity.pack(*identity), data[HEADER_BYTES:]))


def extract_identity(data: Payload) -> SampleIdentity | None:
    """What `embed_identity` put in; None when it is a sample as others send it."""
    if data[2:4] != _IDENTITY_OPTIONS or len(data) < HEADER_BYTES + IDENTITY_BYTES:
        return None
    guid, sequence = _identity.unpack_from(data, HEADER_BYTES)
    return guid, sequence


def add_request_header(message: Payload, client: int, sequence: int) -> bytes:
    """Put the header into an encoded message, which is little-endian; filled up as DDS wants it, in the same copy."""
    rest = message[HEADER_BYTES:] if len(message) < _LARGE_BYTES else memoryview(message)[HEADER_BYTES:]
    return b"".join(
        (message[:HEADER_BYTES], _LITTLE.pack(client & _MASK, sequence), rest, _FILL[len(message) % NETWORK_ALIGN])
    )


def parse_request_header(data: Payload) -> tuple[ClientId, int, int]:
    """Client, number of the request, and where the message begins; raises `DecodeError` when the bytes are too few."""
    identity = extract_identity(data)
    if identity is not None:
        return *identity, HEADER_BYTES + IDENTITY_BYTES
    begin = HEADER_BYTES + SERVICE_HEADER_BYTES
    if len(data) < begin:
        raise DecodeError("service header", len(data), f"expected at least {begin} bytes, found {len(data)}")
    client, sequence = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, HEADER_BYTES)
    return client, sequence, begin


def strip_request_header(data: Payload, begin: int) -> bytes:
    """The plain message, copied."""
    rest = data[begin:] if len(data) < _LARGE_BYTES else memoryview(data)[begin:]
    return b"".join((data[:2], b"\0\0", rest))


def client_gid(client: ClientId, handle: int) -> bytes:
    """How a server names whom a request came from: of a client on Cyclone its number and its writer's handle here."""
    if isinstance(client, bytes):
        return client
    return (client & _MASK).to_bytes(8, "little") + (handle & _MASK).to_bytes(8, "little")


# ------------------------------------------------------------------------------------------------------------- client


class ServerMatch(NamedTuple):
    """The servers of a client.

    Attributes:
        is_available: one is connected, both ways.
        is_identified: requests need an identity: one that is connected is on Fast DDS.
        keeps: how many requests of ours the server that keeps fewest keeps; 0 when all keep all.
        refused: of servers that cannot be talked to, when there are no others.
    """

    is_available: bool
    uses_sample_identity: bool
    keeps: int
    refused: DiscoveredEndpoint | None


def find_servers(
    readers: Collection[DiscoveredEndpoint],
    writers: Collection[DiscoveredEndpoint],
    announced: Collection[DiscoveredEndpoint],
    clients: Iterable[DiscoveredEndpoint],
    refusal: str | None,
    counts: Callable[[DiscoveredEndpoint], bool],
) -> ServerMatch:
    """Source: docs/internals/protocol.md 5.2; servers with identities have no ids, but both endpoints in one
    participant.

    Args:
        readers: of requests, connected with the client.
        writers: of replies, connected with the client.
        announced: everybody who reads requests.
        clients: everybody who writes requests, the client included.
        refusal: why servers with identities cannot be talked to; None when they can.
        counts: whether a server with that endpoint is one, and not one of another definition.
    """
    # Servers on Fast DDS do not tell: they are taken for what ROS has by default.
    keeps = fair_queue_share(
        (SERVICES_DEFAULT if uses_sample_identity(one.guid) else one.qos for one in readers), clients
    )
    readers, writers = list(filter(counts, readers)), list(filter(counts, writers))
    foreign = {one.participant_guid for one in readers if uses_sample_identity(one.guid)}
    foreign &= {one.participant_guid for one in writers if uses_sample_identity(one.guid)}
    ids = {one.service_id for one in readers if not uses_sample_identity(one.guid)}
    replying = {one.service_id for one in writers if not uses_sample_identity(one.guid)}
    told = ids - {""}
    is_served = bool(ids and replying) and (not told or not told.isdisjoint(replying))
    if refusal is not None:
        is_foreign = not is_served and bool(announced) and all(uses_sample_identity(one.guid) for one in announced)
        return ServerMatch(is_served, False, keeps, next(iter(announced)) if is_foreign else None)
    return ServerMatch(is_served or bool(foreign), bool(foreign), keeps, None)


class AnsweredServers:
    """Which servers have answered, each since the last of them appeared, which may have been made anew.

    A server is known by its participant: what it reads and writes has that in common.
    """

    def __init__(self) -> None:
        self._readers: set[bytes] = set()
        self._servers: frozenset[bytes] = frozenset()
        self._heard: set[bytes] = set()

    def set_request_readers(self, readers: set[bytes]) -> None:
        """These are all that requests go to, or will a moment later."""
        if not readers <= self._readers:
            self._heard.clear()
        self._readers = readers
        self._servers = frozenset(guid[:_PREFIX_BYTES] for guid in readers)
        self._heard &= self._servers

    def on_reply(self, writer: bytes) -> None:
        """A reply came from that writer."""
        self._heard.add(writer[:_PREFIX_BYTES])

    def all_answered(self) -> bool:
        """Whether all have answered; never, when one participant has several, whose answers cannot be told apart."""
        return bool(self._readers) and self._heard == self._servers and len(self._servers) == len(self._readers)


class ClientCorrelation:
    """Which bytes are a request of one client, and which replies are for it.

    Args:
        handle: a number that no other client has (docs/internals/protocol.md 5.1).
        reader: the GUID of what it reads.
        writer: the GUID of what it writes.
    """

    def __init__(self, handle: int, reader: bytes, writer: bytes) -> None:
        self._handle = handle
        self._reader = reader
        self._names: tuple[ClientId, ...] = (handle, reader, writer)
        """By which replies may call it."""
        self._is_identified = False
        self._answered = AnsweredServers()

    def update_servers(self, readers: set[bytes], *, is_identified: bool) -> None:
        """Requests go to these, or will a moment later; `uses_sample_identity` as in `ServerMatch`."""
        self._is_identified = is_identified
        self._answered.set_request_readers(readers)

    def request(self, message: bytes, number: int) -> tuple[bytes, SampleIdentity | None]:
        """What is to be written, and what is to be said beside it.

        Once all servers have answered, the identity is left out: they know requests without one by writer and number.
        """
        if not self._is_identified:
            return add_request_header(message, self._handle, number), None
        return message, None if self._answered.all_answered() else (self._reader, number)

    def reply(self, data: Payload, server: bytes | None) -> tuple[int, bytes] | None:
        """Number of the request and message of a reply; None when it is not for this client.

        Raises:
            DecodeError: there is no room for a header.
        """
        client, number, begin = parse_request_header(data)
        if client not in self._names:  # all clients of a service see all replies
            return None
        if server is not None and uses_sample_identity(server):
            if not isinstance(client, bytes):
                return None
            self._answered.on_reply(server)
        return number, strip_request_header(data, begin)


# ------------------------------------------------------------------------------------------------------------- server


def is_reply_reader_matched(
    client: ClientId,
    writer: DiscoveredEndpoint | None,
    matched: Callable[[], Iterable[bytes]],
    known: Callable[[bytes], DiscoveredEndpoint | None],
) -> bool:
    """Whether the reader of a client's replies is connected, or the client does not say which one that is.

    Args:
        writer: of its requests; None when that is not known, or gone.
        matched: the readers that replies go to.
        known: what was discovered of an endpoint.

    Source: docs/internals/protocol.md 5.2 and 5.3.
    """
    if isinstance(client, bytes):
        return not client[15] & _READER_BIT or client in matched()
    if writer is None or not writer.service_id:
        return True
    readers = map(known, matched())
    return any(reader is not None and reader.service_id == writer.service_id for reader in readers)
