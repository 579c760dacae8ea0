"""Event callbacks of publishers and subscriptions."""

from __future__ import annotations

import asyncio
import ctypes
import time
from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import participant_of, reader_of
from support.waiting import until

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import (
    CallbackSignatureError,
    ClosedError,
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
from rosidl_py_gen.runtime import QoSPolicyKind as Kind

if TYPE_CHECKING:
    from support.worlds import World

String: Any = get_message("std_msgs/msg/String")
Bool: Any = get_message("std_msgs/msg/Bool")


@pytest.mark.every_transport
async def test_matched_events_report_new_and_lost_matches(world: World) -> None:
    alice, bob = world.pair()
    heard: list[MatchedStatus] = []
    published: list[MatchedStatus] = []
    callbacks = SubscriptionEventCallbacks(matched=heard.append)
    subscription = bob.create_subscription(String, "t", event_callbacks=callbacks)
    publisher = alice.create_publisher(String, "t", event_callbacks=PublisherEventCallbacks(matched=published.append))
    await until(lambda: bool(heard and published))
    assert heard == published == [MatchedStatus(1, 1, 1, 1)]
    publisher.close()
    await until(lambda: len(heard) == 2)
    assert heard[1] == MatchedStatus(1, 0, 0, -1)
    subscription.close()
    subscription.close()
    alice.create_publisher(String, "t")
    await asyncio.sleep(0.12)  # two polls later
    assert len(heard) == 2 and len(published) == 1


@pytest.mark.every_transport
async def test_incompatible_type_and_qos_events_call_sync_and_async_callbacks(world: World) -> None:
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
    if world.kind != "zenoh":  # Zenoh does not compare QoS profiles
        alice.create_publisher(String, "t", QoSProfile().best_effort())
        await until(lambda: bool(qualities))
        assert (qualities[0].total_count, "Best effort" in qualities[0].reason) == (1, True)
    assert len(types) == 1


RELIABLE, MANUAL = QoSProfile(), QoSProfile().manual_liveliness(1.0)
KINDS = [
    (RELIABLE.best_effort(), RELIABLE, Kind.RELIABILITY),
    (RELIABLE, RELIABLE.transient_local(), Kind.DURABILITY),
    (RELIABLE, RELIABLE.deadline(1.0), Kind.DEADLINE),
    (RELIABLE.deadline(2.0), RELIABLE.deadline(1.0), Kind.DEADLINE),
    (RELIABLE.automatic_liveliness(1.0), MANUAL, Kind.LIVELINESS),
    (MANUAL, RELIABLE.manual_liveliness(0.5), Kind.LIVELINESS),
    (RELIABLE, RELIABLE.automatic_liveliness(1.0), Kind.LIVELINESS),
    (RELIABLE.best_effort(), RELIABLE.transient_local().deadline(1.0), Kind.RELIABILITY),
    (RELIABLE, MANUAL.transient_local().deadline(1.0), Kind.DURABILITY),
    (RELIABLE, MANUAL.deadline(1.0), Kind.DEADLINE),
]
"""Offered and requested profile, and the first incompatible policy."""
DDS_POLICIES = {Kind.DURABILITY: 2, Kind.DEADLINE: 4, Kind.LIVELINESS: 8, Kind.RELIABILITY: 11}
"""Numbers of DDS_..._QOS_POLICY_ID."""


@pytest.mark.every_transport
@pytest.mark.without_zenoh("Zenoh does not compare QoS profiles")
@pytest.mark.parametrize(("offered", "requested", "kind"), KINDS)
async def test_incompatible_qos_events_name_the_policy_on_both_sides(
    world: World, offered: QoSProfile, requested: QoSProfile, kind: Kind
) -> None:
    alice, bob = world.pair()
    subscription_events: list[IncompatibleStatus] = []
    publisher_events: list[IncompatibleStatus] = []
    callbacks = SubscriptionEventCallbacks(incompatible_qos=subscription_events.append)
    subscription = bob.create_subscription(String, "t", qos=requested, event_callbacks=callbacks)
    alice.create_publisher(
        String, "t", offered, event_callbacks=PublisherEventCallbacks(incompatible_qos=publisher_events.append)
    )
    await until(lambda: bool(subscription_events and publisher_events))
    for status in (*subscription_events, *publisher_events):
        assert (status.total_count, status.total_count_change, status.last_policy_kind) == (1, 1, kind)
    if world.kind == "dds":  # as Cyclone itself sees it
        participant, reader = participant_of(subscription), reader_of(subscription)
        found = (ctypes.c_uint32 * 8)()
        read = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32, ctypes.c_void_p)(
            ("dds_get_requested_incompatible_qos_status", participant.api.library)
        )
        await until(lambda: read(reader.entity, found) == 0 and found[0] > 0)
        assert found[2] == DDS_POLICIES[kind]


async def test_incompatible_events_accumulate_totals_and_report_last_policy(memory: World) -> None:
    alice, bob = memory.pair()
    heard: list[IncompatibleStatus] = []
    types: list[IncompatibleStatus] = []
    callbacks = SubscriptionEventCallbacks(incompatible_qos=heard.append, incompatible_type=types.append)
    bob.create_subscription(String, "t", qos=RELIABLE.transient_local(), event_callbacks=callbacks)
    alice.create_publisher(String, "t", RELIABLE)
    await until(lambda: len(heard) == 1)
    gone = alice.create_publisher(String, "t", RELIABLE.best_effort())
    await until(lambda: len(heard) == 2)
    gone.close()
    alice.create_publisher(String, "t", RELIABLE.best_effort())
    alice.create_publisher(String, "t", RELIABLE)
    alice.create_publisher(Bool, "t", RELIABLE)
    await until(lambda: len(heard) == 3 and bool(types))
    assert [(one.total_count, one.total_count_change) for one in heard] == [(1, 1), (2, 1), (4, 2)]
    assert [one.last_policy_kind for one in heard] == [Kind.DURABILITY, Kind.RELIABILITY, Kind.DURABILITY]
    assert [(one.total_count, one.last_policy_kind) for one in types] == [(1, Kind.INVALID)]


def test_policy_kinds_have_the_numbers_of_rmw() -> None:
    assert [int(kind) for kind in Kind] == [1 << bit for bit in range(10)]
    assert (Kind.INVALID, Kind.RELIABILITY, Kind.AVOID_ROS_NAMESPACE_CONVENTIONS) == (1, 16, 512)


async def test_matched_events_report_endpoints_replaced_between_two_polls(dds: World) -> None:
    alice, bob = dds.pair()
    received: list[MatchedStatus] = []
    sent: list[MatchedStatus] = []
    subscription = bob.create_subscription(
        String, "t", event_callbacks=SubscriptionEventCallbacks(matched=received.append)
    )
    publisher = alice.create_publisher(String, "t", event_callbacks=PublisherEventCallbacks(matched=sent.append))
    await until(lambda: bool(received and sent))
    reader: Any = reader_of(subscription)

    def wait_without_polling(total: int, count: int) -> None:
        while reader.event_counts("matched")[0] < total or len(reader.matched_writers()) != count:
            time.sleep(0.001)

    other = alice.create_publisher(String, "t")
    wait_without_polling(2, 2)
    other.close()
    wait_without_polling(2, 1)
    await until(lambda: len(received) == 3)
    assert received == [MatchedStatus(1, 1, 1, 1), MatchedStatus(2, 1, 2, 1), MatchedStatus(2, 0, 1, -1)]
    assert sent == [MatchedStatus(1, 1, 1, 1)] and publisher.subscription_count == 1
    publisher.close()
    wait_without_polling(2, 0)
    others = [alice.create_publisher(String, "t") for _ in range(2)]
    wait_without_polling(4, 2)
    await until(lambda: len(received) == 5)
    assert received[3:] == [MatchedStatus(2, 0, 0, -1), MatchedStatus(4, 2, 2, 2)]
    for one in others:
        one.close()
    wait_without_polling(4, 0)
    await until(lambda: len(received) == 6)
    assert received[5] == MatchedStatus(4, 0, 0, -2)


@pytest.mark.slow
async def test_liveliness_is_lost_without_assert_liveliness(dds: World) -> None:
    statuses: list[LivelinessStatus] = []
    publisher, subscription = await dds.connected(
        String,
        "alive",
        QoSProfile().manual_liveliness(lease_s=1.0),
        event_callbacks=SubscriptionEventCallbacks(liveliness=statuses.append),
    )
    assert await subscription.wait_for_publishers(timeout_s=20)
    publisher.publish(String(data="begins the lease"))
    began_s = last_s = time.monotonic()
    while last_s < began_s + 1.4:  # more than one lease, in which nothing is published
        publisher.assert_liveliness()
        await asyncio.sleep(0.05)
        now_s = time.monotonic()
        if now_s > last_s + 0.45:
            began_s = now_s  # the machine was held up, and the lease may have run out
            statuses.clear()
        else:
            assert not any(status.not_alive_count for status in statuses)
        last_s = now_s
    await until(lambda: bool(statuses) and statuses[-1] == LivelinessStatus(0, 1, -1, 1))
    publisher.publish(String(data="back"))
    await until(lambda: statuses[-1].alive_count == 1)
    publisher.close()
    await until(lambda: statuses[-1] == LivelinessStatus(0, 0, -1, 0))
    with pytest.raises(ClosedError, match="the publisher on /alive of node /alice is closed"):
        publisher.assert_liveliness()


@pytest.mark.slow
async def test_dds_reports_missed_deadlines_and_lost_liveliness(dds: World) -> None:
    alice, bob = dds.pair()
    qos = QoSProfile(deadline_ns=100_000_000, liveliness=Liveliness.MANUAL_BY_TOPIC, liveliness_lease_ns=2_000_000_000)
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
    await subscription.wait_for_publishers(20)
    publisher.publish(String())
    await until(lambda: bool(late and missed and lost) and any(one.not_alive_count for one in alive))
    for first in (late[0], missed[0], lost[0]):
        assert first.total_count == first.total_count_change >= 1
    first_lost = next(one for one in alive if one.not_alive_count)
    assert (alive[0].alive_count, first_lost.alive_count, first_lost.not_alive_count) == (1, 0, 1)


async def test_message_lost_events_follow_the_counter_of_dds(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    node = dds.node()
    lost: list[CountStatus] = []
    callbacks = SubscriptionEventCallbacks(message_lost=lost.append)
    subscription = node.create_subscription(String, "t", event_callbacks=callbacks)
    reader: Any = reader_of(subscription)
    assert reader.event_counts("message_lost") == (0,)
    counts = iter([(0,), (3,), (3,), (5,)])
    monkeypatch.setattr(type(reader), "event_counts", lambda self, event: next(counts, (5,)))
    await until(lambda: len(lost) == 2)
    assert lost == [CountStatus(3, 3), CountStatus(5, 2)]


def test_unsupported_event_callbacks_are_refused(memory: World) -> None:
    node = memory.node("n")
    with pytest.raises(UnsupportedEventError, match="subscription on /t: this middleware does not report deadline"):
        node.create_subscription(String, "t", event_callbacks=SubscriptionEventCallbacks(deadline=print))
    with pytest.raises(UnsupportedEventError, match="the publisher on /t"):
        node.create_publisher(String, "t", event_callbacks=PublisherEventCallbacks(liveliness=print))
    nothing: Any = lambda: None  # noqa: E731
    with pytest.raises(CallbackSignatureError, match="the matched callback of the subscription on /t"):
        node.create_subscription(String, "t", event_callbacks=SubscriptionEventCallbacks(matched=nothing))
    assert node.count_publishers("/t") == node.count_subscribers("/t") == 0
