"""Whose a request or a reply is on DDS, by bytes and GUIDs alone (docs/internals/protocol.md 5)."""

from __future__ import annotations

from dataclasses import replace

import pytest
from example_interfaces.srv import AddTwoInts
from hypothesis import given
from hypothesis import strategies as st
from support import raw_endpoints

from rosidl_py_gen import DecodeError
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.dds import correlation
from rosidl_py_gen.runtime.transport.dds.correlation import (
    AnsweredServers,
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
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, EntityLost
from rosidl_py_gen.runtime.transport.service_endpoints import ServicePeers

HANDLE = 0x1122334455667788
READER, WRITER = b"\1\x10" + bytes(10) + b"\0\0\1\4", b"\1\x10" + bytes(10) + b"\0\0\2\3"
MESSAGE = AddTwoInts.Request(a=1, b=2).encode()
KEEP_10 = QoSProfile().keep_last(10)


def end(
    who: bytes, number: int, *, is_writer: bool, service_id: str = "", qos: QoSProfile = KEEP_10
) -> DiscoveredEndpoint:
    """A reader of requests or writer of replies; the two bytes of the vendor and a number tell the participant."""
    prefix = who + bytes(12 - len(who))
    topic, kind = ("rr/addReply", "Response") if is_writer else ("rq/addRequest", "Request")
    guid = prefix + bytes((0, 0, number, 3 if is_writer else 4))
    type = f"example_interfaces::srv::dds_::AddTwoInts_{kind}_"
    return raw_endpoints.found(guid, prefix + b"\0\0\1\xc1", topic, type, qos, service_id=service_id)


def server(
    who: bytes, service_id: str = "", qos: QoSProfile = KEEP_10
) -> tuple[DiscoveredEndpoint, DiscoveredEndpoint]:
    """What it reads, and what it writes."""
    return end(who, 1, is_writer=False, service_id=service_id, qos=qos), end(
        who, 2, is_writer=True, service_id=service_id
    )


CYCLONE, OTHER, FAST = server(b"\1\x10\1", "a"), server(b"\1\x10\2", "b"), server(b"\1\x0f\1")


def found(
    *servers: tuple[DiscoveredEndpoint, DiscoveredEndpoint],
    announced: tuple[DiscoveredEndpoint, ...] | None = None,
    clients: tuple[DiscoveredEndpoint, ...] = (),
    refusal: str | None = None,
    replying: tuple[DiscoveredEndpoint, ...] | None = None,
    without: tuple[DiscoveredEndpoint, ...] = (),
) -> correlation.ServerMatch:
    readers = tuple(one for one, _ in servers)
    writers = tuple(one for _, one in servers) if replying is None else replying
    everybody = readers if announced is None else announced
    return find_servers(readers, writers, everybody, clients, refusal, lambda one: one not in without)


# -------------------------------------------------------------------------------------------------------------- bytes


def test_the_header_sits_between_encapsulation_and_message() -> None:
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
    assert len(add_request_header(b"\0\1\0\0\7", 1, 1)) == 24, (
        "filled up with zeros, so that nobody has to copy it again"
    )


@given(
    st.binary(max_size=3000), st.integers(0, 2**64 - 1), st.integers(1, 2**63 - 1), st.binary(min_size=16, max_size=16)
)
def test_what_is_put_in_comes_out(content: bytes, client: int, number: int, guid: bytes) -> None:
    message = b"\0\1\0\0" + content
    wire = add_request_header(message, client, number)
    assert parse_request_header(wire) == (client, number, 20) and extract_identity(wire) is None
    assert strip_request_header(wire, 20)[: len(message)] == message and len(wire) % 4 == 0
    beside = embed_identity(message, (guid, number))
    assert extract_identity(beside) == (guid, number) and parse_request_header(beside) == (guid, number, 28)
    assert strip_request_header(memoryview(beside), 28) == message


@given(st.binary(max_size=64))
def test_any_bytes_have_a_header_or_are_refused_as_too_few(data: bytes) -> None:
    try:
        _, _, begin = parse_request_header(data)
    except DecodeError as error:
        assert len(data) < 20 and "expected at least 20 bytes" in str(error)
    else:
        assert begin <= len(data)


def test_a_client_on_cyclone_is_named_by_its_number_and_its_writer_here() -> None:
    assert client_gid(1, 2) == b"\1" + bytes(7) + b"\2" + bytes(7)
    assert client_gid(READER, 2) == READER


# ------------------------------------------------------------------------------------------------------------- client


def client_of(*readers: DiscoveredEndpoint, uses_sample_identity: bool = False) -> ClientCorrelation:
    made = ClientCorrelation(HANDLE, READER, WRITER)
    made.update_servers({one.guid for one in readers}, uses_sample_identity=uses_sample_identity)
    return made


def test_servers_on_cyclone_get_a_header_and_others_an_identity_until_they_have_answered() -> None:
    plain = client_of(CYCLONE[0])
    assert plain.request(MESSAGE, 1) == (add_request_header(MESSAGE, HANDLE, 1), None)
    client = client_of(FAST[0], uses_sample_identity=True)
    assert client.request(MESSAGE, 1) == (MESSAGE, (READER, 1))
    assert client.reply(embed_identity(MESSAGE, (READER, 1)), FAST[1].guid) == (1, MESSAGE)
    assert client.request(MESSAGE, 2) == (MESSAGE, None), "from now on it knows requests by writer and number"
    client.update_servers({FAST[0].guid, server(b"\1\x0f\2")[0].guid}, uses_sample_identity=True)
    assert client.request(MESSAGE, 3) == (MESSAGE, (READER, 3)), "somebody new has not answered yet"


def test_replies_for_others_are_nobody_elses() -> None:
    client = client_of(CYCLONE[0])
    assert client.reply(add_request_header(MESSAGE, HANDLE, 7), CYCLONE[1].guid) == (7, MESSAGE)
    assert client.reply(add_request_header(MESSAGE, HANDLE + 1, 7), CYCLONE[1].guid) is None
    assert client.reply(embed_identity(MESSAGE, (bytes(16), 7)), FAST[1].guid) is None
    for name in (READER, WRITER):
        assert client.reply(embed_identity(MESSAGE, (name, 7)), None) == (7, MESSAGE)


def test_a_header_of_a_server_that_has_identities_is_part_of_its_message() -> None:
    client = client_of(FAST[0], uses_sample_identity=True)
    assert client.reply(add_request_header(MESSAGE, HANDLE, 7), FAST[1].guid) is None
    assert client.request(MESSAGE, 1)[1] is not None, "which is no answer, either"


def test_answers_to_others_are_no_news_of_a_server() -> None:
    client = client_of(FAST[0], uses_sample_identity=True)
    assert client.reply(embed_identity(MESSAGE, (bytes(16), 1)), FAST[1].guid) is None
    assert client.request(MESSAGE, 1) == (MESSAGE, (READER, 1))


def test_too_few_bytes_are_refused() -> None:
    with pytest.raises(DecodeError, match="expected at least 20 bytes, found 8"):
        client_of(CYCLONE[0]).reply(b"\0\1\0\0\7\7\7\7", CYCLONE[1].guid)


# ------------------------------------------------------------------------------------------------------- who is there


def test_a_server_is_there_when_both_of_its_ends_are_connected() -> None:
    assert found() == (False, False, 0, None)
    assert found(CYCLONE).is_available
    assert not found(CYCLONE, replying=(OTHER[1],)).is_available, "that is half of one and half of another"
    assert not found(CYCLONE, replying=()).is_available
    assert found(server(b"\1\x10\1"), replying=(OTHER[1],)).is_available, "who tells no id is believed"


def test_a_server_on_fast_dds_has_both_ends_in_one_participant() -> None:
    assert found(FAST)[:2] == (True, True)
    assert not found(FAST, replying=(server(b"\1\x0f\2")[1],)).is_available
    assert found(FAST, CYCLONE)[:2] == (True, True)


def test_a_server_of_another_definition_is_none() -> None:
    assert not found(CYCLONE, without=(CYCLONE[0],)).is_available
    assert not found(FAST, without=(FAST[1],)).is_available


def test_servers_that_cannot_be_talked_to_are_named_where_there_are_no_others() -> None:
    why = "this build is not known"
    assert found(FAST, refusal=why) == (False, False, 10, FAST[0])
    assert found(FAST, CYCLONE, refusal=why)[:2] == (True, False)
    assert found(announced=(FAST[0],), refusal=why).incompatible_server == FAST[0], (
        "also while they are not connected yet"
    )
    assert found(announced=(FAST[0], CYCLONE[0]), refusal=why).incompatible_server is None, (
        "one may come that can be talked to"
    )
    assert found(announced=(), refusal=why).incompatible_server is None


@pytest.mark.parametrize(
    ("kept", "clients", "expected"), [(10, 1, 10), (10, 3, 3), (10, 20, 1), (0, 2, 0)], ids=lambda value: str(value)
)
def test_clients_share_what_a_server_keeps(kept: int, clients: int, expected: int) -> None:
    qos = QoSProfile().keep_last(kept) if kept else QoSProfile().keep_all()
    asking = tuple(replace(CYCLONE[1], guid=bytes([n]) * 16, participant_guid=bytes([n]) * 16) for n in range(clients))
    assert found(server(b"\1\x10\1", "a", qos), clients=asking).request_queue_depth == expected


def test_servers_on_fast_dds_are_taken_for_what_ros_has_by_default() -> None:
    assert found(server(b"\1\x0f\1", qos=QoSProfile().keep_all())).request_queue_depth == 10


# ------------------------------------------------------------------------------------------------- who has answered


def guid(name: str) -> bytes:
    """The letter is the participant."""
    return name[0].encode() * 12 + name[1].encode() * 4


def test_nobody_has_answered_while_there_is_no_server() -> None:
    servers = AnsweredServers()
    assert not servers.all_answered()
    servers.on_reply(guid("A2"))
    assert not servers.all_answered()


def test_each_server_has_to_answer() -> None:
    servers = AnsweredServers()
    servers.set_request_readers({guid("A1"), guid("B1")})
    servers.on_reply(guid("A2"))
    assert not servers.all_answered()
    servers.on_reply(guid("B2"))
    assert servers.all_answered()
    servers.set_request_readers({guid("B1")})
    assert servers.all_answered()


def test_a_server_that_is_made_anew_in_its_process_has_to_answer_again() -> None:
    servers = AnsweredServers()
    servers.set_request_readers({guid("A1")})
    servers.on_reply(guid("A2"))
    assert servers.all_answered()
    servers.set_request_readers({guid("A3")})
    assert not servers.all_answered()
    servers.on_reply(guid("A4"))
    assert servers.all_answered()


def test_answers_of_two_servers_of_one_process_are_not_told_apart() -> None:
    servers = AnsweredServers()
    servers.set_request_readers({guid("A1"), guid("A3")})
    servers.on_reply(guid("A2"))
    servers.on_reply(guid("A4"))
    assert not servers.all_answered()


# ------------------------------------------------------------------------------------------------------------- server


def test_a_response_is_held_until_its_client_listens() -> None:
    asking, reading = CYCLONE[1], {CYCLONE[0].guid: CYCLONE[0]}
    assert is_reply_reader_matched(1, asking, lambda: reading, reading.get)
    assert not is_reply_reader_matched(1, asking, lambda: (), reading.get)
    assert not is_reply_reader_matched(1, OTHER[1], lambda: reading, reading.get), "that is another client's reader"
    assert is_reply_reader_matched(1, None, lambda: (), reading.get), "it is gone, and nobody waits"
    assert is_reply_reader_matched(1, replace(asking, service_id=""), lambda: (), reading.get), (
        "it does not say what it reads"
    )
    assert not is_reply_reader_matched(READER, None, lambda: (), reading.get)
    assert is_reply_reader_matched(READER, None, lambda: (READER,), reading.get)
    assert is_reply_reader_matched(WRITER, None, lambda: (), reading.get), "it names its writer, which says nothing"


# -------------------------------------------------------------------------------------------------------------- peers


def test_nothing_is_retained_of_services_that_went() -> None:
    """A node that is up for days meets any number of names: those of the parameter services of each node."""
    peers = ServicePeers()
    for one in (*CYCLONE, *OTHER):
        peers.apply([one])
    for one in (*CYCLONE, *OTHER):
        peers.apply([EntityLost(one.guid)])
    assert (peers.version, peers._known, peers._by_channel) == (8, {}, {})
