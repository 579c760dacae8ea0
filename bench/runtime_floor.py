"""The floor of bench/runtime.py: a round trip with cyclonedds-python alone."""

from __future__ import annotations

import os
import time
from typing import Any

from runtime_common import DOMAIN, STOP, TEXT, percentile, report


class Floor:
    """Reader and writer of bare cyclonedds-python, with the QoS of the ROS default profile."""

    def __init__(self, write_to: str, read_from: str) -> None:
        from cyclonedds import _clayer as clayer
        from cyclonedds.core import Policy, Qos, ReadCondition, WaitSet
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from rosidl_py_gen.runtime.node.environment import read_environment
        from rosidl_py_gen.runtime.transport.cyclone.config import cyclone_xml
        from rosidl_py_gen.runtime.transport.cyclone.topics import _DataType

        self.clayer = clayer
        qos = Qos(
            Policy.Reliability.Reliable(max_blocking_time=10**9),
            Policy.History.KeepLast(10),
            Policy.WriterDataLifecycle(autodispose=False),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        kind: Any = _DataType("std_msgs::msg::dds_::String_")
        kind.__idl__.populate = kind.__idl__.fill_type_data = lambda: None
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
