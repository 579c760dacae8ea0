"""Stress: floods, stalls, many entities, killed processes. SOAK_MINUTES=60 makes the soak test last an hour."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import re
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int32, String, UInt8MultiArray
from support.inner_state import graph_of, participant_of, scope_of
from support.processes import python_process
from support.waiting import until, wait_until

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import Context, Node, QoSProfile, WaitTimeoutError
from rosidl_py_gen.runtime.node.context import core_of

if TYPE_CHECKING:
    from support.worlds import World

pytestmark = pytest.mark.on_zenoh


_ZENOH_THREAD_NAME = re.compile(r"(acc|app|net|rx|tx)-\d+\n")
"""Names of threads that Zenoh starts and stops at any time, including threads of the router of other tests."""


def resources() -> tuple[int, int]:
    """Return the numbers of threads (without Zenoh's) and file descriptors of this process."""
    threads = 0
    for thread in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):  # the thread has ended
            threads += _ZENOH_THREAD_NAME.fullmatch((thread / "comm").read_text()) is None
    return threads, len(os.listdir("/proc/self/fd"))


def are_resources_freed(before: tuple[int, int]) -> bool:
    """Return True if no more resources are used than before; the router of the tests may need some time."""
    return all(now <= then for now, then in zip(resources(), before, strict=True))


def rss_kb() -> int:
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * 4


async def test_stalled_reliable_reader_does_not_block_the_event_loop(dds: World, tmp_path: Path) -> None:
    # A process that subscribes reliably and is then stopped: it acknowledges nothing, but its lease has not run out.
    program = (
        "import asyncio\nfrom rosidl_py_gen.runtime import Node, QoSProfile\n"
        "async def main():\n    async with Node('stalled') as node:\n"
        "        s = node.create_subscription('std_msgs/msg/UInt8MultiArray', 'big', qos=QoSProfile().keep_all())\n"
        "        async for m in s: print(len(m['data']), flush=True)\n"
        "asyncio.run(main())\n"
    )
    with python_process(program) as reader:
        publisher = dds.node("talker").create_publisher(UInt8MultiArray, "big", QoSProfile().keep_all())
        assert await publisher.wait_for_subscribers(timeout_s=10)
        publisher.publish(UInt8MultiArray(data=bytes(1)))
        assert await publisher.wait_for_acknowledged(timeout_s=10)
        reader.send_signal(signal.SIGSTOP)
        publish_s, pause_s = list[float](), list[float]()
        last = time.monotonic()
        for _ in range(100):  # 20 MB, far more than DDS sends without acknowledgement
            start = time.monotonic()
            publisher.publish(UInt8MultiArray(data=bytes(200_000)))
            publish_s.append(time.monotonic() - start)
            await asyncio.sleep(0.005)  # the loop under test must continue here
            pause_s.append(time.monotonic() - last)
            last = time.monotonic()
        with pytest.raises(WaitTimeoutError, match=r"were not acknowledged by all 1 subscription in 0.1 s"):
            await publisher.wait_for_acknowledged(timeout_s=0.1)
        # A busy machine delays a few messages; a blocking reader would delay every message after the first.
        assert sorted(publish_s)[-20] < 0.1 and sorted(pause_s)[-20] < 0.2
        reader.send_signal(signal.SIGCONT)
        assert await publisher.wait_for_acknowledged(timeout_s=20)
        assert reader.stdout is not None
        sizes = [await asyncio.to_thread(reader.stdout.readline) for _ in range(101)]
        assert sizes == ["1\n"] + ["200000\n"] * 100


async def test_blocked_publish_in_a_thread_does_not_block_the_event_loop(dds: World) -> None:
    program = "import signal; from rosidl_py_gen.runtime import Node\nn=Node('r')\n"
    program += (
        "n.create_subscription('std_msgs/msg/UInt8MultiArray','big',qos=1)\nprint('up',flush=True); signal.pause()"
    )
    with python_process(program) as reader:
        publisher = dds.node("talker").create_publisher(UInt8MultiArray, "big", QoSProfile().keep_all())
        assert await publisher.wait_for_subscribers(timeout_s=10)
        reader.send_signal(signal.SIGSTOP)
        message = UInt8MultiArray(data=bytes(200_000))

        def flood() -> None:
            with contextlib.suppress(ClosedError):
                for _ in range(100):
                    publisher.publish(message)

        thread = threading.Thread(target=flood, daemon=True)
        thread.start()
        ticks = 0
        for _ in range(50):
            await asyncio.sleep(0.01)  # a tick, while the thread waits
            ticks += 1
        assert thread.is_alive()  # the thread waits while the loop ticks
        assert ticks == 50
        publisher.close()
        thread.join(10)
        assert not thread.is_alive()


@pytest.mark.every_transport
async def test_closing_a_hundred_nodes_and_a_thousand_topics_frees_all_resources(world: World) -> None:
    shares = 10 if world.kind == "zenoh" else 1  # Zenoh announces each endpoint to every peer, which is slow
    node_count, topic_count = 100 // shares, 1000 // shares
    with world.context() as warm_up:
        Node("warm", context=warm_up).close()
    gc.collect()
    before = resources()
    with world.context() as context:
        nodes = [Node(f"n{number}", context=context, enable_rosout=False) for number in range(node_count)]
        for number in range(topic_count):
            nodes[number % node_count].create_publisher(Int32, f"t{number}")
            nodes[number % (node_count // 2)].create_subscription(Int32, f"t{number}", lambda message: None)
        assert len(nodes[0].get_topic_names_and_types()) == topic_count + 1  # and /parameter_events
        assert len(nodes[0].get_node_names()) == node_count
        for node in nodes:
            node.close()
        await until(lambda: core_of(context).discovery.graph.topics() == [])
    await until(lambda: are_resources_freed(before))


@pytest.mark.every_transport
async def test_creating_and_closing_entities_repeatedly_leaks_no_resources(world: World) -> None:
    times = 100 if world.kind == "zenoh" else 300
    node = world.node("n")
    peer = world.node("peer")

    def once() -> None:
        publisher = node.create_publisher(Int32, "t")
        subscription = node.create_subscription(Int32, "t", lambda message: None)
        client = node.create_client(AddTwoInts, "s")
        server = node.create_service(AddTwoInts, "s", lambda request: AddTwoInts.Response())
        timer = node.create_timer(1.0, lambda: None)
        for endpoint in (publisher, subscription, client, server, timer):
            endpoint.close()

    def topics() -> set[str]:
        endpoints = graph_of(peer).endpoints.values()
        ours = {one.topic_key.name for one in endpoints if one.participant_guid == participant_of(node).guid}
        return {name for name in ours if not name.startswith("/n/")}

    def is_at_rest() -> bool:
        return topics() <= {"/rosout", "/parameter_events", "ros_discovery_info"}

    for _ in range(times // 10):
        once()
        await asyncio.sleep(0)
    await until(is_at_rest)
    gc.collect()
    before, memory = resources(), rss_kb()
    owned = list(scope_of(node).owned.values())
    for _ in range(times):
        once()
        await asyncio.sleep(0)
    await until(is_at_rest)
    gc.collect()
    await until(lambda: are_resources_freed(before))
    assert rss_kb() - memory < 10_000
    assert list(scope_of(node).owned.values()) == owned


@pytest.mark.every_transport
def test_opening_and_closing_contexts_repeatedly_leaks_no_resources(world: World) -> None:
    world.context().close()
    gc.collect()
    before = resources()
    for _ in range(30):
        with world.context() as context:
            Node("n", context=context).create_publisher(Int32, "t")
    wait_until(lambda: are_resources_freed(before))


@pytest.mark.every_transport
def test_ten_threads_can_create_nodes_publish_and_close(world: World) -> None:
    def work(context: Context, number: int) -> None:
        for _ in range(2):
            with Node(f"n{number}", context=context) as node:
                publishers = [node.create_publisher(String, f"t{k}") for k in range(10)]
                for _ in range(10):
                    for publisher in publishers:
                        publisher.publish(String(data="x"))

    contexts = [world.context(), world.context()]
    with ThreadPoolExecutor(10) as pool:
        for done in [pool.submit(work, contexts[k % 2], k) for k in range(10)]:
            done.result(30)


SOAK_S = float(os.environ.get("SOAK_MINUTES", "0")) * 60 or 5.0


@pytest.mark.timeout(300 + 1.5 * SOAK_S)
async def test_soak_memory_stays_flat_under_traffic(dds: World) -> None:
    alice, bob = dds.pair()
    received = 0

    def on_text(message: String) -> None:
        nonlocal received
        received += 1

    bob.create_subscription(String, "text", on_text)
    images = bob.create_subscription(UInt8MultiArray, "bytes", qos=2)
    alice.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    client = bob.create_client(AddTwoInts, "add")
    text, data = alice.create_publisher(String, "text"), alice.create_publisher(UInt8MultiArray, "bytes", 2)
    assert await client.wait_for_service(timeout_s=20)
    big = UInt8MultiArray(data=bytes(300_000))

    async def traffic(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for _ in range(5):
                text.publish(String(data="x" * 200))
            data.publish(big)
            images.latest()
            assert (await client.call(AddTwoInts.Request(a=1, b=2), timeout_s=20)).sum == 3
            await asyncio.sleep(0)

    await traffic(SOAK_S / 4)
    gc.collect()
    warm, counted = rss_kb(), resources()
    await traffic(SOAK_S * 3 / 4)
    gc.collect()
    assert received > 100
    assert rss_kb() - warm < 8_000
    await until(lambda: are_resources_freed(counted))


async def test_slow_callback_with_queue_depth_one_receives_the_newest_messages(dds: World) -> None:
    alice, bob = dds.pair()
    lags: list[int] = []
    sent = 0

    async def slow(message: Int32) -> None:
        lags.append(sent - message.data)
        await until(lambda: sent >= min(300, message.data + 20))

    subscription: Any = bob.create_subscription(Int32, "n", slow, 1)
    publisher = alice.create_publisher(Int32, "n", 1)
    assert await publisher.wait_for_subscribers(timeout_s=20)
    for sent in range(1, 301):
        publisher.publish(Int32(data=sent))
        await asyncio.sleep(0.001)  # a sender that does not wait for the receiver
    assert max(lags) <= 1
    assert subscription.dropped > 200
