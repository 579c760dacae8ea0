"""The DDS transport: Cyclone DDS through the `cyclonedds` wheel. The only file that imports it.

Decides how entities are made, waited for, read and deleted. What stands for the types is in `topics.py` and
`types.py`; the C functions are in `abi.py`, QoS in `qos.py`, services
of Fast DDS in `fastdds.py`.

Rules a newcomer would otherwise break:

- Entities are integers. Whoever creates one deletes it in `close`; nothing depends on the garbage collector.
- A write never blocks: max_blocking_time is 0 and a full writer answers False.
- Samples are taken into the reader's own queue by whoever comes first: the waiting thread, or, for writers of this
  process, the writing thread itself. Cyclone delivers inside the process during the write, so taking at once makes
  KEEP_LAST and `dropped` exact there, whatever the event loop is busy with.
"""

from __future__ import annotations

import ctypes as ct
import sys
import threading
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.cyclone import abi
from rosidl_py_gen.runtime.transport.cyclone.discovery import DiscoveryReaders
from rosidl_py_gen.runtime.transport.cyclone.domain import Domain
from rosidl_py_gen.runtime.transport.cyclone.endpoints import CycloneReader, CycloneWriter, TakeBuffers
from rosidl_py_gen.runtime.transport.cyclone.fastdds import FastDds
from rosidl_py_gen.runtime.transport.cyclone.qos import endpoint_qos, participant_qos
from rosidl_py_gen.runtime.transport.interface import BackendMissingError, ReceiveQueue, effective

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from rosidl_py_gen.runtime.transport.interface import DiscoveryEvent, Sink
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

_MAX_WOKEN = 256
_WOKEN_SIZE = ct.c_size_t(_MAX_WOKEN)
_int64 = ct.c_int64
_MAX_IDLE_TOPICS = 256
_GUARD = 0


def _load() -> tuple[ModuleType, ct.CDLL]:
    """The C extension and the C library of the wheel, without the rest of the package.

    ``import cyclonedds`` runs its whole IDL and QoS machinery, 50 ms of which we use nothing. So the package is entered
    without running its ``__init__``, and taken out of `sys.modules` again: whoever imports it later gets all of it,
    with the two modules loaded here.
    """
    if "cyclonedds" not in sys.modules:
        spec = find_spec("cyclonedds")
        if spec is None:
            raise ModuleNotFoundError("No module named 'cyclonedds'")
        sys.modules["cyclonedds"] = module_from_spec(spec)
        try:
            return import_module("cyclonedds._clayer"), import_module("cyclonedds.internal").DDS._dll_handle
        finally:
            del sys.modules["cyclonedds"]
    return import_module("cyclonedds._clayer"), import_module("cyclonedds.internal").DDS._dll_handle


try:
    _clayer, _library = _load()
except ImportError as err:
    raise BackendMissingError(
        "the node runtime needs Cyclone DDS: pip install 'rosidl-py-gen[node]'. Wheels of cyclonedds exist for CPython "
        "3.10 to 3.13 on Linux (x86-64, glibc), macOS and Windows (x86-64); MemoryTransport works without it. "
        f"The import failed with: {err}"
    ) from err
_api = abi.Api(_library)
_wait = _api.bare_wait
_fast_dds = FastDds(_library)


class CycloneTransport:
    """Joins DDS domains; see `transport.Transport`. Stateless."""

    def open(self, domain_id: int, user_data: bytes, *, cyclone_xml: str) -> CycloneParticipant:
        """Join `domain_id`, which all participants of a process configure alike; see `domain.py`."""
        return CycloneParticipant(domain_id, user_data, cyclone_xml)


# --------------------------------------------------------------------------------------------------------- participant


class CycloneParticipant:
    """See `transport.Participant`."""

    must_wait = True

    def __init__(self, domain_id: int, user_data: bytes, xml: str) -> None:
        self.api = _api
        self.fast_dds = _fast_dds
        self.domain_id = domain_id
        self._domain = Domain.join(_api, _fast_dds, domain_id, xml)
        self._closed = False
        self._lock = threading.Lock()
        self._topics: dict[tuple[str, str], list[int]] = {}
        self._idle_topics: dict[tuple[str, str], None] = {}
        self._ready: dict[Sink, None] = {}
        self._notify: Callable[[], None] | None = None
        self._sources: dict[int, CycloneReader] = {}
        self._next_source = _GUARD + 1
        self._woken = (ct.c_ssize_t * _MAX_WOKEN)()
        self.buffers = TakeBuffers()
        self.big_endian: set[bytes] = set()
        try:
            with participant_qos(_api, user_data) as qos:
                what = f"create a participant in domain {domain_id}"
                self.entity = _api.check(_api.create_participant(domain_id, qos, None), what)
            self._publisher = _api.check(_api.create_publisher(self.entity, None, None), "create a publisher")
            self._subscriber = _api.check(_api.create_subscriber(self.entity, None, None), "create a subscriber")
            self._waitset = _api.check(_api.create_waitset(self.entity), "create a waitset")
            self._guard = _api.check(_api.create_guardcondition(self.entity), "create a guard condition")
            _api.check(_api.waitset_attach(self._waitset, self._guard, _GUARD), "attach the guard condition")
        except BaseException:
            if hasattr(self, "entity"):
                _api.delete(self.entity)
            self._domain.leave()
            raise
        self.guid = self.guid_of(self.entity)
        self.discovery = DiscoveryReaders(_api, _fast_dds, domain_id, self.entity)

    @property
    def fast_dds_refusal(self) -> str | None:
        """See `transport.Participant`."""
        return self.fast_dds.refusal

    # ------------------------------------------------------------------------------------------------ endpoints

    def guid_of(self, entity: int) -> bytes:
        """The entity's GUID in network order."""
        buffer = ct.create_string_buffer(16)
        _api.check(_api.get_guid(entity, buffer), "read a GUID")
        return buffer.raw

    def create_writer(self, topic: str, type: str, qos: QoSProfile, user_data: bytes) -> CycloneWriter:
        """See `transport.Participant`."""
        profile = effective(qos, is_writer=True)
        with endpoint_qos(_api, profile, user_data, is_writer=True) as cqos:
            entity = self._create(_api.create_writer, self._publisher, topic, type, cqos)
        return CycloneWriter(self, entity, topic, type)

    def create_reader(
        self, topic: str, type: str, qos: QoSProfile, user_data: bytes, *, ignore_local: bool = False
    ) -> CycloneReader:
        """See `transport.Participant`."""
        profile = effective(qos, is_writer=False)
        with endpoint_qos(_api, profile, user_data, is_writer=False, ignore_local=ignore_local) as cqos:
            entity = self._create(_api.create_reader, self._subscriber, topic, type, cqos)
        return CycloneReader(self, entity, topic, type, ReceiveQueue(profile))

    def _create(self, create: Callable[..., int], parent: int, topic: str, type: str, qos: int) -> int:
        if self._closed:
            raise ClosedError("this participant is closed")
        handle = self._hold_topic(topic, type)
        try:
            return _api.check(create(parent, handle, qos, None), f"create an endpoint of {topic} ({type})")
        except BaseException:
            self.release_topic(topic, type)
            raise

    def _hold_topic(self, topic: str, type: str) -> int:
        with self._lock:
            held = self._topics.get((topic, type))
            self._idle_topics.pop((topic, type), None)
            if held is None:
                handle = self._domain.types.create_topic(_clayer.ddspy_topic_create, self.entity, topic, type)
                held = self._topics[topic, type] = [handle, 0]
            held[1] += 1
            return held[0]

    def type_object(self, type: str) -> int:
        """What stands for a type that has endpoints."""
        return self._domain.types[type]

    def release_topic(self, topic: str, type: str) -> None:
        """Give back what `_hold_topic` took.

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

    # -------------------------------------------------------------------------------------------------- waiting

    def watch(self, reader: CycloneReader) -> int:
        """Let `wait` look at a reader; returns the number `unwatch` needs."""
        with self._lock:
            number = self._next_source
            self._next_source += 1
            self._sources[number] = reader
        _api.set_status_mask(reader.entity, abi.STATUS_DATA_AVAILABLE)
        _api.check(_api.waitset_attach(self._waitset, reader.entity, number), "attach a reader")
        return number

    def unwatch(self, reader: CycloneReader, number: int) -> None:
        """Undo `watch`."""
        self._sources.pop(number, None)
        _api.waitset_detach(self._waitset, reader.entity)

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        """See `transport.Participant`."""
        self.discovery.sink = sink
        for entity, number in self.discovery.entities():
            _api.set_status_mask(entity, abi.STATUS_DATA_AVAILABLE)
            _api.check(_api.waitset_attach(self._waitset, entity, number), "watch discovery")
        self._ready[self.discovery.report] = None
        if self._notify is not None:
            self._notify()

    def report_discovery(self) -> None:
        """See `transport.Participant`."""
        self.discovery.report()

    def set_notify(self, notify: Callable[[], None] | None) -> None:
        """See `transport.Participant`."""
        self._notify = notify
        if notify is not None and self._ready:
            notify()

    def ready(self, sink: Sink) -> None:
        """Note that `sink` has something to do; called outside of `wait`."""
        self._ready[sink] = None
        notify = self._notify
        if notify is not None:
            notify()

    def wait(self, timeout_ns: int) -> bool:
        """See `transport.Participant`."""
        woken = self._woken
        count = _wait(self._waitset, woken, _WOKEN_SIZE, _int64(timeout_ns))
        if count == 1:  # by far the most frequent case
            reader = self._sources.get(woken[0])
            if reader is not None:
                if reader.fetch() and reader.sink is not None:
                    self._ready[reader.sink] = None
                return False
        called = False
        for number in woken[: max(0, count)]:
            if number == _GUARD:
                _api.set_guardcondition(self._guard, False)
                called = True
            elif number < 0:
                self._ready[self.discovery.report] = None
                self.discovery.fetch()
            else:
                reader = self._sources.get(number)
                if reader is not None and reader.fetch() and reader.sink is not None:
                    self._ready[reader.sink] = None
        return called

    def wake(self) -> None:
        """See `transport.Participant`."""
        _api.set_guardcondition(self._guard, True)

    def collect(self) -> list[Sink]:
        """See `transport.Participant`."""
        ready = self._ready
        if len(ready) <= 1:
            return [ready.popitem()[0]] if ready else []
        # Another thread may add at any time: take what is there, one by one.
        return [ready.popitem()[0] for _ in range(len(ready))][::-1]

    def mark_big_endian(self, guid_prefix: bytes) -> None:
        """See `transport.Participant`."""
        self.big_endian.add(guid_prefix)

    def close(self) -> None:
        """See `transport.Participant`."""
        if self._closed:
            return
        self._closed = True
        self.wake()
        self._notify = None
        for reader in list(self._sources.values()):
            reader.close()
        self._ready.clear()
        _api.delete(self.entity)
        self.discovery.close()
        self._domain.leave()
