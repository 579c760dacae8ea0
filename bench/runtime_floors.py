"""The floors of bench/runtime.py: round trips with the middleware alone.

The floor of topics on DDS uses cyclonedds-python. A second floor adds asyncio's loop and a pipe to a bare writer and
reader. cyclonedds-python cannot call services of Fast DDS nodes. Their floor uses the writers and readers of
`transport/cyclone` and sends identities, but has no loop, no node and no service. It accepts every reply as its own,
and treats every request as a request of its only client.

Topics on Zenoh have three floors. In the first a channel wakes a waiting thread without Python, which an event loop
cannot use. The second is the least that a loop needs: a Python function that Zenoh calls, and a pipe. The third has a
loop, and the attachments of rmw_zenoh. Queries have two floors; the second has a loop at both ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes as ct
import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from runtime_nodes import DOMAIN, SERVICE, STOP, TEXT, cpu_s, percentile, report

from rosidl_py_gen.runtime.transport.zenoh.wire_formats import pack_attachment, unpack_attachment


class Floor:
    """Reader and writer of bare cyclonedds-python, with the QoS of the ROS default profile."""

    def __init__(self, write_to: str, read_from: str) -> None:
        from cyclonedds import _clayer as clayer
        from cyclonedds.core import Policy, Qos, ReadCondition, WaitSet
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.idl import make_idl_struct
        from cyclonedds.idl.types import uint8
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from rosidl_py_gen.runtime.node.settings import read_environment
        from rosidl_py_gen.runtime.transport.cyclone.library import cyclone_xml

        self.clayer = clayer
        qos = Qos(
            Policy.Reliability.Reliable(max_blocking_time=10**9),
            Policy.History.KeepLast(10),
            Policy.WriterDataLifecycle(autodispose=False),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        kind: Any = make_idl_struct("opaque", "std_msgs::msg::dds_::String_", {"data": uint8})
        xml = cyclone_xml(read_environment(os.environ), process_id=os.getpid())
        self.domain = Domain(int(DOMAIN), xml)
        self.participant = DomainParticipant(int(DOMAIN))
        self.writer: Any = DataWriter(self.participant, Topic(self.participant, write_to, kind), qos=qos)
        self.reader: Any = DataReader(self.participant, Topic(self.participant, read_from, kind), qos=qos)
        self.condition = ReadCondition(self.reader, 127)
        self.waitset = WaitSet(self.participant)
        self.waitset.attach(self.condition)

    def take(self) -> list[bytes]:
        """Wait for samples."""
        self.waitset.wait(10**9)
        taken = self.clayer.ddspy_take(self.condition._ref, 127, 16)
        return [data for data, info in taken if info.valid_data]

    def write(self, data: bytes) -> None:
        """Send a sample."""
        self.clayer.ddspy_write(self.writer._ref, data)


def floor_pong() -> None:
    """Return every sample until one begins with the STOP text."""
    from rosidl_py_gen import get_message

    stop = get_message("std_msgs/msg/String")(data=STOP).encode()  # type: ignore[call-arg]
    floor = Floor("bench_pong", "bench_ping")
    while True:
        for data in floor.take():
            if data.startswith(stop):
                return
            floor.write(data)


def floor_ping(count: int) -> None:
    """Measure `count` round trips and the bare write."""
    from rosidl_py_gen import get_message

    string: Any = get_message("std_msgs/msg/String")
    floor, message = Floor("bench_ping", "bench_pong"), string(data=TEXT).encode()
    while not (floor.writer.get_matched_subscriptions() and floor.reader.get_matched_publications()):
        time.sleep(0.01)
    time.sleep(0.2)
    times = []
    for _ in range(count):
        start = time.perf_counter_ns()
        floor.write(message)
        while not floor.take():
            pass
        times.append((time.perf_counter_ns() - start) / 1000)
    floor.write(string(data=STOP).encode())
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


class LoopFloor:
    """A writer and a reader whose pipe asyncio's own loop watches, and nothing else: what any asyncio program takes."""

    def __init__(self, write_to: str, read_from: str) -> None:
        from rosidl_py_gen.runtime.node.settings import read_environment
        from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
        from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport
        from rosidl_py_gen.runtime.transport.qos import QoSProfile

        self._participant = CycloneTransport().open(read_environment(os.environ))
        kind = "std_msgs::msg::dds_::String_"
        self.writer = self._participant.create_writer(EndpointSpec(TopicKey("unmangled", write_to), kind, QoSProfile()))
        self._reader = self._participant.create_reader(
            EndpointSpec(TopicKey("unmangled", read_from), kind, QoSProfile())
        )
        while not (self.writer.matched_readers() and self._reader.matched_writers()):
            time.sleep(0.01)
        time.sleep(0.2)

    def run(self, receive: Callable[[bytes], object], first: bytes = b"") -> None:
        """Send `first`, and call `receive` with each sample, until it raises `KeyboardInterrupt`."""
        pipe, items, fetch = self._participant.fileno(), self._reader.queue.items, self._reader.fetch
        assert pipe is not None

        def ready() -> None:
            os.read(pipe, 4096)
            fetch()
            while items:
                receive(bytes(items.popleft()[0]))

        loop = asyncio.new_event_loop()
        loop.add_reader(pipe, ready)
        if first:
            self.writer.write(first)
        with contextlib.closing(loop), contextlib.suppress(KeyboardInterrupt):
            loop.run_forever()


def loop_pong() -> None:
    """Return every sample until one begins with the STOP text."""
    from rosidl_py_gen import get_message

    stop = get_message("std_msgs/msg/String")(data=STOP).encode()  # type: ignore[call-arg]
    floor = LoopFloor("bench_pong", "bench_ping")

    def receive(data: bytes) -> None:
        if data.startswith(stop):
            raise KeyboardInterrupt
        floor.writer.write(data)

    floor.run(receive)


def loop_ping(count: int) -> None:
    """Measure `count` round trips."""
    from rosidl_py_gen import get_message

    string: Any = get_message("std_msgs/msg/String")
    floor, message, times, start = LoopFloor("bench_ping", "bench_pong"), string(data=TEXT).encode(), [], 0

    def receive(_: bytes) -> None:
        nonlocal start
        now = time.perf_counter_ns()
        times.append((now - start) / 1000)
        if len(times) > count:
            raise KeyboardInterrupt
        start = time.perf_counter_ns()
        floor.writer.write(message)

    start = time.perf_counter_ns()
    floor.run(receive, message)
    floor.writer.write(string(data=STOP).encode())
    time.sleep(0.1)
    report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))


class ServiceFloor:
    """Client or server of a SetBool service."""

    def __init__(self, *, is_client: bool) -> None:
        from rosidl_py_gen.runtime.node.settings import read_environment
        from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
        from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
        from rosidl_py_gen.runtime.transport.qos import QoSProfile

        if is_client:
            cyclone.FAST_DDS_SUPPORT.refusal = "not needed"  # keeps its functions out of the way
        participant = cyclone.CycloneTransport().open(read_environment(os.environ))
        self.fast_dds: Any = participant.domain.fast_dds
        request, reply = (
            EndpointSpec(TopicKey(kind, f"/{SERVICE}"), f"std_srvs/srv/SetBool_{section}", QoSProfile().keep_all())
            for kind, section in (("request", "Request"), ("reply", "Response"))
        )
        self.reader = participant.create_reader(reply if is_client else request)
        self.writer = participant.create_writer(request if is_client else reply)
        cyclone.API.set_listener(self.reader.entity, None)
        library = cyclone.API.library
        waitset = library.dds_create_waitset(participant.entity)
        condition = library.dds_create_readcondition(self.reader.entity, ct.c_uint32(127))
        library.dds_waitset_attach(waitset, condition, ct.c_void_p(0))
        self._wait, self._arguments = library.dds_waitset_wait, (waitset, None, ct.c_size_t(0), ct.c_int64(10**9))
        while not (self.writer.matched_readers() and self.reader.matched_writers()):
            time.sleep(0.01)
        time.sleep(1)

    def take(self) -> None:
        """Wait for a sample."""
        while not self.reader.fetch():
            self._wait(*self._arguments)
        self.reader.queue.items.popleft()


def floor_call(count: int) -> None:
    """Measure service calls, then as many as each line of stdin says."""
    floor, request = ServiceFloor(is_client=True), b"\0\1\0\0\1\0\0\0"
    while count:
        times = []
        for _ in range(count):
            start = time.perf_counter_ns()
            floor.writer.write(request)
            floor.take()
            times.append((time.perf_counter_ns() - start) / 1000)
        report(p50=percentile(times, 0.5), p99=percentile(times, 0.99))
        count = int(sys.stdin.readline() or 0)


def floor_serve() -> None:
    """Answer requests until it is killed."""
    floor, reply, number = ServiceFloor(is_client=False), b"\0\1\0\0\1\0\0\0\1\0\0\0\0\0\0\0", 0
    client = floor.writer.matched_readers()[0]
    floor.fast_dds.enable_receive_hooks(False)
    floor.fast_dds.enable_receive_hooks = lambda is_enabled: None
    while True:
        floor.take()
        number += 1
        floor.writer.write(reply, (client, number))


# ---------------------------------------------------------------------------------------------------------------- Zenoh


@contextmanager
def on_zenoh() -> Iterator[None]:
    """Child processes use Zenoh, on this machine only, and meet at a router in this process."""
    from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

    with ZenohRouter({}, print, listen=["tcp/127.0.0.1:0"]) as router:
        override = f'connect/endpoints=["{router.endpoints[0]}"];listen/endpoints=["tcp/127.0.0.1:0"]'
        os.environ.update({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": override})
        yield


def is_on_zenoh() -> bool:
    """Return True in a child process that measures Zenoh."""
    return os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"


class ZenohFloor:
    """Publisher and subscriber of bare Zenoh; samples are handed to the main thread by the wheel's own channel."""

    def __init__(self, write_to: str, read_from: str) -> None:
        import zenoh

        from rosidl_py_gen.runtime.transport.zenoh.participant import session_config

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
        """Wait until a subscriber matches."""
        while not self.publisher.matching_status.matching:
            time.sleep(0.01)
        time.sleep(0.2)


class ZenohPipeFloor(ZenohFloor):
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


class ZenohLoopFloor(ZenohFloor):
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
        with contextlib.suppress(KeyboardInterrupt):
            loop.run_forever()


def attachment() -> bytes:
    """Return the attachment of a sample of rmw_zenoh."""
    return pack_attachment(1, time.time_ns(), bytes(16))


def content(thing: Any) -> bytes:
    """Return the payload of a sample or query, whose attachment must be valid."""
    unpack_attachment(thing.attachment.to_bytes())
    data: bytes = thing.payload.to_bytes()
    return data


def zenoh_loop_pong() -> None:
    """Return every sample until the STOP text."""
    floor = ZenohLoopFloor("bench/pong", "bench/ping")

    def receive(sample: Any) -> None:
        data = content(sample)
        if data == STOP.encode():
            raise KeyboardInterrupt
        floor.publisher.put(data, attachment=attachment())

    floor.run(receive)
    floor.session.close()


def query_loop_pong() -> None:
    """Answer every query until the STOP text."""
    floor = ZenohLoopFloor("bench/pong", "bench/ping")
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


def zenoh_loop_ping(count: int, *, queries: bool = False) -> None:
    """Measure `count` round trips, or queries."""
    floor, message, times, start = ZenohLoopFloor("bench/ping", "bench/pong"), TEXT.encode(), [], 0
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


def zenoh_floor_pong(kind: type[ZenohFloor] = ZenohFloor) -> None:
    """Return every sample until the STOP text."""
    floor = kind("bench/pong", "bench/ping")
    while (data := floor.take()) != STOP.encode():
        floor.publisher.put(data)
    floor.session.close()


def zenoh_floor_ping(count: int, kind: type[ZenohFloor] = ZenohFloor) -> None:
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
    floor = ZenohFloor("bench/pong", "bench/ping")
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
    floor = ZenohFloor("bench/ping", "bench/pong")
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


def zenoh_send(count: int) -> None:
    """Put at 1 kHz."""
    floor = ZenohFloor("bench/paced", "bench/nothing")
    floor.wait_for_peer()
    next_time = time.perf_counter()
    for _ in range(count):
        floor.publisher.put(TEXT.encode())
        next_time += 0.001
        time.sleep(max(0.0, next_time - time.perf_counter()))
    floor.publisher.put(STOP.encode())
    time.sleep(0.2)
    floor.session.close()


def zenoh_count(count: int, kind: type[ZenohFloor]) -> None:
    """CPU of this process for each sample."""
    floor = kind("bench/nothing", "bench/paced")
    floor.take()
    used = cpu_s()
    while floor.take() != STOP.encode():
        pass
    report(cpu_us=(cpu_s() - used) / count * 1e6)
    floor.session.close()


DDS_PAIRS = {"loop": ("loop_pong", "loop_ping")}
"""Round trips, in the order of `runtime.pair`."""
DDS_ROLES: dict[str, Callable[[int], None]] = {
    "floor_pong": lambda count: floor_pong(),
    "floor_ping": floor_ping,
    "loop_pong": lambda count: loop_pong(),
    "loop_ping": loop_ping,
    "floor_serve": lambda count: floor_serve(),
    "floor_call": floor_call,
}
ZENOH_PAIRS = {
    "pipe": ("pipe_pong", "pipe_ping"),
    "query": ("query_pong", "query_ping"),
    "loop": ("loop_pong", "loop_ping"),
    "query_loop": ("query_loop_pong", "query_loop_ping"),
}
ZENOH_ROLES: dict[str, Callable[[int], None]] = {
    "floor_pong": lambda count: zenoh_floor_pong(),
    "floor_ping": zenoh_floor_ping,
    "pipe_pong": lambda count: zenoh_floor_pong(ZenohPipeFloor),
    "pipe_ping": lambda count: zenoh_floor_ping(count, ZenohPipeFloor),
    "query_pong": lambda count: query_pong(),
    "query_ping": query_ping,
    "loop_pong": lambda count: zenoh_loop_pong(),
    "loop_ping": zenoh_loop_ping,
    "query_loop_pong": lambda count: query_loop_pong(),
    "query_loop_ping": partial(zenoh_loop_ping, queries=True),
    "bare_send": zenoh_send,
    "bare_count": lambda count: zenoh_count(count, ZenohFloor),
    "pipe_count": lambda count: zenoh_count(count, ZenohPipeFloor),
}
