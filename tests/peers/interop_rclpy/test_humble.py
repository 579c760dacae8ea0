"""Humble: its definitions, and the format of its graph messages (docs/internals/protocol.md 6.5)."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from peer_helpers import digest, fresh, random_bytes

from rosidl_py_gen import get_message, type_name
from rosidl_py_gen.runtime import WaitTimeoutError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy_peer import Peer

pytestmark = pytest.mark.only_with("humble")
SIX_MEGABYTES = 6 << 20
LITTLE_MB, MUCH_MB = 200, 700
RANGE = "sensor_msgs/msg/Range"
DISTROS = [None, "jazzy", "humble"]


@pytest.fixture(params=DISTROS, ids=["unset", "jazzy", "humble"])
def selected(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str | None:
    """Set `ROS_DISTRO` of our nodes."""
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    if request.param:
        monkeypatch.setenv("ROS_DISTRO", request.param)
    return request.param


async def matched(node: Any, peer: Peer, cls: Any, topic: str) -> tuple[Any, Any]:
    """Return our publisher on `<topic>_to_them` and subscription on `<topic>_to_us`."""
    publisher = node.create_publisher(cls, f"{topic}_to_them")
    subscription = node.create_subscription(cls, f"{topic}_to_us")
    await peer.do("subscribe", topic=f"{topic}_to_them", type=type_name(cls))
    await peer.do("publisher", topic=f"{topic}_to_us", type=type_name(cls))
    assert await publisher.wait_for_subscribers(10) and await subscription.wait_for_publishers(10)
    await peer.do("matched", topic=f"{topic}_to_them")
    await peer.do("matched", topic=f"{topic}_to_us")
    return publisher, subscription


@pytest.mark.parametrize("ours", ["humble", "jazzy"])
async def test_range_messages_are_exchanged_with_humble(
    world: Any, shared_peer: Peer, selected: str | None, ours: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Humble ignores the variance of our Range; its Range is dropped unless the subscription has its definition."""
    cls = get_message(RANGE, distro=ours)
    publisher, subscription = await matched(world.node("ranger"), shared_peer, cls, fresh("range"))
    sent = cls(min_range=0.5, max_range=4.0, range=2.0)
    sent.header.frame_id = "sonar"
    extra = {"variance": 9.0} if ours == "jazzy" else {}
    for name, value in extra.items():
        setattr(sent, name, value)
    publisher.publish(sent)
    (taken,) = await shared_peer.do("take", topic=publisher.topic)
    assert (taken["header"]["frame_id"], taken["min_range"], taken["range"]) == ("sonar", 0.5, 2.0)
    assert "variance" not in taken
    await shared_peer.do("publish", topic=subscription.topic, messages_=[taken])
    if ours == "jazzy":
        with pytest.raises(WaitTimeoutError, match=r"announces no type hash, and .*; dropped 1 message"):
            await subscription.receive(2)
        assert (subscription.undecodable, subscription.incompatible_dropped) == (0, 1)
        assert 'set ROS_DISTRO=humble, or pass distro="humble" to get_message' in caplog.text
        return
    got = await subscription.receive(10)
    assert got == cls(header=sent.header, min_range=0.5, max_range=4.0, range=2.0)
    assert (subscription.undecodable, subscription.incompatible_dropped) == (0, 0)


async def test_six_megabyte_images_are_exchanged_with_humble(world: Any, shared_peer: Peer) -> None:
    cls, data = get_message("sensor_msgs/msg/Image"), random_bytes(SIX_MEGABYTES, 1)
    publisher, subscription = await matched(world.node("camera"), shared_peer, cls, fresh("image"))
    publisher.publish(cls(height=1024, width=2048, encoding="rgb8", step=6144, data=data))
    (taken,) = await shared_peer.do("take", topic=publisher.topic, within_s=60)
    assert (taken["width"], taken["data"]) == (2048, digest(data))
    order = {"width": 2048, "data": {"random_bytes": SIX_MEGABYTES, "seed": 1}}
    await shared_peer.do("publish", topic=subscription.topic, messages_=[order], within_s=60)
    got = await subscription.receive(60)
    assert (got.width, got.data.tobytes()) == (2048, data)


@pytest.mark.parametrize("namespace", ["/", "/ab"])
async def test_humble_lists_nodes_and_only_other_distributions_increase_its_memory(
    world: Any, start_peer: Callable[..., Peer], selected: str | None, namespace: str
) -> None:
    """With another distribution, two letters in the namespace of the first node are 6.4 million nodes for Humble.

    On Cyclone DDS it takes no memory.
    """
    peer = start_peer(fresh("modest").strip("/"), wide=True)
    node = world.node(fresh("ours").strip("/"), namespace)
    assert await node.wait_for_node(f"/{peer.name}", 10)
    if selected != "jazzy":
        await peer.do("until_node", name=node.fully_qualified_name)
        assert await peer.do("memory_mb") < LITTLE_MB
    elif peer.middleware == "Cyclone DDS":
        assert await peer.do("memory_mb") < LITTLE_MB
    elif namespace == "/ab":
        while await peer.do("memory_mb") < MUCH_MB:
            await asyncio.sleep(0.1)
    peer.close()
