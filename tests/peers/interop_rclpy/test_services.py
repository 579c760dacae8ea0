"""Services with rclpy nodes in both directions, including early requests and killed clients and servers."""

from __future__ import annotations

import asyncio
import ctypes as ct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest
from peer_helpers import fresh, plain, random_values, service
from rclpy_peer import Peer
from support.inner_state import graph_of, participant_of, servers_of, transport_end_of
from support.processes import SOON_MISSED
from support.waiting import until

from rosidl_py_gen import from_dict
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.api import TopicKey
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import peers
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.peers import request_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy_peer import Peer


TEST_SERVICES = ["test_msgs/srv/Arrays", "test_msgs/srv/BasicTypes", "test_msgs/srv/Empty"]
CALL_S = 15
SIZES = [1, 1_000, 60_000, 100_000, 1_048_576]


async def client_of_rclpy_server(node: Any, peer: Peer, name: str, kind: str, how: str, **settings: Any) -> Any:
    """Create a service of the peer and our client of it."""
    await peer.do("serve", name=name, type=kind, how=how, **settings)
    client = node.create_client(service(peer, kind), name)
    assert await client.wait_for_service(timeout_s=10)
    return client


@pytest.mark.parametrize("kind", TEST_SERVICES)
async def test_rclpy_server_receives_and_sends_random_values(world: Any, shared_peer: Peer, kind: str) -> None:
    node, cls, share = world.node("tester"), service(shared_peer, kind), shared_peer.share
    sent = random_values(share, f"{kind}_Request", 5)
    for values in random_values(share, f"{kind}_Response", 3):
        name = fresh("random")
        client = await client_of_rclpy_server(node, shared_peer, name, kind, "fixed", values=values)
        for request in sent:
            assert plain(await client.call(from_dict(cls.Request, request), CALL_S)) == values
        assert await shared_peer.do("requests", name=name) == sent


@pytest.mark.parametrize("kind", TEST_SERVICES)
async def test_rclpy_client_sends_and_receives_random_values(world: Any, shared_peer: Peer, kind: str) -> None:
    name, cls, share = fresh("random"), service(shared_peer, kind), shared_peer.share
    answers = random_values(share, f"{kind}_Response", 10)
    sent = random_values(share, f"{kind}_Request", 10)
    arrived: list[Any] = []

    def handler(request: Any) -> Any:
        arrived.append(plain(request))
        return from_dict(cls.Response, answers[len(arrived) - 1])

    world.node("tester").create_service(cls, name, handler)
    await shared_peer.do("client", name=name, type=kind)
    got = [(await shared_peer.do("call", name=name, requests_=[values]))[0] for values in sent]
    assert (arrived, got) == (sent, answers)


@pytest.mark.parametrize("size", SIZES)
async def test_messages_of_any_size_go_both_ways_with_our_client(world: Any, shared_peer: Peer, size: int) -> None:
    name, cls = fresh("size"), service(shared_peer, "test_msgs/srv/BasicTypes")
    client = await client_of_rclpy_server(world.node("tester"), shared_peer, name, "test_msgs/srv/BasicTypes", "echo")
    for letter in "ab":
        response = await client.call(cls.Request(string_value=letter * size), CALL_S)
        assert response.string_value == letter * size


@pytest.mark.parametrize("size", SIZES)
async def test_messages_of_any_size_go_both_ways_with_our_server(world: Any, shared_peer: Peer, size: int) -> None:
    name, cls = fresh("size"), service(shared_peer, "test_msgs/srv/BasicTypes")
    world.node("tester").create_service(
        cls, name, lambda request: cls.Response(string_value=request.string_value[::-1], int64_value=size)
    )
    await shared_peer.do("client", name=name, type="test_msgs/srv/BasicTypes")
    for letter in "ab":
        (answer,) = await shared_peer.do("call", name=name, requests_=[{"string_value": letter * size + "."}])
        assert (answer["string_value"], answer["int64_value"]) == ("." + letter * size, size)


async def test_more_concurrent_calls_than_rclpy_server_queues_are_all_answered(world: Any, shared_peer: Peer) -> None:
    """Four handlers run at a time and ten requests are queued: the other calls wait for responses."""
    cls, name = service(shared_peer, "test_msgs/srv/BasicTypes"), fresh("slow")
    await shared_peer.do("serve_slowly", name=name, type="test_msgs/srv/BasicTypes", threads=4, seconds=0.1)
    node = world.node("tester")
    clients = [node.create_client(cls, name) for _ in range(2)]
    for client in clients:
        assert await client.wait_for_service(timeout_s=10)
    calls = [clients[number % 2].call(cls.Request(int64_value=number), CALL_S) for number in range(40)]
    answers = await asyncio.gather(*calls, return_exceptions=True)
    assert [getattr(answer, "int64_value", answer) for answer in answers] == list(range(40))


async def test_clients_of_several_nodes_receive_their_own_replies_from_rclpy_server(
    world: Any, shared_peer: Peer
) -> None:
    cls, name = service(shared_peer, "test_msgs/srv/BasicTypes"), fresh("several")
    nodes = [world.node(f"tester{number}") for number in range(3)]
    clients = [await client_of_rclpy_server(nodes[0], shared_peer, name, "test_msgs/srv/BasicTypes", "echo")]
    clients += [node.create_client(cls, name) for node in nodes]
    for client in clients:
        assert await client.wait_for_service(timeout_s=10)
    wanted = [(index, number) for number in range(50) for index in range(len(clients))]
    calls = [clients[i].call(cls.Request(int32_value=i, int64_value=n), CALL_S) for i, n in wanted]
    got = [(response.int32_value, response.int64_value) for response in await asyncio.gather(*calls)]
    assert got == wanted


async def test_service_with_own_and_rclpy_servers_replies_to_every_client(world: Any, shared_peer: Peer) -> None:
    name, cls = fresh("both_servers"), service(shared_peer, "std_srvs/srv/Trigger")
    node, other = world.node("tester"), world.node("server")
    client = await client_of_rclpy_server(node, shared_peer, name, "std_srvs/srv/Trigger", "trigger", note="theirs")
    other.create_service(cls, name, lambda _: cls.Response(success=True, message="ours"))
    await until(lambda: node.count_services(name) == 2)
    answers = {(await client.call(cls.Request(), CALL_S)).message for _ in range(20)}
    assert answers and answers <= {"ours", "theirs"}
    await shared_peer.do("client", name=name, type="std_srvs/srv/Trigger")
    got = [(await shared_peer.do("call", name=name, requests_=[{}]))[0]["message"] for _ in range(20)]
    assert set(got) <= {"ours", "theirs"}
    await shared_peer.do("unserve", name=name)
    await until(lambda: node.count_services(name) == 1)
    assert {(await client.call(cls.Request(), CALL_S)).message for _ in range(5)} == {"ours"}


@pytest.mark.about_fast_dds("requests to servers on Cyclone DDS have a header instead of an identity")
async def test_requests_contain_reply_reader_until_all_servers_have_replied(
    world: Any, shared_peer: Peer, start_peer: Callable[..., Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new server then waits until it knows the reader to which it replies."""
    name, kind = fresh("named"), "std_srvs/srv/Trigger"
    client = await client_of_rclpy_server(world.node("tester"), shared_peer, name, kind, "trigger", note="first")
    request = service(shared_peer, kind).Request()
    writer, named = transport_end_of(client)._writer, []
    write = writer.write
    monkeypatch.setattr(
        writer, "write", lambda data, identity: (named.append(identity is not None), write(data, identity))[1]
    )
    for _ in range(3):
        assert (await client.call(request, CALL_S)).message == "first"
    assert named == [True, False, False]
    second = start_peer("second")
    await second.do("serve", name=name, type=kind, how="trigger", note="second")
    await until(lambda: len(servers_of(client)) == len(writer.matched_readers()) == 2)
    await client.call(request, CALL_S)
    assert named[3:] == [True]
    while named[-1]:
        await client.call(request, CALL_S)
        assert len(named) < 1000
    second.close()


_QUEUE_DEPTH = 1000
"""Queue depth of the clients of `many_clients`, and of the servers that they call."""


async def both_kinds_call(peer: Peer, client: Any, name: str) -> None:
    """Call an echoing server from three clients of the peer and one of ours at the same time.

    Every reply goes to every client, and a busy rclpy takes a hundred a second, more slowly than our calls. The total
    number of replies is below the queue depth of its clients, so that none is overwritten.
    """
    many = {"name": name, "type": "test_msgs/srv/BasicTypes", "clients": 3, "calls": 30}
    theirs = asyncio.wrap_future(peer.start("many_clients", **many))
    request = service(peer, "test_msgs/srv/BasicTypes").Request
    number = 0
    while number < 50 or (not theirs.done() and number < _QUEUE_DEPTH - 90):
        assert (await client.call(request(int64_value=number), CALL_S)).int64_value == number
        await asyncio.sleep(0.001)
        number += 1
    assert await theirs == 90


async def test_server_replies_to_concurrent_own_and_rclpy_clients(world: Any, shared_peer: Peer) -> None:
    name, cls = fresh("both_clients"), service(shared_peer, "test_msgs/srv/BasicTypes")

    async def handler(request: Any) -> Any:
        await asyncio.sleep(0.01 * (request.int64_value % 3))  # so that answers overtake each other
        return cls.Response(int32_value=request.int32_value, int64_value=request.int64_value)

    world.node("server").create_service(cls, name, handler, qos=QoSProfile(depth=_QUEUE_DEPTH))
    client = world.node("tester").create_client(cls, name)
    assert await client.wait_for_service(timeout_s=10)
    await both_kinds_call(shared_peer, client, name)


async def test_rclpy_server_replies_to_concurrent_own_and_rclpy_clients(world: Any, shared_peer: Peer) -> None:
    name, kind = fresh("both_clients"), "test_msgs/srv/BasicTypes"
    client = await client_of_rclpy_server(world.node("tester"), shared_peer, name, kind, "echo", depth=_QUEUE_DEPTH)
    await both_kinds_call(shared_peer, client, name)


KIND = "std_srvs/srv/Trigger"


async def test_killed_rclpy_server_is_missed_and_may_return(
    world: Any, shared_peer: Peer, start_mortal: Callable[[str], Peer]
) -> None:
    name, cls = fresh("mortal"), service(shared_peer, KIND)
    client = world.node("tester").create_client(cls, name)
    for note in ("first", "second"):
        peer = start_mortal("mortal")
        await peer.do("serve", name=name, type=KIND, how="trigger", note=note)
        assert await client.wait_for_service(timeout_s=10)
        assert (await client.call(cls.Request(), 10)).message == note
        peer.kill()
        await until(lambda: not client.service_is_available())


async def test_closed_server_is_missed_and_may_return_for_rclpy_client(
    world: Any, shared_peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(*SOON_MISSED)
    name, cls = fresh("mortal"), service(shared_peer, KIND)
    await shared_peer.do("client", name=name, type=KIND, wait=False)
    for note in ("first", "second"):
        context = world.context()
        world.node("server", context=context).create_service(
            cls, name, lambda _, note=note: cls.Response(success=True, message=note)
        )
        await shared_peer.do("ready", name=name)
        assert await shared_peer.do("call", name=name, requests_=[{}]) == [{"success": True, "message": note}]
        context.close()
        if note == "first":  # which takes the time of a lease: Fast DDS does not take Cyclone's word for it
            await shared_peer.do("ready", name=name, expected=False)


_Listener = ct.CFUNCTYPE(None, ct.c_int32, library.DdsMatchedStatus, ct.c_void_p)


def delay_match(server: Any, delay_s: float) -> Any:
    """Delay Cyclone's match of the reader of a server; return the object to keep alive."""
    function = _Listener(lambda *_: time.sleep(delay_s))  # Cyclone does not notify of a suitable moment
    api, listener = cyclone.API, cyclone.API.create_listener(None)
    api.copy_listener(listener, participant_of(server).listener)
    api.lset_subscription_matched_arg(listener, ct.cast(function, ct.c_void_p), None, True)
    assert api.set_listener(transport_end_of(server)._reader.entity, listener) == 0
    api.delete_listener(listener)
    return function


@pytest.mark.about_dds("Zenoh connects no single writers")
async def test_request_received_before_its_writer_is_matched_is_answered(world: Any, shared_peer: Peer) -> None:
    """The request is repeated after the peer's next heartbeat, 3 s later; without the early-request mechanism it is
    lost.
    """
    name, cls = fresh("early"), service(shared_peer, KIND)
    server = world.node("server").create_service(cls, name, lambda _: cls.Response(success=True, message="heard"))
    function = delay_match(server, 0.2)
    await shared_peer.do("client", name=name, type=KIND)
    answers = await shared_peer.do("call", name=name, requests_=[{}, {}], within_s=10)
    assert [answer["message"] for answer in answers] == ["heard", "heard"]
    del function


@pytest.mark.about_fast_dds("only its writers are asked")
async def test_earlier_samples_are_requested_once_from_new_request_writer(
    world: Any, shared_peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested: list[tuple[bytes, bytes]] = []

    def record(pairs: Sequence[tuple[bytes, bytes]], addresses: str, *, is_local: bool) -> None:
        requested.extend(pairs)
        request_samples(pairs, addresses, is_local=is_local)

    name, cls = fresh("asked"), service(shared_peer, KIND)
    node = world.node("server")
    server = node.create_service(cls, name, lambda _: cls.Response(success=True, message="heard"))
    node.create_subscription("std_msgs/msg/String", f"{name}/best_effort", qos=QoSProfile().best_effort())
    reader, best_effort = transport_end_of(server).endpoints[0], list(participant_of(node).readers.values())[-1].guid
    monkeypatch.setattr(peers, "request_samples", record)
    await shared_peer.do("publisher", topic=f"{name}/best_effort", type="std_msgs/msg/String")
    await shared_peer.do("client", name=name, type=KIND)
    await shared_peer.do("call", name=name, requests_=[{}], within_s=10)
    await until(lambda: any(pair[0] == reader for pair in requested))
    of_service = [end.guid for end in graph_of(node).endpoints_on(TopicKey("request", name), writers=True)]
    assert len(of_service) == 1
    assert [pair for pair in requested if pair[0] == reader] == [(reader, of_service[0])]
    assert best_effort not in {pair[0] for pair in requested}
