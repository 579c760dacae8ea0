"""Chains of filters: order of callbacks, waiting, errors, closing."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest
from std_msgs.msg import String
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.message_filters import (
    ApproximateTimeSynchronizer,
    Cache,
    MessageFilter,
    StampError,
    Subscriber,
    TimeSynchronizer,
)
from rosidl_py_gen.runtime import (
    CallbackInUseError,
    CallbackSignatureError,
    ClockType,
    ClosedError,
    Time,
    WaitTimeoutError,
)

PointStamped: Any = get_message("geometry_msgs/msg/PointStamped")
S = 10**9


def stamped(stamp_s: float, x: float = 0) -> Any:
    message = PointStamped()
    set_stamp(message.header.stamp, round(stamp_s * S))
    message.point.x = float(x)
    return message


def ros_time(seconds: int) -> Time:
    return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)


async def test_timeout_error_states_which_topic_has_no_publisher(memory: World) -> None:
    camera, viewer = memory.pair()
    camera.create_publisher(PointStamped, "left"), camera.create_publisher(PointStamped, "front/right")
    pairs = TimeSynchronizer([Subscriber(viewer, PointStamped, topic) for topic in ("left", "right")])
    with pytest.raises(WaitTimeoutError) as raised:
        await pairs.receive(0.1)
    assert raised.value.reason == '/right: no node publishes it; did you mean "/front/right"?'


@pytest.mark.every_transport
async def test_synchronizer_passes_messages_of_equal_stamps_in_pairs(world: World) -> None:
    camera, viewer = world.pair()
    left, right = Subscriber(viewer, PointStamped, "left"), Subscriber(viewer, PointStamped, "right")
    pairs = TimeSynchronizer([left, right])
    one, two = camera.create_publisher(PointStamped, "left"), camera.create_publisher(PointStamped, "right")
    await one.wait_for_subscribers(20)
    await two.wait_for_subscribers(20)
    for second in (1, 2, 3):
        one.publish(stamped(second, second))
    for second in (3, 2):
        two.publish(stamped(second, -second))
    got = {(a.point.x, b.point.x) for a, b in [await pairs.receive(20), await pairs.receive(20)]}
    assert got == {(3, -3), (2, -2)}
    with pytest.raises(WaitTimeoutError, match=r"<TimeSynchronizer> passed nothing for 0.01 s"):
        await pairs.receive(0.01)


async def test_async_callback_handles_one_set_at_a_time_and_its_failure_is_logged(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("viewer")
    topics = ["a", "b"]
    seen: list[float] = []
    running_callbacks = [0]

    async def show(a: Any, b: Any) -> None:
        running_callbacks[0] += 1
        assert running_callbacks[0] == 1
        await asyncio.sleep(0.1)
        running_callbacks[0] -= 1
        seen.append(a.point.x)
        if a.point.x == 1:
            raise RuntimeError("no")

    ApproximateTimeSynchronizer([Subscriber(node, PointStamped, one) for one in topics], show, slop_s=0.1)
    publishers = [node.create_publisher(PointStamped, one) for one in topics]
    with caplog.at_level(logging.ERROR):
        for second in range(4):
            for number, publisher in enumerate(publishers if second % 2 else reversed(publishers)):
                publisher.publish(stamped(second + number / 20, second))
        await until(lambda: len(seen) == 4)
    assert seen == [0, 1, 2, 3]
    assert "RuntimeError: no" in caplog.text


async def test_slow_async_callback_drops_and_counts_the_oldest_sets(memory: World) -> None:
    source, seen = MessageFilter(queue_size=2), []
    gate = asyncio.Event()

    async def slow(message: Any) -> None:
        await gate.wait()
        seen.append(message.point.x)

    source.register_callback(slow)
    tasks = [
        asyncio.ensure_future(answer) for x in range(6) if (answer := source.signal_message(stamped(1, x))) is not None
    ]
    assert len(tasks) == 3  # at most as many as sets that can be passed
    await asyncio.sleep(0)
    gate.set()
    await asyncio.gather(*tasks)
    assert seen == [4, 5] and source.dropped == 4


def test_plain_callbacks_run_immediately_and_in_order_even_if_one_fails() -> None:
    source, calls = MessageFilter(), []

    def wrong(message: Any) -> None:
        raise RuntimeError("no")

    source.register_callback(lambda message: calls.append(("first", message)))
    source.register_callback(wrong)
    last = source.register_callback(lambda message: calls.append(("last", message)))
    with pytest.raises(RuntimeError, match="no"):
        source.signal_message("x")
    assert calls == [("first", "x"), ("last", "x")]
    last.close()
    with pytest.raises(RuntimeError, match="no"):
        source.signal_message("y")
    assert calls[2:] == [("first", "y")]


async def test_failure_of_a_plain_callback_is_raised_after_async_callbacks_ran() -> None:
    source, calls = MessageFilter(), []

    async def right(message: Any) -> None:
        calls.append(message)

    def wrong(message: Any) -> None:
        raise RuntimeError("no")

    source.register_callback(wrong)
    source.register_callback(right)
    answer = source.signal_message("x")
    assert answer is not None
    with pytest.raises(RuntimeError, match="no"):
        await answer
    assert calls == ["x"]


async def test_sets_without_receiver_are_queued_up_to_the_queue_size(memory: World) -> None:
    node = memory.node()
    subscriber = Subscriber(node, PointStamped, "points")
    cache = Cache(subscriber, 3)
    pairs = TimeSynchronizer([cache], queue_size=2)
    publisher = node.create_publisher(PointStamped, "points")
    for second in range(5):
        publisher.publish(stamped(second, second))
    await until(lambda: len(cache) == 3)
    assert [(await pairs.receive()).point.x for _ in range(2)] == [3, 4]
    assert pairs.dropped == 3


async def test_iteration_ends_when_the_node_or_the_filter_closes(memory: World) -> None:
    node, other = memory.pair()
    inputs = [Subscriber(node, PointStamped, "a"), Subscriber(other, PointStamped, "b")]
    by_node, by_hand = (ApproximateTimeSynchronizer(inputs, slop_s=1) for _ in range(2))

    async def count(pairs: Any) -> int:
        return sum([1 async for _ in pairs])

    counting = [asyncio.ensure_future(count(pairs)) for pairs in (by_node, by_hand)]
    for topic in "ab":
        other.create_publisher(PointStamped, topic).publish(stamped(1))
    await asyncio.sleep(0.1)
    by_hand.close()
    assert await counting[1] == 1 and not counting[0].done()
    other.close()
    assert await counting[0] == 1
    for pairs in (by_node, by_hand):
        with pytest.raises(ClosedError, match="<ApproximateTimeSynchronizer closed> is closed"):
            await pairs.receive()
        assert pairs.signal_message(1, 2) is None
        pairs.close()


async def test_backward_time_jump_clears_cache_and_synchronizer(memory: World) -> None:
    clock, node = memory.node("clock"), memory.node("viewer", args="--ros-args -p use_sim_time:=true")
    time = clock.create_sim_time_publisher()
    left, right = (Subscriber(node, PointStamped, one) for one in ("left", "right"))
    pairs, cache = TimeSynchronizer([left, right], queue_size=2), Cache(left, 5)
    one, two = (clock.create_publisher(PointStamped, topic) for topic in ("left", "right"))
    time.set_time(ros_time(100))
    await until(lambda: node.clock.now().nanoseconds == 100 * S)
    for second in (98, 99):
        one.publish(stamped(second))
    await until(lambda: len(cache) == 2)
    time.set_time(ros_time(1))
    await until(lambda: node.clock.now().nanoseconds == 1 * S)
    assert len(cache) == 0
    one.publish(stamped(1))
    two.publish(stamped(1))
    assert len(await pairs.receive(5)) == 2


async def test_messages_without_a_stamp_are_refused_or_use_the_current_time(memory: World) -> None:
    node = memory.node()
    bare, raw = Subscriber(node, String, "text"), Subscriber(node, PointStamped, "raw", raw=True)
    points = Subscriber(node, "geometry_msgs/msg/PointStamped", "points")
    for make in (lambda: TimeSynchronizer([points, bare]), lambda: Cache(bare)):
        with pytest.raises(StampError, match=r"/text: std_msgs/msg/String has no header.stamp"):
            make()
    with pytest.raises(StampError, match="/raw: bytes has no"):
        TimeSynchronizer([raw])
    with pytest.raises(StampError, match=r"pass clock=\.\.\."):
        Cache(MessageFilter(), allow_headerless=True)
    by_hand = MessageFilter()
    TimeSynchronizer([by_hand])
    with pytest.raises(StampError, match=r"input 0 of <TimeSynchronizer> got a message without header.stamp: String"):
        by_hand.signal_message(String())
    pairs = ApproximateTimeSynchronizer([points, bare], slop_s=0.5, allow_headerless=True)
    cache = Cache(bare, 3, allow_headerless=True)
    now = node.clock.now().nanoseconds
    node.create_publisher(PointStamped, "points").publish(stamped(now / S, 7))
    node.create_publisher(String, "text").publish(String(data="seven"))
    point, text = await pairs.receive(5)
    assert point["point"]["x"] == 7 and text.data == "seven"
    assert cache.latest().data == "seven" and abs(cache.latest_stamp - now) < S


def test_cache_returns_messages_within_and_around_an_interval() -> None:
    source = MessageFilter()
    cache = Cache(source, 10)
    assert cache.latest() is cache.oldest_stamp is cache.at_or_before(1) is cache.at_or_after(1) is None
    assert cache.surrounding(0, 1) == []
    for second in (1, 2, 3, 4, 5):
        source.signal_message(stamped(second, second))

    def xs(messages: list[Any]) -> list[float]:
        return [one.point.x for one in messages]

    assert xs(cache.surrounding(int(2.5 * S), int(3.5 * S))) == [2, 3, 4]
    assert xs(cache.surrounding(2 * S, 4 * S)) == [2, 3, 4]
    assert xs(cache.surrounding(0, 9 * S)) == [1, 2, 3, 4, 5]
    assert xs(cache.interval(stamped(2).header.stamp, int(3.5 * S))) == [2, 3]
    for query in (cache.interval, cache.surrounding):
        with pytest.raises(ValueError, match="is before the start"):
            query(2, 1)
    with pytest.raises(TypeError, match="expected a Time, a Time message or nanoseconds, got 'now'"):
        cache.at_or_after("now")


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: TimeSynchronizer([]), ValueError, "at least one filter"),
        (lambda: TimeSynchronizer(["/topic"]), TypeError, "each input must be a filter"),
        (lambda: TimeSynchronizer(MessageFilter(), queue_size=0), ValueError, "queue_size must be 1 or more, got 0"),
        (lambda: TimeSynchronizer([MessageFilter()], queue_size=1.5), TypeError, "queue_size must be an int"),
        (lambda: TimeSynchronizer([MessageFilter()] * 2, lambda a: a), CallbackSignatureError, "2"),
        (lambda: TimeSynchronizer([MessageFilter()], "f"), TypeError, "must be a function, got 'f'"),
        (lambda: ApproximateTimeSynchronizer([MessageFilter()], slop_s=-1), ValueError, "slop_s must be 0 or more"),
        (lambda: ApproximateTimeSynchronizer([MessageFilter()], slop_s="1"), TypeError, "a number of seconds"),
        (lambda: ApproximateTimeSynchronizer([MessageFilter()], slop_s=float("nan")), ValueError, "got nan"),
        (lambda: Cache("/topic"), TypeError, "source must be a filter"),
        (lambda: Cache(MessageFilter(), 0), ValueError, "cache_size must be 1 or more"),
    ],
)
def test_invalid_arguments_are_refused(make: Any, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        make()


async def test_receive_after_a_closed_callback_skips_earlier_messages(memory: World) -> None:
    source = MessageFilter()
    source.signal_message(stamped(1))
    source.register_callback(lambda message: None).close()
    source.signal_message(stamped(2))
    assert (await source.receive(1)).header.stamp.sec == 2


async def test_filter_with_a_callback_refuses_receive_and_iteration(memory: World) -> None:
    source = MessageFilter(lambda message: None)
    with pytest.raises(CallbackInUseError, match="<MessageFilter> has a callback"):
        await source.receive()
    with pytest.raises(CallbackInUseError):
        aiter(source)
