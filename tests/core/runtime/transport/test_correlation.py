"""Identification of requests and replies on DDS by bytes and GUIDs (docs/internals/protocol.md 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from hypothesis import given
from hypothesis import strategies as st
from support import raw_endpoints

from rosidl_py_gen import DecodeError
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, IncompatiblePeer, ServerAvailability
from rosidl_py_gen.runtime.transport.dds.services import (
    ClientCorrelation,
    add_request_header,
    client_gid,
    embed_identity,
    extract_identity,
    find_servers,
    is_reply_reader_matched,
    parse_request_header,
    strip_request_header,
)

if TYPE_CHECKING:
    pass


HANDLE = 0x1122334455667788
READER, WRITER = b"\1\x10" + bytes(10) + b"\0\0\1\4", b"\1\x10" + bytes(10) + b"\0\0\2\3"
MESSAGE = AddTwoInts.Request(a=1, b=2).encode()
KEEP_10 = QoSProfile().keep_last(10)


def endpoint(
    prefix: bytes, number: int, *, is_writer: bool, service_id: str = "", qos: QoSProfile = KEEP_10
) -> DiscoveredEndpoint:
    """Create a request reader or reply writer of the participant with this GUID prefix."""
    prefix += bytes(12 - len(prefix))
    topic, kind = ("rr/addReply", "Response") if is_writer else ("rq/addRequest", "Request")
    guid = prefix + bytes((0, 0, number, 3 if is_writer else 4))
    type = f"example_interfaces::srv::dds_::AddTwoInts_{kind}_"
    return raw_endpoints.found(guid, prefix + b"\0\0\1\xc1", topic, type, qos, service_id=service_id)


def server(
    prefix: bytes, service_id: str = "", qos: QoSProfile = KEEP_10
) -> tuple[DiscoveredEndpoint, DiscoveredEndpoint]:
    reader = endpoint(prefix, 1, is_writer=False, service_id=service_id, qos=qos)
    return reader, endpoint(prefix, 2, is_writer=True, service_id=service_id)


CYCLONE, OTHER, FAST = server(b"\1\x10\1", "a"), server(b"\1\x10\2", "b"), server(b"\1\x0f\1")


def uses_sample_identity(guid: bytes) -> bool:
    return guid.startswith(b"\1\x0f")


def find(
    *servers: tuple[DiscoveredEndpoint, DiscoveredEndpoint],
    announced: tuple[DiscoveredEndpoint, ...] | None = None,
    clients: tuple[DiscoveredEndpoint, ...] = (),
    refusal: str | None = None,
    replying: tuple[DiscoveredEndpoint, ...] | None = None,
    without: tuple[DiscoveredEndpoint, ...] = (),
) -> tuple[ServerAvailability, bool]:
    readers = tuple(reader for reader, _ in servers)
    writers = tuple(writer for _, writer in servers) if replying is None else replying
    announced = readers if announced is None else announced
    return find_servers(
        readers, writers, announced, clients, refusal, lambda one: one not in without, uses_sample_identity
    )


def is_available(*servers: tuple[DiscoveredEndpoint, DiscoveredEndpoint], **more: Any) -> bool:
    return find(*servers, **more)[0].is_available


# -------------------------------------------------------------------------------------------------------------- bytes


def test_request_header_is_stored_between_encapsulation_and_message() -> None:
    wire = add_request_header(MESSAGE, HANDLE, 1)
    assert wire == bytes.fromhex(
        "00010000"  # XCDR1, little endian
        "8877665544332211"  # the client's number
        "0100000000000000"  # sequence number
        "0100000000000000"  # a
        "0200000000000000"  # b
    )
    assert parse_request_header(wire) == (HANDLE, 1, 20) and strip_request_header(wire, 20) == MESSAGE
    big = bytes.fromhex("00000000 1122334455667788 0000000000000001 07")
    assert parse_request_header(big) == (HANDLE, 1, 20) and strip_request_header(big, 20) == b"\0\0\0\0\7"
    assert len(add_request_header(b"\0\1\0\0\7", 1, 1)) == 24  # padded, so that it is not copied again


@given(
    st.binary(max_size=3000), st.integers(0, 2**64 - 1), st.integers(1, 2**63 - 1), st.binary(min_size=16, max_size=16)
)
def test_request_header_and_identity_round_trip(content: bytes, client: int, number: int, guid: bytes) -> None:
    message = b"\0\1\0\0" + content
    wire = add_request_header(message, client, number)
    assert parse_request_header(wire) == (client, number, 20) and extract_identity(wire) is None
    assert strip_request_header(wire, 20)[: len(message)] == message and len(wire) % 4 == 0
    embedded = embed_identity(message, (guid, number))
    assert extract_identity(embedded) == (guid, number) and parse_request_header(embedded) == (guid, number, 28)
    assert strip_request_header(memoryview(embedded), 28) == message


@given(st.binary(max_size=64))
def test_any_bytes_have_a_request_header_or_raise_decode_error(data: bytes) -> None:
    try:
        _, _, begin = parse_request_header(data)
    except DecodeError as error:
        assert len(data) < 20 and "expected at least 20 bytes" in str(error)
    else:
        assert begin <= len(data)


def test_client_gid_is_made_of_cyclone_client_number_or_guid() -> None:
    assert client_gid(1, 2) == b"\1" + bytes(7) + b"\2" + bytes(7)
    assert client_gid(READER, 2) == READER


# ------------------------------------------------------------------------------------------------------------- client


def client_of(*readers: DiscoveredEndpoint, has_fast_dds_server: bool = False) -> ClientCorrelation:
    client = ClientCorrelation(HANDLE, READER, WRITER, uses_sample_identity)
    client.update_servers({reader.guid for reader in readers}, uses_sample_identity=has_fast_dds_server)
    return client


def test_requests_have_header_for_cyclone_and_identity_until_fast_dds_replied() -> None:
    plain = client_of(CYCLONE[0])
    assert plain.request(MESSAGE, 1) == (add_request_header(MESSAGE, HANDLE, 1), None)
    client = client_of(FAST[0], has_fast_dds_server=True)
    assert client.request(MESSAGE, 1) == (MESSAGE, (READER, 1))
    assert client.reply(embed_identity(MESSAGE, (READER, 1)), FAST[1].guid) == (1, MESSAGE)
    assert client.request(MESSAGE, 2) == (MESSAGE, None)
    client.update_servers({FAST[0].guid, server(b"\1\x0f\2")[0].guid}, uses_sample_identity=True)
    assert client.request(MESSAGE, 3) == (MESSAGE, (READER, 3))


def test_replies_for_other_clients_are_ignored() -> None:
    client = client_of(FAST[0], has_fast_dds_server=True)
    assert client.reply(add_request_header(MESSAGE, HANDLE, 7), CYCLONE[1].guid) == (7, MESSAGE)
    assert client.reply(add_request_header(MESSAGE, HANDLE + 1, 7), CYCLONE[1].guid) is None
    assert client.reply(embed_identity(MESSAGE, (bytes(16), 7)), FAST[1].guid) is None
    # A header of a server that has identities is part of its message.
    assert client.reply(add_request_header(MESSAGE, HANDLE, 7), FAST[1].guid) is None
    assert client.request(MESSAGE, 1) == (MESSAGE, (READER, 1))  # none of these replies came from that server
    for name in (READER, WRITER):
        assert client.reply(embed_identity(MESSAGE, (name, 7)), None) == (7, MESSAGE)


# ------------------------------------------------------------------------------------------------------------ servers


def test_server_is_available_when_both_endpoints_are_matched() -> None:
    assert find() == (ServerAvailability(), False)
    assert is_available(CYCLONE)
    assert not is_available(CYCLONE, replying=(OTHER[1],))  # endpoints of two servers
    assert not is_available(CYCLONE, replying=())
    assert is_available(server(b"\1\x10\1"), replying=(OTHER[1],))  # a server without id


def test_fast_dds_server_has_both_endpoints_in_one_participant() -> None:
    assert is_available(FAST) and find(FAST)[1]
    assert not is_available(FAST, replying=(server(b"\1\x0f\2")[1],))
    assert is_available(FAST, CYCLONE) and find(FAST, CYCLONE)[1]


def test_server_of_another_definition_is_not_available() -> None:
    assert not is_available(CYCLONE, without=(CYCLONE[0],))
    assert not is_available(FAST, without=(FAST[1],))


def test_incompatible_server_is_reported_if_no_other_server_exists() -> None:
    why = "this build is not known"
    named = IncompatiblePeer(FAST[0].guid, why)
    assert find(FAST, refusal=why) == (ServerAvailability(False, 10, named), False)
    assert is_available(FAST, CYCLONE, refusal=why) and not find(FAST, CYCLONE, refusal=why)[1]
    for announced, expected in (((FAST[0],), named), ((FAST[0], CYCLONE[0]), None), ((), None)):  # not matched yet
        assert find(announced=announced, refusal=why)[0].incompatible_server == expected


@pytest.mark.parametrize(("depth", "clients", "expected"), [(10, 1, 10), (10, 3, 3), (10, 20, 1), (0, 2, 0)])
def test_request_queue_depth_is_divided_between_clients(depth: int, clients: int, expected: int) -> None:
    qos = QoSProfile().keep_last(depth) if depth else QoSProfile().keep_all()
    writers = tuple(replace(CYCLONE[1], guid=bytes([n]) * 16, participant_guid=bytes([n]) * 16) for n in range(clients))
    assert find(server(b"\1\x10\1", "a", qos), clients=writers)[0].request_queue_depth == expected


def test_fast_dds_server_is_assumed_to_have_default_queue_depth() -> None:
    assert find(server(b"\1\x0f\1", qos=QoSProfile().keep_all()))[0].request_queue_depth == 10


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ([], False),
        (["A2"], False),
        ([{"A1", "B1"}, "A2"], False),
        ([{"A1", "B1"}, "A2", "B2"], True),
        ([{"A1", "B1"}, "A2", "B2", {"B1"}], True),
        ([{"A1"}, "A2", {"A3"}], False),  # restarted in its process
        ([{"A1"}, "A2", {"A3"}, "A4"], True),
        ([{"A1", "A3"}, "A2", "A4"], False),  # replies of two servers of one process look alike
    ],
)
def test_all_answered_is_true_after_a_reply_of_every_server(steps: list[str | set[str]], expected: bool) -> None:
    """A set contains request readers, a string names the writer of a reply; the letter is the participant."""

    def guid(name: str) -> bytes:
        return name[0].encode() * 12 + name[1].encode() * 4

    client = ClientCorrelation(HANDLE, READER, WRITER, lambda guid: True)
    for step in steps:
        if isinstance(step, str):
            client.reply(embed_identity(MESSAGE, (READER, 1)), guid(step))
        else:
            client.update_servers(set(map(guid, step)), uses_sample_identity=True)
    assert client.all_answered() is expected


# ------------------------------------------------------------------------------------------------------------- server


@pytest.mark.parametrize(
    ("client", "writer", "matched", "expected"),
    [
        (1, CYCLONE[1], [CYCLONE[0].guid], True),
        (1, CYCLONE[1], [], False),
        (1, OTHER[1], [CYCLONE[0].guid], False),  # the reader of another client
        (1, None, [], True),  # a client that has disappeared
        (1, replace(CYCLONE[1], service_id=""), [], True),  # a client that does not announce its reader
        (READER, None, [], False),
        (READER, None, [READER], True),
        (WRITER, None, [], True),  # a client that is named by its writer
    ],
)
def test_response_is_delayed_until_reply_reader_is_matched(
    client: int | bytes, writer: DiscoveredEndpoint | None, matched: list[bytes], expected: bool
) -> None:
    assert is_reply_reader_matched(client, writer, lambda: matched, {CYCLONE[0].guid: CYCLONE[0]}.get) is expected
