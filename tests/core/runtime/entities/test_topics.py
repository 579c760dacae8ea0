"""Publishers and subscriptions on every transport."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Image
from std_msgs.msg import Int32, String
from support.inner_state import type_fields
from support.waiting import until, while_the_loop_sleeps

from rosidl_py_gen import compile_definition, dtype
from rosidl_py_gen.errors import ClosedError, EncodeError, InvalidNameError, TypeNotFoundError
from rosidl_py_gen.runtime import History, QoSProfile, WaitTimeoutError

if TYPE_CHECKING:
    from support.worlds import World

pytestmark = pytest.mark.on_zenoh


@pytest.mark.every_transport
async def test_iterating_over_subscription_yields_messages_in_order(world: World) -> None:
    publisher, subscription = await world.connected(String, "chatter")
    for number in range(5):
        publisher.publish(String(data=str(number)))
    seen = []
    async for message in subscription:
        seen.append(message.data)
        if len(seen) == 5:
            break
    assert seen == ["0", "1", "2", "3", "4"]


@pytest.mark.every_transport
async def test_keep_last_drops_oldest_messages_and_counts_them(world: World) -> None:
    publisher, subscription = await world.connected(Int32, "n", 5)
    for number in range(100):
        publisher.publish(Int32(data=number))
    await until(lambda: subscription.dropped == 95)
    seen = [(await subscription.receive(timeout_s=20)).data for _ in range(5)]
    assert seen == [95, 96, 97, 98, 99]
    assert subscription.dropped == 95


@pytest.mark.every_transport
async def test_keep_all_delivers_every_message(world: World) -> None:
    publisher, subscription = await world.connected(Int32, "n", QoSProfile().keep_all())
    for number in range(2000):
        publisher.publish(Int32(data=number))
    assert [(await subscription.receive(timeout_s=20)).data for _ in range(2000)] == list(range(2000))
    assert subscription.dropped == 0
    assert await publisher.wait_for_acknowledged(timeout_s=20)


@pytest.mark.every_transport
async def test_late_transient_local_subscription_receives_retained_messages(world: World) -> None:
    alice, bob = world.pair()
    qos = QoSProfile().keep_last(3).transient_local()
    publisher = alice.create_publisher(Int32, "n", qos)
    for number in range(10):
        publisher.publish(Int32(data=number))
    late = bob.create_subscription(Int32, "n", qos=qos)
    assert [(await late.receive(timeout_s=20)).data for _ in range(3)] == [7, 8, 9]
    volatile = bob.create_subscription(Int32, "n", qos=3)  # not earlier: Zenoh sends to all at first
    with pytest.raises(WaitTimeoutError):
        await volatile.receive(timeout_s=0.1)


@pytest.mark.every_transport
async def test_raw_bytes_are_published_and_received_with_header(world: World) -> None:
    alice, bob = world.pair()
    typed = bob.create_subscription(Int32, "n")
    raw = bob.create_subscription(Int32, "n", raw=True)
    publisher = alice.create_publisher(Int32, "n")
    assert await publisher.wait_for_subscribers(timeout_s=20, count=2)
    publisher.publish_raw(bytes.fromhex("00010000 07000000"))
    assert await typed.receive(timeout_s=20) == Int32(data=7)
    data = await raw.receive(timeout_s=20)
    assert type(data) is bytes
    assert data == bytes.fromhex("00010000 07000000")


async def test_sequences_of_fixed_size_messages_are_published_and_received_as_arrays(world: World) -> None:
    cloud = compile_definition(
        "arrays_msgs/msg/Cloud", f"string frame\nXyz[] points\n{'=' * 80}\nMSG: arrays_msgs/Xyz\nfloat32 x\nuint8 y"
    )
    xyz = type_fields(cloud)[1].cls
    alice, bob = world.pair()
    listed = bob.create_subscription(cloud, "n")
    as_arrays = bob.create_subscription(cloud, "n", arrays=True)
    publisher = alice.create_publisher(cloud, "n")
    assert await publisher.wait_for_subscribers(timeout_s=5, count=2)
    points = np.zeros(3, dtype(xyz))
    points["x"] = [1, 2, 3]
    publisher.publish(cloud(frame="abc", points=points))
    assert (await listed.receive(timeout_s=5)).points == [xyz(1.0), xyz(2.0), xyz(3.0)]
    found = await as_arrays.receive(timeout_s=5)
    assert found.points.dtype == points.dtype and found.points["x"].tolist() == [1, 2, 3]
    for wrong in ("std_msgs/msg/String", cloud):
        with pytest.raises(TypeError, match="arrays=True"):
            bob.create_subscription(wrong, "n", raw=wrong is cloud, arrays=True)  # type: ignore[call-overload]


async def test_invalid_types_names_and_raw_bytes_are_refused_when_publishing(memory: World) -> None:
    node = memory.node("alice")
    with pytest.raises(TypeNotFoundError, match="std_msgs/msg/Strin"):
        node.create_publisher("std_msgs/msg/Strin", "s")
    with pytest.raises(TypeError, match="generated message class"):
        node.create_publisher(int, "s")  # type: ignore[type-var]
    with pytest.raises(InvalidNameError, match="digit"):
        node.create_publisher(String, "1chatter")
    publisher = node.create_publisher(String, "s")
    with pytest.raises(TypeError, match="std_msgs/msg/String"):
        publisher.publish(Int32(data=1))  # type: ignore[arg-type]
    for bad in (b"", b"\0\1\0\0", b"\0\0\0\0\0\0\0\7", b"\0\7\0\0\0\0\0\0"):
        with pytest.raises(EncodeError, match="header 00 01"):
            publisher.publish_raw(bad)


@pytest.mark.every_transport
async def test_undecodable_samples_are_dropped_counted_and_logged_once(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    publisher, subscription = await world.connected(String, "s")
    with caplog.at_level(logging.WARNING):
        for _ in range(5):
            publisher.publish_raw(bytes.fromhex("00010000 ffffff00 61000000"))
        publisher.publish(String(data="good"))
        assert await subscription.receive(timeout_s=20) == String(data="good")
    assert subscription.undecodable == 5
    assert caplog.text.count("dropped a sample on /s") == 1


@pytest.mark.every_transport
async def test_type_named_by_text_publishes_and_receives_dicts(world: World) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription("geometry_msgs/msg/PoseStamped", "pose")
    typed = bob.create_subscription(PoseStamped, "pose")
    publisher = alice.create_publisher("geometry_msgs/msg/PoseStamped", "pose")
    assert await publisher.wait_for_subscribers(timeout_s=20, count=2)
    publisher.publish({"header": {"frame_id": "map"}, "pose": {"position": {"x": 1.5}}})
    message = await subscription.receive(timeout_s=20)
    assert message["header"]["frame_id"] == "map"
    assert message["pose"]["position"] == {"x": 1.5, "y": 0.0, "z": 0.0}
    assert (await typed.receive(timeout_s=20)).pose.position.x == 1.5


@pytest.mark.every_transport
async def test_large_messages_arrive_intact_and_their_memory_is_not_reused(world: World) -> None:
    qos = QoSProfile(depth=3)
    if world.kind == "zenoh":  # a busy machine drops samples that do not block (docs/internals/zenoh.md 5)
        qos = QoSProfile(history=History.KEEP_ALL)
    publisher, subscription = await world.connected(Image, "image", qos)
    pixels = np.random.default_rng(1).integers(0, 256, 6_220_800, dtype=np.uint8)
    publisher.publish(Image(height=1080, width=1920, step=5760, encoding="rgb8", data=pixels))
    first = await subscription.receive(timeout_s=20)
    for _ in range(3):  # the memory of the first must not be reused
        publisher.publish(Image(data=np.zeros(6_220_800, dtype=np.uint8)))
        await subscription.receive(timeout_s=20)
    assert np.array_equal(first.data, pixels)


@pytest.mark.every_transport
@pytest.mark.parametrize("how", ["iterate", "receive"])
async def test_closing_subscription_in_another_thread_wakes_pending_receive(world: World, how: str) -> None:
    subscription = world.node("bob").create_subscription(String, "s")

    async def iterate() -> int:
        return len([message async for message in subscription])

    waiting: asyncio.Future[object] = asyncio.ensure_future(iterate() if how == "iterate" else subscription.receive())
    closing = while_the_loop_sleeps(subscription.close)
    start = time.monotonic()
    await asyncio.wait({waiting}, timeout=20)  # nothing else wakes the loop
    closing.join()
    assert time.monotonic() - start < 10
    if how == "iterate":
        assert waiting.result() == 0
    else:
        with pytest.raises(ClosedError, match="/s"):
            waiting.result()


@pytest.mark.every_transport
@pytest.mark.parametrize("closed", ["publisher", "node"])
async def test_blocked_publish_raises_closed_error_when_its_publisher_closes(
    world: World, monkeypatch: pytest.MonkeyPatch, closed: str
) -> None:
    node = world.node("alice")
    publisher = node.create_publisher(String, "s", QoSProfile().keep_all())
    await node.create_timer(0.001).tick()  # the loop is attached
    tries = threading.Semaphore(0)

    def full(_: bytes) -> bool:
        tries.release()
        return False

    monkeypatch.setattr(publisher, "_write", full)
    waiting = asyncio.ensure_future(asyncio.to_thread(publisher.publish, String()))
    for _ in range(3):
        assert await asyncio.to_thread(tries.acquire, timeout=20)
    assert not waiting.done()
    (publisher if closed == "publisher" else node).close()
    with pytest.raises(ClosedError, match="publisher on /s"):
        await waiting


@pytest.mark.every_transport
async def test_closed_publisher_subscription_and_node_raise_closed_error(world: World) -> None:
    alice, _ = world.pair()
    publisher = alice.create_publisher(String, "s", QoSProfile().manual_liveliness(lease_s=60))
    publisher.assert_liveliness()
    waiting = asyncio.ensure_future(publisher.wait_for_subscribers())
    await asyncio.sleep(0)  # it has begun to wait
    publisher.close()
    publisher.close()
    with pytest.raises(ClosedError, match="publisher on /s"):
        await asyncio.wait_for(waiting, 10)
    for call in (lambda: publisher.publish(String()), publisher.assert_liveliness):
        with pytest.raises(ClosedError, match="publisher on /s"):
            call()
    assert publisher.subscription_count == 0
    subscription, later = alice.create_subscription(String, "s"), alice.create_subscription(String, "s")
    subscription.close()
    with pytest.raises(ClosedError, match="subscription on /s"):
        subscription.latest()
    assert subscription.publisher_count == 0
    alice.close()
    with pytest.raises(ClosedError, match="/s"):
        later.latest()
    with pytest.raises(ClosedError, match="node"):
        alice.create_publisher(String, "s")


@pytest.mark.every_transport
async def test_ignore_local_receives_only_messages_of_other_nodes(world: World) -> None:
    alice, bob = world.pair()
    subscription = alice.create_subscription(String, "s", ignore_local=True)
    own, other = alice.create_publisher(String, "s"), bob.create_publisher(String, "s")
    assert await other.wait_for_subscribers(timeout_s=20)
    own.publish(String(data="own"))
    other.publish(String(data="other"))
    assert await subscription.receive(timeout_s=20) == String(data="other")
