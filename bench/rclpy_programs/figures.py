"""Program that bench/rclpy.py runs with this rclpy and the real one: ``figures.py ROLE [ARGUMENT ...]``.

Nothing but rclpy's own names is used. A role prints its figures as a line of JSON.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool

STOP = "stop"
TEXT = "hello world"
WORK_S = 0.0005
SILENCE_S = 3.0
"""All that was sent has come, or was lost."""


def cpu_s() -> float:
    """CPU seconds of this process so far, all threads."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def rss_mb() -> float:
    """Resident memory of this process now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def report(**figures: float) -> None:
    """Send figures to the parent."""
    print(json.dumps(figures), flush=True)


def percentile(values: list[float], share: float) -> float:
    """The value below which `share` of all values lie."""
    return sorted(values)[min(len(values) - 1, int(len(values) * share))]


def wait_until(node: Node, condition: Callable[[], object]) -> None:
    """Spin until something holds."""
    while not condition():
        rclpy.spin_once(node, timeout_sec=0.01)


class _Enough(Exception):
    """Ends a spin."""


def spin(node: Node) -> None:
    """`rclpy.spin` until a callback raises `_Enough`."""
    with contextlib.suppress(_Enough):
        rclpy.spin(node)


# ------------------------------------------------------------------------------------------------------------- topics


def pong() -> None:
    """Return every message."""
    node = rclpy.create_node("pong")
    publisher = node.create_publisher(String, "pong", 10)

    def callback(message: String) -> None:
        if message.data == STOP:
            raise _Enough
        publisher.publish(message)

    node.create_subscription(String, "ping", callback, 10)
    spin(node)


def ping(count: str) -> None:
    """Measure round trips."""
    node = rclpy.create_node("ping")
    publisher = node.create_publisher(String, "ping", 10)
    message, times, start = String(data=TEXT), list[float](), 0

    def callback(_: String) -> None:
        nonlocal start
        times.append((time.perf_counter_ns() - start) / 1000)
        if len(times) == int(count):
            raise _Enough
        start = time.perf_counter_ns()
        publisher.publish(message)

    subscription = node.create_subscription(String, "pong", callback, 10)
    wait_until(node, lambda: publisher.get_subscription_count() and subscription.get_publisher_count())
    time.sleep(0.3)
    start = time.perf_counter_ns()
    publisher.publish(message)
    spin(node)
    publisher.publish(String(data=STOP))
    time.sleep(0.2)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


def receive(name: str, count: str) -> None:
    """Receive messages by `rclpy.spin`, and report the CPU of each."""
    node = rclpy.create_node("receiver")
    received, begin, last = 0, 0.0, 0.0

    def callback(_: Any) -> None:
        nonlocal received, begin, last
        received += 1
        if received == 1:
            begin = cpu_s()
        last = time.perf_counter()
        if received == int(count):
            raise _Enough

    def look() -> None:
        if received and time.perf_counter() > last + SILENCE_S:
            raise _Enough

    package, _, kind = name.split("/")
    message_type = getattr(importlib.import_module(f"{package}.msg"), kind)
    node.create_subscription(message_type, "paced", callback, 10)
    node.create_timer(1.0, look)
    spin(node)
    report(cpu_us=(cpu_s() - begin) * 1e6 / max(1, received - 1), received=received)


def busy(count: str) -> None:
    """A main loop with 0.5 ms of work and `spin_once(timeout_sec=0)`; reports the age of messages, and losses."""
    node = rclpy.create_node("busy")
    ages = list[float]()

    def callback(message: String) -> None:
        ages.append((time.time_ns() - int(message.data)) / 1e6)

    node.create_subscription(String, "stamped", callback, 10)
    last = time.perf_counter() + 10
    while len(ages) < int(count) and time.perf_counter() < last:
        end = time.perf_counter() + WORK_S
        while time.perf_counter() < end:
            pass
        seen = len(ages)
        rclpy.spin_once(node, timeout_sec=0)
        if len(ages) > seen:
            last = time.perf_counter() + SILENCE_S
    report(p50=percentile(ages, 0.5), p99=percentile(ages, 0.99), lost=int(count) - len(ages))


# ----------------------------------------------------------------------------------------------------------- services


def serve() -> None:
    """Answer, until the parent closes the pipe."""
    import threading

    node = rclpy.create_node("server")

    def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = request.data
        return response

    node.create_service(SetBool, "set", answer)

    def end() -> None:
        sys.stdin.read()
        rclpy.try_shutdown()

    threading.Thread(target=end, daemon=True).start()
    with contextlib.suppress(rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


def call(count: str) -> None:
    """Measure `call_async` and `spin_until_future_complete`."""
    node = rclpy.create_node("client")
    client = node.create_client(SetBool, "set")
    assert client.wait_for_service(10)
    time.sleep(0.5)
    request, times = SetBool.Request(data=True), list[float]()
    for _ in range(int(count)):
        start = time.perf_counter_ns()
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future)
        times.append((time.perf_counter_ns() - start) / 1000)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


# -------------------------------------------------------------------------------------------------------------- nodes


def nodes(count: str) -> None:
    """Many nodes in one process, each with a publisher, a subscription and a timer."""
    begin, before_mb, begin_cpu = time.perf_counter(), rss_mb(), cpu_s()
    executor, all_nodes, ticks = rclpy.get_global_executor(), list[Node](), 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 50 * int(count):
            raise _Enough

    for number in range(int(count)):
        node = rclpy.create_node(f"node_{number}")
        node.create_publisher(String, f"topic_{number}", 10)
        node.create_subscription(String, f"topic_{number}", lambda message: None, 10)
        executor.add_node(node)
        all_nodes.append(node)
    made, made_cpu = time.perf_counter() - begin, cpu_s() - begin_cpu
    made_mb = rss_mb() - before_mb
    for node in all_nodes:
        node.create_timer(0.1, tick)
    time.sleep(0.3)
    begin, begin_cpu = time.perf_counter(), cpu_s()
    with contextlib.suppress(_Enough):
        executor.spin()
    percent = (cpu_s() - begin_cpu) / (time.perf_counter() - begin) * 100
    report(made_s=made, made_cpu_s=made_cpu, made_mb=made_mb, percent=percent)


ROLES: dict[str, Callable[..., None]] = {
    "pong": pong,
    "ping": ping,
    "receive": receive,
    "busy": busy,
    "serve": serve,
    "call": call,
    "nodes": nodes,
}

if __name__ == "__main__":
    rclpy.init(args=[])
    ROLES[sys.argv[1]](*sys.argv[2:])
    sys.stdout.flush()
    rclpy.try_shutdown()
