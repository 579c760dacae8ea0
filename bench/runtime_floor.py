"""The floor of bench/runtime.py: round trips with Cyclone DDS alone.

Topics use cyclonedds-python; a second floor is asyncio's loop and a pipe beside a bare writer and reader. Services of
Fast DDS nodes are beyond that, so that their floor uses writers, readers and the sending of identities of
`transport/cyclone`, but no loop, no node and no service: it takes any reply for its own, and any request for that of
the one client there is, and looks into no packet.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes as ct
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from runtime_common import DOMAIN, SERVICE, STOP, TEXT, percentile, report


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

        from rosidl_py_gen.runtime.node.environment import read_environment
        from rosidl_py_gen.runtime.transport.cyclone.config import cyclone_xml

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
        from rosidl_py_gen.runtime.node.environment import read_environment
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
        from rosidl_py_gen.runtime.node.environment import read_environment
        from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
        from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
        from rosidl_py_gen.runtime.transport.qos import QoSProfile

        self.fast_dds = cyclone._fast_dds
        if is_client:
            self.fast_dds.refusal = "not needed"  # keeps its functions out of the way
        participant = cyclone.CycloneTransport().open(read_environment(os.environ))
        request, reply = (
            EndpointSpec(TopicKey(kind, f"/{SERVICE}"), f"std_srvs/srv/SetBool_{section}", QoSProfile().keep_all())
            for kind, section in (("request", "Request"), ("reply", "Response"))
        )
        self.reader = participant.create_reader(reply if is_client else request)
        self.writer = participant.create_writer(request if is_client else reply)
        cyclone._api.set_listener(self.reader.entity, None)
        library = cyclone._api.library
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
    floor.fast_dds._enable_receive_hooks(False)
    floor.fast_dds._enable_receive_hooks = lambda is_enabled: None
    while True:
        floor.take()
        number += 1
        floor.writer.write(reply, (client, number))


PAIRS = {"loop": ("loop_pong", "loop_ping")}
"""Round trips, in the order of `runtime.pair`."""
ROLES: dict[str, Callable[[int], None]] = {
    "loop_pong": lambda count: loop_pong(),
    "loop_ping": loop_ping,
    "floor_serve": lambda count: floor_serve(),
    "floor_call": floor_call,
}
