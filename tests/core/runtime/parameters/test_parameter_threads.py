"""Parameters that are set from threads."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import dataclass

import pytest
from support.waiting import take, until
from support.worlds import World

from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterEvent as EventMessage
from rosidl_py_gen.runtime.loop.queues import AsyncQueue
from rosidl_py_gen.runtime.parameters.dataclass_parameters import snapshot, update_parameters

pytestmark = pytest.mark.on_zenoh


@dataclass
class Pair:
    a: int = 0
    b: int = 0


async def test_parameter_changes_stream_is_woken_by_sets_and_close_in_threads(world: World) -> None:
    node = world.node("n")
    pair = node.declare_parameters(Pair)
    changes = node.parameter_changes()
    reader = asyncio.ensure_future(take(changes))
    await asyncio.sleep(0.05)  # the loop is idle; only the thread can wake it
    worker = threading.Thread(target=lambda: update_parameters(pair, a=1, b=2))
    worker.start()
    assert await asyncio.wait_for(reader, 10) == ("a", 1)
    assert await take(changes) == ("b", 2)
    worker.join()
    await asyncio.to_thread(node.set_parameter, "a", 5)
    assert await take(changes) == ("a", 5)
    waiting = asyncio.ensure_future(anext_or_end(changes))
    await asyncio.sleep(0.02)
    await asyncio.to_thread(changes.close)
    assert await asyncio.wait_for(waiting, 10) == "end"


async def anext_or_end(stream: AsyncQueue[object]) -> object:
    try:
        return await stream.__anext__()
    except StopAsyncIteration:
        return "end"


async def test_parameter_changes_of_several_threads_keep_set_order(world: World) -> None:
    node = world.node("n")
    node.declare_parameter("a", -1)
    changes = node.parameter_changes()
    seen: list[object] = []

    async def listen() -> None:
        async for change in changes:
            seen.append(change.value)

    listener = asyncio.ensure_future(listen())
    stored: list[object] = []
    node.add_pre_set_callback(lambda ps: stored.append(ps[0].value.value) or ps)  # type: ignore[func-returns-value]

    def work(first: int) -> None:
        for number in range(first, first + 100):
            node.set_parameter("a", number)

    workers = [asyncio.to_thread(work, first) for first in (0, 1000, 2000)]
    for number in range(3000, 3100):
        node.set_parameter("a", number)
        await asyncio.sleep(0)
    await asyncio.gather(*workers)
    await until(lambda: len(seen) == 400)
    assert seen == stored
    changes.close()
    await listener


@pytest.mark.every_transport
async def test_parameter_events_and_services_work_while_a_thread_sets(world: World) -> None:
    node = world.node("n")
    pair = node.declare_parameters(Pair)
    other = world.node("other")
    events: list[EventMessage] = []
    subscription = other.create_subscription(EventMessage, "/parameter_events", None, 1000)
    await subscription.wait_for_publishers(5, count=2)
    await until(lambda: node.count_subscribers("/parameter_events") == 1)
    remote = other.create_parameter_client("/n")
    assert await remote.wait_for_services(20)
    listener = asyncio.ensure_future(collect(subscription, events))

    def work() -> None:
        for number in range(1, 301):
            update_parameters(pair, a=number, b=number)

    worker = asyncio.ensure_future(asyncio.to_thread(work))
    requests = 0
    while not worker.done() or requests < 5:
        a, b = await remote.get(["a", "b"], 5)
        seen = snapshot(pair)
        assert a == b and seen.a == seen.b
        requests += 1
    await worker

    def ours() -> list[EventMessage]:
        return [event for event in events if event.node == "/n" and len(event.changed_parameters) == 2]

    await until(lambda: len(ours()) >= 300)
    assert [event.changed_parameters[0].value.integer_value for event in ours()] == list(range(1, 301))
    listener.cancel()


async def collect(subscription: object, into: list[EventMessage]) -> None:
    async for message in subscription:  # type: ignore[attr-defined]
        into.append(message)


@pytest.mark.every_transport
async def test_remote_sets_and_sets_of_a_thread_do_not_block_each_other(world: World) -> None:
    node = world.node("n")
    pair = node.declare_parameters(Pair)
    remote = world.node("other").create_parameter_client("/n")
    loop = asyncio.get_running_loop()
    waited: list[int] = []

    def wait_for_the_loop(parameters: object) -> None:
        if threading.current_thread() is not threading.main_thread():
            waited.append(asyncio.run_coroutine_threadsafe(asyncio.sleep(0, 1), loop).result(20))

    node.add_post_set_callback(wait_for_the_loop)
    worker = asyncio.ensure_future(asyncio.to_thread(lambda: [update_parameters(pair, a=n) for n in range(50)]))
    for number in range(50):
        assert (await remote.set({"b": number}, 20))[0].successful
    await asyncio.wait_for(worker, 10)
    assert (pair.a, pair.b, len(waited)) == (49, 49, 50)


async def test_use_sim_time_can_be_set_by_a_thread(world: World) -> None:
    node, simulator = world.node("n"), world.node("simulator")
    clock = simulator.create_sim_time_publisher()
    await asyncio.to_thread(node.set_parameter, "use_sim_time", True)
    await clock.wait_for_subscribers(5)
    clock.advance(7.0)
    await until(lambda: node.clock.now_ns() == 7_000_000_000)


def test_async_queue_works_without_a_loop_and_across_loops() -> None:
    stream: AsyncQueue[int] = AsyncQueue(2)
    for number in range(3):
        stream._push(number)
    assert stream.dropped == 1

    async def first() -> int:
        return await stream.__anext__()

    assert asyncio.run(first()) == 1 and asyncio.run(first()) == 2
    loop = asyncio.new_event_loop()
    left = loop.create_task(first())
    loop.run_until_complete(asyncio.sleep(0))
    stream._push(3)  # the reader's loop does not run at the moment
    assert loop.run_until_complete(left) == 3
    left = loop.create_task(first())
    loop.run_until_complete(asyncio.sleep(0))
    left.cancel()
    loop.run_until_complete(asyncio.gather(left, return_exceptions=True))
    loop.close()
    stream._push(4)
    assert asyncio.run(first()) == 4
