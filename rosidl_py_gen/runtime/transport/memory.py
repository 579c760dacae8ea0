"""Transport inside one process, with the behaviour of DDS but without network, threads and delays.

For tests of programs that use this package, and of this package itself. Contexts with the same `MemoryTransport`
discover each other. `write` delivers to the readers in the order of their creation, so each run gives the same result.
Matching, KEEP_LAST, transient-local history, lifespan and discovery follow the rules of DDS. Deadlines and leases do
not exist, because no participant can disappear without closing.
"""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import (
    SYSTEM_CLOCKS,
    ClockFunctions,
    DiscoveredEndpoint,
    DiscoveryEvent,
    DomainSettings,
    EndpointSpec,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    Payload,
    ReceiveQueue,
    Sample,
    ServiceSpec,
    Sink,
    pad_to_4_bytes,
)
from rosidl_py_gen.runtime.transport.dds.services import DdsClient, DdsServer, SampleIdentity, embed_identity
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
from rosidl_py_gen.runtime.transport.middleware_threads import ReadyItems
from rosidl_py_gen.runtime.transport.qos import Durability, History, check_compatible, effective, qos_incompatibility

_VENDOR = b"\x01\x10"
"""Vendor id of Cyclone DDS, which endpoints in memory have so that no rules for other vendors apply to them."""
_TRANSPORT_NUMBERS = itertools.count(1)
_transport_lock = threading.Lock()


class MemoryTransport:
    """In-process transport; pass it to `Context(transport=...)` of every node that must communicate.

    Args:
        clocks: clock functions of all nodes that use the transport; None: the clocks of this machine.

    Example:
        >>> transport = MemoryTransport()
        >>> talker = Node("talker", context=Context(transport=transport))  # doctest: +SKIP
    """

    def __init__(self, clocks: ClockFunctions | None = None) -> None:
        self.clocks = clocks or SYSTEM_CLOCKS
        self._lock = threading.RLock()
        self._counter = itertools.count(1)
        with _transport_lock:
            self._number = next(_TRANSPORT_NUMBERS)
        self._domains: dict[int, list[MemoryParticipant]] = {}

    def open(self, settings: DomainSettings, enclave: str = "/") -> MemoryParticipant:
        with self._lock:
            prefix = _VENDOR + bytes(2) + self._number.to_bytes(4, "big") + next(self._counter).to_bytes(4, "big")
            peers = self._domains.setdefault(settings.domain_id, [])
            participant = MemoryParticipant(self, peers, prefix, enclave)
            peers.append(participant)
            for peer in peers:
                peer.report(ParticipantDiscovered(participant.guid, enclave))
            return participant


class MemoryParticipant:
    """Participant of a `MemoryTransport`."""

    middleware = "memory"
    library = ""
    capabilities: Mapping[str, str] = MappingProxyType({})
    services_unavailable_reason: str | None = None
    incompatibility_reason = staticmethod(qos_incompatibility)

    def __init__(self, transport: MemoryTransport, peers: list[MemoryParticipant], prefix: bytes, enclave: str) -> None:
        self.time_ns = transport.clocks.system_ns
        self.lock = transport._lock
        self.peers = peers
        self.prefix = prefix
        self.guid = prefix + b"\x00\x00\x01\xc1"
        self.enclave = enclave
        self.counter = transport._counter
        self.writers: dict[bytes, MemoryWriter] = {}
        self.readers: dict[bytes, MemoryReader] = {}
        self.endpoint_index = EndpointIndex()
        self.nodes: tuple[NodeEntities, ...] = ()
        self.closed = False
        self._ready_sinks: ReadyItems[Sink] = ReadyItems(has_pipe=False)
        self.mark_ready, self.set_wakeup = self._ready_sinks.put, self._ready_sinks.set_wakeup
        self.take_ready_sinks, self.fileno = self._ready_sinks.take, self._ready_sinks.fileno
        self._events: list[DiscoveryEvent] = []
        self._report_lock = threading.RLock()
        """Lock that is held until the sink has applied the events: without a running loop, several threads report."""
        self._discovery_sink: Callable[[list[DiscoveryEvent]], None] | None = None

    def create_writer(self, spec: EndpointSpec) -> MemoryWriter:
        with self.lock:
            writer = MemoryWriter(self, self._info(spec, is_writer=True))
            self.writers[writer.guid] = writer
            self._report_to_all(writer.info)
            return writer

    def create_reader(self, spec: EndpointSpec) -> MemoryReader:
        with self.lock:
            reader = MemoryReader(self, self._info(spec, is_writer=False), spec.ignore_local)
            self.readers[reader.guid] = reader
            self._report_to_all(reader.info)
            for peer in self.peers:
                for writer in peer.writers.values():
                    if matches(writer, reader):
                        writer.replay(reader)
            return reader

    def create_client(self, service: ServiceSpec) -> DdsClient:
        return DdsClient(self, service)

    def create_server(self, service: ServiceSpec) -> DdsServer:
        return DdsServer(self, service)

    def next_gid(self) -> bytes:
        return self._next_guid(b"\xc5")

    def service_refusal(self, service: ServiceSpec) -> str | None:
        return None

    def uses_sample_identity(self, guid: bytes) -> bool:
        return False

    def _info(self, spec: EndpointSpec, *, is_writer: bool) -> DiscoveredEndpoint:
        guid, qos = self._next_guid(b"\x03" if is_writer else b"\x04"), effective(spec.qos, is_writer=is_writer)
        service, wire = (spec.service_id or spec.client_id, spec.service_hash), (spec.topic_key.name, spec.type)
        ids = guid, self.guid, is_writer
        return DiscoveredEndpoint(*ids, spec.topic_key, spec.type, qos, spec.type_hash, *service, *wire)

    def _next_guid(self, kind: bytes) -> bytes:
        if self.closed:
            raise ClosedError("this participant is closed")
        with self.lock:  # without the GIL, `next` of CPython 3.13 may return a number twice
            return self.prefix + next(self.counter).to_bytes(3, "big") + kind

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        with self.lock:
            self._discovery_sink = sink
            self._events.clear()
            for peer in self.peers:
                self._events.append(ParticipantDiscovered(peer.guid, peer.enclave))
                self._events += [endpoint.info for endpoint in (*peer.writers.values(), *peer.readers.values())]
                if peer.nodes:
                    self._events.append(NodesAnnounced(peer.guid, peer.nodes))
            self.mark_ready(self.report_discovery)

    def report(self, event: DiscoveryEvent) -> None:
        """Queue an event for the discovery sink; drop the event if there is no discovery sink."""
        if self._discovery_sink is not None:
            self._events.append(event)
            self.mark_ready(self.report_discovery)

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        with self.lock:
            self.nodes = tuple(nodes.values())
            for peer in self.peers:
                if peer is not self:
                    peer.report(NodesAnnounced(self.guid, self.nodes))

    def report_discovery(self) -> None:
        with self._report_lock:
            with self.lock:
                events, self._events = self._events, []
            sink = self._discovery_sink  # another thread may close the participant
            if events and sink is not None:
                self.endpoint_index.apply(events)
                sink(events)

    def _report_to_all(self, event: DiscoveryEvent) -> None:
        for peer in self.peers:
            peer.report(event)

    def unregister(self, guid: bytes) -> None:
        """Remove an endpoint that was closed, and report its loss to all participants of the domain."""
        with self.lock:
            self.writers.pop(guid, None)
            self.readers.pop(guid, None)
            self._report_to_all(EntityLost(guid))

    def detach_after_fork(self) -> None:
        """Do nothing: in a forked child, the copy of the participant's memory is harmless."""

    def close(self) -> None:
        with self.lock:
            if self.closed:
                return
            for endpoint in (*self.writers.values(), *self.readers.values()):
                endpoint.close()
            self.closed = True
            self._discovery_sink = None
            self._ready_sinks.close()
            self.peers.remove(self)
            self._report_to_all(EntityLost(self.guid))


class _MemoryEndpoint:
    def __init__(self, owner: MemoryParticipant, info: DiscoveredEndpoint) -> None:
        self.owner = owner
        self.guid = info.guid
        self.qos = info.qos
        self.closed = False
        self.info = info

    def close(self) -> None:
        """Delete the endpoint. May be called twice."""
        with self.owner.lock:
            if not self.closed:
                self.closed = True
                self.owner.unregister(self.guid)


class MemoryWriter(_MemoryEndpoint):
    """Writer of a `MemoryTransport`."""

    def __init__(self, owner: MemoryParticipant, info: DiscoveredEndpoint) -> None:
        super().__init__(owner, info)
        qos = info.qos
        self.handle = int.from_bytes(info.guid[8:], "big")  # `MemoryReader.writer_guid` is the inverse
        depth: int | None = 0
        if qos.durability is Durability.TRANSIENT_LOCAL:
            depth = None if qos.history is History.KEEP_ALL else max(1, qos.depth)
        self._history: deque[Sample] = deque(maxlen=depth)
        self._numbers = itertools.count(1)

    def write(self, data: Payload, identity: SampleIdentity | None = None) -> bool:
        if self.closed:
            raise ClosedError("this writer is closed")
        payload = pad_to_4_bytes(data if identity is None else embed_identity(data, identity))
        now = self.owner.time_ns()
        with self.owner.lock:
            sample = (payload, now, self.handle, now, next(self._numbers))
            self._history.append(sample)
            for peer in self.owner.peers:
                for reader in peer.readers.values():
                    if matches(self, reader):
                        reader.receive(sample)
        return True

    def replay(self, reader: MemoryReader) -> None:
        """Deliver the retained samples that have not expired to a new transient local reader."""
        if reader.qos.durability is not Durability.TRANSIENT_LOCAL:
            return
        oldest = self.owner.time_ns() - self.qos.lifespan_ns
        for sample in self._history:
            if sample[1] >= oldest:
                reader.receive(sample)

    def has_readers(self) -> bool:
        return bool(self.matched_readers())

    def matched_readers(self) -> list[bytes]:
        with self.owner.lock:
            readers = (reader for peer in self.owner.peers for reader in peer.readers.values())
            return [reader.guid for reader in readers if matches(self, reader)]

    def all_acknowledged(self) -> bool:
        return True  # delivery is immediate

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def assert_liveliness(self) -> None:
        """Do nothing: a publisher in memory cannot lose its liveliness."""


class MemoryReader(_MemoryEndpoint):
    """Reader of a `MemoryTransport`."""

    def __init__(self, owner: MemoryParticipant, info: DiscoveredEndpoint, ignore_local: bool) -> None:
        super().__init__(owner, info)
        self.queue = ReceiveQueue(info.qos)
        self.ignore_local = ignore_local
        self._sink: Sink | None = None

    def receive(self, sample: Sample) -> None:
        """Add a sample to the queue, and mark the reader's sink as ready."""
        self.queue.push(sample)
        if self._sink is not None:
            self.owner.mark_ready(self._sink)

    def set_sink(self, sink: Sink | None) -> None:
        with self.owner.lock:
            self._sink = sink
            if sink is not None and self.queue.items:
                self.owner.mark_ready(sink)

    def fetch(self) -> bool:
        return bool(self.queue.items)  # samples are delivered into the queue

    def matched_writers(self) -> list[bytes]:
        with self.owner.lock:
            writers = (writer for peer in self.owner.peers for writer in peer.writers.values())
            return [writer.guid for writer in writers if matches(writer, self)]

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def writer_guid(self, handle: int) -> bytes | None:
        # All GUIDs of one transport have the same first half; the handle is the second.
        return self.guid[:8] + handle.to_bytes(8, "big")


def matches(writer: MemoryWriter, reader: MemoryReader) -> bool:
    """Return True if DDS would match two endpoints.

    Topic and type must be equal, the QoS compatible, and `ignore_local` must not exclude the writer.
    """
    if reader.ignore_local and writer.owner is reader.owner:
        return False
    has_same_names = writer.info.topic_key == reader.info.topic_key and writer.info.type == reader.info.type
    return has_same_names and check_compatible(writer.qos, reader.qos).matches
