"""Latency, CPU and start-up of the runtime beside a bare loop on the same DDS, two processes, loopback only.

Run `python bench/runtime.py` (about two minutes), `--quick` for a quarter of that. The floor is what cyclonedds-python
does without us: WaitSet, ddspy_take, ddspy_write. Rounds of floor and runtime alternate, so that both see the same
machine. Virtual machines have quiet and noisy
minutes, up to a factor of three apart; so a ratio is the median over rounds of the ratio within one round, and times
are shown as the range over all rounds. It prints a table with the targets beside the figures and asserts nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
DOMAIN = "77"
os.environ.update({"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
os.environ.pop("CYCLONEDDS_URI", None)

STOP = "stop"
TEXT = "hello world"
IMAGE_BYTES = 1920 * 1080 * 3


def cpu_s() -> float:
    """CPU seconds of this process so far, all threads."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def percentile(values: list[float], share: float) -> float:
    """The value below which `share` of all values lie."""
    return sorted(values)[min(len(values) - 1, int(len(values) * share))]


def report(**figures: object) -> None:
    """Send figures to the parent."""
    print(json.dumps(figures), flush=True)


# --------------------------------------------------------------------------------------------------------------- floor


class Floor:
    """Reader and writer of bare cyclonedds-python, with the QoS of the ROS default profile."""

    def __init__(self, write_to: str, read_from: str) -> None:
        from cyclonedds import _clayer as clayer
        from cyclonedds.core import Policy, Qos, ReadCondition, WaitSet
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from rosidl_py_gen.runtime.cyclone import _data_type
        from rosidl_py_gen.runtime.environment import cyclone_xml, read_environment

        self.clayer = clayer
        qos = Qos(
            Policy.Reliability.Reliable(max_blocking_time=10**9),
            Policy.History.KeepLast(10),
            Policy.WriterDataLifecycle(autodispose=False),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        kind: Any = _data_type("std_msgs::msg::dds_::String_")
        kind.__idl__.populate = kind.__idl__.fill_type_data = lambda: None
        xml = cyclone_xml(read_environment(os.environ), process_id=os.getpid())
        self.domain = Domain(int(DOMAIN), xml)
        self.participant = DomainParticipant(int(DOMAIN))
        self.writer: Any = DataWriter(self.participant, Topic(self.participant, write_to, kind), qos=qos)
        self.reader: Any = DataReader(self.participant, Topic(self.participant, read_from, kind), qos=qos)
        self.condition = ReadCondition(self.reader, 127)
        self.waitset = WaitSet(self.participant)
        self.waitset.attach(self.condition)

    def take(self) -> list[bytes]:
        """Wait for samples."""
        self.waitset.wait(10**9)
        taken = self.clayer.ddspy_take(self.condition._ref, 127, 16)
        return [data for data, info in taken if info.valid_data]

    def write(self, data: bytes) -> None:
        """Send a sample."""
        self.clayer.ddspy_write(self.writer._ref, data)


def floor_pong() -> None:
    """Return every sample until one begins with the STOP text."""
    from rosidl_py_gen import get_message

    stop = get_message("std_msgs/msg/String")(data=STOP).encode()  # type: ignore[call-arg]
    floor = Floor("bench_pong", "bench_ping")
    while True:
        for data in floor.take():
            if data.startswith(stop):
                return
            floor.write(data)


def floor_ping(count: int) -> None:
    """Measure `count` round trips and the bare write."""
    from rosidl_py_gen import get_message

    string: Any = get_message("std_msgs/msg/String")
    floor, message = Floor("bench_ping", "bench_pong"), string(data=TEXT).encode()
    while not (floor.writer.get_matched_subscriptions() and floor.reader.get_matched_publications()):
        time.sleep(0.01)
    time.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        floor.write(message)
        while not floor.take():
            pass
        times.append((time.perf_counter_ns() - start) / 1000)
    floor.write(string(data=STOP).encode())
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


# ------------------------------------------------------------------------------------------------------------- runtime


def run_node(main: Callable[[Any, Any], Any], name: str) -> None:
    """Run `main(node, String)` on an event loop."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.runtime import Node

    async def body() -> None:
        async with Node(name) as node:
            await main(node, get_message("std_msgs/msg/String"))

    asyncio.run(body())


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


async def both_ways(publisher: Any, subscription: Any) -> None:
    """Wait until both directions are connected, and a moment for the peer to see the same."""
    await publisher.wait_for_subscribers(timeout_s=10)
    await subscription.wait_for_publishers(timeout_s=10)
    await asyncio.sleep(0.2)


async def serve(node: Any, _: Any) -> None:
    """A service server with a plain handler; ends with its parent's pipe."""
    from rosidl_py_gen import get_service

    kind: Any = get_service("std_srvs/srv/SetBool")
    node.create_service(kind, "set", lambda request: kind.Response(success=request.data))
    await asyncio.to_thread(sys.stdin.read)


async def call(node: Any, _: Any, count: int) -> None:
    """Measure service calls."""
    from rosidl_py_gen import get_service

    kind: Any = get_service("std_srvs/srv/SetBool")
    client = node.create_client(kind, "set")
    await client.wait_for_service(timeout_s=10)
    await asyncio.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        await client.call(kind.Request(data=True), timeout_s=5)
        times.append((time.perf_counter_ns() - start) / 1000)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


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
    """Publishing 100 bytes, and the bare write on a bare writer of the same participant, alternating."""
    from cyclonedds import _clayer as clayer

    publisher = node.create_publisher(string, "cost")
    message = string(data="x" * 91)
    data, entity = message.encode(), publisher._writer._entity
    await publisher.wait_for_subscribers(timeout_s=10)
    ours: list[float] = []
    bare: list[float] = []
    for _ in range(30):
        functions: tuple[Callable[[], object], ...] = (
            lambda: publisher.publish(message),
            lambda: clayer.ddspy_write(entity, data),
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


START = """
import time; start = time.perf_counter()
from rosidl_py_gen.runtime import Node
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
node = Node("start"); node.create_publisher(Log, "x"); node.create_subscription(Log, "y")
import resource
print((time.perf_counter() - start) * 1000, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
node.close()
"""


# -------------------------------------------------------------------------------------------------------------- parent


def start_figures(count: int) -> list[list[float]]:
    """Milliseconds and megabytes of a fresh process with one node, with byte code at hand, as pip installs it."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": cache}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        command = [sys.executable, "-c", START]
        runs = [
            subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
            for _ in range(count + 1)
        ]
    return [[float(part) for part in run.stdout.split()] for run in runs[1:]]


def child(role: str, count: int = 0) -> subprocess.Popen[str]:
    """Start this file in a role."""
    command = [sys.executable, __file__, "--role", role, "--count", str(count)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def figures(process: subprocess.Popen[str]) -> dict[str, float]:
    """What a child reports."""
    assert process.stdout is not None
    line = process.stdout.readline()
    found: dict[str, float] = json.loads(line) if line else {}
    return found


def pair(server: str, client: str, count: int, reporter: int = 1) -> dict[str, float]:
    """Run two roles against each other; `reporter` says whose figures count."""
    processes = [child(server, count), child(client, count)]
    try:
        return figures(processes[reporter])
    finally:
        time.sleep(0.2)
        for process in processes:
            assert process.stdin is not None
            process.stdin.close()
        for process in processes:
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def row(name: str, value: str, target: str) -> None:
    """One line of the table."""
    print(f"| {name} | {value} | {target} |", flush=True)


def table(quick: bool) -> None:
    """Measure and print."""
    rounds, trips = (3, 2000) if quick else (10, 3000)
    kinds = {"floor": ("floor_pong", "floor_ping"), "callback": ("callback_pong", "callback_ping")}
    kinds |= {"asyncio": ("stream_pong", "stream_ping"), "service": ("serve", "call")}
    measured: dict[str, list[float]] = {kind: [] for kind in kinds}
    for _ in range(rounds):
        for kind, (server, client) in kinds.items():
            measured[kind].append(pair(server, client, trips)["p50"])
    print("| Figure | Measured | Target |\n|---|---|---|")
    floor = measured["floor"]
    row("floor: bare WaitSet round trip, String, p50", f"{min(floor):.0f} to {max(floor):.0f} us", "")
    for kind, name, target in (
        ("asyncio", "round trip, asyncio both ends", "1.6x"),
        ("callback", "round trip, callback style", "1.3x"),
        ("service", "service call", "2.5x"),
    ):
        times = measured[kind]
        ratio = statistics.median(ours / bare for ours, bare in zip(times, floor, strict=True))
        row(f"{name}, p50", f"{min(times):.0f} to {max(times):.0f} us, {ratio:.2f}x", f"<= {target} the floor")
    paced = pair("count_paced", "send_paced", 3000 if quick else 8000, reporter=0)
    row("CPU per received message at 1 kHz", f"{paced['cpu_us']:.0f} us", "<= 60 us")
    flood = pair("count_flood", "send_flood", 50_000 if quick else 200_000, reporter=0)
    row("CPU per received message, flood", f"{flood['cpu_us']:.1f} us at {flood['per_s']:.0f}/s", "<= 15 us")
    cost = pair("listen_cost", "publish_cost", 0)
    row("publish, 100-byte String", f"{cost['ours']:.1f} us = {cost['ours'] / cost['bare']:.2f}x ddspy_write", "<= 3x")
    quiet = figures(child("idle", 5 if quick else 20))
    row("idle node, 20 subscriptions", f"{quiet['percent']:.2f} % CPU, {quiet['threads']:.0f} thread", "<= 0.2 %, 1")
    count = 150 if quick else 900
    images = pair("count_images", "send_images", count, reporter=0)
    whole = f"{images['whole']:.0f} of {count} whole, {images['cpu_ms']:.1f} ms CPU each"
    row("1080p images, 6.2 MB, 30 Hz", whole, "all")
    numbers = start_figures(5)
    row("start of a node, import included", f"{statistics.median(n[0] for n in numbers):.0f} ms", "<= 200 ms")
    row("memory of that node", f"{statistics.median(n[1] for n in numbers):.0f} MB", "<= 60 MB")


ROLES: dict[str, Callable[[int], None]] = {
    "floor_pong": lambda count: floor_pong(),
    "floor_ping": floor_ping,
    "stream_pong": lambda count: run_node(stream_pong, "pong"),
    "callback_pong": lambda count: run_node(callback_pong, "pong"),
    "stream_ping": lambda count: run_node(lambda n, s: stream_ping(n, s, count), "ping"),
    "callback_ping": lambda count: run_node(lambda n, s: callback_ping(n, s, count), "ping"),
    "serve": lambda count: run_node(serve, "server"),
    "call": lambda count: run_node(lambda n, s: call(n, s, count), "client"),
    "send_paced": lambda count: run_node(lambda n, s: send_paced(n, s, count), "sender"),
    "count_paced": lambda count: run_node(lambda n, s: count_paced(n, s, count), "receiver"),
    "send_flood": lambda count: run_node(lambda n, s: send_flood(n, s, count), "sender"),
    "count_flood": lambda count: run_node(lambda n, s: count_flood(n, s, count), "receiver"),
    "listen_cost": lambda count: run_node(listen_cost, "listener"),
    "publish_cost": lambda count: run_node(publish_cost, "talker"),
    "idle": lambda count: run_node(lambda n, s: idle(n, s, count), "idle"),
    "send_images": lambda count: run_node(lambda n, s: send_images(n, s, count), "camera"),
    "count_images": lambda count: run_node(lambda n, s: count_images(n, s, count), "viewer"),
}


def main() -> None:
    """Print the table, or play a role in it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--role", choices=sorted(ROLES))
    parser.add_argument("--count", type=int, default=0)
    arguments = parser.parse_args()
    sys.argv[1:] = []
    if arguments.role:
        ROLES[arguments.role](arguments.count)
    else:
        table(arguments.quick)


if __name__ == "__main__":
    main()
