"""What bench/runtime.py needs for Zenoh: a router on loopback, and the floor, a round trip with eclipse-zenoh alone."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from runtime_common import STOP, TEXT, percentile, report


@contextmanager
def on_zenoh() -> Iterator[None]:
    """Child processes use Zenoh, on this machine only, and meet at a router in this process."""
    from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

    with ZenohRouter({}, print, listen=["tcp/127.0.0.1:0"]) as router:
        override = f'connect/endpoints=["{router.endpoints[0]}"];listen/endpoints=["tcp/127.0.0.1:0"]'
        os.environ.update({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": override})
        yield


def is_chosen() -> bool:
    """In a child: whether the figures are those of Zenoh."""
    return os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"


class Floor:
    """Publisher and subscriber of bare Zenoh; samples are handed to the main thread by the wheel's own channel."""

    def __init__(self, write_to: str, read_from: str) -> None:
        import zenoh

        from rosidl_py_gen.runtime.transport.zenoh.config import session_config

        self.session = zenoh.open(session_config(os.environ, print))
        self.publisher: Any = self.session.declare_publisher(write_to)
        self.subscriber: Any = self.session.declare_subscriber(read_from)

    def take(self) -> bytes:
        """Wait for a sample."""
        data: bytes = self.subscriber.recv().payload.to_bytes()
        return data


def floor_pong() -> None:
    """Return every sample until the STOP text."""
    floor = Floor("bench/pong", "bench/ping")
    while (data := floor.take()) != STOP.encode():
        floor.publisher.put(data)
    floor.session.close()


def floor_ping(count: int) -> None:
    """Measure `count` round trips."""
    floor, message = Floor("bench/ping", "bench/pong"), TEXT.encode()
    while not floor.publisher.matching_status.matching:
        time.sleep(0.01)
    time.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        floor.publisher.put(message)
        floor.take()
        times.append((time.perf_counter_ns() - start) / 1000)
    floor.publisher.put(STOP.encode())
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
    floor.session.close()
