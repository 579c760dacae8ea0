"""Zenoh for bench/runtime.py: a router on loopback, and the floors, round trips with eclipse-zenoh alone.

There are three for topics. A channel wakes a thread that waits in it without Python, which an event loop cannot do; the
least that a loop needs is a Python function that Zenoh calls, and a pipe; the third is a loop, and the attachments of
rmw_zenoh. Queries have two floors of their own, the second again with a loop at both ends.
"""

from __future__ import annotations

import asyncio
import os
import select
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

from runtime_common import STOP, TEXT, cpu_s, percentile, report

from rosidl_py_gen.runtime.transport.zenoh.wire_formats import pack_attachment, unpack_attachment


@contextmanager
def on_zenoh() -> Iterator[None]:
    """Child processes use Zenoh, on this machine only, and meet at a router in this process."""
    from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

    with ZenohRouter({}, print, listen=["tcp/127.0.0.1:0"]) as router:
        override = f'connect/endpoints=["{router.endpoints[0]}"];listen/endpoints=["tcp/127.0.0.1:0"]'
        os.environ.update({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": override})
        yield


def is_chosen() -> bool:
    """Return True in a child process that measures Zenoh."""
    return os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"


class Floor:
    """Publisher and subscriber of bare Zenoh; samples are handed to the main thread by the wheel's own channel."""

    def __init__(self, write_to: str, read_from: str) -> None:
        import zenoh

        from rosidl_py_gen.runtime.transport.zenoh.config import session_config

        self.session = zenoh.open(session_config(os.environ, print))
        self.publisher: Any = self.session.declare_publisher(write_to)
        self.subscriber: Any = self._subscribe(read_from)

    def _subscribe(self, key: str) -> Any:
        return self.session.declare_subscriber(key)

    def take(self) -> bytes:
        """Wait for a sample."""
        data: bytes = self.subscriber.recv().payload.to_bytes()
        return data

    def wait_for_peer(self) -> None:
        """Until somebody receives what is put."""
        while not self.publisher.matching_status.matching:
            time.sleep(0.01)
        time.sleep(0.2)


class PipeFloor(Floor):
    """The same as an event loop needs it: Zenoh calls a function, which writes into a pipe that is waited for."""

    def _subscribe(self, key: str) -> Any:
        from zenoh.handlers import Callback

        reading, writing = os.pipe()
        self._samples: deque[Any] = deque()
        self._read = partial(os.read, reading, 64)
        self._poll = select.epoll()
        self._poll.register(reading, select.EPOLLIN)

        def call(sample: Any) -> None:
            self._samples.append(sample)
            os.write(writing, b"\0")

        return self.session.declare_subscriber(key, Callback(call, indirect=False))

    def take(self) -> bytes:
        """Wait for a sample."""
        while not self._samples:
            self._poll.poll()
            self._read()
        data: bytes = self._samples.popleft().payload.to_bytes()
        return data


class LoopFloor(Floor):
    """The same with asyncio's own loop in place of a thread that waits, and with the attachment of rmw_zenoh: what any
    asyncio program takes.
    """

    def _subscribe(self, key: str) -> Any:
        self._pipe = os.pipe()
        self._things: deque[Any] = deque()
        return self.session.declare_subscriber(key, self.handler())

    def handler(self) -> Any:
        """Puts what Zenoh hands over where `run` takes it from."""
        from zenoh.handlers import Callback

        def call(thing: Any) -> None:
            self._things.append(thing)
            os.write(self._pipe[1], b"\0")

        return Callback(call, indirect=False)

    def run(self, receive: Callable[[Any], object], start: Callable[[], object] | None = None) -> None:
        """Call `start`, and `receive` with each thing, until it raises `KeyboardInterrupt`."""
        reading, things = self._pipe[0], self._things

        def ready() -> None:
            os.read(reading, 64)
            while things:
                receive(things.popleft())

        loop = asyncio.new_event_loop()
        loop.add_reader(reading, ready)
        if start is not None:
            start()
        with suppress(KeyboardInterrupt):
            loop.run_forever()


def attachment() -> bytes:
    """Return the attachment of a sample of rmw_zenoh."""
    return pack_attachment(1, time.time_ns(), bytes(16))


def content(thing: Any) -> bytes:
    """Return the payload of a sample or query, whose attachment must be valid."""
    unpack_attachment(thing.attachment.to_bytes())
    data: bytes = thing.payload.to_bytes()
    return data


def loop_pong() -> None:
    """Return every sample until the STOP text."""
    floor = LoopFloor("bench/pong", "bench/ping")

    def receive(sample: Any) -> None:
        data = content(sample)
        if data == STOP.encode():
            raise KeyboardInterrupt
        floor.publisher.put(data, attachment=attachment())

    floor.run(receive)
    floor.session.close()


def query_loop_pong() -> None:
    """Answer every query until the STOP text."""
    floor = LoopFloor("bench/pong", "bench/ping")
    server = floor.session.declare_queryable("bench/query", floor.handler(), complete=True)

    def receive(query: Any) -> None:
        data = content(query)
        query.reply("bench/query", data, attachment=attachment())
        query.drop()
        if data == STOP.encode():
            raise KeyboardInterrupt

    floor.run(receive)
    time.sleep(0.1)
    server.undeclare()
    floor.session.close()


def loop_ping(count: int, *, queries: bool = False) -> None:
    """Measure `count` round trips, or queries."""
    floor, message, times, start = LoopFloor("bench/ping", "bench/pong"), TEXT.encode(), [], 0
    handler = floor.handler

    def send(data: bytes = message) -> None:
        nonlocal start
        start = time.perf_counter_ns()
        if queries:
            floor.session.get("bench/query", handler(), payload=data, attachment=attachment())
        else:
            floor.publisher.put(data, attachment=attachment())

    def receive(thing: Any) -> None:
        content(thing.ok if queries else thing)
        times.append((time.perf_counter_ns() - start) / 1000)
        if len(times) > count:
            raise KeyboardInterrupt
        send()

    if queries:
        client = floor.session.declare_querier("bench/query")
        while not client.matching_status.matching:
            time.sleep(0.01)
        time.sleep(0.2)
    else:
        floor.wait_for_peer()
    floor.run(receive, send)
    send(STOP.encode())
    time.sleep(0.2)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
    floor.session.close()


def floor_pong(kind: type[Floor] = Floor) -> None:
    """Return every sample until the STOP text."""
    floor = kind("bench/pong", "bench/ping")
    while (data := floor.take()) != STOP.encode():
        floor.publisher.put(data)
    floor.session.close()


def floor_ping(count: int, kind: type[Floor] = Floor) -> None:
    """Measure `count` round trips."""
    floor, message = kind("bench/ping", "bench/pong"), TEXT.encode()
    floor.wait_for_peer()
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        floor.publisher.put(message)
        floor.take()
        times.append((time.perf_counter_ns() - start) / 1000)
    floor.publisher.put(STOP.encode())
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
    floor.session.close()


def query_pong() -> None:
    """Answer every query until the STOP text."""
    floor = Floor("bench/pong", "bench/ping")
    server = floor.session.declare_queryable("bench/query", complete=True)
    data = b""
    while data != STOP.encode():
        query = server.recv()
        data = query.payload.to_bytes()
        query.reply("bench/query", data)
        query.drop()
    time.sleep(0.1)
    floor.session.close()


def query_ping(count: int) -> None:
    """Measure `count` queries."""
    floor = Floor("bench/ping", "bench/pong")
    client = floor.session.declare_querier("bench/query")
    while not client.matching_status.matching:
        time.sleep(0.01)
    time.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        client.get(payload=TEXT.encode()).recv()
        times.append((time.perf_counter_ns() - start) / 1000)
    client.get(payload=STOP.encode()).recv()
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
    floor.session.close()


def send_paced(count: int) -> None:
    """Put at 1 kHz."""
    floor = Floor("bench/paced", "bench/nothing")
    floor.wait_for_peer()
    next_time = time.perf_counter()
    for _ in range(count):
        floor.publisher.put(TEXT.encode())
        next_time += 0.001
        time.sleep(max(0.0, next_time - time.perf_counter()))
    floor.publisher.put(STOP.encode())
    time.sleep(0.2)
    floor.session.close()


def count_paced(count: int, kind: type[Floor]) -> None:
    """CPU of this process for each sample."""
    floor = kind("bench/nothing", "bench/paced")
    floor.take()
    used = cpu_s()
    while floor.take() != STOP.encode():
        pass
    report(cpu_us=(cpu_s() - used) / count * 1e6)
    floor.session.close()


PAIRS = {
    "pipe": ("pipe_pong", "pipe_ping"),
    "query": ("query_pong", "query_ping"),
    "loop": ("loop_pong", "loop_ping"),
    "query_loop": ("query_loop_pong", "query_loop_ping"),
}
"""Round trips, in the order of `runtime.pair`."""
ROLES: dict[str, Callable[[int], None]] = {
    "pipe_pong": lambda count: floor_pong(PipeFloor),
    "pipe_ping": lambda count: floor_ping(count, PipeFloor),
    "query_pong": lambda count: query_pong(),
    "query_ping": query_ping,
    "loop_pong": lambda count: loop_pong(),
    "loop_ping": loop_ping,
    "query_loop_pong": lambda count: query_loop_pong(),
    "query_loop_ping": partial(loop_ping, queries=True),
    "bare_send": send_paced,
    "bare_count": lambda count: count_paced(count, Floor),
    "pipe_count": lambda count: count_paced(count, PipeFloor),
}
