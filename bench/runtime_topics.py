"""The parts of bench/runtime.py that concern topics and services: what each of its processes does."""

from __future__ import annotations

import asyncio
import statistics
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from runtime_common import IMAGE_BYTES, SERVICE, STOP, TEXT, both_ways, cpu_s, percentile, report


async def stream_pong(node: Any, string: Any) -> None:
    """asyncio style: return every message."""
    publisher = node.create_publisher(string, "pong")
    async for message in node.create_subscription(string, "ping"):
        if message.data == STOP:
            return
        publisher.publish(message)


async def callback_pong(node: Any, string: Any) -> None:
    """Callback style: return every message."""
    publisher = node.create_publisher(string, "pong")
    done = asyncio.get_running_loop().create_future()

    def callback(message: Any) -> None:
        if message.data == STOP:
            done.set_result(None)
        else:
            publisher.publish(message)

    node.create_subscription(string, "ping", callback)
    await done


async def stream_ping(node: Any, string: Any, count: int) -> None:
    """asyncio style: measure round trips."""
    publisher = node.create_publisher(string, "ping")
    subscription = node.create_subscription(string, "pong")
    await both_ways(publisher, subscription)
    message, times = string(data=TEXT), []
    for _ in range(count):
        start = time.perf_counter_ns()
        publisher.publish(message)
        await subscription.receive()
        times.append((time.perf_counter_ns() - start) / 1000)
    publisher.publish(string(data=STOP))
    await publisher.wait_for_acknowledged(timeout_s=1)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


async def callback_ping(node: Any, string: Any, count: int) -> None:
    """Callback style: measure round trips."""
    publisher = node.create_publisher(string, "ping")
    done = asyncio.get_running_loop().create_future()
    message, times, start = string(data=TEXT), [], 0

    def callback(_: Any) -> None:
        nonlocal start
        times.append((time.perf_counter_ns() - start) / 1000)
        if len(times) == count:
            done.set_result(None)
            return
        start = time.perf_counter_ns()
        publisher.publish(message)

    await both_ways(publisher, node.create_subscription(string, "pong", callback))
    start = time.perf_counter_ns()
    publisher.publish(message)
    await done
    publisher.publish(string(data=STOP))
    await publisher.wait_for_acknowledged(timeout_s=1)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


async def serve(node: Any, _: Any) -> None:
    """A service server with a plain handler; ends with its parent's pipe."""
    from rosidl_py_gen import get_service

    kind: Any = get_service("std_srvs/srv/SetBool")
    node.create_service(kind, SERVICE, lambda request: kind.Response(success=request.data))
    await asyncio.to_thread(sys.stdin.read)


async def call(node: Any, _: Any, count: int) -> None:
    """Measure service calls, then as many as each line of stdin says."""
    from rosidl_py_gen import get_service

    kind: Any = get_service("std_srvs/srv/SetBool")
    client = node.create_client(kind, SERVICE)
    await client.wait_for_service(timeout_s=10)
    await asyncio.sleep(0.2)
    while count:
        times = []
        for _ in range(count):
            start = time.perf_counter_ns()
            await client.call(kind.Request(data=True), timeout_s=5)
            times.append((time.perf_counter_ns() - start) / 1000)
        report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
        count = int(await asyncio.to_thread(sys.stdin.readline) or 0)


async def send_paced(node: Any, string: Any, count: int) -> None:
    """Publish at 1 kHz."""
    publisher = node.create_publisher(string, "paced")
    await publisher.wait_for_subscribers(timeout_s=10)
    await asyncio.sleep(0.2)
    message = string(data=TEXT)
    next_time = time.perf_counter()
    for _ in range(count):
        publisher.publish(message)
        next_time += 0.001
        await asyncio.sleep(max(0.0, next_time - time.perf_counter()))
    await publisher.wait_for_acknowledged(timeout_s=5)


async def count_paced(node: Any, string: Any, count: int) -> None:
    """Receive in a callback and report CPU per message."""
    await receive_and_report(node, string, "paced", count, 10)


async def send_flood(node: Any, string: Any, count: int) -> None:
    """Publish as fast as the reader confirms, keep-all, from a thread: its publish waits when DDS wants it to."""
    from rosidl_py_gen.runtime import QoSProfile

    publisher = node.create_publisher(string, "flood", QoSProfile().keep_all())
    await publisher.wait_for_subscribers(timeout_s=10)
    await asyncio.sleep(0.2)
    message = string(data=TEXT)
    await asyncio.to_thread(lambda: [publisher.publish(message) for _ in range(count)] and None)
    await publisher.wait_for_acknowledged(timeout_s=30)


async def count_flood(node: Any, string: Any, count: int) -> None:
    """Receive everything and report CPU per message."""
    from rosidl_py_gen.runtime import QoSProfile

    await receive_and_report(node, string, "flood", count, QoSProfile().keep_all())


async def receive_and_report(node: Any, string: Any, topic: str, count: int, qos: Any) -> None:
    """CPU of this process from the first to the last message, divided by their number."""
    done = asyncio.get_running_loop().create_future()
    received, cpu, start = 0, 0.0, 0.0

    def callback(_: Any) -> None:
        nonlocal received, cpu, start
        received += 1
        if received == 1:
            cpu, start = cpu_s(), time.perf_counter()
        elif received == count:
            done.set_result(None)

    node.create_subscription(string, topic, callback, qos)
    await asyncio.wait((done,), timeout=count / 500 + 20)
    used, passed = cpu_s() - cpu, time.perf_counter() - start
    report(cpu_us=used / max(1, received - 1) * 1e6, per_s=(received - 1) / passed, received=received)


async def publish_cost(node: Any, string: Any) -> None:
    """Publishing 100 bytes, and the two C calls that this takes, alternating."""
    from rosidl_py_gen.runtime.transport.cyclone.private_layout import new_sample

    publisher = node.create_publisher(string, "cost")
    message = string(data="x" * 91)
    writer = publisher._writer
    data, entity, api = message.encode(), writer.entity, writer._api
    type_object = writer._owner.domain.types[writer.type].address
    await publisher.wait_for_subscribers(timeout_s=10)
    ours: list[float] = []
    bare: list[float] = []
    for _ in range(30):
        functions: tuple[Callable[[], object], ...] = (
            lambda: publisher.publish(message),
            lambda: api.writecdr(entity, new_sample(api, type_object, data)),
        )
        for times, function in zip((ours, bare), functions, strict=True):
            start = time.perf_counter_ns()
            for _ in range(200):
                function()
            times.append((time.perf_counter_ns() - start) / 200 / 1000)
        await asyncio.sleep(0.005)
    report(ours=statistics.median(ours), bare=statistics.median(bare))


async def listen_cost(node: Any, string: Any) -> None:
    """The reader for `publish_cost`; ends with its parent's pipe."""
    node.create_subscription(string, "cost", lambda message: None, 1000)
    await asyncio.to_thread(sys.stdin.read)


async def idle(node: Any, string: Any, seconds: int) -> None:
    """A node with 20 subscriptions and nothing to do."""
    before = threading.active_count()
    for number in range(20):
        node.create_subscription(string, f"idle_{number}", lambda message: None)
    await asyncio.sleep(1)
    cpu = cpu_s()
    await asyncio.sleep(seconds)
    report(percent=(cpu_s() - cpu) / seconds * 100, threads=threading.active_count() - 1, before=before)


async def send_images(node: Any, _: Any, count: int) -> None:
    """1080p images at 30 Hz."""
    import numpy as np

    from rosidl_py_gen import get_message

    image: Any = get_message("sensor_msgs/msg/Image")
    publisher = node.create_publisher(image, "image", 10)
    await publisher.wait_for_subscribers(timeout_s=10)
    await asyncio.sleep(0.3)
    pixels = np.zeros(IMAGE_BYTES, dtype=np.uint8)
    next_time = time.perf_counter()
    for number in range(count):
        pixels[0] = pixels[-1] = number % 256
        publisher.publish(image(height=1080, width=1920, step=5760, encoding="rgb8", data=pixels))
        next_time += 1 / 30
        await asyncio.sleep(max(0.0, next_time - time.perf_counter()))
    await publisher.wait_for_acknowledged(timeout_s=10)
    report(dropped=publisher.dropped)


async def count_images(node: Any, _: Any, count: int) -> None:
    """Receive images and check their ends."""
    from rosidl_py_gen import get_message

    image: Any = get_message("sensor_msgs/msg/Image")
    subscription = node.create_subscription(image, "image", qos=10)
    whole, cpu = 0, cpu_s()
    try:
        for _ in range(count):
            message = await subscription.receive(timeout_s=12)
            whole += int(message.data[0] == message.data[-1] and len(message.data) == IMAGE_BYTES)
    except TimeoutError:
        pass
    report(dropped=subscription.dropped, whole=whole, cpu_ms=(cpu_s() - cpu) / max(1, whole) * 1000)
