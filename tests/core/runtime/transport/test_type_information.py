"""Endpoints without type information match by name, also with peers that announce type information."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int32, String, UInt8MultiArray
from std_srvs.srv import SetBool
from support import raw_endpoints
from support.inner_state import graph_of
from support.processes import python_process
from support.waiting import until

from rosidl_py_gen import type_hash
from rosidl_py_gen.runtime import CallTimeoutError
from rosidl_py_gen.runtime.transport.cyclone import endpoints as cyclone_endpoints
from rosidl_py_gen.runtime.transport.dds.names import endpoint_user_data
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from support.worlds import World

    from rosidl_py_gen.runtime import Node, QoSProfile

TRUE_TYPE = """
import os, time
from dataclasses import dataclass
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int64, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str

@dataclass
class Request(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Request_"):
    client: uint64  # the header of rmw_cyclonedds, docs/internals/protocol.md 5.1
    number: int64
    a: int64
    b: int64

@dataclass
class Response(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Response_"):
    client: uint64
    number: int64
    sum: int64

number = int(os.environ["ROS_DOMAIN_ID"])
domain = Domain(number, '''<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
    <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery>''')
participant = DomainParticipant(number)
qos = Qos(Policy.Reliability.Reliable(0), Policy.DataRepresentation(use_cdrv0_representation=True))
reader = DataReader(participant, Topic(participant, "rt/questions", String), qos=qos)
writer = DataWriter(participant, Topic(participant, "rt/answers", String), qos=qos)
def user_data(kind):
    hashes = f"typehash={os.environ[kind]};sertypehash={os.environ['SERVICE']};"
    return Policy.Userdata(f"serviceid= 1.10.2;{hashes}".encode())
requests = DataReader(participant, Topic(participant, "rq/addRequest", Request), qos=qos + Qos(user_data("REQUEST")))
replies = DataWriter(participant, Topic(participant, "rr/addReply", Response), qos=qos + Qos(user_data("RESPONSE")))
while True:
    for message in reader.take(10):
        writer.write(message)
    for request in requests.take(10):
        replies.write(Response(request.client, request.number, request.a + request.b))
    time.sleep(0.01)
"""


def true_typed_peer(**hashes: str) -> AbstractContextManager[object]:
    """Run the peer, which announces the hashes of its service."""
    return python_process(TRUE_TYPE, **dict.fromkeys(("REQUEST", "RESPONSE", "SERVICE"), "") | hashes)


needs_cyclonedds = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="the peer is made of cyclonedds")


@pytest.mark.slow
@needs_cyclonedds
async def test_peers_that_announce_type_information_match_by_name(dds: World) -> None:
    with true_typed_peer():
        node = dds.node("ours")
        questions = node.create_publisher(String, "questions")
        answers = node.create_subscription(String, "answers")
        assert await questions.wait_for_subscribers(timeout_s=10)
        assert await answers.wait_for_publishers(timeout_s=10)
        receiving = asyncio.ensure_future(answers.receive(timeout_s=10))
        while not receiving.done():  # the peer may know us later than we know it
            questions.publish(String(data="across"))
            await asyncio.wait([receiving], timeout=0.2)
        assert receiving.result().data == "across"


@pytest.mark.slow
@needs_cyclonedds
async def test_server_with_user_data_of_lyrical_on_cyclone_11_is_called(dds: World) -> None:
    parts = {"REQUEST": AddTwoInts.Request, "RESPONSE": AddTwoInts.Response, "SERVICE": AddTwoInts}
    hashes = {name: type_hash(cls) for name, cls in parts.items()}
    with true_typed_peer(**hashes):
        node = dds.node("ours")
        client = node.create_client(AddTwoInts, "add")
        assert await client.wait_for_service(10)
        for _ in range(10):
            with suppress(CallTimeoutError):  # the peer may know us later than we know it
                await client.call(AddTwoInts.Request(), 1)
                break
        sums = [(await client.call(AddTwoInts.Request(a=number, b=-5), 10)).sum for number in range(20)]
        assert sums == [number - 5 for number in range(20)]
        endpoints = graph_of(node).endpoints.values()
        theirs = [one for one in endpoints if one.service_id == " 1.10.2"]
        assert {one.type_hash for one in theirs} == {hashes["REQUEST"], hashes["RESPONSE"]}
        assert {one.service_hash for one in theirs} == {hashes["SERVICE"]}


async def test_different_types_on_one_topic_are_not_matched(dds: World) -> None:
    node, peer = dds.pair()
    text, number = peer.create_publisher(String, "mixed"), peer.create_publisher(Int32, "mixed")
    texts, numbers = node.create_subscription(String, "mixed"), node.create_subscription(Int32, "mixed")
    for publisher in (text, number):
        assert await publisher.wait_for_subscribers(timeout_s=20)
    assert (text.subscription_count, number.subscription_count) == (1, 1)
    assert (texts.publisher_count, numbers.publisher_count) == (1, 1)
    text.publish(String(data="a"))
    number.publish(Int32(data=7))
    assert (await texts.receive(timeout_s=20)).data == "a"
    assert (await numbers.receive(timeout_s=20)).data == 7
    assert texts.undecodable == numbers.undecodable == 0


@pytest.mark.parametrize("backends", [b"bufbe=cpu=;", b"BUFBE:cpu=;"])
@pytest.mark.parametrize("profile", [DEFAULT, DEFAULT.transient_local()], ids=["volatile", "latched"])
async def test_endpoints_that_announce_buffer_backends_exchange_messages(
    dds: World, monkeypatch: pytest.MonkeyPatch, backends: bytes, profile: QoSProfile
) -> None:
    """`bufbe=` is the form of later versions of rmw_fastrtps, `BUFBE:` the form of 9.4.6."""
    ours, theirs = dds.pair()
    with monkeypatch.context() as patch:
        patch.setattr(
            cyclone_endpoints, "endpoint_user_data", lambda *args, **ids: endpoint_user_data(*args, **ids) + backends
        )
        their_publisher = theirs.create_publisher(UInt8MultiArray, "theirs", profile)
        their_subscription = theirs.create_subscription(UInt8MultiArray, "ours", qos=profile)
    our_publisher = ours.create_publisher(UInt8MultiArray, "ours", profile)
    our_subscription = ours.create_subscription(UInt8MultiArray, "theirs", qos=profile)
    assert await our_publisher.wait_for_subscribers(20) and await our_subscription.wait_for_publishers(20)
    assert await their_publisher.wait_for_subscribers(20)
    for info in (*ours.get_publishers_info_by_topic("theirs"), *ours.get_subscriptions_info_by_topic("ours")):
        assert info.topic_type_hash == type_hash(UInt8MultiArray)
    for publisher, subscription in ((their_publisher, our_subscription), (our_publisher, their_subscription)):
        publisher.publish(UInt8MultiArray(data=[1, 2, 3]))
        assert list((await subscription.receive(20)).data) == [1, 2, 3]


@pytest.mark.every_transport
async def test_service_endpoints_announce_the_service_hash(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service(SetBool, "s", lambda request: SetBool.Response())
    bob.create_client(SetBool, "s")

    def hashes(node: Node) -> list[str]:
        endpoints = graph_of(node).endpoints.values()
        return [endpoint.service_hash for endpoint in endpoints if endpoint.service_type == "std_srvs/srv/SetBool"]

    await until(lambda: hashes(alice) == hashes(bob) == [type_hash(SetBool)] * 4)


@pytest.mark.every_transport
async def test_samples_are_padded_with_zeros(world: World) -> None:
    node, odd = world.node(), ("rt/odd", "pkg::msg::dds_::Odd_")
    reader, writer = raw_endpoints.reader(node, *odd), raw_endpoints.writer(node, *odd)
    for length in range(5, 9):
        writer.write(b"\0\1\0\0" + b"\7" * (length - 4))
    assert [sample[0] for sample in reader.queue.items] == [
        b"\0\1\0\0" + (b"\7" * (length - 4)).ljust(4, b"\0") for length in range(5, 9)
    ]
