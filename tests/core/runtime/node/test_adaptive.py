"""Adaptive subscriptions, and waiting for one message."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from std_msgs.msg import Int32, String
from support.inner_state import reader_of
from support.waiting import until
from support.worlds import World, entity

from rosidl_py_gen import decode, get_message, type_hash
from rosidl_py_gen.cdr.message import opaque_message_class
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import AdaptiveSubscription, Durability, Reliability, WaitTimeoutError, WouldDeadlockError
from rosidl_py_gen.runtime import qos as presets

pytestmark = pytest.mark.on_zenoh


async def test_adaptive_subscription_lowers_qos_for_a_weaker_publisher(world: World) -> None:
    near, far = world.pair()
    notes: list[str] = []
    first = far.create_publisher(String, "t", presets.DEFAULT.transient_local())
    await until(lambda: near.count_publishers("t") == 1)
    async with AdaptiveSubscription(near, "t", String, raw=True, note=notes.append) as follow:
        assert follow.qos.durability is Durability.TRANSIENT_LOCAL and follow.qos.reliability is Reliability.RELIABLE
        waiting = asyncio.ensure_future(follow.receive_with_info(20))
        await asyncio.sleep(0)  # the wait has started
        second = far.create_publisher(String, "t", presets.SENSOR_DATA)
        await second.wait_for_subscribers(20)  # the first subscription does not match this publisher
        assert follow.qos.durability is Durability.VOLATILE and follow.qos.reliability is Reliability.BEST_EFFORT
        assert [note.split(":")[0] for note in notes] == [
            "some, but not all, publishers are reliable",
            "some, but not all, publishers are transient local",
        ]
        await first.wait_for_subscribers(20)
        second.publish(String(data="new"))
        message, _ = await waiting  # the wait continues on the new subscription
        assert decode(String, message) == String(data="new")
    with pytest.raises(ClosedError):
        await follow.receive_with_info(1)


async def test_adaptive_subscription_raises_qos_only_for_the_first_publishers(memory: World) -> None:
    near, far = memory.pair()
    durable = presets.DEFAULT.transient_local()
    follow: AdaptiveSubscription[String] = AdaptiveSubscription(near, "t", String)
    called: AdaptiveSubscription[String] = AdaptiveSubscription(near, "t", String, print)
    far.create_publisher(String, "t", durable)
    for one, expected in ((follow, Durability.TRANSIENT_LOCAL), (called, Durability.VOLATILE)):
        one.refresh()
        assert one.qos.durability is expected
    late: AdaptiveSubscription[String] = AdaptiveSubscription(near, "u", String)
    volatile = far.create_publisher(String, "u")
    late.refresh()
    volatile.close()
    far.create_publisher(String, "u", durable)
    late.refresh()
    assert late.qos.durability is Durability.VOLATILE


async def test_resubscribe_retains_received_messages_and_drop_count(world: World) -> None:
    near, far = world.pair()
    publisher = far.create_publisher(Int32, "t")
    follow: AdaptiveSubscription[Int32] = AdaptiveSubscription(near, "t", Int32, depth=1)
    await publisher.wait_for_subscribers(20)
    for number in range(3):
        publisher.publish(Int32(data=number))
    await until(lambda: follow.dropped == 2)
    follow.resubscribe()
    assert follow.dropped == 2
    await publisher.wait_for_subscribers(20)
    for number in range(3, 5):
        publisher.publish(Int32(data=number))
    await until(lambda: follow.dropped == 3)
    assert [(await follow.receive_with_info(20))[0].data for _ in range(2)] == [2, 4]
    follow.close()


@pytest.mark.every_transport
async def test_wait_for_message_receives_from_publishers_of_any_qos(world: World) -> None:
    near, far = world.pair()
    for number, qos in enumerate((presets.DEFAULT, presets.SENSOR_DATA, presets.DEFAULT.transient_local())):
        topic = f"t{number}"
        waiting = asyncio.ensure_future(near.wait_for_message(String, topic, 20))
        await asyncio.sleep(0.1)
        publisher = far.create_publisher(String, topic, qos)
        if qos.durability is Durability.VOLATILE:
            await publisher.wait_for_subscribers(20)
        publisher.publish(String(data=topic))  # a retained message may arrive before any endpoint is matched
        assert await waiting == String(data=topic)
        assert not near.count_subscribers(topic)
    assert decode(String, await near.wait_for_message(String, "t2", 20, raw=True)) == String(data="t2")
    assert await near.wait_for_message("std_msgs/msg/String", "t2", 20) == {"data": "t2"}


async def test_wait_for_message_times_out_with_reason_and_ends_with_its_node(memory: World) -> None:
    near, far = memory.pair()
    far.create_publisher(String, "r1/t")
    with pytest.raises(
        WaitTimeoutError, match=r'no message on /t in 0\.1 s: no node publishes it; did you mean "/r1/t"'
    ):
        await near.wait_for_message(String, "t", 0.1)
    far.create_publisher(String, "u", presets.SENSOR_DATA)
    with pytest.raises(WaitTimeoutError, match="offers incompatible QoS: reliability BEST_EFFORT, here RELIABLE"):
        await near.wait_for_message(String, "u", 0.1, qos=1)
    far.create_publisher(String, "map", presets.DEFAULT.transient_local()).publish(String(data="retained"))
    far.create_publisher(String, "map")
    with pytest.raises(WaitTimeoutError, match=r"2 publishers .*; some, but not all, .* without earlier messages"):
        await near.wait_for_message(String, "map", 0.1)
    with pytest.raises(WouldDeadlockError, match="wait_for_message_sync"):
        near.wait_for_message_sync(String, "t", 0.1)
    waiting = asyncio.ensure_future(near.wait_for_message(String, "t"))
    await asyncio.sleep(0.1)
    near.close()
    with pytest.raises(ClosedError):
        await waiting


@pytest.mark.real_time("blocking calls")
def test_wait_for_message_sync_receives_or_times_out(memory: World) -> None:
    near, far = memory.pair()
    far.create_publisher(String, "t", presets.DEFAULT.transient_local()).publish(String(data="x"))
    assert near.wait_for_message_sync(String, "t", 20) == String(data="x")
    with pytest.raises(WaitTimeoutError):
        near.wait_for_message_sync(String, "u", 0.05)


@pytest.mark.parametrize("left", [False, True], ids=["of a previous subscription", "of a publisher that has left"])
async def test_raw_messages_are_dropped_if_definition_set_later_differs(
    memory: World, left: bool, caplog: pytest.LogCaptureFixture
) -> None:
    ours: Any = get_message("sensor_msgs/msg/Range", distro="jazzy")
    theirs: Any = get_message("sensor_msgs/msg/Range", distro="humble")
    alice, bob = memory.pair()
    publishers = [alice.create_publisher(cls, "range") for cls in (theirs, ours)]
    unknown = opaque_message_class("sensor_msgs/msg/Range", "")
    async with AdaptiveSubscription[bytes](bob, "range", unknown, raw=True) as messages:
        for publisher in publishers:
            await publisher.wait_for_subscribers(5)
        for number in range(3):
            for cls, publisher in zip((theirs, ours), publishers, strict=True):
                publisher.publish(cls(range=number))
        await until(lambda: len(reader_of(entity(bob, "/range")).queue.items) == 6)
        if left:
            alice.context.close()
            await until(lambda: bob.count_publishers("range") == 0)
        else:
            messages.resubscribe()
        subscription = entity(bob, "/range")
        messages.set_definition(opaque_message_class("sensor_msgs/msg/Range", type_hash(ours)))
        received = [(await messages.receive_with_info(5))[0] for _ in range(3)]
    assert [ours.decode(data) for data in received] == [ours(range=number) for number in range(3)]
    assert subscription.incompatible_dropped == 3
    if not left:
        warning = f"messages on /range from node /alice are dropped: its definition is {type_hash(theirs)}; here it is "
        await until(lambda: warning in caplog.text)
