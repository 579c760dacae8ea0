"""QoS events of endpoints of this package about endpoints of rclpy, with the counts that rclpy reports."""

from __future__ import annotations

from typing import Any

import pytest
from peer_helpers import fresh
from rclpy_peer import Peer
from support.waiting import until

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import (
    CountStatus,
    IncompatibleStatus,
    LivelinessStatus,
    MatchedStatus,
    PublisherEventCallbacks,
    QoSPolicyKind,
    QoSProfile,
    SubscriptionEventCallbacks,
)

STRING = "std_msgs/msg/String"
String: Any = get_message(STRING)


@pytest.mark.parametrize(
    ("theirs", "ours", "kind"),
    [
        ({"reliability": "BEST_EFFORT"}, QoSProfile().reliable(), QoSPolicyKind.RELIABILITY),
        ({"reliability": "RELIABLE"}, QoSProfile().best_effort(), None),
        ({"durability": "VOLATILE"}, QoSProfile().transient_local(), QoSPolicyKind.DURABILITY),
        ({"durability": "TRANSIENT_LOCAL"}, QoSProfile().volatile(), None),
        ({"deadline_s": 2}, QoSProfile().deadline(1.0), QoSPolicyKind.DEADLINE),
        ({"liveliness": "AUTOMATIC"}, QoSProfile().manual_liveliness(), QoSPolicyKind.LIVELINESS),
        ({"lease_s": 2}, QoSProfile().automatic_liveliness(1.0), QoSPolicyKind.LIVELINESS),
    ],
)
async def test_qos_policies_decide_whether_rclpy_publisher_matches(
    world: Any, shared_peer: Peer, theirs: dict[str, Any], ours: QoSProfile, kind: QoSPolicyKind | None
) -> None:
    if shared_peer.middleware == "Zenoh":
        kind = None  # no policies are incompatible: docs/internals/zenoh.md 5
    topic = fresh("policies")
    events: list[IncompatibleStatus] = []
    callbacks = SubscriptionEventCallbacks(incompatible_qos=events.append)
    subscription = world.node().create_subscription(String, topic, qos=ours, event_callbacks=callbacks)
    await shared_peer.do("publisher", topic=topic, type=STRING, qos=theirs)
    await until(lambda: subscription.publisher_count > 0 or events)
    assert subscription.publisher_count == (kind is None)
    assert [(one.total_count, one.last_policy_kind) for one in events] == ([] if kind is None else [(1, kind)])


@pytest.mark.about_dds("Zenoh has no events for deadlines and liveliness")
async def test_events_report_match_deadline_and_liveliness_of_rclpy_publisher(world: Any, shared_peer: Peer) -> None:
    topic = fresh("silent")
    matched: list[MatchedStatus] = []
    alive: list[LivelinessStatus] = []
    missed: list[CountStatus] = []
    callbacks = SubscriptionEventCallbacks(matched=matched.append, liveliness=alive.append, deadline=missed.append)
    qos = QoSProfile().deadline(0.5).manual_liveliness(1.0)
    world.node().create_subscription(String, topic, qos=qos, event_callbacks=callbacks)
    theirs = {"deadline_s": 0.5, "lease_s": 1, "liveliness": "MANUAL_BY_TOPIC"}
    await shared_peer.do("publisher", topic=topic, type=STRING, qos=theirs)
    await shared_peer.do("matched", topic=topic)
    await until(lambda: bool(matched))
    await shared_peer.do("publish", topic=topic, messages_=[{"data": "once"}])
    await until(lambda: bool(missed) and bool(alive) and alive[-1].not_alive_count == 1)
    assert missed[0].total_count >= missed[0].total_count_change >= 1
    await shared_peer.do("unpublish", topic=topic)
    await until(lambda: len(matched) == 2 and alive[-1].not_alive_count == 0)
    assert matched == [MatchedStatus(1, 1, 1, 1), MatchedStatus(1, 0, 0, -1)]


@pytest.mark.about_dds("no policies are incompatible on Zenoh")
async def test_publisher_events_report_incompatible_and_matching_rclpy_subscriptions(
    world: Any, shared_peer: Peer
) -> None:
    topic = fresh("both")
    matched: list[MatchedStatus] = []
    incompatible: list[IncompatibleStatus] = []
    callbacks = PublisherEventCallbacks(matched=matched.append, incompatible_qos=incompatible.append)
    world.node().create_publisher(String, topic, QoSProfile().best_effort(), event_callbacks=callbacks)
    await shared_peer.do("subscribe", topic=topic, type=STRING, qos={"reliability": "RELIABLE"})
    await until(lambda: bool(incompatible))
    assert (incompatible[0].total_count, incompatible[0].last_policy_kind) == (1, QoSPolicyKind.RELIABILITY)
    assert matched == []
    await shared_peer.do("unsubscribe", topic=topic)
    await shared_peer.do("subscribe", topic=topic, type=STRING, qos={"reliability": "BEST_EFFORT"})
    await until(lambda: bool(matched))
    assert matched == [MatchedStatus(1, 1, 1, 1)] and len(incompatible) == 1
