"""Subscriptions of messages with an unbounded array of bytes, which publishers of Lyrical send on other keys.

The publisher chooses the key as rmw_zenoh_cpp 0.10.5 does (rmw_publisher_data.cpp, `publish` and
`on_subscriber_discovered`; docs/internals/zenoh.md 9.2 to 9.4).
"""

from __future__ import annotations

import itertools
import struct
from typing import TYPE_CHECKING, Any

import pytest
import xxhash
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import Image
from std_msgs.msg import ByteMultiArray, Empty, String, UInt8MultiArray
from support.waiting import until
from support.zenoh_peer import PLAIN, PlainPublisher
from visualization_msgs.msg import MarkerArray

from rosidl_py_gen import compile_definition, type_hash
from rosidl_py_gen.command_support.command_node import CommandNode
from rosidl_py_gen.command_support.graph_lookup import opaque_class
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.entities.message_types import has_unbounded_bytes, message_type, raw_type

if TYPE_CHECKING:
    from support.worlds import World
    from support.zenoh_peer import Peer

BYTES = f"std_msgs::msg::dds_::UInt8MultiArray_/{type_hash(UInt8MultiArray)}"


def bytes_message(*values: int) -> bytes:
    """A UInt8MultiArray without dimensions."""
    return b"\0\1\0\0" + struct.pack("<III", 0, 0, len(values)) + bytes(values)


class LyricalPublisher(PlainPublisher):
    """Buffer-aware publisher: a subscription belongs to its CPU group, or gets samples on a separate key."""

    def __init__(self, peer: Peer, name: str, type_and_hash: str) -> None:
        super().__init__(peer, name, type_and_hash)
        self.gid = peer.tell("MP", name, type_and_hash, f"{PLAIN}/backends:cpu:")

    def publish(self, data: bytes) -> None:
        subscribers = self.peer.of_others("MS", self.name)
        is_cpu = [chunks[13:] == ["backends:cpu:"] for chunks in subscribers]
        if any(is_cpu):
            self.put(f"{self.base}/_buf_cpu", data)
        for chunks in itertools.compress(subscribers, [not cpu for cpu in is_cpu]):
            gid = xxhash.xxh3_128_intdigest("/".join(chunks).encode()).to_bytes(16, "little")
            self.put(f"{self.base}/_buf/{gid.hex()}", b"\0\1\0\0a descriptor")

    def publish_serialized(self, data: bytes) -> None:
        self.put(self.base, data)


@pytest.mark.parametrize(
    ("cls", "expected"),
    [
        (UInt8MultiArray, True),
        (Image, True),
        (MarkerArray, True),  # a compressed image in each marker
        (OccupancyGrid, False),  # int8
        (ByteMultiArray, False),  # an octet is no uint8
        (String, False),
        (Empty, False),
        (compile_definition("p/msg/Chars", "char[] data"), True),
        (compile_definition("p/msg/Bounded", "uint8[<=9] some\nuint8[9] all"), False),
    ],
)
def test_has_unbounded_bytes_detects_byte_sequences_in_fields(cls: type[Any], expected: bool) -> None:
    assert has_unbounded_bytes(message_type(cls)) is expected
    assert has_unbounded_bytes(raw_type(message_type(cls))) is (expected or cls is Empty)


async def test_subscription_receives_samples_of_lyrical_publisher(zenoh: World, peer: Peer) -> None:
    subscription = zenoh.node("ours").create_subscription(UInt8MultiArray, "/bytes")
    publisher = LyricalPublisher(peer, "/bytes", BYTES)
    publisher.publish(bytes_message(0))  # before it knows a subscription
    await until(lambda: len(peer.of_others("MS", "/bytes")) == 1)
    next(publisher.numbers)  # its numbers have gaps: they count the samples of all keys
    publisher.publish(bytes_message(1, 2))
    publisher.publish_serialized(bytes_message(3))
    publisher.publish(bytes_message(4))
    received: list[list[int]] = []
    while not received or received[-1] != [4]:
        message, info = await subscription.receive_with_info(20)
        assert info.publisher_gid == publisher.gid
        received.append(list(message.data))
    assert received[-3:] == [[1, 2], [3], [4]] and received[:-3] in ([], [[0]])


async def test_opaque_subscription_receives_samples_of_lyrical_publisher(zenoh: World, peer: Peer) -> None:
    node = zenoh.node("ours")
    publisher = LyricalPublisher(peer, "/bytes", BYTES)
    await until(lambda: node.count_publishers("/bytes") > 0)
    command: Any = type("Command", (), {"node": node, "announced_types": CommandNode.announced_types})()
    subscription = node.create_subscription(opaque_class(command, "/bytes"), "/bytes", raw=True)
    await until(lambda: len(peer.of_others("MS", "/bytes")) == 1)
    publisher.publish(bytes_message(7))
    assert await subscription.receive(5) == bytes_message(7)


@pytest.mark.parametrize(
    ("cls", "qos", "end"),
    [
        (UInt8MultiArray, 10, f"{PLAIN}/backends:cpu:"),
        (UInt8MultiArray, QoSProfile().transient_local(), ":1:,10:,:,:,,"),
        (String, 10, PLAIN),
    ],
)
async def test_only_volatile_byte_subscriptions_announce_the_cpu_backend(
    zenoh: World, peer: Peer, cls: type[Any], qos: Any, end: str
) -> None:
    node = zenoh.node("ours")
    subscription = node.create_subscription(cls, "/t", qos=qos)
    await until(lambda: len(peer.of_others("MS", "/t")) == 1)
    (chunks,) = peer.of_others("MS", "/t")
    assert "/".join(chunks[12:]) == end
    gid = xxhash.xxh3_128_intdigest("/".join(chunks).encode()).to_bytes(16, "little")
    (info,) = node.get_subscriptions_info_by_topic("/t")
    assert bytes(info.endpoint_gid) == gid
    subscription.close()
    await until(lambda: not peer.of_others("MS", "/t"))


async def test_byte_messages_of_jazzy_and_own_publishers_arrive_once(zenoh: World, peer: Peer) -> None:
    alice, bob = zenoh.pair()
    subscription = alice.create_subscription(UInt8MultiArray, "/bytes")
    own_publisher, peer_publisher = (
        bob.create_publisher(UInt8MultiArray, "/bytes"),
        PlainPublisher(peer, "/bytes", BYTES),
    )
    assert await own_publisher.wait_for_subscribers(20)
    await until(lambda: len(peer.of_others("MS", "/bytes")) == 1 and alice.count_publishers("/bytes") == 2)
    for number in range(3):
        own_publisher.publish(UInt8MultiArray(data=[number]))
    assert [list((await subscription.receive(20)).data) for _ in range(3)] == [[0], [1], [2]]
    for number in range(3):
        peer_publisher.publish(bytes_message(number))
    assert [list((await subscription.receive(20)).data) for _ in range(3)] == [[0], [1], [2]]


async def test_own_publisher_reaches_lyrical_subscription(zenoh: World, peer: Peer) -> None:
    received: list[bytes] = []
    for key in (peer.key("/bytes", BYTES), f"{peer.key('/bytes', BYTES)}/_buf_cpu"):
        peer.listen(key, received)
    peer.tell("MS", "/bytes", BYTES, f"{PLAIN}/backends:cpu:")
    publisher = zenoh.node("ours").create_publisher(UInt8MultiArray, "/bytes")
    assert await publisher.wait_for_subscribers(20)
    publisher.publish(UInt8MultiArray(data=[1]))
    publisher.publish(UInt8MultiArray(data=[2]))
    await until(lambda: len(received) >= 2)
    assert received == [bytes_message(1), bytes_message(2)]
