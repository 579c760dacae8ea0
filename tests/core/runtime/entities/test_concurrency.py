"""Concurrency of async callbacks, and warnings about dropped messages."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int64
from support.waiting import until
from support.worlds import World

if TYPE_CHECKING:
    from collections.abc import Callable


class Slow:
    """Async callbacks that finish when the test allows it."""

    def __init__(self) -> None:
        self.may_continue = asyncio.Event()
        self.started: list[int] = []
        self.max_running = self.running = 0

    async def callback(self, message: Int64) -> None:
        self.started.append(message.data)
        self.running += 1
        self.max_running = max(self.max_running, self.running)
        await self.may_continue.wait()
        await asyncio.sleep(0)
        self.running -= 1


def forms(slow: Slow) -> dict[str, Callable[[Int64], Any]]:
    return {"async": slow.callback, "lambda": lambda message: slow.callback(message)}


@pytest.mark.parametrize("form", ["async", "lambda"])
@pytest.mark.parametrize("concurrency", [1, 3])
async def test_concurrency_limits_parallel_callbacks_and_order_is_preserved(
    world: World, form: str, concurrency: int
) -> None:
    slow = Slow()
    node = world.node()
    publisher = node.create_publisher(Int64, "t", 20)
    subscription = node.create_subscription(Int64, "t", forms(slow)[form], 20, concurrency=concurrency)
    await publisher.wait_for_subscribers(5)
    for number in range(8):
        publisher.publish(Int64(data=number))
    await until(lambda: len(slow.started) == concurrency)
    slow.may_continue.set()
    await until(lambda: len(slow.started) == 8 and slow.running == 0)
    assert slow.started == list(range(8)) and slow.max_running == concurrency and subscription.dropped == 0


@pytest.mark.parametrize("form", ["async", "lambda"])
async def test_dropped_messages_are_counted_and_warned_about_once(
    world: World, caplog: pytest.LogCaptureFixture, form: str
) -> None:
    slow = Slow()
    node = world.node()
    publisher = node.create_publisher(Int64, "t", 100)
    subscription = node.create_subscription(Int64, "t", forms(slow)[form], 2)
    await publisher.wait_for_subscribers(5)
    publisher.publish(Int64(data=0))
    await until(lambda: slow.started == [0])
    for number in range(1, 9):
        publisher.publish(Int64(data=number))
        await publisher.wait_for_acknowledged(5)
        await asyncio.sleep(0.001)
    await until(lambda: subscription.dropped == 6)
    slow.may_continue.set()
    await until(lambda: slow.started == [0, 7, 8])
    [warning] = [record.getMessage() for record in caplog.records if "dropped" in record.getMessage()]
    assert "/t" in warning and "concurrency=1" in warning and "2 are waiting" in warning


async def test_drops_with_queue_depth_one_are_not_warned_about(world: World, caplog: pytest.LogCaptureFixture) -> None:
    slow, quick = Slow(), list[Int64]()
    node = world.node()
    publisher = node.create_publisher(Int64, "t", 100)
    one = node.create_subscription(Int64, "t", slow.callback, 1)
    node.create_subscription(Int64, "t", quick.append, 5)
    await publisher.wait_for_subscribers(5, count=2)
    for number in range(5):
        publisher.publish(Int64(data=number))
        await until(lambda: len(quick) == number + 1)  # noqa: B023
    await until(lambda: one.dropped > 0)
    assert "dropped" not in caplog.text


@pytest.mark.parametrize(("value", "error"), [(0, ValueError), (-1, ValueError), (2.0, TypeError), (True, TypeError)])
async def test_invalid_concurrency_is_refused(memory: World, value: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="concurrency must be"):
        memory.node().create_subscription(Int64, "t", print, concurrency=value)


@pytest.mark.every_transport
async def test_latest_returns_newest_message_regardless_of_how_it_was_received(world: World) -> None:
    node = world.node()
    publisher, subscription = node.create_publisher(Int64, "t"), node.create_subscription(Int64, "t")
    await publisher.wait_for_subscribers(20)
    assert subscription.latest() is None
    publisher.publish(Int64(data=1))
    taken = await subscription.receive(20)
    assert subscription.latest() is taken and subscription.latest() is taken
    publisher.publish(Int64(data=2))
    assert (await subscription.receive_with_info(20))[0] is subscription.latest()
    publisher.publish(Int64(data=3))
    async for message in subscription:
        assert subscription.latest() is message and message.data == 3
        break
    for number in (4, 5):
        publisher.publish(Int64(data=number))
    assert (await subscription.receive(20)).data == 4
    await until(lambda: getattr(subscription.latest(), "data", 0) == 5)
    publisher.publish(Int64(data=6))
    assert (await subscription.receive(20)).data == 6
    assert getattr(subscription.latest(), "data", 0) == 6
