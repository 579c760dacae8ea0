"""The cost of programs written for rclpy under `rosidl-py run`, beside our own API and beside real rclpy on Fast DDS.

Run `python bench/rclpy.py --rclpy PYTHON`, where PYTHON is the interpreter of an environment with rclpy, such as one of
tests/peers/interop_rclpy; without it, what compares with rclpy is left out. `--quick` takes a third of the time,
`--only NAME` measures one part, `--soak SECONDS` makes the last part longer. Loopback only, a process for each end.
Sides take turns round by round, so that both see the same machine; a ratio is the median over rounds of the ratio
within one, and CPU is the processor time of the whole process for each message. It prints a table with the targets
beside the figures and asserts nothing. The programs are in bench/rclpy_programs, and use rclpy's names only."""

from __future__ import annotations

import argparse
import asyncio
import os
import resource
import select
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import runtime_nodes as nodes
from runtime import figures
from runtime_nodes import TEXT, cpu_s, report, run_node

PROGRAMS = Path(__file__).resolve().parent / "rclpy_programs"
RUN = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run"]
# At 60 images per second a receiver of the real rclpy may hang: docs/internals/dds.md 13.
MESSAGES = {  # type: messages a second, and how many
    "std_msgs/msg/String": (1000, 3000),
    "sensor_msgs/msg/JointState": (1000, 3000),
    "sensor_msgs/msg/Image": (20, 100),
    "sensor_msgs/msg/PointCloud2": (20, 100),
}
START = """
import rclpy
rclpy.init()
node = rclpy.create_node("start")
"""
TALKER = (
    START
    + """
from {0}.msg import {1}
publisher = node.create_publisher({1}, "topic", 10)
node.create_timer(0.01, lambda: publisher.publish({1}()))
for _ in range(3):
    rclpy.spin_once(node)
node.destroy_node()
rclpy.shutdown()
"""
)
STARTS = {
    "rclpy.init and a node": START,
    "a talker of String": TALKER.format("std_msgs", "String"),
    "a talker of Imu, which has numpy arrays": TALKER.format("sensor_msgs", "Imu"),
}
LIMIT_S = 120.0
"""Maximum time of a process in seconds."""
Process = subprocess.Popen[str]
Start = Callable[..., Process]


# ------------------------------------------------------------------------------------------------ our own ends, native


def sample(name: str) -> Any:
    """A message of the size that the type usually has."""
    import numpy as np

    from rosidl_py_gen import get_message

    message: Any = get_message(name)()
    match name.rsplit("/", 1)[1]:
        case "String":
            message.data = TEXT
        case "JointState":
            message.name = [f"joint_{number}" for number in range(12)]
            message.position = message.velocity = message.effort = np.arange(12.0)
        case "Image":
            message.height, message.width, message.step, message.encoding = 480, 640, 1920, "rgb8"
            message.data = np.zeros(640 * 480 * 3, dtype=np.uint8)
        case "PointCloud2":
            message.height, message.width, message.point_step, message.row_step = 1, 65536, 16, 1 << 20
            message.data = np.zeros(1 << 20, dtype=np.uint8)
    return message


async def send(node: Any, name: str, rate_hz: float, count: int) -> None:
    """Publish at a rate."""
    message = sample(name)
    publisher = node.create_publisher(type(message), "paced", 10)
    await publisher.wait_for_subscribers(timeout_s=30)
    await asyncio.sleep(0.5)
    next_s = time.perf_counter()
    for _ in range(count):
        publisher.publish(message)
        next_s += 1 / rate_hz
        await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
    await publisher.wait_for_acknowledged(timeout_s=5)


async def send_stamped(node: Any, string: Any, count: int) -> None:
    """Publish the time at 500 Hz."""
    publisher = node.create_publisher(string, "stamped", 10)
    await publisher.wait_for_subscribers(timeout_s=10)
    await asyncio.sleep(0.3)
    next_s = time.perf_counter()
    for _ in range(count):
        publisher.publish(string(data=str(time.time_ns())))
        next_s += 0.002
        await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
    await publisher.wait_for_acknowledged(timeout_s=5)


async def receive(node: Any, name: str, count: int) -> None:
    """Receive by a callback, and report the CPU of each message."""
    from rosidl_py_gen import get_message

    done = asyncio.get_running_loop().create_future()
    received, begin = 0, 0.0

    def callback(_: Any) -> None:
        nonlocal received, begin
        received += 1
        if received == 1:
            begin = cpu_s()
        elif received == count:
            done.set_result(None)

    node.create_subscription(get_message(name), "paced", callback, 10)
    await asyncio.wait((done,), timeout=30)
    report(cpu_us=(cpu_s() - begin) * 1e6 / max(1, received - 1), received=received)


def bare_receive(name: str, count: int) -> None:
    """A thread that reads the pipe Cyclone DDS writes into, and takes samples: no loop, no node, nothing decoded."""

    from rosidl_py_gen.runtime.node.settings import read_environment
    from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
    from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

    participant = CycloneTransport().open(read_environment(os.environ))
    end = EndpointSpec(TopicKey("topic", "/paced"), name, QoSProfile())
    reader, pipe = participant.create_reader(end), participant.fileno()
    assert pipe is not None
    os.set_blocking(pipe, True)
    received, begin = 0, 0.0
    while received < count and select.select([pipe], [], [], 30 if not received else 3)[0]:
        os.read(pipe, 4096)
        reader.fetch()
        while reader.queue.items:
            reader.queue.items.popleft()
            received += 1
            if received == 1:
                begin = cpu_s()
    report(cpu_us=(cpu_s() - begin) * 1e6 / max(1, received - 1), received=received)


ROLES: dict[str, Callable[..., None]] = {
    "pong": lambda: run_node(nodes.callback_pong, "pong"),
    "ping": lambda count: run_node(lambda n, s: nodes.callback_ping(n, s, int(count)), "ping"),
    "serve": lambda: run_node(nodes.serve, "server"),
    "call": lambda count: run_node(lambda n, s: nodes.call(n, s, int(count)), "client"),
    "receive": lambda name, count: run_node(lambda n, _: receive(n, name, int(count)), "receiver"),
    "bare_receive": lambda name, count: bare_receive(name, int(count)),
    "send": lambda name, rate, count: run_node(lambda n, _: send(n, name, float(rate), int(count)), "sender"),
    "send_stamped": lambda count: run_node(lambda n, s: send_stamped(n, s, int(count)), "sender"),
}


# -------------------------------------------------------------------------------------------------------------- parent


def started(command: list[str], *arguments: object, **settings: str) -> Process:
    """A process with pipes."""
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen([*command, *map(str, arguments)], env={**os.environ, **settings}, **pipes)


def native(role: str, *arguments: object) -> Process:
    """A role of this file."""
    return started([sys.executable, __file__, "--role", role], *arguments)


def shim(role: str, *arguments: object) -> Process:
    """A role of the programs, under `rosidl-py run`."""
    return started([*RUN, str(PROGRAMS / "figures.py"), role], *arguments)


def real(python: str) -> Start:
    """The same under real rclpy."""
    command = [python, str(PROGRAMS / "figures.py")]
    return lambda role, *arguments: started(command, role, *arguments, RMW_IMPLEMENTATION="rmw_fastrtps_cpp")


def measured(reporter: Process, *others: Process) -> dict[str, float]:
    """Return the report of one of several processes after all have ended."""
    hung = threading.Timer(LIMIT_S, reporter.kill)
    hung.start()
    try:
        found = figures(reporter)
        if not found:
            raise SystemExit(f"{reporter.args}: no figures, or none within {LIMIT_S:g} s")
        return found
    finally:
        hung.cancel()
        for process in (reporter, *others):
            process.stdin.close()
        for process in (reporter, *others):
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def row(name: str, value: str, target: str = "") -> None:
    """Print a line of the table."""
    print(f"| {name} | {value} | {target} |", flush=True)


def shown(times: list[float], base: list[float] | None = None, unit: str = "us") -> str:
    """The range, and the median ratio within rounds."""
    text = f"{min(times):.0f} to {max(times):.0f} {unit}"
    if base is not None:
        text += f", {statistics.median(one / other for one, other in zip(times, base, strict=True)):.2f}x"
    return text


def round_trips(rounds: int, python: str | None) -> None:
    """Topics and services, both ends of one kind."""
    for what, server, client in (("topic", "pong", "ping"), ("service", "serve", "call")):
        kinds: dict[str, Start] = {"ours": native, "shim": shim} | ({"rclpy": real(python)} if python else {})
        p50: dict[str, list[float]] = {kind: [] for kind in kinds}
        for _ in range(rounds):
            for kind, start in kinds.items():
                other = start(server)
                # Real rclpy takes tens of milliseconds for a call of a service when it is spun for each.
                count = 2000 if what == "topic" or kind != "rclpy" else 100
                p50[kind].append(measured(start(client, count), other)["p50"])
        row(f"{what}, round trip, our own API, p50", shown(p50["ours"]))
        row(f"{what}, round trip, rclpy program under run, p50", shown(p50["shim"], p50["ours"]), "<= 1.1x")
        if python:
            row(f"{what}, round trip, real rclpy, p50", shown(p50["rclpy"], p50["ours"]))


def received(rounds: int, python: str | None) -> None:
    """CPU of a received message."""
    for name, (rate, count) in MESSAGES.items():
        kinds: dict[str, Start] = {"rclpy": real(python)} if python else {}
        kinds |= {"shim": shim, "ours": native}
        cpu: dict[str, list[float]] = {kind: [] for kind in ("bare", *kinds)}
        for _ in range(rounds):
            for kind in cpu:
                start, role = (native, "bare_receive") if kind == "bare" else (kinds[kind], "receive")
                reporter = start(role, name, count)
                cpu[kind].append(measured(reporter, native("send", name, rate, count + 20))["cpu_us"])
        short = f"CPU a message, {name.rsplit('/', 1)[1]} at {rate} Hz"
        base = cpu.get("rclpy")
        if base:
            row(f"{short}, real rclpy on Fast DDS", shown(base))
        row(f"{short}, rclpy program under run", shown(cpu["shim"], base), "<= 0.5x" if base else "")
        row(f"{short}, our own API, callback", shown(cpu["ours"], base))
        row(f"{short}, a thread that only takes", shown(cpu["bare"], base))


def both(python: str | None) -> dict[str, Start]:
    """Ours, and the real one if it is there."""
    return {"under run": shim} | ({"real rclpy": real(python)} if python else {})


def busy_loop(rounds: int, python: str | None) -> None:
    """A main loop that is busy."""
    for kind, start in both(python).items():
        found = measured(start("busy", 2000), native("send_stamped", 2000))
        text = f"p50 {found['p50']:.2f} ms, p99 {found['p99']:.2f} ms, {found['lost']:.0f} of 2000 lost"
        row(f"busy main loop, 500 Hz, {kind}: age of messages", text, "0 lost")


def many_nodes(rounds: int, python: str | None) -> None:
    """50 nodes in one process."""
    for kind, start in both(python).items():
        found = [measured(start("nodes", 50)) for _ in range(rounds)]
        best = {key: min(one[key] for one in found) for key in found[0]}
        made = f"{best['made_s']:.2f} s ({best['made_cpu_s']:.2f} s CPU), {best['made_mb']:.0f} MB"
        text = f"{made}, then {best['percent']:.1f} % CPU"
        row(f"50 nodes, {kind}: made in, memory, 50 timers at 10 Hz", text)


def starts(rounds: int, python: str | None) -> None:
    """Start of programs with a node, with byte code and caches at hand."""
    for name, text in STARTS.items():
        start(name, text, rounds, python)


def start(name: str, text: str, rounds: int, python: str | None) -> None:
    """Start and end of a program; the caches of the import hook do not take what has changed in the last 2 s."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "start.py")
        program.write_text(text)
        time.sleep(2.1)
        settings = {**os.environ, "PYTHONPYCACHEPREFIX": str(Path(folder, "cache"))}
        settings.pop("PYTHONDONTWRITEBYTECODE", None)
        kinds = {"pass": [sys.executable, "-c", "pass"], "run": [*RUN, str(program)]}
        if text == START:
            kinds["native"] = [sys.executable, "-c", "from rosidl_py_gen.runtime import Node; Node('start')"]
        kinds |= {"rclpy": [python, str(program)]} if python else {}
        wall: dict[str, list[float]] = {kind: [] for kind in kinds}
        cpu: dict[str, list[float]] = {kind: [] for kind in kinds}
        for number in range(-1, 5 * rounds):
            for kind, command in kinds.items():
                begin, begin_cpu = time.perf_counter(), children_s()
                subprocess.run(command, env=settings, check=True, stdout=subprocess.DEVNULL)
                if number >= 0:
                    wall[kind].append(time.perf_counter() - begin)
                    cpu[kind].append(children_s() - begin_cpu)
    names = {"run": f"{name}, under run", "native": "a node of our own API", "rclpy": "the same, real rclpy"}
    for kind, label in names.items():
        if kind in kinds:
            best = min(wall[kind]) - min(wall["pass"])
            cpu_s = statistics.median(cpu[kind])
            figure = f"{best:.2f} s at best, CPU {cpu_s * 1000:.0f} ms"
            if kind == "run" and python:
                figure += f", {cpu_s / statistics.median(cpu['rclpy']):.2f}x of real rclpy"
            row(f"start to end over `python -c pass`: {label}", figure, "<= 1x CPU" if kind == "run" else "")


def soak(seconds: float) -> None:
    """A MultiThreadedExecutor with blocking calls in callbacks, for long."""
    process = started([*RUN, str(PROGRAMS / "soak.py"), f"{seconds:g}"])
    lines = process.communicate(timeout=seconds + 60)[0].splitlines()
    row(f"MultiThreadedExecutor, {seconds:g} s", f"{lines[-1]}; {' '.join(lines[-2].split())}", "no hang, no growth")


def children_s() -> float:
    """CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)  # os.times has steps of 10 ms
    return used.ru_utime + used.ru_stime


PARTS: dict[str, Callable[..., None]] = {
    "round_trips": round_trips,
    "received": received,
    "busy": busy_loop,
    "nodes": many_nodes,
    "start": starts,
    "soak": soak,
}


def main() -> None:
    """Print the table, or play a role in it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rclpy", metavar="PYTHON", help="of an environment with rclpy")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", choices=sorted(PARTS), action="append")
    parser.add_argument("--soak", type=float, default=20, metavar="SECONDS")
    parser.add_argument("--role", choices=sorted(ROLES))
    parser.add_argument("arguments", nargs="*")
    given = parser.parse_args()
    if given.role:
        sys.argv[1:] = []
        ROLES[given.role](*given.arguments)
        return
    print("| Figure | Measured | Target |\n|---|---|---|", flush=True)
    for name, part in PARTS.items():
        if not given.only or name in given.only:
            if part is soak:
                soak(given.soak)
            else:
                part(3 if given.quick else 9, given.rclpy)


if __name__ == "__main__":
    main()
