"""Service calls between our nodes and those of rclpy on Fast DDS, for bench/runtime.py --rclpy PYTHON.

PYTHON is one that can import rclpy, such as that of an environment of tests/interop_rclpy. All of it runs in a network
of its own, because Fast DDS sends to every interface.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

SERVE = """
import rclpy
from std_srvs.srv import SetBool
rclpy.init()
node = rclpy.create_node("server")
def answer(request, response):
    response.success = request.data
    return response
node.create_service(SetBool, "set", answer)
rclpy.spin(node)
"""
CALL = """
import json, sys, time
import rclpy
from std_srvs.srv import SetBool
rclpy.init()
node = rclpy.create_node("client")
client = node.create_client(SetBool, "set")
assert client.wait_for_service(10)
time.sleep(1)
times = []
async def calls():
    for _ in range(int(sys.argv[1])):
        start = time.perf_counter_ns()
        await client.call_async(SetBool.Request(data=True))
        times.append((time.perf_counter_ns() - start) / 1000)
executor = rclpy.get_global_executor()
executor.add_node(node)
executor.spin_until_future_complete(executor.create_task(calls()))
print(json.dumps({"p50": sorted(times)[len(times) // 2]}), flush=True)
"""
Start = Callable[[int], "subprocess.Popen[str]"]


def private_network() -> AbstractContextManager[Any]:
    """Where this process and its children see nobody else; as it is where the system does not allow that."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "interop_rclpy"))
    from private_network import PrivateNetwork  # type: ignore[import-not-found]

    try:
        return PrivateNetwork().entered()  # type: ignore[no-any-return]
    except OSError:
        return nullcontext()


def rclpy_process(python: str, script: str, *arguments: str) -> subprocess.Popen[str]:
    """One of the scripts above."""
    environment = {**os.environ, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    command = [python, "-c", script, *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def one_round(serve: subprocess.Popen[str], call: subprocess.Popen[str]) -> float:
    """The median of one client's calls, in us."""
    try:
        assert call.stdout is not None
        found: dict[str, float] = json.loads(call.stdout.readline())
        return found["p50"]
    finally:
        for process in (call, serve):
            process.kill()
            process.communicate()


def rows(python: str, rounds: int, count: int, child: Callable[[str, int], subprocess.Popen[str]]) -> list[list[str]]:
    """Ours as client and as server, in turn with rclpy as both; a ratio is the median over rounds."""

    def theirs(script: str) -> Start:
        return lambda calls: rclpy_process(python, script, str(calls))

    ours: dict[str, Start] = {role: lambda calls, role=role: child(role, calls) for role in ("serve", "call")}  # type: ignore[misc]
    kinds = {
        "rclpy to rclpy": (theirs(SERVE), theirs(CALL)),
        "our client": (theirs(SERVE), ours["call"]),
        "our server": (ours["serve"], theirs(CALL)),
    }
    measured: dict[str, list[float]] = {kind: [] for kind in kinds}
    with private_network():
        for _ in range(rounds):
            for kind, (serve, call) in kinds.items():
                measured[kind].append(one_round(serve(count), call(count)))
    reference = measured.pop("rclpy to rclpy")
    table = [["service call, rclpy to rclpy on Fast DDS, p50", f"{min(reference):.0f} to {max(reference):.0f} us", ""]]
    for kind, times in measured.items():
        ratio = statistics.median(one / other for one, other in zip(times, reference, strict=True))
        found = f"{min(times):.0f} to {max(times):.0f} us, {ratio:.2f}x"
        table.append([f"{kind}, the other end rclpy on Fast DDS, p50", found, "<= 0.7x of that"])
    return table
