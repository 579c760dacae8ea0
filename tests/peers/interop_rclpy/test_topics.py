"""Topics with rclpy nodes in both directions: messages arrive unchanged, field by field."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from peer_helpers import digest, fresh, message, plain, random_bytes, random_values, repeated
from rclpy_peer import Peer
from support.waiting import until

from rosidl_py_gen import from_dict, type_name
from rosidl_py_gen.runtime import Node, QoSProfile
from rosidl_py_gen.runtime.transport.qos import SENSOR_DATA

if TYPE_CHECKING:
    from collections.abc import Callable

TYPES = [
    *(f"std_msgs/msg/{name}" for name in ("String", "Empty", "Header", "ColorRGBA", "Float64MultiArray")),
    *(
        f"test_msgs/msg/{name}"
        for name in (
            *("Arrays", "BasicTypes", "BoundedPlainSequences", "BoundedSequences", "Builtins", "Constants"),
            *("Defaults", "Empty", "MultiNested", "Nested", "Strings", "UnboundedSequences", "WStrings"),
        )
    ),
    pytest.param("test_msgs/msg/NonKeyedWithNestedKey", marks=pytest.mark.only_with("kilted", "lyrical")),
]
KEYED = ["test_msgs/msg/KeyedLong", "test_msgs/msg/KeyedString", "test_msgs/msg/ComplexNestedKey"]
MEGABYTE = 1_048_576


async def matched_publisher(
    node: Node, peer: Peer, cls: Any, topic: str, qos: QoSProfile, theirs: dict[str, Any]
) -> Any:
    """Return our publisher that is matched with a subscription of the peer."""
    await peer.do("subscribe", topic=topic, type=type_name(cls), qos=theirs)
    publisher = node.create_publisher(cls, topic, qos)
    assert await publisher.wait_for_subscribers(timeout_s=10)
    await peer.do("matched", topic=topic)
    return publisher


async def matched_subscription(
    node: Node, peer: Peer, cls: Any, topic: str, qos: QoSProfile, theirs: dict[str, Any]
) -> Any:
    """Return our subscription that is matched with a publisher of the peer."""
    subscription = node.create_subscription(cls, topic, qos=qos)
    await peer.do("publisher", topic=topic, type=type_name(cls), qos=theirs)
    assert await subscription.wait_for_publishers(timeout_s=10)
    await peer.do("matched", topic=topic)
    return subscription


DEEP = QoSProfile().keep_last(100)
RCLPY_DEEP = {"depth": 100}


def lossless(peer: Peer) -> tuple[QoSProfile, dict[str, Any]]:
    """Return the QoS of our endpoints and of the peer's with which large messages at once arrive on a busy machine.

    Zenoh drops reliable messages of an endpoint that keeps the last ones: rmw_zenoh's nodes lose them between
    themselves, too. With keep all, Zenoh blocks the publisher.
    """
    return (QoSProfile().keep_all(), {"history": "KEEP_ALL"}) if peer.middleware == "Zenoh" else (DEEP, RCLPY_DEEP)


@pytest.mark.parametrize("name", TYPES)
async def test_random_messages_arrive_as_sent(
    world: Any, shared_peer: Peer, name: str, request: pytest.FixtureRequest
) -> None:
    if name == "test_msgs/msg/WStrings" and shared_peer.distro == "lyrical" and shared_peer.middleware == "Cyclone DDS":
        reason = "rmw_cyclonedds of Lyrical writes two bytes for a character (docs/reference/compatibility.md)"
        request.applymarker(pytest.mark.xfail(reason=reason, strict=True))
    node, sent = world.node("tester"), random_values(shared_peer.share, name)
    cls = message(shared_peer, name)
    topic, back = fresh("to_them"), fresh("to_us")
    publisher = await matched_publisher(node, shared_peer, cls, topic, DEEP, RCLPY_DEEP)
    for values in sent:
        publisher.publish(from_dict(cls, values))
    assert await shared_peer.do("take", topic=topic, count=len(sent)) == sent
    subscription = await matched_subscription(node, shared_peer, cls, back, DEEP, RCLPY_DEEP)
    await shared_peer.do("publish", topic=back, messages_=sent)
    assert [plain(await subscription.receive(timeout_s=10)) for _ in sent] == sent


async def test_endpoints_match_after_rclpy_peers_exchanged_type_information(
    world: Any, shared_peer: Peer, start_peer: Callable[..., Peer]
) -> None:
    """Peers of Kilted request type definitions of each other, and Cyclone DDS receives the replies.

    It takes arrays in them for invalid, and would then ignore endpoints of such types, so it is configured to ignore
    type information.
    """
    node, name = world.node("tester"), "test_msgs/msg/Arrays"
    cls, first = message(shared_peer, name), fresh("before")
    await matched_subscription(node, shared_peer, cls, first, DEEP, RCLPY_DEEP)
    other = start_peer("other_peer")  # asks for the types of all that shared_peer has
    await matched_subscription(
        node, other, message(shared_peer, "std_msgs/msg/String"), first + "_other", DEEP, RCLPY_DEEP
    )
    await other.do("subscribe", topic=first + "_both", type="std_msgs/msg/String")
    await shared_peer.do("publisher", topic=first + "_both", type="std_msgs/msg/String")
    await other.do("matched", topic=first + "_both")
    await matched_subscription(node, shared_peer, cls, fresh("after"), DEEP, RCLPY_DEEP)


@pytest.mark.only_with("kilted", "lyrical")  # Jazzy's test_msgs have no keys
async def test_topics_with_keyed_types_match(world: Any, shared_peer: Peer, request: pytest.FixtureRequest) -> None:
    if shared_peer.middleware == "Fast DDS":  # rmw_cyclonedds and rmw_zenoh have no keys, either
        request.applymarker(pytest.mark.xfail(reason="our topics have no keys", strict=True))
    node = world.node("tester")
    publishers = []
    for name in KEYED:
        publishers.append(node.create_publisher(message(shared_peer, name), fresh("keyed")))
        await shared_peer.do("subscribe", topic=publishers[-1].topic, type=name)
    assert all(await asyncio.gather(*(publisher.wait_for_subscribers(timeout_s=3) for publisher in publishers)))


async def test_messages_of_one_megabyte_arrive_complete(world: Any, shared_peer: Peer, distro: str) -> None:
    node, data = world.node("tester"), random_bytes(MEGABYTE, 1)
    at_once = 1 if distro == "humble" else 3  # docs/internals/dds.md 13
    cls = message(shared_peer, "std_msgs/msg/UInt8MultiArray")
    topic, back = fresh("big_to_them"), fresh("big_to_us")
    publisher = await matched_publisher(node, shared_peer, cls, topic, *lossless(shared_peer))
    for _ in range(3 // at_once):
        for _ in range(at_once):
            publisher.publish(cls(data=data))
        taken = await shared_peer.do("take", topic=topic, count=at_once)
        assert [one["data"] for one in taken] == [digest(data)] * at_once
    subscription = await matched_subscription(node, shared_peer, cls, back, *lossless(shared_peer))
    order = {"data": {"random_bytes": MEGABYTE, "seed": 1}}

    await shared_peer.do("publish", topic=back, messages_=[order] * 3)
    for _ in range(3):
        assert (await subscription.receive(timeout_s=20)).data.tobytes() == data


async def test_large_first_message_of_rclpy_publisher_arrives(world: Any, shared_peer: Peer) -> None:
    """Fast DDS splits messages into packets of 64 KB. Its first heartbeat mostly precedes Cyclone's discovery of the
    publisher, and Cyclone would take the packets before the next heartbeat for old.
    """
    node, order = world.node("tester"), {"data": {"random_bytes": 200_000, "seed": 1}}
    cls, topics = message(shared_peer, "std_msgs/msg/UInt8MultiArray"), [fresh("big_at_once") for _ in range(10)]
    subscriptions = [
        await matched_subscription(node, shared_peer, cls, topic, *lossless(shared_peer)) for topic in topics
    ]
    for topic in topics:
        await shared_peer.do("publish", topic=topic, messages_=[order])
    for subscription in subscriptions:
        assert (await subscription.receive(timeout_s=10)).data.tobytes() == random_bytes(200_000, 1)


async def test_best_effort_messages_are_exchanged_with_rclpy(world: Any, shared_peer: Peer) -> None:
    """Losses are allowed, so each message is sent until one arrives."""
    node, cls = world.node("tester"), message(shared_peer, "std_msgs/msg/String")
    topic, back = fresh("lossy_to_them"), fresh("lossy_to_us")
    theirs = {"depth": 5, "reliability": "BEST_EFFORT"}
    publisher = await matched_publisher(node, shared_peer, cls, topic, SENSOR_DATA, theirs)
    taken = shared_peer.do("take", topic=topic)
    assert await repeated(lambda: publisher.publish(cls(data="out")), taken) == [{"data": "out"}]
    subscription = await matched_subscription(node, shared_peer, cls, back, SENSOR_DATA, theirs)

    async def send() -> None:
        await shared_peer.do("publish", topic=back, messages_=[{"data": "back"}])

    assert await repeated(send, subscription.receive(timeout_s=10)) == cls(data="back")


LATCHED = QoSProfile().keep_last(3).transient_local()
RCLPY_LATCHED = {"depth": 3, "durability": "TRANSIENT_LOCAL"}
FIVE = [{"data": f"message {number}"} for number in range(5)]


async def test_late_joiners_receive_latched_messages_up_to_history_depth(world: Any, shared_peer: Peer) -> None:
    node, cls = world.node("tester"), message(shared_peer, "std_msgs/msg/String")
    ours, theirs = fresh("latched_by_us"), fresh("latched_by_them")
    publisher = node.create_publisher(cls, ours, LATCHED)
    for values in FIVE:
        publisher.publish(from_dict(cls, values))
    await shared_peer.do("subscribe", topic=ours, type="std_msgs/msg/String", qos=RCLPY_LATCHED)
    assert await shared_peer.do("take", topic=ours, count=3) == FIVE[-3:]
    await shared_peer.do("publisher", topic=theirs, type="std_msgs/msg/String", qos=RCLPY_LATCHED)
    await shared_peer.do("publish", topic=theirs, messages_=FIVE)
    subscription = node.create_subscription(cls, theirs, qos=LATCHED)
    assert [plain(await subscription.receive(timeout_s=10)) for _ in range(3)] == FIVE[-3:]


async def test_keep_last_subscription_retains_newest_of_many_messages(world: Any, shared_peer: Peer) -> None:
    node, cls = world.node("tester"), message(shared_peer, "std_msgs/msg/String")
    topic, last = fresh("newest"), {"data": "message 499"}
    subscription = await matched_subscription(node, shared_peer, cls, topic, QoSProfile().keep_last(2), {"depth": 1000})
    many = [{"data": f"message {number}"} for number in range(500)]
    await shared_peer.do("publish", topic=topic, messages_=many)
    await until(lambda: subscription.latest() == from_dict(cls, last))
