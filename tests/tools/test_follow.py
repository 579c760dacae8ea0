"""A subscription that follows its publishers is one subscription for who receives, however often it is made again."""

from __future__ import annotations

import asyncio

import pytest
from std_msgs.msg import String
from worlds import World, until

from rosidl_py_gen import decode
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import Durability, Reliability
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools.follow import Follow


async def test_it_asks_for_less_when_one_appears_that_offers_less(world: World) -> None:
    near, far = world.pair()
    notes: list[str] = []
    first = far.create_publisher(String, "t", presets.DEFAULT.transient_local())
    await until(lambda: near.count_publishers("t") == 1)
    async with Follow(near, "t", String, note=notes.append) as follow:
        assert follow.qos.durability is Durability.TRANSIENT_LOCAL and follow.qos.reliability is Reliability.RELIABLE
        waiting = asyncio.ensure_future(follow.receive_with_info(20))
        await asyncio.sleep(0)  # it has begun
        second = far.create_publisher(String, "t", presets.SENSOR_DATA)
        await second.wait_for_subscribers(20)  # which the first subscription never was to it
        assert follow.qos.durability is Durability.VOLATILE and follow.qos.reliability is Reliability.BEST_EFFORT
        assert [note.split(":")[0] for note in notes] == [
            "some, but not all, publishers are reliable",
            "some, but not all, publishers are transient local",
        ]
        await first.wait_for_subscribers(20)
        second.publish(String(data="new"))
        message, _ = await waiting  # it did not end with the subscription that it began with
        assert decode(String, message) == String(data="new")
    with pytest.raises(ClosedError):
        await follow.receive_with_info(1)


async def test_what_was_dropped_stays_counted(world: World) -> None:
    near, far = world.pair()
    publisher = far.create_publisher(String, "t")
    follow = Follow(near, "t", String, depth=1)
    await publisher.wait_for_subscribers(20)
    for text in "abc":
        publisher.publish(String(data=text))
    await until(lambda: follow.dropped == 2)
    follow.renew()
    assert follow.dropped == 2
    await publisher.wait_for_subscribers(20)
    for text in "de":
        publisher.publish(String(data=text))
    await until(lambda: follow.dropped == 3)
    follow.close()
