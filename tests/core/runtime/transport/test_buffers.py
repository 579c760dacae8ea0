"""Publishers of Lyrical send images to one of two topics; two of our publishers simulate one of them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import participant_of
from support.waiting import until

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from support.worlds import World

    from rosidl_py_gen.runtime import Node, Publisher, Subscription

Image: Any = get_message("sensor_msgs/msg/Image")
String: Any = get_message("std_msgs/msg/String")
BUFFERS = "image/_buf_cpu"
ALL = QoSProfile().keep_all()


def of_lyrical(node: Node, message_type: Any = Image, qos: Any = ALL) -> tuple[Publisher[Any], Publisher[Any]]:
    """Return the two writers of a publisher of Lyrical."""
    return node.create_publisher(message_type, "image", qos), node.create_publisher(message_type, BUFFERS, qos)


async def exchange(subscription: Subscription[Any], both: tuple[Publisher[Any], Publisher[Any]]) -> None:
    """Send messages to one topic after the other; they arrive in order, so none of them arrives twice."""
    for publisher in both:
        assert await publisher.wait_for_subscribers(timeout_s=10)
    for number in range(20):
        both[number // 3 % 2].publish(Image(height=number, data=bytes(100)))
        assert (await subscription.receive(timeout_s=10)).height == number


@pytest.mark.parametrize("is_first", ["publisher", "subscription"])
async def test_messages_on_plain_and_buffer_topic_arrive_once(dds: World, is_first: str) -> None:
    alice, bob = dds.pair()
    if is_first == "publisher":
        both = of_lyrical(alice)
        await until(lambda: f"/{BUFFERS}" in dict(bob.get_topic_names_and_types()))
        subscription = bob.create_subscription(Image, "image", qos=ALL)
    else:
        subscription = bob.create_subscription(Image, "image", qos=ALL)
        both = of_lyrical(alice)
    await exchange(subscription, both)
    subscription.close()
    await until(lambda: not both[1].subscription_count)


async def test_callbacks_and_take_receive_messages_of_the_buffer_topic(dds: World) -> None:
    alice, bob = dds.pair()
    received: list[int] = []
    bob.create_subscription(Image, "image", lambda message: received.append(message.height), qos=ALL)
    polled = bob.create_subscription(Image, "image", qos=ALL)
    _, buffers = of_lyrical(alice)
    await until(lambda: buffers.subscription_count == 2)
    for number in range(10):
        buffers.publish(Image(height=number, data=bytes(1_000_000)))
    taken: list[int] = []

    def take() -> bool:
        message = polled.take()
        if message is not None:
            taken.append(message.height)
        return len(taken) == 10

    await until(lambda: len(received) == 10)
    await until(take)
    assert received == taken == list(range(10))


@pytest.mark.parametrize(
    ("message_type", "qos"),
    [(String, ALL), (Image, QoSProfile().transient_local())],
    ids=["no bytes", "transient local"],
)
async def test_subscriptions_without_bytes_or_volatility_have_no_buffer_reader(
    dds: World, message_type: Any, qos: QoSProfile
) -> None:
    alice, bob = dds.pair()
    plain, buffers = of_lyrical(alice, message_type, qos)
    bob.create_subscription(message_type, "image", qos=qos)
    assert await plain.wait_for_subscribers(timeout_s=10)
    await until(lambda: f"/{BUFFERS}" in dict(bob.get_topic_names_and_types()))
    assert buffers.subscription_count == 0


async def test_subscription_creates_one_reader_if_no_publisher_is_of_lyrical(dds: World) -> None:
    alice, bob = dds.pair()
    bob.create_subscription(Image, "image")
    assert await alice.create_publisher(Image, "image").wait_for_subscribers(timeout_s=10)
    assert f"/{BUFFERS}" not in dict(alice.get_topic_names_and_types())


async def test_buffer_messages_of_a_second_publisher_arrive_after_the_first_closed(dds: World) -> None:
    alice, bob = dds.pair()
    subscription = bob.create_subscription(Image, "image", qos=ALL)
    for _ in range(2):
        both = of_lyrical(alice)
        await exchange(subscription, both)
        for publisher in both:
            publisher.close()


async def test_subscription_closed_during_discovery_leaves_no_buffer_reader(dds: World) -> None:
    node = dds.node()
    node.create_subscription(Image, "image", qos=ALL)
    participant = participant_of(node)
    (reader,) = (one for one in participant.readers.values() if one.topic == "rt/image")
    with participant.buffers.lock:
        closing = threading.Thread(target=reader.close)
        closing.start()
        await until(lambda: reader.is_closed)
        participant.read_buffers(reader)  # as if a writer were discovered now
    closing.join()
    assert [one for one in participant.readers.values() if one.topic.endswith(BUFFERS)] == []


async def test_late_subscription_announces_its_reader_of_the_second_topic_first(dds: World) -> None:
    """A publisher that has matched the first reader may send to either topic."""
    alice, bob = dds.pair()
    of_lyrical(alice)
    await until(lambda: f"/{BUFFERS}" in dict(bob.get_topic_names_and_types()))
    bob.create_subscription(Image, "image", qos=ALL)
    participant = participant_of(bob)
    entity_ids = {reader.topic: reader.guid[12:] for reader in participant.readers.values()}
    # Cyclone numbers endpoints in the order of their creation, which is also that of their announcements.
    assert entity_ids[f"rt/{BUFFERS}"] < entity_ids["rt/image"]
