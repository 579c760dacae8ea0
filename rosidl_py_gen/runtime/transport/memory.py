"""A transport inside one process: the same behaviour as DDS, without network, threads or waiting.

For tests of programs that use this package, and for our own. A `MemoryTransport` is a little world: contexts that were
given the same one see each other. Delivery happens inside `write`, in the order of creation of the readers, so a test
gives the same result every time. Matching, KEEP_LAST, transient-local history, lifespan and discovery follow the rules
of DDS; deadlines and leases do not exist, because nobody here can die without saying so.
"""

from __future__ import annotations

import itertools
import threading
from collections import deque
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.clocks import SYSTEM_CLOCKS
from rosidl_py_gen.runtime.transport.dds.names import channel_of
from rosidl_py_gen.runtime.transport.dds.participant import DdsParticipant, reaches
from rosidl_py_gen.runtime.transport.discovered import EndpointFound, Lost, ParticipantFound
from rosidl_py_gen.runtime.transport.matching import check_compatible
from rosidl_py_gen.runtime.transport.port import ReceiveQueue, identified, in_fours
from rosidl_py_gen.runtime.transport.qos import Durability, History, effective
from rosidl_py_gen.runtime.transport.type_names import ros_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.clocks import Clocks
    from rosidl_py_gen.runtime.transport.dds.participant import DdsEndpoint
    from rosidl_py_gen.runtime.transport.discovered import DiscoveryEvent
    from rosidl_py_gen.runtime.transport.port import DomainSettings, Identity, Payload, Sample, Sink

_VENDOR = b"\x01\x10"
"""Cyclone's vendor id, so that nothing treats our endpoints as foreign ones."""
_WORLDS = itertools.count(1)


class MemoryTransport:
    """One world; give it to `Context(transport=...)` of every node that shall take part.

    Args:
        clocks: what time it is in this world.

    Example:
        >>> world = MemoryTransport()
        >>> talker = Node("talker", context=Context(transport=world))  # doctest: +SKIP
    """

    def __init__(self, clocks: Clocks = SYSTEM_CLOCKS) -> None:
        self.clocks = clocks
        self._lock = threading.RLock()
        self._number = next(_WORLDS)
        self._counter = itertools.count(1)
        self._domains: dict[int, list[MemoryParticipant]] = {}

    def open(self, settings: DomainSettings, enclave: str = "/") -> MemoryParticipant:
        """Join a domain of this world."""
        with self._lock:
            number = next(self._counter)
            prefix = _VENDOR + bytes(2) + self._number.to_bytes(4, "big") + number.to_bytes(4, "big")
            peers = self._domains.setdefault(settings.domain_id, [])
            participant = MemoryParticipant(self._lock, peers, prefix, enclave, self._counter, self.clocks)
            peers.append(participant)
            for peer in peers:
                peer.tell(ParticipantFound(participant.guid, enclave))
            return participant


class MemoryParticipant(DdsParticipant):
    """A member of a `MemoryTransport`; see `port.Participant`."""

    identity_refusal: str | None = None

    def __init__(
        self,
        lock: threading.RLock,
        peers: list[MemoryParticipant],
        prefix: bytes,
        enclave: str,
        counter: itertools.count[int],
        clocks: Clocks,
    ) -> None:
        super().__init__()
        self.time_ns = clocks.system_ns
        self.lock = lock
        self.peers = peers
        self.prefix = prefix
        self.guid = prefix + b"\x00\x00\x01\xc1"
        self.enclave = enclave
        self.counter = counter
        self.writers: list[MemoryWriter] = []
        self.readers: list[MemoryReader] = []
        self.closed = False
        self._notify: Callable[[], None] | None = None
        self._ready: dict[Sink, None] = {}
        self._events: list[DiscoveryEvent] = []
        self._discovery_sink: Callable[[list[DiscoveryEvent]], None] | None = None

    # ------------------------------------------------------------------------------------------------ endpoints

    def make_writer(self, end: DdsEndpoint) -> MemoryWriter:
        with self.lock:
            writer = MemoryWriter(self, self._found(end, is_writer=True))
            self.writers.append(writer)
            self._announce(writer.info)
            return writer

    def make_reader(self, end: DdsEndpoint) -> MemoryReader:
        with self.lock:
            reader = MemoryReader(self, self._found(end, is_writer=False), end.ignore_local)
            self.readers.append(reader)
            self._announce(reader.info)
            for peer in self.peers:
                for writer in peer.writers:
                    if matches(writer, reader):
                        writer.replay(reader)
            return reader

    def _found(self, end: DdsEndpoint, *, is_writer: bool) -> EndpointFound:
        return EndpointFound(
            self._next_guid(b"\x03" if is_writer else b"\x04"),
            self.guid,
            is_writer,
            channel_of(end.topic),
            ros_type(end.type),
            effective(end.qos, is_writer=is_writer),
            end.type_hash,
            end.service_id or end.client_id,
            wire_name=end.topic,
            wire_type=end.type,
        )

    def _next_guid(self, kind: bytes) -> bytes:
        if self.closed:
            raise ClosedError("this participant is closed")
        return self.prefix + next(self.counter).to_bytes(3, "big") + kind

    # ------------------------------------------------------------------------------------------------ discovery

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        with self.lock:
            self._discovery_sink = self.listen_for_nodes(sink)
            self._events.clear()
            for peer in self.peers:
                self._events.append(ParticipantFound(peer.guid, peer.enclave))
                self._events += [endpoint.info for endpoint in (*peer.writers, *peer.readers)]
            self.ready(self._report)

    def tell(self, event: DiscoveryEvent) -> None:
        """Report one event; nothing is kept while nobody listens."""
        if self._discovery_sink is not None:
            self._events.append(event)
            self.ready(self._report)

    def report_discovery(self) -> None:
        self._report()
        self.read_nodes()

    def _report(self) -> None:
        with self.lock:
            events, self._events = self._events, []
        if events and self._discovery_sink is not None:
            self._discovery_sink(events)

    def _announce(self, event: DiscoveryEvent) -> None:
        for peer in self.peers:
            peer.tell(event)

    def forget(self, endpoint: MemoryWriter | MemoryReader) -> None:
        """Remove an endpoint that was closed."""
        with self.lock:
            if isinstance(endpoint, MemoryWriter):
                self.writers.remove(endpoint)
            else:
                self.readers.remove(endpoint)
            self._announce(Lost(endpoint.guid))

    # -------------------------------------------------------------------------------------------------- waiting

    def set_notify(self, notify: Callable[[], None] | None) -> None:
        self._notify = notify
        if notify is not None and self._ready:
            notify()

    def ready(self, sink: Sink) -> None:
        """Note that `sink` has something to do."""
        self._ready[sink] = None
        if self._notify is not None:
            self._notify()

    def fileno(self) -> None:
        """Nothing to watch: whoever writes, notifies."""

    def collect(self) -> list[Sink]:
        with self.lock:
            ready = list(self._ready)
            self._ready.clear()
            return ready

    def abandon(self) -> None:
        """See `port.Participant`; a copy of memory harms nobody."""

    def close(self) -> None:
        with self.lock:
            if self.closed:
                return
            self.forget_nodes()
            for endpoint in (*self.writers, *self.readers):
                endpoint.close()
            self.closed = True
            self._discovery_sink = None
            self._ready.clear()
            self.peers.remove(self)
            self._announce(Lost(self.guid))


class _Endpoint:
    def __init__(self, owner: MemoryParticipant, info: EndpointFound) -> None:
        self.owner = owner
        self.guid = info.guid
        self.qos = info.qos
        self.closed = False
        self.info = info

    def close(self) -> None:
        """Delete it; may be called twice."""
        if not self.closed:
            self.closed = True
            self.owner.forget(self)  # type: ignore[arg-type]  # only the two subclasses exist


class MemoryWriter(_Endpoint):
    """See `port.Writer`."""

    def __init__(self, owner: MemoryParticipant, info: EndpointFound) -> None:
        super().__init__(owner, info)
        qos = info.qos
        self.handle = int.from_bytes(info.guid[8:], "big")  # `MemoryReader.writer_guid` is the way back
        keeps = qos.durability is Durability.TRANSIENT_LOCAL
        depth = (None if qos.history is History.KEEP_ALL else max(1, qos.depth)) if keeps else 0
        self._history: deque[Sample] = deque(maxlen=depth)

    def write(self, data: Payload, identity: Identity | None = None, timeout_s: float | None = None) -> bool:
        if self.closed:
            raise ClosedError("this writer is closed")
        now = self.owner.time_ns()
        sample = (in_fours(data if identity is None else identified(data, identity)), now, self.handle, now)
        with self.owner.lock:
            self._history.append(sample)
            for peer in self.owner.peers:
                for reader in peer.readers:
                    if matches(self, reader):
                        reader.receive(sample)
        return True

    def replay(self, reader: MemoryReader) -> None:
        """Give a late joiner what is still kept and has not expired."""
        if reader.qos.durability is not Durability.TRANSIENT_LOCAL:
            return
        oldest = self.owner.time_ns() - (self.qos.lifespan_ns)
        for sample in self._history:
            if sample[1] >= oldest:
                reader.receive(sample)

    def has_readers(self) -> bool:
        return bool(self.matched_readers())

    def matched_readers(self) -> list[bytes]:
        with self.owner.lock:
            return [reader.guid for peer in self.owner.peers for reader in peer.readers if matches(self, reader)]

    def forget(self, number: int) -> None:
        """Nothing is kept of requests."""

    def reaches(self, client: bytes) -> bool:
        return reaches(client, self.matched_readers)

    def all_acknowledged(self) -> bool:
        """Delivery is immediate."""
        return True

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def assert_liveliness(self) -> None:
        """Nobody can die here."""


class MemoryReader(_Endpoint):
    """See `port.Reader`."""

    def __init__(self, owner: MemoryParticipant, info: EndpointFound, ignore_local: bool) -> None:
        super().__init__(owner, info)
        self.queue = ReceiveQueue(info.qos)
        self.ignore_local = ignore_local
        self._sink: Sink | None = None

    def receive(self, sample: Sample) -> None:
        """Take a sample into the queue."""
        self.queue.push(sample)
        if self._sink is not None:
            self.owner.ready(self._sink)

    def set_sink(self, sink: Sink | None) -> None:
        with self.owner.lock:
            self._sink = sink
            if sink is not None and self.queue.items:
                self.owner.ready(sink)

    def fetch(self) -> bool:
        """Everything is in the queue already."""
        return bool(self.queue.items)

    def matched_writers(self) -> list[bytes]:
        with self.owner.lock:
            return [writer.guid for peer in self.owner.peers for writer in peer.writers if matches(writer, self)]

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def writer_guid(self, handle: int) -> bytes | None:
        """See `port.Reader`. All GUIDs of one world begin alike, and the rest is the handle."""
        return self.guid[:8] + handle.to_bytes(8, "big")


def matches(writer: MemoryWriter, reader: MemoryReader) -> bool:
    """Whether DDS would connect the two: names equal, QoS compatible, not told to ignore each other."""
    if reader.ignore_local and writer.owner is reader.owner:
        return False
    same = writer.info.channel == reader.info.channel and writer.info.type == reader.info.type
    return same and check_compatible(writer.qos, reader.qos).matches
