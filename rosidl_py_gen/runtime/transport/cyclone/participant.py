"""Participant of the DDS transport, and the transport that opens it.

Both use plain C calls of Cyclone DDS, with the libddsc that `library.py` finds. Entities are integers. The creator of
an entity deletes it in `close`; nothing depends on the garbage collector.
"""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.transport.api import (
    GUID_PREFIX_BYTES,
    SYSTEM_CLOCKS,
    DiscoveredEndpoint,
    DiscoveryEvent,
    DiscoveryRange,
    DomainSettings,
    EndpointSpec,
    EntityLost,
    NodeEntities,
    SecurityEnclave,
    SecurityError,
    ServiceSpec,
    Sink,
    TransportError,
)
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.discovery import BuiltinTopicReaders
from rosidl_py_gen.runtime.transport.cyclone.domain import Domain, wait_for_others
from rosidl_py_gen.runtime.transport.cyclone.endpoints import (
    CycloneReader,
    CycloneWriter,
    TakeBuffers,
    WakeupPipe,
    endpoint_qos,
    new_qos,
    putw,
)
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsPeers, FastDdsSupport
from rosidl_py_gen.runtime.transport.cyclone.library import DEFAULT_CONFIG, cyclone_xml
from rosidl_py_gen.runtime.transport.cyclone.security import (
    CAPABILITY,
    Governance,
    SecurityLog,
    creation_error,
    denied_error,
    find_plugins,
    security_properties,
)
from rosidl_py_gen.runtime.transport.dds.discovery_info import DISCOVERY_TOPIC, DiscoveryInfoTopic
from rosidl_py_gen.runtime.transport.dds.names import BUFFER_SUFFIX, participant_user_data, wire_name, wire_type
from rosidl_py_gen.runtime.transport.dds.services import DdsClient, DdsServer
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
from rosidl_py_gen.runtime.transport.qos import Durability, Reliability, effective, qos_incompatibility

_MAX_IDLE_TOPICS = 256

LIBRARY = library.find_library()
API = library.CycloneApi(LIBRARY.handle)
"""Functions of the loaded library."""
FAST_DDS_SUPPORT = FastDdsSupport(API, LIBRARY.unsupported_elements)
"""Support of the loaded library for peers on Fast DDS."""
_security_log = SecurityLog(API)


class CycloneTransport:
    """Transport that joins DDS domains; the object has no state."""

    clocks = SYSTEM_CLOCKS
    has_security = True

    def open(self, settings: DomainSettings, enclave: str = "/") -> CycloneParticipant:
        """Join the domain of `settings`; all participants of a process in one domain need the same configuration."""
        return CycloneParticipant(settings, enclave)


def _usable_security(enclave: SecurityEnclave | None) -> SecurityEnclave | None:
    """Return `enclave` if the DDS library supports security; otherwise warn and return None.

    Raises:
        SecurityError: security is enforced, and the library does not support it.
    """
    plugins = find_plugins(LIBRARY) if enclave is not None else {}
    if enclave is None or not isinstance(plugins, str):
        return enclave
    if enclave.is_enforced:
        raise SecurityError(f"ROS_SECURITY_STRATEGY=Enforce requires a secured context, but {plugins}")
    get_root_logger().warning(
        f"ROS_SECURITY_ENABLE=true, but {plugins}. This process communicates unencrypted, and does not find secured "
        "nodes"
    )
    return None


def _configuration(settings: DomainSettings) -> str:
    # With shared memory a payload may be stored outside of the sample. Newer versions disable it by QoS.
    no_shared_memory = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    return cyclone_xml(
        settings,
        process_id=os.getpid(),
        extra=DEFAULT_CONFIG,
        last=no_shared_memory if API.qset_psmx_instances is None else "",
        unsupported=LIBRARY.unsupported_elements,
    )


class CycloneParticipant:
    """Participant of the DDS transport."""

    middleware = "DDS"
    incompatibility_reason = staticmethod(qos_incompatibility)

    def __init__(self, settings: DomainSettings, enclave: str) -> None:
        self.api = API
        self.endpoint_index = EndpointIndex()
        self._entity_numbers = itertools.count(1)
        self._discovery_info: DiscoveryInfoTopic | None = None
        self._ros_distro = settings.ros_distro
        self.domain_id = settings.domain_id
        self._closed = False
        self.is_deleted = False
        """True from the moment at which `close` starts to delete the participant, and with it all remaining endpoints.
        """
        self.deleting: list[int] = []
        """Ids of the threads that are deleting an endpoint of the participant."""
        self._lock = threading.Lock()
        self._topics: dict[tuple[str, str], list[int]] = {}
        self._idle_topics: dict[tuple[str, str], None] = {}
        self.readers: dict[int, CycloneReader] = {}
        """Readers of the participant by entity, the handle that Cyclone writes into `pipe` when the reader has samples.
        """
        self._buffer_writers: dict[bytes, tuple[str, str]] = {}
        """Topics, with their types, for which publishers of Lyrical send messages with unbounded arrays of bytes to a
        second topic.

        The keys are the GUIDs of the writers of the second topic.
        """
        self._buffer_lock = threading.Lock()
        self.buffers = TakeBuffers()
        is_local = settings.discovery_range in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF)
        self._security = security = _usable_security(settings.security)
        self._governance: Governance | None = None
        self._only_data_reason = ""
        """Reason why secured Fast DDS peers do not receive some topics; empty if there is no reason, or if it was
        logged already."""
        with ExitStack() as undo:
            self.pipe = WakeupPipe()
            undo.callback(self.pipe.close)
            folder = "" if security is None else security.folder
            self.domain = Domain.join(API, FAST_DDS_SUPPORT, self.domain_id, _configuration(settings), folder)
            undo.callback(self.domain.leave)
            self.listener: int = API.create_listener(None)
            undo.callback(API.delete_listener, self.listener)
            # Cyclone's threads write the handle of a reader with samples into the pipe, without Python and the GIL.
            API.lset_data_available_arg(self.listener, putw, self.pipe.stream, True)
            self.fast_dds = FastDdsPeers(
                self.domain.fast_dds, self.listener, is_local=is_local, is_secured=security is not None
            )
            undo.callback(self.fast_dds.close)
            self.uses_sample_identity = self.fast_dds.uses_sample_identity
            if security is not None:
                _security_log.open(self._report_soon)
                undo.callback(_security_log.close, self._report_soon)
            self.entity = self._create_participant(participant_user_data(enclave))
            undo.callback(API.delete, self.entity)
            # Permissions concern the name of a topic, and every ROS participant may use this one.
            with self._naming_denied(DISCOVERY_TOPIC, is_writer=True):
                create_topic = partial(self.domain.types.create_topic, self.entity, DISCOVERY_TOPIC)
                self.domain.fast_dds.drop_type_lookups(create_topic)
            self._publisher = API.check(API.create_publisher(self.entity, None, None), "create a publisher")
            self._subscriber = API.check(API.create_subscriber(self.entity, None, None), "create a subscriber")
            self.guid = API.guid_of(self.entity)
            self.fast_dds.start(self.guid)
            self.discovery = BuiltinTopicReaders(
                API, self.entity, self.listener, self.pipe.stream, self.fast_dds, self._new_warnings
            )
            self._undo = undo.pop_all()

    def _create_participant(self, user_data: bytes) -> int:
        security, domain_id = self._security, self.domain_id
        if security is None:
            with new_qos(API, user_data) as qos:
                activity = f"create a participant in domain {domain_id}"
                return API.check(API.create_participant(domain_id, qos, None), activity)
        plugins = find_plugins(LIBRARY)
        assert isinstance(plugins, dict)
        properties = security_properties(security, plugins)
        with new_qos(API, user_data, properties) as qos, _security_log.captured() as lines:
            code: int = API.create_participant(domain_id, qos, None)
        if code < 0:
            raise creation_error(security, domain_id, f"{API.strretcode(code).decode()}, {code}", lines)
        self._governance = Governance(security.folder, domain_id)
        self._only_data_reason = self._governance.only_data_reason()
        return code

    def _report_soon(self) -> None:
        """Make the loop log new texts of the security log soon, by scheduling a call of `BuiltinTopicReaders.report`.

        Called by Cyclone; must not raise, block or log.
        """
        if "discovery" in vars(self):
            putw(self.discovery.entities[0], self.pipe.stream)

    def _new_warnings(self) -> list[str]:
        warnings = self.fast_dds.new_warnings()
        if self._security is None:
            return warnings
        if self._only_data_reason and self.fast_dds.has_secured_peers():
            rule, self._only_data_reason = self._only_data_reason, ""
            warnings.append(f"security: a peer on Fast DDS was found, and {rule}")
        return [*warnings, *_security_log.new_records()]

    @property
    def services_unavailable_reason(self) -> str | None:
        return FAST_DDS_SUPPORT.refusal

    def service_refusal(self, service: ServiceSpec) -> str | None:
        """Return the reason why Fast DDS servers of a service cannot be used; None if they can be used."""
        rule = self._governance and self._governance.only_data_reason(wire_name(service.topic_keys[0]))
        return rule or FAST_DDS_SUPPORT.refusal

    @property
    def library(self) -> str:
        return str(LIBRARY)

    @property
    def capabilities(self) -> dict[str, str]:
        plugins = find_plugins(LIBRARY)
        return {**FAST_DDS_SUPPORT.capabilities(), CAPABILITY: plugins if isinstance(plugins, str) else "yes"}

    def create_writer(self, spec: EndpointSpec) -> CycloneWriter:
        spec = replace(spec, qos=effective(spec.qos, is_writer=True))
        names = wire_name(spec.topic_key), wire_type(spec.type)
        with endpoint_qos(API, spec, is_writer=True) as qos, self._naming_denied(names[0], is_writer=True):
            entity = self._create(API.create_writer, self._publisher, names, qos, None)
        return CycloneWriter(self, entity, *names)

    def create_reader(self, spec: EndpointSpec) -> CycloneReader:
        spec = replace(spec, qos=effective(spec.qos, is_writer=False))
        names = wire_name(spec.topic_key), wire_type(spec.type)
        buffer_spec = spec if spec.has_buffer and spec.qos.durability is Durability.VOLATILE else None
        buffer_names, second = (names[0] + BUFFER_SUFFIX, names[1]), None
        if buffer_spec is not None and names in list(self._buffer_writers.values()):
            # A publisher that has matched the first reader may send to either topic: announce the second one first.
            second = self._create_buffer_reader(spec, buffer_names)
            buffer_spec = None
        try:
            reader = CycloneReader(self, self._create_reader(spec, names), *names, spec.qos)
        except BaseException:
            if second is not None:
                API.delete(second)
                self.release_topic(*buffer_names)
            raise
        if second is not None:
            reader.second = CycloneReader(self, second, *buffer_names, spec.qos, first=reader)
        elif buffer_spec is not None:
            reader.buffer_spec = spec
            if names in list(self._buffer_writers.values()):  # discovered in between
                self.read_buffers(reader)
        return reader

    def _create_reader(self, spec: EndpointSpec, names: tuple[str, str]) -> int:
        with endpoint_qos(API, spec, is_writer=False) as qos, self._naming_denied(names[0], is_writer=False):
            create = partial(self._create, API.create_reader, self._subscriber, names, qos)
            return self.fast_dds.create_reader(create, is_reliable=spec.qos.reliability is Reliability.RELIABLE)

    def _create_buffer_reader(self, spec: EndpointSpec, names: tuple[str, str]) -> int | None:
        """Create a reader of the topic to which publishers of Lyrical send buffers, and return its handle.

        Returns:
            None, with a warning, if the reader cannot be created.
        """
        try:
            return self._create_reader(spec, names)
        except (TransportError, ClosedError) as error:
            if not self._closed:
                get_root_logger().warning(f"messages of publishers of Lyrical may be missing: {error}")
            return None

    def read_buffers(self, reader: CycloneReader) -> None:
        """Create a reader for the second topic of `reader`, unless it exists.

        Publishers of Lyrical send messages with unbounded arrays of bytes (buffers) to the second topic. Each message
        is sent to one of the two topics.
        """
        with self._buffer_lock:
            if reader.second is not None or reader.buffer_spec is None or reader.is_closed:
                return
            names = reader.topic + BUFFER_SUFFIX, reader.type
            entity = self._create_buffer_reader(reader.buffer_spec, names)
            if entity is None:
                reader.buffer_spec = None
                return
            reader.second = second = CycloneReader(self, entity, *names, reader.buffer_spec.qos, first=reader)
        if reader.is_closed:  # meanwhile
            second.close()
        elif second.fetch():
            self.pipe.notify(second.entity)

    def _follow_buffers(self, events: list[DiscoveryEvent]) -> None:
        """Record writers of topics to which publishers of Lyrical send buffers, and create readers of these topics."""
        for event in events:
            if isinstance(event, EntityLost):
                self._buffer_writers.pop(event.guid, None)
            elif isinstance(event, DiscoveredEndpoint) and event.is_writer and event.wire_name.endswith(BUFFER_SUFFIX):
                names = event.wire_name.removesuffix(BUFFER_SUFFIX), event.wire_type
                self._buffer_writers[event.guid] = names
                for reader in list(self.readers.values()):
                    if reader.buffer_spec is not None and (reader.topic, reader.type) == names:
                        self.read_buffers(reader)

    def next_gid(self) -> bytes:
        """Return the GID of a new client or server, the 16 bytes that rmw_get_gid_for_client returns."""
        with self._lock:  # without the GIL, `next` of CPython 3.13 may return a number twice
            return self.guid[:GUID_PREFIX_BYTES] + next(self._entity_numbers).to_bytes(4, "big")

    def create_client(self, service: ServiceSpec) -> DdsClient:
        return DdsClient(self, service)

    def create_server(self, service: ServiceSpec) -> DdsServer:
        return DdsServer(self, service)

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        if self._discovery_info is not None:
            self._discovery_info.announce(nodes)

    @contextmanager
    def _naming_denied(self, topic: str, *, is_writer: bool) -> Iterator[None]:
        """Run a block that creates an endpoint.

        If security denies the endpoint, raise `SecurityError` that names the topic.
        """
        try:
            yield
        except TransportError as error:
            if self._security is None or f"({library.NOT_ALLOWED_BY_SECURITY})" not in str(error):
                raise
            raise denied_error(self._security, topic, is_writer=is_writer) from None

    def _create(
        self, create: Callable[..., int], parent: int, names: tuple[str, str], qos: int, listener: int | None
    ) -> int:
        if self._closed:
            raise ClosedError("this participant is closed")
        handle, (topic, type) = self._acquire_topic(*names), names
        try:
            return API.check(create(parent, handle, qos, listener), f"create an endpoint of {topic} ({type})")
        except BaseException:
            self.release_topic(*names)
            raise

    def _acquire_topic(self, topic: str, type: str) -> int:
        with self._lock:
            entry = self._topics.get((topic, type))
            self._idle_topics.pop((topic, type), None)
            if entry is None:
                handle = self.domain.types.create_topic(self.entity, topic, type)
                entry = self._topics[topic, type] = [handle, 0]
            entry[1] += 1
            return entry[0]

    def release_topic(self, topic: str, type: str) -> None:
        """Release a topic entity after one of its endpoints was deleted.

        Up to `_MAX_IDLE_TOPICS` unused topic entities are cached.
        """
        with self._lock:
            entry = self._topics[topic, type]
            entry[1] -= 1
            if entry[1] == 0:
                # Not deleted at once: Cyclone has crashed when a topic was repeatedly created and deleted during
                # discovery.
                self._idle_topics[topic, type] = None
                if len(self._idle_topics) > _MAX_IDLE_TOPICS:
                    oldest = next(iter(self._idle_topics))
                    del self._idle_topics[oldest]
                    API.delete(self._topics.pop(oldest)[0])

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        def apply(events: list[DiscoveryEvent]) -> None:
            self.endpoint_index.apply(events)
            sink(events)

        lock = self.discovery.report_lock
        self._discovery_info = discovery_info = DiscoveryInfoTopic(self, apply, self._ros_distro, lock)

        def on_events(events: list[DiscoveryEvent]) -> None:
            self.fast_dds.on_events(events, self.readers, self.discovery.guids)
            self._follow_buffers(events)
            discovery_info.forward_events(events)

        self.discovery.sink = on_events
        self.pipe.notify(self.discovery.entities[0])

    def report_discovery(self) -> None:
        self.discovery.report()
        if self._discovery_info is not None:
            self._discovery_info.read()

    def fileno(self) -> int | None:
        return self.pipe.fileno()

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        if notify is not None or self.pipe.fileno() is None:
            self.pipe.read_in_thread(notify)

    def take_ready_sinks(self) -> list[Sink]:
        entities, readers = self.pipe.drain(), self.readers
        if entities is None:  # a handle did not fit into the pipe, so any reader may have samples
            entities = (*self.discovery.entities, *readers)
        sinks: list[Sink] = []
        for entity in entities:
            reader = readers.get(entity)
            if reader is not None:
                if reader.first is not None:  # its samples are in the queue of the first
                    reader = reader.first
                # Whichever comes first moves samples into the queue: this call, or the writing thread if the writer is
                # in this process. So the sink is ready if the queue has samples, even if this take finds none.
                if (reader.fetch() or reader.queue.items) and reader.sink is not None:
                    sinks.append(reader.sink)
            elif entity in self.discovery.entities and self.discovery.report not in sinks:
                sinks.append(self.discovery.report)
        return sinks

    def detach_after_fork(self) -> None:
        self._closed = True
        self.fast_dds.forget()
        Domain.detach_after_fork()

    def close(self) -> None:
        if self._closed:
            return
        if self._discovery_info is not None:
            self._discovery_info.close()
        self._closed = True
        for reader in list(self.readers.values()):
            reader.close()
        # Deleting a builtin reader frees the samples that it has lent, also while a thread reads them
        # (docs/internals/dds.md 9), so the thread must have stopped before.
        self.discovery.stop()
        # Cyclone aborts the process if one thread deletes an endpoint while another one deletes its participant: the
        # first one locks or unlocks the mutex of an entity that the second one has freed. Seen with 11.0.1 in
        # `really_delete_pinned_closed_locked`.
        self.is_deleted = True
        with self._undo:  # also if Ctrl-C was pressed, which is raised after the wait: no later call would delete it
            library.call_with_sigint_deferred(wait_for_others, self.deleting)
