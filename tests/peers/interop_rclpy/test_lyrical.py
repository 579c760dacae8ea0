"""Images of Lyrical on Fast DDS, whose publishers send them to one of two topics (docs/internals/dds.md 14)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from peer_helpers import fresh, random_bytes
from support.environments import built_peers
from support.waiting import until

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy_peer import Peer

    from rosidl_py_gen.runtime import Subscription

pytestmark = [
    pytest.mark.parametrize("peer_name", ["lyrical"], indirect=True, scope="session"),
    pytest.mark.skipif("lyrical" not in built_peers(), reason="needs lyrical/bin/python in the folder $ROSIDL_PEERS"),
]
NAME = "sensor_msgs/msg/Image"
Image: Any = get_message(NAME)
SIZE = 10_000
ALL = QoSProfile().keep_all()
DEPTH = {"depth": 1000}


class Camera:
    """Publisher of numbered images, and of nothing else, in a process of Lyrical."""

    def __init__(self, peer: Peer) -> None:
        self.topic = fresh("image")
        self._peer = peer
        self._count = 0

    async def start(self) -> None:
        await self._peer.do("publisher", topic=self.topic, type=NAME, qos=DEPTH)

    async def wait_for_subscriptions(self, count: int) -> None:
        await self._peer.do("matched_exactly", topic=self.topic, count=count)

    async def publish(self, count: int = 40) -> list[int]:
        """Publish images and return their numbers."""
        numbers = list(range(self._count, self._count + count))
        self._count += count
        data = {"random_bytes": SIZE, "seed": 1}
        await self._peer.do("publish", topic=self.topic, messages_=[{"height": one, "data": data} for one in numbers])
        return numbers


async def received(subscription: Subscription[Any], count: int) -> list[int]:
    """Return the numbers of the next images."""
    images = [await subscription.receive(timeout_s=10) for _ in range(count)]
    assert {image.data.tobytes() for image in images} == {random_bytes(SIZE, 1)}
    return [image.height for image in images]


@pytest.mark.parametrize("end", ["closed", "process ends", "process is killed"])
async def test_images_arrive_once_before_during_and_after_a_subscription_of_lyrical(
    world: Any, shared_peer: Peer, start_peer: Callable[..., Peer], start_mortal: Callable[[str], Peer], end: str
) -> None:
    """After its subscription has gone, a publisher of Lyrical sends images to the second topic only."""
    camera = Camera(shared_peer)
    await camera.start()
    subscription = world.node("viewer").create_subscription(Image, camera.topic, qos=ALL)
    await camera.wait_for_subscriptions(1)
    assert await subscription.wait_for_publishers(timeout_s=10)
    numbers = await camera.publish()
    assert await received(subscription, len(numbers)) == numbers
    for _ in range(2):
        name = fresh("other_viewer").strip("/")
        other = start_mortal(name) if end == "process is killed" else start_peer(name, wide=True)
        await other.do("subscribe", topic=camera.topic, type=NAME, qos=DEPTH)
        await camera.wait_for_subscriptions(2)
        await other.do("matched", topic=camera.topic)
        numbers = await camera.publish()
        assert await received(subscription, len(numbers)) == numbers
        theirs = await other.do("take", topic=camera.topic, count=len(numbers))
        assert [image["height"] for image in theirs] == numbers
        if end == "closed":
            await other.do("unsubscribe", topic=camera.topic)
        elif end == "process ends":
            other.close()
        else:
            other.kill()
        await camera.wait_for_subscriptions(1)
        numbers = await camera.publish()
        assert await received(subscription, len(numbers)) == numbers
    assert subscription.take() is None


async def test_late_subscription_receives_images_after_a_subscription_of_lyrical_has_closed(
    world: Any, shared_peer: Peer, start_peer: Callable[..., Peer]
) -> None:
    camera = Camera(shared_peer)
    await camera.start()
    other = start_peer(fresh("other_viewer").strip("/"), wide=True)
    await other.do("subscribe", topic=camera.topic, type=NAME, qos=DEPTH)
    await camera.wait_for_subscriptions(1)
    await other.do("unsubscribe", topic=camera.topic)
    await camera.wait_for_subscriptions(0)
    node = world.node("viewer")
    await until(lambda: f"{camera.topic}/_buf_cpu" in dict(node.get_topic_names_and_types()))
    subscription = node.create_subscription(Image, camera.topic, qos=ALL)
    await camera.wait_for_subscriptions(1)
    numbers = await camera.publish()
    assert await received(subscription, len(numbers)) == numbers
    assert subscription.take() is None
