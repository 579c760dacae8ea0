"""A `LoopRunner` beside our own callback style, in one run: round trips, CPU per message, and a main loop that is busy.

Run `python bench/runtime_runner.py` (about a minute), `--quick` for a third of that. Two processes a figure, loopback
only; rounds of both styles alternate, so that both see the same machine, and a ratio is the median over rounds of the
ratio within one. "Polling" waits until something is ready, takes one message and handles it outside the loop, as an
executor does that hands work out.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import runtime_topics as topics
from runtime import figures
from runtime_common import STOP, TEXT, cpu_s, percentile, report, run_node

PERIOD_S = 0.002
WORK_S = 0.0005
SILENCE_S = 3.0
"""All that was sent has come, or was lost."""


def driven(main: Callable[[Any, Any, Any], None], name: str) -> None:
    """Run `main(runner, node, String)`."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.runtime import Context, LoopRunner, Node

    with LoopRunner() as runner, Context(loop_runner=runner) as context:
        main(runner, Node(name, context=context), get_message("std_msgs/msg/String"))


class Poller:
    """Takes one message for each wait."""

    def __init__(self, runner: Any, subscription: Any) -> None:
        self._runner, self._subscription = runner, subscription
        self._ready: list[int] = []
        subscription.on_ready(self._mark)

    def _mark(self) -> None:
        self._ready.append(1)
        self._runner.wake()

    def next(self) -> Any:
        """The next message; None when none came for long."""
        while (message := self._subscription.take()) is None:
            self._ready.clear()
            if not self._runner.wait(lambda: self._ready, SILENCE_S):
                break
        return message


def pong(runner: Any, node: Any, string: Any) -> None:
    """Return every message."""
    publisher, poller = node.create_publisher(string, "pong"), Poller(runner, node.create_subscription(string, "ping"))
    runner.wait(lambda: publisher.subscription_count, 10)
    while (message := poller.next()) is not None and message.data != STOP:
        publisher.publish(message)


def ping(runner: Any, node: Any, string: Any, count: int) -> None:
    """Measure round trips."""
    publisher, subscription = node.create_publisher(string, "ping"), node.create_subscription(string, "pong")
    runner.wait(lambda: publisher.subscription_count and subscription.publisher_count, 10)
    runner.wait(timeout_s=0.2)
    poller, message, times = Poller(runner, subscription), string(data=TEXT), []
    for _ in range(count):
        start = time.perf_counter_ns()
        publisher.publish(message)
        poller.next()
        times.append((time.perf_counter_ns() - start) / 1000)
    publisher.publish(string(data=STOP))
    publisher.wait_for_acknowledged_sync(timeout_s=1)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


def count_paced(runner: Any, node: Any, string: Any, count: int) -> None:
    """Receive at 1 kHz, and report the CPU of each message."""
    subscription = node.create_subscription(string, "paced", qos=10)
    poller = Poller(runner, subscription)
    runner.wait(lambda: subscription.publisher_count, 10)
    poller.next()
    begin, received = cpu_s(), 0
    while received < count - 1 and poller.next() is not None:
        received += 1
    report(cpu_us=(cpu_s() - begin) * 1e6 / received)


def busy(runner: Any, node: Any, string: Any, count: int) -> None:
    """A main loop with 0.5 ms of work and a wait of 0; reports how old messages are, and how many were dropped."""
    subscription, ages = node.create_subscription(string, "paced", qos=10), list[float]()
    last_s = time.perf_counter() + 10
    while len(ages) + subscription.dropped < count and time.perf_counter() < last_s:
        end = time.perf_counter() + WORK_S
        while time.perf_counter() < end:
            pass
        runner.wait(timeout_s=0)
        if (found := subscription.take_with_info()) is not None:
            last_s = time.perf_counter() + SILENCE_S
            ages.append((time.time_ns() - found[1].source_timestamp_ns) / 1e6)
    report(p50=percentile(ages, 0.5), p99=percentile(ages, 0.99), dropped=subscription.dropped)


async def send_slowly(node: Any, string: Any, count: int) -> None:
    """Publish at 500 Hz."""
    import asyncio

    publisher = node.create_publisher(string, "paced")
    await publisher.wait_for_subscribers(timeout_s=10)
    await asyncio.sleep(0.2)
    next_s = time.perf_counter()
    for _ in range(count):
        publisher.publish(string(data=TEXT))
        next_s += PERIOD_S
        await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
    await publisher.wait_for_acknowledged(timeout_s=5)


ROLES: dict[str, Callable[[int], None]] = {
    "pong": lambda count: driven(pong, "pong"),
    "ping": lambda count: driven(lambda d, n, s: ping(d, n, s, count), "ping"),
    "callback_pong": lambda count: run_node(topics.callback_pong, "pong"),
    "callback_ping": lambda count: run_node(lambda n, s: topics.callback_ping(n, s, count), "ping"),
    "send_paced": lambda count: run_node(lambda n, s: topics.send_paced(n, s, count), "sender"),
    "count_callback": lambda count: run_node(lambda n, s: topics.count_paced(n, s, count), "receiver"),
    "count_paced": lambda count: driven(lambda d, n, s: count_paced(d, n, s, count), "receiver"),
    "send_slowly": lambda count: run_node(lambda n, s: send_slowly(n, s, count), "sender"),
    "busy": lambda count: driven(lambda d, n, s: busy(d, n, s, count), "busy"),
}


def pair(server: str, client: str, count: int, reporter: int = 1) -> dict[str, float]:
    """Run two roles of this file against each other; `reporter` says whose figures count."""
    import subprocess

    command = [sys.executable, __file__, "--count", str(count), "--role"]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([*command, role], **pipes) for role in (server, client)]
    try:
        return figures(processes[reporter])
    finally:
        for process in processes:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def ratio(ours: list[float], base: list[float]) -> str:
    """Return the text of two rows."""
    median = statistics.median(one / other for one, other in zip(ours, base, strict=True))
    return f"{min(ours):.0f} to {max(ours):.0f} us, {median:.2f}x"


def table(quick: bool) -> None:
    """Measure and print."""
    rounds, trips = (3, 1500) if quick else (10, 3000)
    trip: dict[str, list[float]] = {"callback": [], "polling": []}
    cpu: dict[str, list[float]] = {"callback": [], "polling": []}
    for _ in range(rounds):
        trip["callback"].append(pair("callback_pong", "callback_ping", trips)["p50"])
        trip["polling"].append(pair("pong", "ping", trips)["p50"])
        cpu["callback"].append(pair("count_callback", "send_paced", trips, reporter=0)["cpu_us"])
        cpu["polling"].append(pair("count_paced", "send_paced", trips, reporter=0)["cpu_us"])
    found = pair("busy", "send_slowly", 2000, reporter=0)
    print("| Figure | Measured | Target |\n|---|---|---|")
    base = trip["callback"]
    print(f"| round trip, callback style, p50 | {min(base):.0f} to {max(base):.0f} us | |")
    print(f"| round trip, polling at both ends, p50 | {ratio(trip['polling'], base)} | <= 1.1x |")
    base = cpu["callback"]
    print(f"| CPU per message at 1 kHz, callback style | {min(base):.0f} to {max(base):.0f} us | |")
    print(f"| CPU per message at 1 kHz, polling | {ratio(cpu['polling'], base)} | |")
    shown = f"p50 {found['p50']:.2f} ms, p99 {found['p99']:.2f} ms, {found['dropped']:.0f} of 2000 dropped"
    print(f"| busy main loop, 500 Hz: age of messages | {shown} | 0 dropped |")


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
