"""Code that the processes of bench/runtime.py share: the DDS domain on loopback, and reports."""

from __future__ import annotations

import asyncio
import json
import os
import resource
import sys
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
