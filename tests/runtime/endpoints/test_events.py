"""What happens to endpoints beside messages, told to callbacks."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from worlds import until

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import (
    CallbackSignatureError,
    CountStatus,
    IncompatibleStatus,
    Liveliness,
    LivelinessStatus,
    MatchedStatus,
    PublisherEventCallbacks,
    QoSProfile,
    SubscriptionEventCallbacks,
    UnsupportedEventError,
)

if TYPE_CHECKING:
    from worlds import World

String: Any = get_message("std_msgs/msg/String")
Bool: Any = get_message("std_msgs/msg/Bool")


@pytest.mark.every_transport
async def test_matches_come_and_go(world: World) -> None:
    alice, bob = world.pair()
    heard: list[MatchedStatus] = []
    published: list[MatchedStatus] = []
    bob.create_subscription(String, "t", event_callbacks=SubscriptionEventCallbacks(matched=heard.append))
    publisher = alice.create_publisher(String, "t", event_callbacks=PublisherEventCallbacks(matched=published.append))
    await until(lambda: bool(heard and published))
    assert heard == published == [MatchedStatus(1, 1, 1, 1)]
    publisher.close()
    await until(lambda: len(heard) == 2)
    assert heard[1] == MatchedStatus(1, 0, 0, -1)
    assert len(published) == 1


@pytest.mark.every_transport
async def test_async_callbacks_hear_of_other_types_and_qualities(world: World) -> None:
    alice, bob = world.pair()
    types: list[IncompatibleStatus] = []
    qualities: list[IncompatibleStatus] = []

    async def on_type(status: IncompatibleStatus) -> None:
        await asyncio.sleep(0)
        types.append(status)

    callbacks = SubscriptionEventCallbacks(incompatible_type=on_type, incompatible_qos=qualities.append)
    bob.create_subscription(String, "t", event_callbacks=callbacks)
    alice.create_publisher(Bool, "t")
    await until(lambda: bool(types))
    assert types == [IncompatibleStatus(1, 1, "types differ, std_msgs/msg/Bool and std_msgs/msg/String")]
    if world.kind != "zenoh":  # nobody looks at profiles there
        alice.create_publisher(String, "t", QoSProfile().best_effort())
        await until(lambda: bool(qualities))
        assert (qualities[0].total_count, "Best effort" in qualities[0].reason) == (1, True)
    assert len(types) == 1


async def test_dds_tells_of_deadlines_and_liveliness(dds: World) -> None:
    alice, bob = dds.pair()
    qos = QoSProfile(deadline_ns=100_000_000, liveliness=Liveliness.MANUAL_BY_TOPIC, liveliness_lease_ns=200_000_000)
    late: list[CountStatus] = []
    alive: list[LivelinessStatus] = []
    missed: list[CountStatus] = []
    lost: list[CountStatus] = []
    subscription = bob.create_subscription(
        String, "t", qos=qos, event_callbacks=SubscriptionEventCallbacks(deadline=late.append, liveliness=alive.append)
    )
    publisher = alice.create_publisher(
        String, "t", qos, event_callbacks=PublisherEventCallbacks(deadline=missed.append, liveliness=lost.append)
    )
    await subscription.wait_for_publishers(5)
    publisher.publish(String())
    await until(lambda: bool(late and missed and lost) and any(one.not_alive_count for one in alive))
    assert late[0].total_count >= late[0].total_count_change >= 1
    assert alive[-1].alive_count_change + alive[-1].not_alive_count_change == 0 or alive[0].alive_count == 1


async def test_lost_messages_are_counted_by_dds(dds: World) -> None:
    node = dds.node()
    lost: list[CountStatus] = []
    callbacks = SubscriptionEventCallbacks(message_lost=lost.append)
    subscription = node.create_subscription(String, "t", event_callbacks=callbacks)
    assert subscription._reader.event_counts("message_lost") == (0,)
    counts = iter([(0,), (3,), (3,), (5,)])
    events: Any = subscription._events
    events._end = type("Counted", (), {"event_counts": lambda self, event: next(counts, (5,))})()
    await until(lambda: len(lost) == 2)
    assert lost == [CountStatus(3, 3), CountStatus(5, 2)]


def test_what_a_middleware_does_not_tell_is_refused(memory: World) -> None:
    node = memory.node("n")
    with pytest.raises(UnsupportedEventError, match="subscription on /t: this middleware does not tell of deadline"):
        node.create_subscription(String, "t", event_callbacks=SubscriptionEventCallbacks(deadline=print))
    with pytest.raises(UnsupportedEventError, match="the publisher on /t"):
        node.create_publisher(String, "t", event_callbacks=PublisherEventCallbacks(liveliness=print))
    nothing: Any = lambda: None  # noqa: E731
    with pytest.raises(CallbackSignatureError, match="the matched callback of the subscription on /t"):
        node.create_subscription(String, "t", event_callbacks=SubscriptionEventCallbacks(matched=nothing))
    assert node.count_publishers("/t") == node.count_subscribers("/t") == 0


async def test_a_closed_endpoint_tells_nothing_more(memory: World) -> None:
    alice, bob = memory.pair()
    heard: list[MatchedStatus] = []
    subscription = bob.create_subscription(
        String, "t", event_callbacks=SubscriptionEventCallbacks(matched=heard.append)
    )
    alice.create_publisher(String, "t")
    await until(lambda: bool(heard))
    subscription.close()
    subscription.close()
    await asyncio.sleep(0.12)  # two looks later
    assert len(heard) == 1
