"""Identification of requests and replies on DDS, and search for a client's servers.

The functions work on bytes and GUIDs. There are two formats: the header of rmw_cyclonedds, and the `SampleIdentity` of
Fast DDS. This module represents both as a client and a number; the type of the client (`int` or `bytes`) shows the
format.

Source: docs/internals/protocol.md 5.1 to 5.4, docs/internals/dds.md 3 and 4.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterable
from typing import TypeAlias

from rosidl_py_gen.cdr.layout import HEADER_BYTES, NETWORK_ALIGN, PADDING
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.transport.api import GUID_PREFIX_BYTES, DiscoveredEndpoint, Payload
from rosidl_py_gen.runtime.transport.endpoint_index import fair_queue_share
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.service_api import IncompatiblePeer, ServerAvailability

SampleIdentity: TypeAlias = "tuple[bytes, int]"
"""GUID of a client and number of a request; with Fast DDS, both are sent together with the request and with its reply.
"""
ClientId: TypeAlias = "int | bytes"
"""Client of a request: its number on rmw_cyclonedds, the GUID of its reply reader or request writer on Fast DDS."""
UsesSampleIdentity: TypeAlias = "Callable[[bytes], bool]"
"""Function that returns True if the endpoint with a GUID uses sample identities, as on Fast DDS, and not headers."""

SERVICE_HEADER_BYTES = 16
IDENTITY_BYTES = 24
_READER_BIT = 0x04
"""Bit that is set in the last byte of the GUID of a reader."""
_IDENTITY_OPTIONS = b"\xfd\x5d"
"""Option bytes of the encapsulation header (otherwise zero) that mark an embedded sample identity."""
_LITTLE = struct.Struct("<Qq")
_BIG = struct.Struct(">Qq")
_identity = struct.Struct("<16sq")
_MASK = 2**64 - 1
_FILL = PADDING[NETWORK_ALIGN]
_LARGE_BYTES = 1024
"""Size in bytes from which a message is passed as a memoryview, because this is cheaper than another copy."""


def embed_identity(data: Payload, identity: SampleIdentity) -> bytes:
    """Return a sample with a sample identity inserted between encapsulation header and message, and marked in the
    header.
    """
    # Fast DDS sends the identity as RTPS inline QoS, which is not part of a sample; `sample_identity.py` calls this.
    # The 24 bytes replace the header of rmw_cyclonedds. They are a multiple of 8, so the alignment does not change.
    return b"".join((data[:2], _IDENTITY_OPTIONS, _identity.pack(*identity), data[HEADER_BYTES:]))


def extract_identity(data: Payload) -> SampleIdentity | None:
    """Return the sample identity that `embed_identity` inserted into a sample; None if there is none."""
    if data[2:4] != _IDENTITY_OPTIONS or len(data) < HEADER_BYTES + IDENTITY_BYTES:
        return None
    guid, sequence = _identity.unpack_from(data, HEADER_BYTES)
    return guid, sequence


def add_request_header(message: Payload, client: int, sequence: int) -> bytes:
    """Return an encoded message (little-endian) with the request header of rmw_cyclonedds, padded for DDS without a
    further copy.
    """
    # The header of rmw_cyclonedds is between the 4 encapsulation bytes and the message: 8 bytes number of the client, 8
    # bytes number of the request (docs/internals/protocol.md 5.1).
    rest = message[HEADER_BYTES:] if len(message) < _LARGE_BYTES else memoryview(message)[HEADER_BYTES:]
    return b"".join(
        (message[:HEADER_BYTES], _LITTLE.pack(client & _MASK, sequence), rest, _FILL[len(message) % NETWORK_ALIGN])
    )


def parse_request_header(data: Payload) -> tuple[ClientId, int, int]:
    """Return client, number of the request, and offset of the message from a request or reply of either format.

    Raises:
        DecodeError: the data is too short for a header.
    """
    if data[2:4] == _IDENTITY_OPTIONS:  # before the call, which most messages need not
        identity = extract_identity(data)
        if identity is not None:
            return *identity, HEADER_BYTES + IDENTITY_BYTES
    begin = HEADER_BYTES + SERVICE_HEADER_BYTES
    if len(data) < begin:
        raise DecodeError("service header", len(data), f"expected at least {begin} bytes, found {len(data)}")
    client, sequence = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, HEADER_BYTES)
    return client, sequence, begin


def strip_request_header(data: Payload, begin: int) -> bytes:
    """Return a copy of a request or reply without the header or sample identity before the message, which begins at
    `begin`.
    """
    rest = data[begin:] if len(data) < _LARGE_BYTES else memoryview(data)[begin:]
    return b"".join((data[:2], b"\0\0", rest))


def client_gid(client: ClientId, handle: int) -> bytes:
    """Return the GID under which a server knows a client.

    The GID is the GUID of the client's endpoint, or else the client's number and the local `handle` of its writer.
    """
    if isinstance(client, bytes):
        return client
    return (client & _MASK).to_bytes(8, "little") + (handle & _MASK).to_bytes(8, "little")


def find_servers(
    readers: Collection[DiscoveredEndpoint],
    writers: Collection[DiscoveredEndpoint],
    announced: Collection[DiscoveredEndpoint],
    clients: Iterable[DiscoveredEndpoint],
    refusal: str | None,
    is_compatible: Callable[[DiscoveredEndpoint], bool],
    uses_sample_identity: UsesSampleIdentity,
) -> tuple[ServerAvailability, bool]:
    """Find the servers that a client can call.

    A server is available if its request reader and its reply writer are both matched.

    Args:
        readers: request readers that are matched with the client.
        writers: reply writers that are matched with the client.
        announced: all discovered request readers.
        clients: all discovered request writers, the client's included.
        refusal: reason why Fast DDS servers cannot be used; None if they can be used.
        is_compatible: returns False for an endpoint with another definition of the service, which must not be used.
        uses_sample_identity: returns True for the GUID of an endpoint on Fast DDS.

    Returns:
        The availability, and True if requests need a sample identity, because a matched server is on Fast DDS.

    Source: docs/internals/protocol.md 5.2.
    """
    # Fast DDS does not announce the depth of its queue: the default of ROS is assumed.
    depth = fair_queue_share(
        (SERVICES_DEFAULT if uses_sample_identity(reader.guid) else reader.qos for reader in readers), clients
    )
    readers, writers = list(filter(is_compatible, readers)), list(filter(is_compatible, writers))
    # Fast DDS announces no service ids: there a server is a request reader and a reply writer of one participant.
    fast_dds = {reader.participant_guid for reader in readers if uses_sample_identity(reader.guid)}
    fast_dds &= {writer.participant_guid for writer in writers if uses_sample_identity(writer.guid)}
    # rmw_cyclonedds announces a service id for both endpoints of a server, but some servers announce none.
    reader_ids = {reader.service_id for reader in readers if not uses_sample_identity(reader.guid)}
    writer_ids = {writer.service_id for writer in writers if not uses_sample_identity(writer.guid)}
    announced_ids = reader_ids - {""}
    is_served = bool(reader_ids and writer_ids) and (not announced_ids or not announced_ids.isdisjoint(writer_ids))
    if refusal is None:
        return ServerAvailability(is_served or bool(fast_dds), depth), bool(fast_dds)
    is_unusable = not is_served and bool(announced) and all(uses_sample_identity(end.guid) for end in announced)
    incompatible = IncompatiblePeer(next(iter(announced)).guid, refusal) if is_unusable else None
    return ServerAvailability(is_served, depth, incompatible), False


class ClientCorrelation:
    """Encoder of one client's requests, which also recognizes the client's replies.

    Args:
        handle: number that no other client has (docs/internals/protocol.md 5.1).
        reader: GUID of the client's reply reader.
        writer: GUID of the client's request writer.
        server_uses_identity: returns True for the GUID of a server that uses sample identities.
    """

    def __init__(self, handle: int, reader: bytes, writer: bytes, server_uses_identity: UsesSampleIdentity) -> None:
        self._server_uses_identity = server_uses_identity
        self._handle = handle
        self._reader = reader
        self._own_ids: tuple[ClientId, ...] = (handle, reader, writer)
        """Identifiers with which a reply may refer to this client."""
        self.uses_sample_identity = False
        """True while a matched server is on Fast DDS, so that requests need a sample identity."""
        self._request_readers: set[bytes] = set()
        self._servers: frozenset[bytes] = frozenset()
        self._answered: set[bytes] = set()

    def update_servers(self, readers: set[bytes], *, uses_sample_identity: bool) -> None:
        """Set `readers`, the GUIDs of the request readers of all servers, even if they are not matched yet."""
        self.uses_sample_identity = uses_sample_identity
        if not readers <= self._request_readers:
            # A new server, which may be a restarted one, does not know the client's reply reader.
            self._answered.clear()
        self._request_readers = readers
        # The participant identifies a server: its reader and its writer have it in common.
        self._servers = frozenset(guid[:GUID_PREFIX_BYTES] for guid in readers)
        self._answered &= self._servers

    def all_answered(self) -> bool:
        """Return True if every server has replied once.

        If a participant has several servers of the service, their replies cannot be distinguished: the result is False.
        """
        readers, servers = self._request_readers, self._servers
        return bool(readers) and self._answered == servers and len(servers) == len(readers)

    def request(
        self, message: bytes, number: int, *, always_identified: bool = False
    ) -> tuple[bytes, SampleIdentity | None]:
        """Return the payload of a request, and the sample identity to send as inline QoS.

        The identity is None if no Fast DDS server is matched, or if servers need none and `always_identified` is False.
        """
        if not self.uses_sample_identity:
            return add_request_header(message, self._handle, number), None
        # Without an identity a Fast DDS server identifies the request by the writer and the sequence number, so
        # `number` counts the samples of the writer from 1 (docs/internals/dds.md 3). An identity costs time, and only a
        # server that does not know the client's reply reader needs it: it is omitted after all servers have replied.
        is_needed = always_identified or not self.all_answered()
        return message, (self._reader, number) if is_needed else None

    def reply(self, data: Payload, server: bytes | None) -> tuple[int, bytes] | None:
        """Return the number of the request and the message of a reply; None if the reply is for another client.

        Args:
            server: GUID of the server's reply writer, if known.

        Raises:
            DecodeError: the data is too short for a header.
        """
        client, number, begin = parse_request_header(data)
        if client not in self._own_ids:  # all clients of a service receive all replies
            return None
        if server is not None and self._server_uses_identity(server):
            if not isinstance(client, bytes):
                return None
            self._answered.add(server[:GUID_PREFIX_BYTES])
        return number, strip_request_header(data, begin)


def is_reply_reader_matched(
    client: ClientId,
    writer: DiscoveredEndpoint | None,
    matched: Callable[[], Iterable[bytes]],
    find: Callable[[bytes], DiscoveredEndpoint | None],
) -> bool:
    """Return True if the reply reader of a client is matched with a server, or if the reply reader is unknown.

    Args:
        client: id of the client in its request.
        writer: request writer of the client; None if unknown or gone.
        matched: returns the GUIDs of the reply readers that are matched with the server's reply writer.
        find: returns a discovered endpoint by GUID.

    Source: docs/internals/protocol.md 5.2, 5.3.
    """
    if isinstance(client, bytes):
        # The GUID of the request writer or of the client does not tell the reader.
        return not client[15] & _READER_BIT or client in matched()
    if writer is None or not writer.service_id:
        return True
    readers = map(find, matched())
    return any(reader is not None and reader.service_id == writer.service_id for reader in readers)
