"""The parts of bench/runtime.py that concern actions and parameters: what each of its processes does."""

from __future__ import annotations

import asyncio
import gc
import sys
import time
from typing import Any

from runtime_common import percentile, report, rss_mb

WARM_UP = 1000
KEPT_S = 0.2


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
