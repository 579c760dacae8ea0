"""Services and actions of another definition: their keys contain another hash (docs/internals/zenoh.md 2.4)."""

from __future__ import annotations

import asyncio
import itertools
import struct
from typing import TYPE_CHECKING, Any

import pytest
from support.waiting import until

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.base.descriptions import individual_descriptions
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.errors import DecodeError, EncodeError
from rosidl_py_gen.runtime import CallTimeoutError, ServerLostError
from rosidl_py_gen.type_loading import peer_definitions
from rosidl_py_gen.type_loading.peer_definitions import PeerDefinition

if TYPE_CHECKING:
    from support.worlds import World
    from support.zenoh_peer import Peer

Range: Any = get_message("sensor_msgs/msg/Range", distro="jazzy")
HumbleRange: Any = get_message("sensor_msgs/msg/Range", distro="humble")
BOTH = "sensor_msgs/Range seen\nint32 a\n---\nsensor_msgs/Range seen\nint32 b\n"
_numbers = itertools.count()


def two(text: str) -> tuple[Any, Any]:
    """Return the classes of a service that uses Range of Jazzy, and of Humble."""
    name = f"sonar_msgs/srv/Zonar{next(_numbers)}"
    return compile_definition(name, text), compile_definition(name, text + HUMBLE_RANGE)


HUMBLE_RANGE = f"""
{"=" * 80}
MSG: sensor_msgs/Range
std_msgs/Header header
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
"""


def key_of(cls: Any) -> str:
    return f"sonar_msgs::srv::dds_::{cls._TYPE.name.rpartition('/')[2]}_/{cls._TYPE.hash}"


def body(seen: Any, number: int) -> bytes:
    """Return a request or response without its header: the bytes that a peer of that definition sends."""
    header = struct.pack("<iIIB", 0, 0, 1, 0) + b"\0"
    floats = [seen.field_of_view, seen.min_range, seen.max_range, seen.range]
    floats += [seen.variance] if hasattr(seen, "variance") else []
    data = header + bytes([seen.radiation_type]) + b"\0"
    return data + struct.pack(f"<{len(floats)}fi", *floats, number)


async def test_server_replies_to_client_of_humble_definition_in_its_definition(zenoh: World, peer: Peer) -> None:
    ours, theirs = two(BOTH)
    node = zenoh.node("ours")
    server = node.create_service(
        ours, "/s", lambda request: ours.Response(seen=Range(range=request.seen.range + 1, variance=9.0), b=request.a)
    )
    peer.tell("SC", "/s", key_of(theirs))
    await until(lambda: len(server.matched_clients()) > 0)
    responses = peer.call("/s", key_of(theirs), body(HumbleRange(range=3.0), 7))
    await until(lambda: bool(responses))
    assert responses == [body(HumbleRange(range=4.0), 7)]
    assert server.converted == 1
    assert len(server.matched_clients()) == 2
    responses = peer.call("/s", key_of(ours), body(Range(range=3.0, variance=2.0), 7))
    await until(lambda: bool(responses))
    assert responses == [body(Range(range=4.0, variance=9.0), 7)] and server.converted == 1


async def test_client_calls_server_of_humble_definition_in_its_definition(
    zenoh: World, peer: Peer, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two(BOTH)
    requests: list[bytes] = []

    def respond(request: bytes) -> bytes:
        requests.append(request)
        return body(HumbleRange(range=5.0), 8)

    peer.serve("/s", key_of(theirs), respond)
    node = zenoh.node("ours")
    client = node.create_client(ours, "/s")
    assert await client.wait_for_service(5)
    request = ours.Request(seen=Range(range=3.0, variance=2.0), a=7)
    for _ in range(2):
        assert await client.call(request, 5) == ours.Response(seen=Range(range=5.0), b=8)
    assert requests == [body(HumbleRange(range=3.0), 7)] * 2 and client.converted == 2
    await until(lambda: "are converted" in caplog.text)
    (warning,) = [record.message for record in caplog.records if "are converted" in record.message]
    assert warning == (
        f"requests and responses of /s are converted for node /peer: its definition of {ours._TYPE.name} is that of "
        f"humble, {type_hash(theirs)}; here it is {type_hash(ours)}; received, set to the default: "
        "sensor_msgs/msg/Range.variance; sent, dropped: sensor_msgs/msg/Range.variance"
    )
    assert "no messages" not in caplog.text


async def test_server_of_own_definition_is_preferred(zenoh: World, peer: Peer) -> None:
    ours, theirs = two(BOTH)
    requests: list[bytes] = []
    peer.serve("/s", key_of(theirs), lambda request: requests.append(request) or body(HumbleRange(), 1))
    node = zenoh.node("ours")
    client = node.create_client(ours, "/s")
    assert (await client.call(ours.Request(), 5)).b == 1
    server = zenoh.node("same").create_service(ours, "/s", lambda request: ours.Response(b=2))
    await until(lambda: len(client._transport_client.connected()) == 2)
    assert (await client.call(ours.Request(), 5)).b == 2
    server.close()
    await until(lambda: len(client._transport_client.connected()) == 1)
    assert (await client.call(ours.Request(), 5)).b == 1
    assert len(requests) == 2


async def test_undecodable_bytes_of_peer_definition_are_dropped_or_raise_decode_error(
    zenoh: World, peer: Peer, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two(BOTH)
    node = zenoh.node("ours")
    server = node.create_service(ours, "/served", lambda request: ours.Response())
    peer.tell("SC", "/served", key_of(theirs))
    await until(lambda: len(server.matched_clients()) > 0)
    peer.call("/served", key_of(theirs), b"\7")
    await until(lambda: "dropped a request to /served that is not a sonar_msgs/srv/Zonar" in caplog.text)
    peer.serve("/called", key_of(theirs), lambda request: b"\7")
    client = node.create_client(ours, "/called")
    with pytest.raises(DecodeError, match=r"_Response\.seen\.header\.stamp\.sec: at byte 4"):
        await client.call(ours.Request(), 5)


@pytest.mark.parametrize("strict", ["alice", "bob", "both"])
async def test_endpoint_in_error_mode_leaves_conversion_to_its_peer(
    zenoh: World, strict: str, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two("sensor_msgs/Range seen\n---\nsensor_msgs/Range seen\n")
    modes: dict[str, Any] = {name: "error" if strict in (name, "both") else "convert" for name in ("alice", "bob")}
    alice, bob = (zenoh.node(name, type_hash_check=mode) for name, mode in modes.items())
    server = alice.create_service(theirs, "s", lambda request: theirs.Response(seen=request.seen))
    client = bob.create_client(ours, "s")
    if modes["bob"] == "error":
        with pytest.raises(CallTimeoutError, match="node /alice has another definition of its type"):
            await client.call(ours.Request(), 0.5)
        assert "no messages on /s from node /bob to node /alice: their definitions of" in caplog.text
        return
    assert (await client.call(ours.Request(seen=Range(range=3.0, variance=5.0)), 5)).seen == Range(range=3.0)
    assert (server.converted, client.converted) == (0, 1)


def known(monkeypatch: pytest.MonkeyPatch, our_text: str, their_text: str) -> tuple[Any, Any]:
    """Return two classes of a service, of which only the second is a known definition of a peer."""
    name = f"known_msgs/srv/Known{next(_numbers)}"
    ours, theirs = compile_definition(name, our_text), compile_definition(name, their_text)
    individuals = individual_descriptions(type_description(theirs))
    definition = PeerDefinition(name, type_hash(theirs), ("humble",), individuals)
    monkeypatch.setitem(peer_definitions._by_hash, (name, type_hash(ours)), {type_hash(theirs): definition})
    monkeypatch.setitem(peer_definitions._by_hash, (name, type_hash(theirs)), {})
    return ours, theirs


async def test_unconvertible_service_is_refused_and_logged_with_its_field(
    zenoh: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = known(monkeypatch, "string x\n---\n", "int32 x\n---\n")
    name = ours._TYPE.name
    alice, bob = zenoh.pair()
    alice.create_service(theirs, "s", lambda request: theirs.Response())
    client = bob.create_client(ours, "s")
    with pytest.raises(CallTimeoutError, match="node /alice has another definition of its type"):
        await client.call(ours.Request(), 0.5)
    warning = f"requests and responses of the definition of {name} of humble cannot be converted: {name}_Request.x: "
    assert warning + "string cannot become int32" in caplog.text


async def test_response_that_does_not_fit_the_peer_definition_ends_the_call(
    zenoh: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = known(monkeypatch, "---\nint32 x\n", "---\nuint8 x\n")
    alice, bob = zenoh.pair()
    server = alice.create_service(ours, "s", lambda request: ours.Response(x=256))
    client = bob.create_client(theirs, "s")
    await until(lambda: bob.count_services("s") == 1 and len(server.matched_clients()) > 0)
    future = client.send_request(theirs.Request())
    with pytest.raises(ServerLostError):
        await asyncio.wrap_future(future)
    assert "_Response.x: expected" in caplog.text


async def test_request_that_does_not_fit_the_peer_definition_raises_encode_error(
    zenoh: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = known(monkeypatch, "int32 x\n---\n", "uint8 x\n---\n")
    alice, bob = zenoh.pair()
    requests: list[int] = []
    alice.create_service(theirs, "s", lambda request: requests.append(request.x) or theirs.Response())
    client = bob.create_client(ours, "s")
    await client.call(ours.Request(x=255), 5)
    with pytest.raises(EncodeError, match="256"):
        await client.call(ours.Request(x=256), 5)
    assert requests == [255]


async def test_type_hash_can_be_accepted_while_a_zenoh_thread_finds_servers(
    zenoh: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = two(BOTH)
    alice, bob = zenoh.pair()
    alice.create_service(theirs, "s", lambda request: theirs.Response(b=1))
    client = bob.create_client(ours, "s")
    assert (await client.call(ours.Request(), 5)).b == 1
    transport: Any = client._transport_client
    graph: Any = bob._scope.participant.graph  # type: ignore[attr-defined]
    connected, added = graph.connected, iter(range(100))

    def slow_connected(own: Any) -> Any:  # the loop runs while this waits for the lock of the graph
        transport.accept_type_hash(f"RIHS01_{next(added):064}")
        return connected(own)

    monkeypatch.setattr(graph, "connected", slow_connected)
    assert len(transport.connected()) == 1
