"""The DDS transport: Cyclone DDS through plain C calls, on the libddsc that `library.py` finds.

Decides how entities are made, waited for, read and deleted. What stands for the types is in `topics.py`; the C
functions are in `functions.py`, QoS in `qos.py`, services of Fast DDS in `fast_dds`.

Rules a newcomer would otherwise break:

- Entities are integers. Whoever creates one deletes it in `close`; nothing depends on the garbage collector.
- A write never blocks: max_blocking_time is 0 and a full writer answers False.
- Samples are taken into the reader's own queue by whoever comes first: the thread that calls `take_ready_sinks`, or,
for writers
  of this process, the writing thread itself. Cyclone delivers inside the process during the write, so taking at once
  makes KEEP_LAST and `dropped` exact there, whatever the event loop is busy with.
- Whoever has something to do is told by the pipe, and by nothing else: a reader that was named and whose queue is not
  empty, no matter who filled it.
"""

from __future__ import annotations

import os
import threading
from collections import defaultdict
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import DiscoveryRange
from rosidl_py_gen.runtime.transport.clock_functions import SYSTEM_CLOCKS
from rosidl_py_gen.runtime.transport.cyclone import c_api, library
from rosidl_py_gen.runtime.transport.cyclone.config import DEFAULT_CONFIG, IGNORE_TYPE_INFORMATION, cyclone_xml
from rosidl_py_gen.runtime.transport.cyclone.discovery import BuiltinTopicReaders
from rosidl_py_gen.runtime.transport.cyclone.domain import Domain
from rosidl_py_gen.runtime.transport.cyclone.endpoints import CycloneReader, CycloneWriter, TakeBuffers
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.early_acknack import request_endpoints, request_samples
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.early_samples import EarlySampleReaders
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import PROBE_TYPE, FastDdsInterop
from rosidl_py_gen.runtime.transport.cyclone.qos import endpoint_qos, new_qos
from rosidl_py_gen.runtime.transport.cyclone.wakeup_pipe import WakeupPipe, putw
from rosidl_py_gen.runtime.transport.dds.names import participant_user_data
from rosidl_py_gen.runtime.transport.dds.participant import DdsParticipant
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
from rosidl_py_gen.runtime.transport.qos import Reliability, effective

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.api import DomainSettings
    from rosidl_py_gen.runtime.transport.cyclone.topics import Sertype
    from rosidl_py_gen.runtime.transport.dds.participant import DdsEndpoint
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent
    from rosidl_py_gen.runtime.transport.samples import Sink

_MAX_IDLE_TOPICS = 256
_MATCH_DELAY_S = 0.002
"""Cyclone connects a writer some 50 us after it has told of it, longer when it is held up, and says nothing of that.
After 10 ms it asks in its own way, which counts as the question.
"""


_library = library.find()
_api = c_api.CycloneApi(_library.handle)
_fast_dds = FastDdsInterop(_api, _library.unsupported_elements)


class CycloneTransport:
    """Joins DDS domains; see `port.Transport`. Stateless."""

    clocks = SYSTEM_CLOCKS

    def open(self, settings: DomainSettings, enclave: str = "/") -> CycloneParticipant:
        """Join the domain, which all participants of a process configure alike; see `domain.py`."""
        xml = cyclone_xml(
            settings,
            process_id=os.getpid(),
            extra=DEFAULT_CONFIG,
            last=_without_shared_memory(),
            lacks=_library.unsupported_elements,
        )
        is_local = settings.discovery_range in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF)
        return CycloneParticipant(settings.domain_id, participant_user_data(enclave), xml, is_local=is_local)


# --------------------------------------------------------------------------------------------------------- participant


class CycloneParticipant(DdsParticipant):
    """See `port.Participant`."""

    def __init__(self, domain_id: int, user_data: bytes, xml: str, *, is_local: bool) -> None:
        super().__init__(_fast_dds)
        self.api = _api
        self.domain_id = domain_id
        self._closed = False
        self._lock = threading.Lock()
        self._topics: dict[tuple[str, str], list[int]] = {}
        self._idle_topics: dict[tuple[str, str], None] = {}
        self.readers: dict[int, CycloneReader] = {}
        """By their entities: those that `take_ready_sinks` looks at when `pipe` names them."""
        self.buffers = TakeBuffers()
        self._is_local = is_local
        with ExitStack() as undo:
            self.pipe = WakeupPipe()
            undo.callback(self.pipe.close)
            self.domain = Domain.join(_api, _fast_dds, domain_id, xml)
            undo.callback(self.domain.leave)
            self._listener: int = _api.create_listener(None)
            undo.callback(_api.delete_listener, self._listener)
            _api.lset_data_available_arg(self._listener, putw, self.pipe.stream, True)
            self._early = EarlySampleReaders(_api, _fast_dds, self._listener)
            undo.callback(self._early.close)
            with new_qos(_api, user_data) as qos:
                what = f"create a participant in domain {domain_id}"
                self.entity = _api.check(_api.create_participant(domain_id, qos, None), what)
            undo.callback(_api.delete, self.entity)
            if IGNORE_TYPE_INFORMATION in _library.unsupported_elements:  # before anybody answers
                self.domain.types.create_topic(self.entity, PROBE_TYPE, PROBE_TYPE)
            self._publisher = _api.check(_api.create_publisher(self.entity, None, None), "create a publisher")
            self._subscriber = _api.check(_api.create_subscriber(self.entity, None, None), "create a subscriber")
            self.guid = _api.guid_of(self.entity)
            self.discovery = BuiltinTopicReaders(
                *(_api, _fast_dds, self.entity, self._listener, self.pipe.stream),
                greet=partial(request_endpoints, self.guid, is_local=is_local),
            )
            self._early.probe_layout(self.discovery.entities[0])
            self._undo = undo.pop_all()

    @property
    def library(self) -> str:
        """See `port.Participant`."""
        return str(_library)

    @property
    def capabilities(self) -> dict[str, str]:
        """See `port.Participant`."""
        _ = self.fast_dds.slots  # which decides about services
        return self.fast_dds.capabilities()

    # ------------------------------------------------------------------------------------------------ endpoints

    def make_writer(self, end: DdsEndpoint) -> CycloneWriter:
        end = replace(end, qos=effective(end.qos, is_writer=True))
        with endpoint_qos(_api, end, is_writer=True) as cqos:
            entity = self._create(_api.create_writer, self._publisher, end, cqos, None)
        return CycloneWriter(self, entity, end)

    def make_reader(self, end: DdsEndpoint) -> CycloneReader:
        end = replace(end, qos=effective(end.qos, is_writer=False))
        with endpoint_qos(_api, end, is_writer=False) as cqos:
            create = partial(self._create, _api.create_reader, self._subscriber, end, cqos)
            entity = self._early.create_reader(create, is_reliable=end.qos.reliability is Reliability.RELIABLE)
        return CycloneReader(self, entity, end)

    def _create(self, create: Callable[..., int], parent: int, end: DdsEndpoint, qos: int, listener: int | None) -> int:
        if self._closed:
            raise ClosedError("this participant is closed")
        handle = self._acquire_topic(end.topic, end.type)
        try:
            return _api.check(create(parent, handle, qos, listener), f"create an endpoint of {end.topic} ({end.type})")
        except BaseException:
            self.release_topic(end.topic, end.type)
            raise

    def _acquire_topic(self, topic: str, type: str) -> int:
        with self._lock:
            held = self._topics.get((topic, type))
            self._idle_topics.pop((topic, type), None)
            if held is None:
                handle = self.domain.types.create_topic(self.entity, topic, type)
                held = self._topics[topic, type] = [handle, 0]
            held[1] += 1
            return held[0]

    def type_object(self, type: str) -> Sertype:
        """What stands for a type that has endpoints."""
        return self.domain.types[type]

    def release_topic(self, topic: str, type: str) -> None:
        """Give back what `_acquire_topic` took.

        Topics without users are kept for the next one, up to a number: creating and deleting the same topic over and
        over beside discovery is where the library was once seen to crash.
        """
        with self._lock:
            held = self._topics[topic, type]
            held[1] -= 1
            if held[1] == 0:
                self._idle_topics[topic, type] = None
                if len(self._idle_topics) > _MAX_IDLE_TOPICS:
                    oldest = next(iter(self._idle_topics))
                    del self._idle_topics[oldest]
                    _api.delete(self._topics.pop(oldest)[0])

    # ------------------------------------------------------------------------------------------------- arrivals

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        pass_on = self.start_discovery_info(sink)

        def take(events: list[DiscoveryEvent]) -> None:
            self._schedule_sample_request(events)
            pass_on(events)

        self.discovery.sink = take
        self.pipe.notify(self.discovery.entities[0])

    def _schedule_sample_request(self, events: list[DiscoveryEvent]) -> None:
        """Those on Fast DDS are asked what they have written, when Cyclone has had time to connect them."""
        new = [
            event
            for event in events
            if isinstance(event, DiscoveredEndpoint)
            and event.is_writer
            and event.qos.reliability is Reliability.RELIABLE
            and self.discovery.fast_dds_addresses(event.guid)
        ]
        loop = current_loop()
        if new and loop is not None:
            loop.call_later(_MATCH_DELAY_S, self._request_samples, new)

    def _request_samples(self, writers: list[DiscoveredEndpoint]) -> None:
        readers: defaultdict[tuple[str, str], list[bytes]] = defaultdict(list)
        for reader in list(self.readers.values()):
            if reader.is_reliable:
                readers[reader.topic, reader.type].append(reader.guid)
        asked: defaultdict[str, list[tuple[bytes, bytes]]] = defaultdict(list)
        for writer in writers:
            told = self.discovery.fast_dds_addresses(writer.guid)
            if told is not None:  # it may be gone
                asked[told] += [(guid, writer.guid) for guid in readers.get((writer.wire_name, writer.wire_type), ())]
        for told, pairs in asked.items():
            request_samples(pairs, told, is_local=self._is_local)

    def report_discovery(self) -> None:
        self.discovery.report()
        self.read_discovery_info()

    def fileno(self) -> int | None:
        return self.pipe.fileno()

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        if notify is not None or self.pipe.fileno() is None:
            self.pipe.read_in_thread(notify)

    def take_ready_sinks(self) -> list[Sink]:
        named, readers = self.pipe.drain(), self.readers
        if named is None:
            named = (*self.discovery.entities, *readers)
        sinks: list[Sink] = []
        for entity in named:
            reader = readers.get(entity)
            if reader is not None:
                if (reader.fetch() or reader.queue.items) and reader.sink is not None:
                    sinks.append(reader.sink)
            elif entity in self.discovery.entities and self.discovery.report not in sinks:
                sinks.append(self.discovery.report)
        return sinks

    def detach_after_fork(self) -> None:
        self._closed = True
        Domain.detach_after_fork()

    def close(self) -> None:
        if self._closed:
            return
        self.stop_discovery_info()
        self._closed = True
        for reader in list(self.readers.values()):
            reader.close()
        self.discovery.stop()
        self._undo.close()
        self.discovery.close()


def _without_shared_memory() -> str:
    """Bytes of a sample may lie elsewhere then; versions that do not have this element are told by QoS."""
    return "" if _api.qset_psmx_instances is not None else "<SharedMemory><Enable>false</Enable></SharedMemory>"
