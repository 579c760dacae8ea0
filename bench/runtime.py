"""Latency, CPU and start-up of the runtime beside a bare loop on the same DDS, two processes, loopback only.

Run `python bench/runtime.py` (about four minutes; needs uvloop), `--quick` for a quarter of that, `--rclpy PYTHON` for
calls to and from rclpy on Fast DDS as well, with a Python that has it, `--transport zenoh` for Zenoh. The floor is what
cyclonedds-python does without us, WaitSet, ddspy_take, ddspy_write, or eclipse-zenoh, put and recv. Rounds of floor and
runtime alternate, so that both see the same machine. Virtual machines have quiet and noisy minutes, up to a factor of
three apart; so a ratio is the median over rounds of the ratio within one round, and times are shown as the range over
all rounds. It prints a table with the targets beside the figures and asserts nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import runtime_floors as floors
import runtime_nodes as nodes
from runtime_nodes import run_node

BASES = {"floor": "the floor", "service": "a service call", "callback": "one context"}
BASES |= {"loop": "asyncio's loop", "query_loop": "the query"}
START = """
import time; start = time.perf_counter()
from rosidl_py_gen.runtime import Node
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
node = Node("start"); node.create_publisher(Log, "x"); node.create_subscription(Log, "y")
import resource
print((time.perf_counter() - start) * 1000, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
node.close()
"""
RCLPY_SERVE = """
import sys
import rclpy
from std_srvs.srv import SetBool
rclpy.init()
node = rclpy.create_node("server")
def answer(request, response):
    response.success = request.data
    return response
node.create_service(SetBool, sys.argv[1], answer)
rclpy.spin(node)
"""
RCLPY_CALL = """
import json, sys, time
import rclpy
from std_srvs.srv import SetBool
rclpy.init()
node = rclpy.create_node("client")
client = node.create_client(SetBool, sys.argv[1])
assert client.wait_for_service(10)
time.sleep(1)
async def calls(count):
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        await client.call_async(SetBool.Request(data=True))
        times.append((time.perf_counter_ns() - start) / 1000)
    print(json.dumps({"p50": sorted(times)[len(times) // 2]}), flush=True)
executor = rclpy.get_global_executor()
executor.add_node(node)
count = int(sys.argv[2])
while count:
    executor.spin_until_future_complete(executor.create_task(calls(count)))
    count = int(sys.stdin.readline() or 0)
"""
TURN = 100
"""Calls, before it is another pair's turn."""
Process = subprocess.Popen[str]
Start = Callable[[str], Process]


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


def child(role: str, count: int = 0, **settings: str) -> subprocess.Popen[str]:
    """Start this file in a role; `settings` are those of `run_node`."""
    command = [sys.executable, __file__, "--role", role, "--count", str(count)]
    environment = {**os.environ, **settings}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def figures(process: subprocess.Popen[str]) -> dict[str, float]:
    """Return the report of a child process."""
    assert process.stdout is not None
    line = process.stdout.readline()
    found: dict[str, float] = json.loads(line) if line else {}
    return found


def pair(server: str, client: str, count: int, reporter: int = 1, **settings: str) -> dict[str, float]:
    """Run two roles against each other; `reporter` says whose figures count."""
    processes = [child(server, count, **settings), child(client, count, **settings)]
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


# ----------------------------------------------------------------------------------------------------- rclpy, Fast DDS

# All pairs of client and server run at once, each with a service of its own, and take turns of a hundred calls, so that
# they see the same machine. They run in a network of their own, because Fast DDS sends to every interface. Clients have
# a core of their own, and servers another one: left to the scheduler, the same pair may take twice as long in one run
# as in the next.


@contextmanager
def private_network() -> Iterator[bool]:
    """Isolate the network of this process and its children; returns False if the system does not allow it."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "peers" / "interop_rclpy"))
    from private_network import PrivateNetwork  # type: ignore[import-not-found]

    try:
        network = PrivateNetwork()
    except OSError:
        yield False
        return
    with network.entered():
        yield True


def rclpy_process(python: str, script: str, *arguments: str, **settings: str) -> Process:
    """Start one of the scripts above."""
    environment = {**os.environ, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", **settings}
    command = [python, "-c", script, *arguments]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)


def rclpy_pairs(python: str, is_alone: bool) -> dict[str, tuple[Start, Start]]:
    """Server and client of each row; each is started with the name of its service."""

    def theirs(script: str, **settings: str) -> Start:
        return lambda name: rclpy_process(python, script, name, str(TURN), **settings)

    def ours(role: str) -> Start:
        return lambda name: child(role, TURN, BENCH_SERVICE=name)

    found = {
        "rclpy to rclpy": (theirs(RCLPY_SERVE), theirs(RCLPY_CALL)),
        "our client": (theirs(RCLPY_SERVE), ours("call")),
        "bare client on Cyclone DDS": (theirs(RCLPY_SERVE), ours("floor_call")),
        "our server": (ours("serve"), theirs(RCLPY_CALL)),
        "bare server on Cyclone DDS": (ours("floor_serve"), theirs(RCLPY_CALL)),
    }
    if is_alone:  # without shared memory, which with the range LOCALHOST cannot be had from rmw_fastrtps
        udp = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        found["rclpy to rclpy by UDP"] = (theirs(RCLPY_SERVE, **udp), theirs(RCLPY_CALL, **udp))
    return found


def on_core(index: int, start: Start, name: str) -> Process:
    """Start a process that stays on one of our cores."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(cores)[index]})
    try:
        return start(name)
    finally:
        os.sched_setaffinity(0, cores)


def p50(client: Process) -> float:
    """Return the median round-trip time of the client in us."""
    assert client.stdout is not None
    found: dict[str, float] = json.loads(client.stdout.readline())
    return found["p50"]


def measure(kinds: dict[str, tuple[Start, Start]], turns: int) -> dict[str, list[float]]:
    """The medians of all turns of each pair."""
    started: list[Process] = []
    clients: dict[str, Process] = {}
    try:
        for number, (kind, (serve, call)) in enumerate(kinds.items()):
            started.append(on_core(-1, serve, f"set_{number}"))
            started.append(on_core(0, call, f"set_{number}"))
            clients[kind] = started[-1]
            p50(started[-1])  # the first turn does not count
        measured: dict[str, list[float]] = {kind: [] for kind in kinds}
        for _ in range(turns):
            # In any order: who comes first finds other caches than who comes last.
            for kind, client in random.sample(list(clients.items()), len(clients)):
                assert client.stdin is not None
                client.stdin.write(f"{TURN}\n")
                client.stdin.flush()
                measured[kind].append(p50(client))
        return measured
    finally:
        for process in started:
            process.kill()
            process.communicate()


def rclpy_rows(python: str, turns: int) -> list[list[str]]:
    """Ours and bare ones as client and as server, beside rclpy as both; a ratio is the median over all turns."""
    with private_network() as is_alone:
        measured = measure(rclpy_pairs(python, is_alone), turns)
    reference = measured.pop("rclpy to rclpy")
    table = [["service call, rclpy to rclpy on Fast DDS, p50", f"{min(reference):.0f} to {max(reference):.0f} us", ""]]
    for kind, times in measured.items():
        ratio = statistics.median(one / other for one, other in zip(times, reference, strict=True))
        found = f"{min(times):.0f} to {max(times):.0f} us, {ratio:.2f}x"
        goal = "<= 0.7x of that" if kind.startswith("our") else ""
        table.append([f"{kind}, p50" if "rclpy" in kind else f"{kind}, the other end rclpy, p50", found, goal])
    return table


def row(name: str, value: str, target: str) -> None:
    """Print a line of the table."""
    print(f"| {name} | {value} | {target} |", flush=True)


def table(quick: bool, rclpy: str | None) -> None:
    """Measure and print."""
    rounds, trips = (3, 2000) if quick else (10, 3000)
    kinds = {"floor": ("floor_pong", "floor_ping"), "callback": ("callback_pong", "callback_ping")}
    kinds |= {"asyncio": ("stream_pong", "stream_ping"), "service": ("serve", "call")}
    styles, loops = ("callback", "asyncio", "service"), {"uvloop": "uvloop", "plain loop": "asyncio"}
    settings = {f"{kind}, {name}": {"BENCH_LOOP": loop} for kind in styles for name, loop in loops.items()}
    settings["callback, three contexts"] = {"BENCH_CONTEXTS": "3"}
    kinds |= {kind: kinds[kind.partition(",")[0]] for kind in settings}
    kinds |= floors.ZENOH_PAIRS if floors.is_on_zenoh() else floors.DDS_PAIRS
    kinds |= {"action": ("goal_server", "goal_client"), "parameter": ("parameter_server", "parameter_setter")}
    measured: dict[str, list[float]] = {kind: [] for kind in kinds}
    for _ in range(rounds):
        for kind, (server, client) in kinds.items():
            count = trips // 4 if kind == "action" else trips
            measured[kind].append(pair(server, client, count, **settings.get(kind, {}))["p50"])
    print("| Figure | Measured | Target |\n|---|---|---|")
    floor = measured["floor"]
    way = "put and recv" if floors.is_on_zenoh() else "WaitSet"
    row(f"floor: bare {way} round trip, String, p50", f"{min(floor):.0f} to {max(floor):.0f} us", "")
    dds_rows = (
        ("loop", "asyncio's own loop, a pipe, a bare writer and reader", "", "floor"),
        ("callback", "callback style beside that", "", "loop"),
    )
    zenoh_rows = (
        ("pipe", "a bare function that writes into a pipe", "", "floor"),
        ("loop", "asyncio's own loop, the pipe, attachments, no node", "", "floor"),
        ("callback", "callback style beside that", "", "loop"),
        ("query", "a bare query and its reply", "", "floor"),
        ("query_loop", "the same with asyncio's own loop at both ends", "", "floor"),
        ("service", "a service call beside that", "", "query_loop"),
    )
    for kind, name, target, base in (
        *(zenoh_rows if floors.is_on_zenoh() else dds_rows),
        ("callback", "round trip, callback style", "1.3x", "floor"),
        ("callback, uvloop", "the same on uvloop", "1.3x", "floor"),
        ("callback, plain loop", "the same by asyncio.run", "1.3x", "floor"),
        ("asyncio", "round trip, asyncio both ends", "1.5x", "floor"),
        ("asyncio, uvloop", "the same on uvloop", "1.5x", "floor"),
        ("asyncio, plain loop", "the same by asyncio.run", "1.5x", "floor"),
        ("service", "service call", "1.7x", "floor"),
        ("service, uvloop", "the same on uvloop", "1.7x", "floor"),
        ("service, plain loop", "the same by asyncio.run", "1.7x", "floor"),
        ("callback, three contexts", "callback style, last of three contexts on a loop", "1.2x", "callback"),
        ("action", "action, goal to result", "4x", "service"),
        ("parameter", "set_parameters of another node", "1.5x", "service"),
    ):
        times = measured[kind]
        ratio = statistics.median(ours / other for ours, other in zip(times, measured[base], strict=True))
        goal = target and f"<= {target} {BASES[base]}"
        row(f"{name}, p50", f"{min(times):.0f} to {max(times):.0f} us, {ratio:.2f}x", goal)
    for cells in rclpy_rows(rclpy, 10 * rounds) if rclpy else ():
        row(*cells)
    paced = pair("count_paced", "send_paced", 3000 if quick else 8000, reporter=0)
    row("CPU per received message at 1 kHz", f"{paced['cpu_us']:.0f} us", "<= 60 us")
    if floors.is_on_zenoh():
        bare = [pair(kind, "bare_send", 3000, reporter=0)["cpu_us"] for kind in ("bare_count", "pipe_count")]
        row("of bare Zenoh, by recv and by the pipe", f"{bare[0]:.0f} and {bare[1]:.0f} us", "")
    flood = pair("count_flood", "send_flood", 50_000 if quick else 200_000, reporter=0)
    row("CPU per received message, flood", f"{flood['cpu_us']:.1f} us at {flood['per_s']:.0f}/s", "<= 15 us")
    if not floors.is_on_zenoh():
        cost = pair("listen_cost", "publish_cost", 0)
        row(
            "publish, 100-byte String",
            f"{cost['ours']:.1f} us = {cost['ours'] / cost['bare']:.2f}x the C calls",
            "<= 3x",
        )
    quiet = figures(child("idle", 5 if quick else 20))
    row("idle node, 20 subscriptions", f"{quiet['percent']:.2f} % CPU, {quiet['threads']:.0f} threads", "<= 0.2 %, 0")
    count = 150 if quick else 900
    images = pair("count_images", "send_images", count, reporter=0)
    whole = f"{images['whole']:.0f} of {count} whole, {images['cpu_ms']:.1f} ms CPU each"
    row("1080p images, 6.2 MB, 30 Hz", whole, "all")
    left = [pair("memory_server", "memory_client", 1000, reporter=end)["grown_mb"] for end in (0, 1)]
    row("left by 1000 action goals, server and client", f"{left[0]:.2f} and {left[1]:.2f} MB", "nothing")
    numbers = start_figures(5)
    row("start of a node, import included", f"{statistics.median(n[0] for n in numbers):.0f} ms", "<= 200 ms")
    row("memory of that node", f"{statistics.median(n[1] for n in numbers):.0f} MB", "<= 60 MB")


ROLES: dict[str, Callable[[int], None]] = {
    **(floors.ZENOH_ROLES if floors.is_on_zenoh() else floors.DDS_ROLES),
    "stream_pong": lambda count: run_node(nodes.stream_pong, "pong"),
    "callback_pong": lambda count: run_node(nodes.callback_pong, "pong"),
    "stream_ping": lambda count: run_node(lambda n, s: nodes.stream_ping(n, s, count), "ping"),
    "callback_ping": lambda count: run_node(lambda n, s: nodes.callback_ping(n, s, count), "ping"),
    "serve": lambda count: run_node(nodes.serve, "server"),
    "call": lambda count: run_node(lambda n, s: nodes.call(n, s, count), "client"),
    "send_paced": lambda count: run_node(lambda n, s: nodes.send_paced(n, s, count), "sender"),
    "count_paced": lambda count: run_node(lambda n, s: nodes.count_paced(n, s, count), "receiver"),
    "send_flood": lambda count: run_node(lambda n, s: nodes.send_flood(n, s, count), "sender"),
    "count_flood": lambda count: run_node(lambda n, s: nodes.count_flood(n, s, count), "receiver"),
    "listen_cost": lambda count: run_node(nodes.listen_cost, "listener"),
    "publish_cost": lambda count: run_node(nodes.publish_cost, "talker"),
    "idle": lambda count: run_node(lambda n, s: nodes.idle(n, s, count), "idle"),
    "goal_server": lambda count: run_node(nodes.goal_server, "server"),
    "goal_client": lambda count: run_node(lambda n, s: nodes.goal_client(n, s, count), "client"),
    "memory_server": lambda count: run_node(lambda n, s: nodes.memory_server(n, s, count), "server"),
    "memory_client": lambda count: run_node(lambda n, s: nodes.memory_client(n, s, count), "client"),
    "parameter_server": lambda count: run_node(nodes.parameter_server, "parameter_server"),
    "parameter_setter": lambda count: run_node(lambda n, s: nodes.parameter_setter(n, s, count), "client"),
    "send_images": lambda count: run_node(lambda n, s: nodes.send_images(n, s, count), "camera"),
    "count_images": lambda count: run_node(lambda n, s: nodes.count_images(n, s, count), "viewer"),
}


def main() -> None:
    """Print the table, or play a role in it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rclpy", metavar="PYTHON")
    parser.add_argument("--transport", choices=["dds", "zenoh"], default="dds")
    parser.add_argument("--role", choices=sorted(ROLES))
    parser.add_argument("--count", type=int, default=0)
    arguments = parser.parse_args()
    sys.argv[1:] = []
    if arguments.role:
        ROLES[arguments.role](arguments.count)
    else:
        with floors.on_zenoh() if arguments.transport == "zenoh" else nullcontext():
            table(arguments.quick, arguments.rclpy)


if __name__ == "__main__":
    main()
