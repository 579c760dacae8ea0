"""Service calls between our nodes and those of rclpy on Fast DDS, for bench/runtime.py --rclpy PYTHON.

PYTHON is one that can import rclpy, such as that of an environment of tests/interop_rclpy. All of it runs in a network
of its own, because Fast DDS sends to every interface. All pairs of client and server are there at once, each with a
service of its own, and take turns of a hundred calls, so that they see the same machine. Clients have a core of their
own, and servers another one: left to the scheduler, the same pair may take twice as long in one run as in the next.
"""

from __future__ import annotations

import json
import os
import random
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

SERVE = """
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
CALL = """
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


@contextmanager
def private_network() -> Iterator[bool]:
    """Isolate the network of this process and its children; returns False if the system does not allow it."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "interop_rclpy"))
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


def pairs(python: str, child: Callable[..., Process], is_alone: bool) -> dict[str, tuple[Start, Start]]:
    """Server and client of each row; each is started with the name of its service."""

    def theirs(script: str, **settings: str) -> Start:
        return lambda name: rclpy_process(python, script, name, str(TURN), **settings)

    def ours(role: str) -> Start:
        return lambda name: child(role, TURN, BENCH_SERVICE=name)

    found = {
        "rclpy to rclpy": (theirs(SERVE), theirs(CALL)),
        "our client": (theirs(SERVE), ours("call")),
        "bare client on Cyclone DDS": (theirs(SERVE), ours("floor_call")),
        "our server": (ours("serve"), theirs(CALL)),
        "bare server on Cyclone DDS": (ours("floor_serve"), theirs(CALL)),
    }
    if is_alone:  # without shared memory, which with the range LOCALHOST cannot be had from rmw_fastrtps
        udp = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        found["rclpy to rclpy by UDP"] = (theirs(SERVE, **udp), theirs(CALL, **udp))
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


def rows(python: str, turns: int, child: Callable[..., Process]) -> list[list[str]]:
    """Ours and bare ones as client and as server, beside rclpy as both; a ratio is the median over all turns."""
    with private_network() as is_alone:
        measured = measure(pairs(python, child, is_alone), turns)
    reference = measured.pop("rclpy to rclpy")
    table = [["service call, rclpy to rclpy on Fast DDS, p50", f"{min(reference):.0f} to {max(reference):.0f} us", ""]]
    for kind, times in measured.items():
        ratio = statistics.median(one / other for one, other in zip(times, reference, strict=True))
        found = f"{min(times):.0f} to {max(times):.0f} us, {ratio:.2f}x"
        goal = "<= 0.7x of that" if kind.startswith("our") else ""
        table.append([f"{kind}, p50" if "rclpy" in kind else f"{kind}, the other end rclpy, p50", found, goal])
    return table
