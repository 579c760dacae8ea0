"""Time of rosidl-py commands from the start of Python to its end: python bench/commands.py [--runs N].

A node of another process publishes ten times a second, serves a service and has a parameter. The peer is started once;
the commands take turns, so that a busy machine slows all of them alike. Prints the median, the fastest and the slowest.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import statistics
import subprocess
import sys
from time import monotonic

COMMANDS = {
    "--help": ("--help",),
    "topic echo --help": ("topic", "echo", "--help"),
    "topic list": ("topic", "list"),
    "topic echo --once": ("topic", "echo", "/bench", "--once"),
    "param get": ("param", "get", "/bench_peer", "rate"),
    "service call": ("service", "call", "/bench_add", "example_interfaces/srv/AddTwoInts", "{a: 1, b: 2}"),
    "interface show": ("interface", "show", "geometry_msgs/msg/PoseStamped"),
    "interface hash": ("interface", "hash", "std_msgs/msg/String"),
    "graph": ("graph",),
    "doctor": ("doctor",),
}
DOMAIN = "217"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--peer", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ.update(ROS_DOMAIN_ID=DOMAIN, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    if arguments.peer:
        serve()
        return
    peer = subprocess.Popen([sys.executable, __file__, "--peer"], stdout=subprocess.PIPE)
    try:
        assert peer.stdout is not None and peer.stdout.readline() == b"READY\n"
        times: dict[str, list[float]] = {name: [] for name in COMMANDS}
        for _ in range(arguments.runs):
            for name, words in COMMANDS.items():
                times[name].append(timed(words))
    finally:
        peer.terminate()
        peer.wait()
    for name, found in times.items():
        print(f"{name:20} {statistics.median(found):6.2f} s  ({min(found):.2f} to {max(found):.2f})")


def timed(words: tuple[str, ...]) -> float:
    """Seconds of one run, which has to end well."""
    began = monotonic()
    done = subprocess.run([sys.executable, "-m", "rosidl_py_gen.ros_cli", *words], capture_output=True, text=True)
    seconds = monotonic() - began
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(words)} ended with {done.returncode}: {done.stderr}")
    return seconds


def serve() -> None:
    """The peer."""
    from rosidl_py_gen import get_message, get_service
    from rosidl_py_gen.runtime import Node, run

    text, add = get_message("std_msgs/msg/String"), get_service("example_interfaces/srv/AddTwoInts")

    async def main() -> None:
        async with Node("bench_peer") as node:
            node.declare_parameter("rate", 10.0)
            node.create_service(add, "/bench_add", lambda request: add.Response(sum=request.a + request.b))
            publisher = node.create_publisher(text, "/bench")
            print("READY", flush=True)
            while True:
                publisher.publish(text(data="hello"))
                await asyncio.sleep(0.1)

    run(main)


if __name__ == "__main__":
    main()
