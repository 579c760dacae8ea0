"""Writers and readers of the DDS transport.

Decides how bytes get into and out of Cyclone: one ctypes call a sample to write, one a batch to take. `participant.py`
makes them; the rules written there hold here.
"""

from __future__ import annotations

import ctypes as ct
import struct
import threading
import time
import weakref
from typing import TYPE_CHECKING, Any, Protocol

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.cyclone import abi
from rosidl_py_gen.runtime.transport.cyclone.sockets import LARGE_BYTES, warn_about_socket_buffers
from rosidl_py_gen.runtime.transport.samples import in_fours

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.discovery import DiscoveryReaders
    from rosidl_py_gen.runtime.transport.cyclone.fastdds import FastDds
    from rosidl_py_gen.runtime.transport.dds.correlation import Identity
    from rosidl_py_gen.runtime.transport.samples import Payload, ReceiveQueue, Sink

_BATCH = 32
"""Samples per take. More only helps when the queue is deeper; the arrays cost 80 bytes a piece."""
_VIEW_FROM_BYTES = 65536
"""Payloads of this size are not copied into a bytes object, but freed when the last view of them dies."""

_by_reference = ct.byref
_string_at = ct.PYFUNCTYPE(ct.py_object, ct.c_void_p, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))
"""`ctypes.string_at` without its Python wrapper."""
_Container = abi.Container
_time_ns = time.time_ns
_container_fields = struct.Struct("=QQ").unpack_from
_info_fields = struct.Struct("=12x?3xq8xQ24x").unpack_from
"""valid_data, source timestamp and publication handle of dds_sample_info_t (64 bytes)."""
_local_lock = threading.Lock()
_local_readers: dict[tuple[int, str], tuple[CycloneReader, ...]] = {}
"""Readers of this process by domain and topic, for `CycloneWriter.write`."""


class Host(Protocol):
    """What endpoints need of their participant."""

    api: abi.Api
    fast_dds: FastDds
    domain_id: int
    discovery: DiscoveryReaders
    buffers: TakeBuffers

    def guid_of(self, entity: int) -> bytes:
        """The entity's GUID in network order."""

    def type_object(self, type: str) -> int:
        """The address of what stands for a type that has endpoints."""

    def release_topic(self, topic: str, type: str) -> None:
        """An endpoint of it is gone."""

    def watch(self, reader: CycloneReader) -> None:
        """Tell the sink of that reader when something arrived."""

    def unwatch(self, entity: int) -> None:
        """Undo `watch`."""

    def wake(self, entity: int) -> None:
        """Tell the sink of that reader: something is in its queue already."""


# -------------------------------------------------------------------------------------------------------------- writer


class CycloneWriter:
    """See `port.Writer`."""

    def __init__(self, owner: Host, entity: int, topic: str, type: str) -> None:
        self._owner = owner
        self._topic = topic
        self._type = type
        self._key = (owner.domain_id, topic)
        self._entity = entity
        self._api = api = owner.api
        self._dds_write = api.bare_write
        self.guid = owner.guid_of(entity)
        handle = ct.c_uint64()
        api.check(api.get_instance_handle(entity, ct.byref(handle)), "read an instance handle")
        self.handle = handle.value

    def write(self, data: Payload) -> bool:
        """See `port.Writer`. Raises `ClosedError` or `TransportError`."""
        if data.__class__ is not bytes or len(data) & 3:
            data = in_fours(data)
        if len(data) > LARGE_BYTES:
            warn_about_socket_buffers(len(data))
        code = self._dds_write(self._entity, _by_reference(_Container(data, len(data))))
        if code == 0 and self._key not in _local_readers:
            return True
        return self._is_written(code, data)

    def write_for(self, data: Payload, identity: Identity) -> bool:
        """As `write`, with an identity beside the sample."""
        data = in_fours(data)
        if len(data) > LARGE_BYTES:
            warn_about_socket_buffers(len(data))
        if self._entity == 0:
            raise ClosedError(f"the writer of {self._topic} is closed")
        type_object = self._owner.type_object(self._type)
        return self._is_written(self._owner.fast_dds.write(self._entity, self.guid, type_object, data, identity), data)

    def _is_written(self, code: int, data: Payload) -> bool:
        if code == 0:
            if self._key in _local_readers:
                for reader in _local_readers.get(self._key, ()):
                    reader.fetch()
            return True
        if code == abi.TIMEOUT:
            return False
        if self._entity == 0:
            raise ClosedError(f"the writer of {self._topic} is closed")
        self._api.check(code, f"write {len(data)} bytes to {self._topic}")
        return True

    def matched_readers(self) -> list[bytes]:
        return self._owner.discovery.matched(self._entity, is_writer=True)

    def has_readers(self) -> bool:
        status = abi.MatchedStatus()
        return self._api.bare_matched(self._entity, _by_reference(status)) == 0 and status.current > 0

    def all_acknowledged(self) -> bool:
        code = self._api.wait_for_acks(self._entity, 0)
        return code == 0 or (code != abi.TIMEOUT and self._api.check(code, "wait for acknowledgements") == 0)

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        status = {"deadline": "offered_deadline_missed", "liveliness": "liveliness_lost"}[event]
        return self._api.counts(self._entity, status, 1)

    def assert_liveliness(self) -> None:
        self._api.check(self._api.assert_liveliness(self._entity), "assert liveliness")

    def close(self) -> None:
        entity, self._entity = self._entity, 0
        if entity:
            self._api.delete(entity)
            self._owner.release_topic(self._topic, self._type)
            self._owner.fast_dds.sweep()


# -------------------------------------------------------------------------------------------------------------- reader


class TakeBuffers:
    """The arrays of one take; shared by all readers of a participant, under their lock.

    A signal handler, or a finalizer of the user, may run while they are in use, in the same thread, and publish or
    close. So the lock is reentrant, and `user` says who is in the middle of a take.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.user: CycloneReader | None = None
        self.containers = (ct.c_uint64 * (2 * _BATCH))()
        base = ct.addressof(self.containers)
        self.pointers = (ct.c_void_p * _BATCH)(*(base + 16 * index for index in range(_BATCH)))
        self.infos = (ct.c_ubyte * (64 * _BATCH))()
        self.arguments: tuple[Any, ...] = (
            ct.byref(self.pointers),
            ct.byref(self.infos),
            ct.c_size_t.from_param(_BATCH),
            _BATCH,
        )
        """Of a take, behind the reader; made once, because converting them would take longer than the call."""
        self.container_bytes = memoryview(self.containers).cast("B")
        self.info_bytes = memoryview(self.infos)


class CycloneReader:
    """See `port.Reader`."""

    def __init__(
        self, owner: Host, entity: int, topic: str, type: str, queue: ReceiveQueue, *, is_reliable: bool
    ) -> None:
        self._owner = owner
        self.topic = topic
        self.is_reliable = is_reliable
        self.type = type
        self._key = (owner.domain_id, topic)
        self.entity = entity
        self.queue = queue
        self.sink: Sink | None = None
        self._api = owner.api
        self._take = owner.api.bare_take
        self._samples = owner.fast_dds.samples(owner.type_object(type))
        self._free = owner.api.free
        self._free_small = owner.api.bare_free
        self._buffers = owner.buffers
        self._guids = owner.discovery.guids
        self._large_bytes = 0
        self.guid = owner.guid_of(entity)
        owner.watch(self)
        with _local_lock:
            _local_readers[self._key] = (*_local_readers.get(self._key, ()), self)

    def set_sink(self, sink: Sink | None) -> None:
        self.sink = sink
        if sink is not None and (self.fetch() or self.queue.items):
            self._owner.wake(self.entity)

    def fetch(self) -> bool:
        """Move all samples from DDS into the queue; returns whether there were any. From any thread."""
        buffers = self._buffers
        with buffers.lock:
            if buffers.user is not None:
                # A signal handler came between: newer samples must not overtake those being taken.
                return buffers.user is not self and self._take_all(TakeBuffers())
            buffers.user = self
            try:
                found = self._take_all(buffers)
            finally:
                buffers.user = None
            large, self._large_bytes = self._large_bytes, 0
        if large:
            warn_about_socket_buffers(large)  # logging takes locks of its own: never under ours
        return found

    def _take_all(self, buffers: TakeBuffers) -> bool:
        items, found = self.queue.items, False
        count = _BATCH
        while count == _BATCH:
            if self._samples is not None and self._samples.sends:
                count = abi.undisturbed(self._take, self.entity, *buffers.arguments)
            else:
                count = self._take(self.entity, *buffers.arguments)
            now = _time_ns()
            for index in range(count):
                pointer, size = _container_fields(buffers.container_bytes, 16 * index)
                # Cyclone frees what it finds here when the next sample carries no data.
                buffers.containers[2 * index] = 0
                valid, source_ns, writer = _info_fields(buffers.info_bytes, 64 * index)
                data: Payload
                if size < _VIEW_FROM_BYTES or not valid:
                    data = _string_at(pointer, size) if valid else b""
                    self._free_small(pointer)
                else:
                    data = self._large(pointer, size)
                if valid:
                    if len(items) == items.maxlen:  # as `ReceiveQueue.push`, without a call for each sample
                        self.queue.dropped += 1
                    items.append((data, source_ns, writer, now))
                    found = True
        return found

    def _large(self, pointer: int, size: int) -> memoryview:
        """A read-only view of memory that DDS allocated; it is freed when the last view of it is gone."""
        if size > LARGE_BYTES:
            self._large_bytes = size
        array = (ct.c_ubyte * size).from_address(pointer)
        weakref.finalize(array, self._free, pointer).atexit = False
        return memoryview(array).cast("B").toreadonly()

    def matched_writers(self) -> list[bytes]:
        return self._owner.discovery.matched(self.entity, is_writer=False)

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        if event == "liveliness":
            return self._api.counts(self.entity, "liveliness_changed", 2)
        status = {"deadline": "requested_deadline_missed", "message_lost": "sample_lost"}[event]
        return self._api.counts(self.entity, status, 1)

    def writer_guid(self, handle: int) -> bytes | None:
        guid = self._guids.get(handle)
        return guid or self._owner.discovery.endpoint_guid(self.entity, handle, is_writer=False)

    def close(self) -> None:
        entity, self.sink = self.entity, None
        if not entity:
            return
        with _local_lock:
            left = tuple(reader for reader in _local_readers[self._key] if reader is not self)
            if left:
                _local_readers[self._key] = left
            else:
                del _local_readers[self._key]
        self._owner.unwatch(entity)
        with self._owner.buffers.lock:
            self.entity = 0
        self._api.delete(entity)
        self._owner.release_topic(self.topic, self.type)
