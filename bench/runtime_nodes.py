"""Nodes of bench/runtime.py and bench/rclpy.py: what each of their processes does, and how it reports.

The DDS domain is on loopback.
"""

from __future__ import annotations

import asyncio
import gc
import json
import os
import resource
import statistics
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
DOMAIN = "219"
os.environ.update({"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
os.environ.pop("CYCLONEDDS_URI", None)

SERVICE = os.environ.get("BENCH_SERVICE", "set")
STOP = "stop"
TEXT = "hello world"
IMAGE_BYTES = 1920 * 1080 * 3
WARM_UP = 1000
KEPT_S = 0.2


def cpu_s() -> float:
    """CPU seconds of this process so far, all threads."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def rss_mb() -> float:
    """Resident memory of this process now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def percentile(values: list[float], share: float) -> float:
    """The value below which `share` of all values lie."""
    return sorted(values)[min(len(values) - 1, int(len(values) * share))]


def report(**figures: object) -> None:
    """Send figures to the parent."""
    print(json.dumps(figures), flush=True)


def run_node(main: Callable[[Any, Any], Any], name: str) -> None:
    """Run `main(node, String)` on an event loop: BENCH_LOOP says which, BENCH_CONTEXTS how many contexts are on it."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.runtime import Context, Node, run

    async def body() -> None:
        async with AsyncExitStack() as stack:
            for number in range(int(os.environ.get("BENCH_CONTEXTS", "1")) - 1):
                context = await stack.enter_async_context(Context())
                await stack.enter_async_context(Node(f"{name}_beside_{number}", context=context))
            node = await stack.enter_async_context(Node(name))
            await main(node, get_message("std_msgs/msg/String"))

    kind = os.environ.get("BENCH_LOOP")
    if kind == "uvloop":
        import uvloop

        uvloop.run(body())
    elif kind == "asyncio":
        asyncio.run(body())
    else:
        run(body)


async def both_ways(publisher: Any, subscription: Any) -> None:
    """Wait until both directions are connected, and a moment for the peer to see the same."""
    await publisher.wait_for_subscribers(timeout_s=10)
    await subscription.wait_for_publishers(timeout_s=10)
    await asyncio.sleep(0.2)


# -------------------------------------------------------------------------------------------------- topics and services


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


# ----------------------------------------------------------------------------------------------- actions and parameters


def fibonacci() -> Any:
    """The action type."""
    from rosidl_py_gen import get_action

    return get_action("example_interfaces/action/Fibonacci")


async def goal_server(node: Any, _: Any) -> None:
    """An action server whose goals end at once; ends with its parent's pipe."""
    kind = fibonacci()

    async def execute(goal: Any) -> Any:
        return kind.Result(sequence=[0, 1, 1])

    node.create_action_server(kind, "fibonacci", execute)
    await asyncio.to_thread(sys.stdin.read)


async def goal_client(node: Any, _: Any, count: int) -> None:
    """Measure from sending a goal to having its result."""
    kind = fibonacci()
    client = node.create_action_client(kind, "fibonacci")
    await client.wait_for_server(timeout_s=10)
    await asyncio.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        goal = await client.send_goal(kind.Goal(order=3), timeout_s=5)
        await goal.result(timeout_s=5)
        times.append((time.perf_counter_ns() - start) / 1000)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


async def memory_server(node: Any, _: Any, count: int) -> None:
    """An action server that forgets results soon; reports how much `count` goals after the first ones left behind."""
    kind = fibonacci()
    done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    served, before = 0, 0.0

    async def execute(goal: Any) -> Any:
        nonlocal served, before
        served += 1
        goal.publish_feedback(kind.Feedback(sequence=[0]))
        if served == WARM_UP:
            gc.collect()
            before = rss_mb()
        elif served == WARM_UP + count:
            done.set_result(None)
        return kind.Result(sequence=[0, 1, 1])

    server = node.create_action_server(kind, "fibonacci", execute, result_timeout_s=KEPT_S)
    await done
    await asyncio.sleep(2 * KEPT_S + 0.1)
    gc.collect()
    report(grown_mb=rss_mb() - before, goals=len(server.goals))


async def memory_client(node: Any, _: Any, count: int) -> None:
    """Send `count` goals after the first ones; reports how much memory they left behind."""
    kind = fibonacci()
    client = node.create_action_client(kind, "fibonacci")
    await client.wait_for_server(timeout_s=10)
    await asyncio.sleep(0.2)
    before = 0.0
    for number in range(WARM_UP + count):
        if number == WARM_UP:
            gc.collect()
            before = rss_mb()
        goal = await client.send_goal(kind.Goal(order=3), timeout_s=5)
        await goal.result(timeout_s=5)
    gc.collect()
    report(grown_mb=rss_mb() - before)
    await asyncio.to_thread(sys.stdin.read)


async def parameter_server(node: Any, _: Any) -> None:
    """A node with a parameter; ends with its parent's pipe."""
    node.declare_parameter("speed", 0.5)
    await asyncio.to_thread(sys.stdin.read)


async def parameter_setter(node: Any, _: Any, count: int) -> None:
    """Measure setting a parameter of another node."""
    client = node.create_parameter_client("/parameter_server")
    await client.wait_for_services(timeout_s=10)
    await asyncio.sleep(0.2)
    times = []
    for number in range(count):
        start = time.perf_counter_ns()
        results = await client.set({"speed": float(number)}, timeout_s=5)
        times.append((time.perf_counter_ns() - start) / 1000)
        assert results[0].successful
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
