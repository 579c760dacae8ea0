"""Writers and readers of the DDS transport.

Decides how bytes get into and out of Cyclone: a sample is made of them and written; samples are taken in batches, and
their bytes copied, or, of large ones, shown where they are. `participant.py` makes them; the rules written there hold
here.

A sample belongs to whoever holds a reference, wherever it came from: in one process the reader gets the very sample
that was written. One of up to 256 bytes goes back to a pool of its domain, so that small ones are never kept.

Source: docs/internals/dds.md 9.
"""

from __future__ import annotations

import ctypes as ct
import struct
import threading
import time
import weakref
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.cdr.layout import NETWORK_ALIGN
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import c_api
from rosidl_py_gen.runtime.transport.cyclone.c_api import SAMPLE_NOT_CONSUMED, SAMPLE_WITH_DATA, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.private_layout import bytes_at, payload_array
from rosidl_py_gen.runtime.transport.cyclone.sockets import LARGE_BYTES, warn_about_socket_buffers
from rosidl_py_gen.runtime.transport.qos import Reliability
from rosidl_py_gen.runtime.transport.samples import ReceiveQueue, pad_to_4_bytes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneParticipant
    from rosidl_py_gen.runtime.transport.dds.correlation import SampleIdentity
    from rosidl_py_gen.runtime.transport.dds.participant import DdsEndpoint
    from rosidl_py_gen.runtime.transport.samples import Payload, Sink

_BATCH = 32
"""Samples per take. More only helps when the queue is deeper; the arrays cost 72 bytes a piece."""
_ANY_STATE = 127
_LARGE_SAMPLE = 65536
"""Samples of this size are copied into Cyclone without the GIL, and out of it not at all: they are freed when the last
view of them dies."""

_OFFERED = {
    "deadline": ("offered_deadline_missed", 1),
    "liveliness": ("liveliness_lost", 1),
    "matched": ("publication_matched", 1),
}
_REQUESTED = {
    "deadline": ("requested_deadline_missed", 1),
    "liveliness": ("liveliness_changed", 2),
    "message_lost": ("sample_lost", 1),
    "matched": ("subscription_matched", 1),
}
"""The status of DDS that counts an event, and how many of its numbers do."""

_by_reference = ct.byref
_address = ct.c_void_p
_size = ct.c_size_t
_one = ct.c_size_t(1)
_time_ns = time.time_ns
_thread = threading.get_ident
_info_fields = struct.Struct("=12x?3xq8xQ24x").unpack_from
"""valid_data, source timestamp and publication handle of dds_sample_info_t (64 bytes)."""
_local_lock = threading.Lock()
_local_readers: dict[tuple[int, str], tuple[CycloneReader, ...]] = {}
"""Readers of this process by domain and topic, for `CycloneWriter.write`."""


class _CycloneEndpoint:
    """What writers and readers have in common.

    Attributes:
        entity: 0 once it is closed.
    """

    _statuses: Mapping[str, tuple[str, int]]

    def __init__(self, owner: CycloneParticipant, entity: int, end: DdsEndpoint) -> None:
        """`end` has the profile that went through `qos.effective`."""
        self._owner = owner
        self._api = owner.api
        self.entity = entity
        self.topic = end.topic
        self.type = end.type
        self._key = (owner.domain_id, end.topic)
        self.guid = owner.api.guid_of(entity)

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        """See `port.Writer` and `port.Reader`."""
        return self._api.counts(self.entity, *self._statuses[event])


# -------------------------------------------------------------------------------------------------------------- writer


class CycloneWriter(_CycloneEndpoint):
    """See `port.Writer`."""

    _statuses = _OFFERED

    def __init__(self, owner: CycloneParticipant, entity: int, end: DdsEndpoint) -> None:
        super().__init__(owner, entity, end)
        api = owner.api
        self._copy = api.bare_copy
        address = owner.type_object(end.type).address
        self._type_object = _address(address)
        self._fast_dds_hooks = owner.fast_dds.samples(address)
        self._write = api.bare_write if self._fast_dds_hooks is None else self._fast_dds_hooks.write_plain
        self._domain = owner.domain
        self._writing = owner.domain.writing
        handle = ct.c_uint64()
        api.check(api.get_instance_handle(entity, ct.byref(handle)), "read an instance handle")
        self.handle = handle.value

    def write(self, data: Payload) -> bool:
        """See `port.Writer`. Raises `ClosedError` or `TransportError`."""
        if data.__class__ is not bytes or len(data) % NETWORK_ALIGN:
            data = pad_to_4_bytes(data)
        size = len(data)
        iov = pack_iov(address_of(data), size)
        if size > LARGE_BYTES:
            warn_about_socket_buffers(size)
        domain, writing, here = self._domain, self._writing, _thread()
        writing.append(here)
        try:
            if domain.is_closing:
                raise ClosedError(f"the writer of {self.topic} is closed")
            if size < _LARGE_SAMPLE:
                sample = self._copy(self._type_object, SAMPLE_WITH_DATA, _one, iov, _size(size))
            else:
                sample = self._api.copy_large(self._type_object, SAMPLE_WITH_DATA, 1, iov, size)
            if not sample:
                what = f"{data[:8].hex()}... ({size} bytes)"
                raise TransportError(f"Cyclone DDS does not take {what}: no serialized message")
            code = self._write(self.entity, _address(sample))
            if code in SAMPLE_NOT_CONSUMED:
                self._api.serdata_unref(sample)
        finally:
            writing.remove(here)
            if domain.is_closing:
                domain.end_if_unused()
        if code == 0 and self._key not in _local_readers:
            return True
        return self._is_written(code, data)

    def write_with_identity(self, data: Payload, identity: SampleIdentity) -> bool:
        """As `write`, with an identity beside the sample."""
        data = pad_to_4_bytes(data)
        if len(data) > LARGE_BYTES:
            warn_about_socket_buffers(len(data))
        if self.entity == 0:
            raise ClosedError(f"the writer of {self.topic} is closed")
        if self._fast_dds_hooks is None:
            raise TransportError(f"Cyclone DDS cannot say whose a sample is: {self._owner.fast_dds.refusal}")
        address = self._type_object.value or 0
        domain, writing, here = self._domain, self._writing, _thread()
        writing.append(here)
        try:
            if domain.is_closing:
                raise ClosedError(f"the writer of {self.topic} is closed")
            code = self._fast_dds_hooks.write(self.entity, self.guid[12:], address, data, identity)
        finally:
            writing.remove(here)
            if domain.is_closing:
                domain.end_if_unused()
        return self._is_written(code, data)

    def _is_written(self, code: int, data: Payload) -> bool:
        if code == 0:
            if self._key in _local_readers:
                for reader in _local_readers.get(self._key, ()):
                    reader.fetch()
            return True
        if code == c_api.TIMEOUT:
            return False
        if self.entity == 0:
            raise ClosedError(f"the writer of {self.topic} is closed")
        self._api.check(code, f"write {len(data)} bytes to {self.topic}")
        return True

    def matched_readers(self) -> list[bytes]:
        return self._owner.discovery.matched(self.entity, is_writer=True)

    def has_readers(self) -> bool:
        status = c_api.DdsMatchedStatus()
        return self._api.bare_matched(self.entity, _by_reference(status)) == 0 and status.current > 0

    def all_acknowledged(self) -> bool:
        code = self._api.wait_for_acks(self.entity, 0)
        return code == 0 or (code != c_api.TIMEOUT and self._api.check(code, "wait for acknowledgements") == 0)

    def assert_liveliness(self) -> None:
        self._api.check(self._api.assert_liveliness(self.entity), "assert liveliness")

    def close(self) -> None:
        entity, self.entity = self.entity, 0
        if entity:
            self._api.delete(entity)
            self._owner.release_topic(self.topic, self.type)


# -------------------------------------------------------------------------------------------------------------- reader


class TakeBuffers:
    """The arrays of one take; shared by all readers of a participant, under their lock.

    A signal handler, or a finalizer of the user, may run while they are in use, in the same thread, and publish or
    close. So the lock is reentrant, and `active_reader` says who is in the middle of a take.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.active_reader: CycloneReader | None = None
        self.samples: ct.Array[Any] = (ct.c_void_p * _BATCH)()
        self.infos = (ct.c_ubyte * (64 * _BATCH))()
        self.arguments: tuple[Any, ...] = (ct.byref(self.samples), _BATCH, ct.byref(self.infos), _ANY_STATE)
        """Of a take, behind the reader; made once, because converting them would take longer than the call."""
        self.info_bytes = memoryview(self.infos)


class CycloneReader(_CycloneEndpoint):
    """See `port.Reader`."""

    _statuses = _REQUESTED

    def __init__(self, owner: CycloneParticipant, entity: int, end: DdsEndpoint) -> None:
        super().__init__(owner, entity, end)
        self.is_reliable = end.qos.reliability is Reliability.RELIABLE
        self.queue = ReceiveQueue(end.qos)
        self.sink: Sink | None = None
        self._take = owner.api.bare_take
        address, self._content = owner.type_object(end.type)
        self._fast_dds_hooks = owner.fast_dds.samples(address)
        self._size_of, self._unref = owner.api.serdata_size, owner.api.serdata_unref
        self._buffers = owner.buffers
        self._guids = owner.discovery.guids
        self._large_bytes = 0
        owner.readers[entity] = self
        with _local_lock:
            _local_readers[self._key] = (*_local_readers.get(self._key, ()), self)

    def set_sink(self, sink: Sink | None) -> None:
        self.sink = sink
        if sink is not None and (self.fetch() or self.queue.items):
            self._owner.pipe.notify(self.entity)

    def fetch(self) -> bool:
        """Move all samples from DDS into the queue; returns whether there were any. From any thread."""
        buffers = self._buffers
        with buffers.lock:
            if buffers.active_reader is not None:
                # A signal handler came between: newer samples must not overtake those being taken.
                return buffers.active_reader is not self and self._take_all(TakeBuffers())
            buffers.active_reader = self
            try:
                found = self._take_all(buffers)
            finally:
                buffers.active_reader = None
            large, self._large_bytes = self._large_bytes, 0
        if large:
            warn_about_socket_buffers(large)  # logging takes locks of its own: never under ours
        return found

    def _take_all(self, buffers: TakeBuffers) -> bool:
        items, found = self.queue.items, False
        size_of, unref, content = self._size_of, self._unref, self._content
        functions_of_ours, samples = self._fast_dds_hooks, buffers.samples
        count = _BATCH
        while count == _BATCH:
            count = self._take(self.entity, *buffers.arguments)
            now = _time_ns()
            for index in range(count):
                sample = samples[index]
                valid, source_ns, writer = _info_fields(buffers.info_bytes, 64 * index)
                if not valid:
                    unref(sample)
                    continue
                size = size_of(sample)
                data: Payload | None = None
                if functions_of_ours is not None and functions_of_ours.sends:
                    data = functions_of_ours.identified(sample, size)
                if data is not None:
                    unref(sample)
                elif content is None:
                    data = self._copy_payload(sample, size)
                elif size < _LARGE_SAMPLE:
                    data = bytes_at(sample + content, size)
                    unref(sample)
                else:
                    data = self._view(sample, sample + content, size)
                if len(items) == items.maxlen:  # as `ReceiveQueue.push`, without a call for each sample
                    self.queue.dropped += 1
                items.append((data, source_ns, writer, now, None))
                found = True
        return found

    def _view(self, sample: int, address: int, size: int) -> memoryview:
        """A read-only view of the bytes of a sample, which is freed when the last view of it is gone."""
        if size > LARGE_BYTES:
            self._large_bytes = size
        array = payload_array(address, size)
        weakref.finalize(array, self._api.drop_large, sample).atexit = False
        return memoryview(array).cast("B").toreadonly()

    def _copy_payload(self, sample: int, size: int) -> bytes:
        """A copy of the bytes of a sample, wherever they lie."""
        copy = (ct.c_ubyte * size)()
        self._api.serdata_to_ser(sample, 0, size, copy)
        self._unref(sample)
        return bytes(copy)

    def matched_writers(self) -> list[bytes]:
        return self._owner.discovery.matched(self.entity, is_writer=False)

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
        self._owner.readers.pop(entity, None)
        with self._owner.buffers.lock:
            self.entity = 0
        self._api.delete(entity)
        self._owner.release_topic(self.topic, self.type)
