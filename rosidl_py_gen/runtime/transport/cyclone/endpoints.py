"""Writers and readers of the DDS transport, their QoS, and the pipe by which readers wake up an event loop.

A write creates a sample of Cyclone from bytes and writes it. A reader takes samples in batches. Small payloads are
copied; large payloads are exposed as views that share memory with Cyclone. Cyclone is used by plain C calls.

QoS profiles of ROS are converted to QoS objects of Cyclone and back. Policies of DDS that ROS does not have keep the
default of DDS.

Cyclone writes the handles of readers that have samples into a `WakeupPipe`. The loop that watches `fileno` reads the
pipe; on Windows, where loops cannot watch pipes, a thread reads it. A wake-up may find no samples: a writer in the same
process moves the samples that it delivers into the reader's queue, maybe before the loop does.

Source: docs/internals/dds.md 9, docs/internals/protocol.md 6.4, 7.3.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.cdr.layout import Alignment
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.logs import get_logger
from rosidl_py_gen.runtime.transport.api import (
    EndpointSpec,
    Payload,
    ReceiveQueue,
    Sink,
    TransportError,
    pad_to_4_bytes,
)
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.library import (
    SAMPLE_NOT_CONSUMED,
    SAMPLE_WITH_DATA,
    CycloneApi,
    address_of,
    pack_iov,
    qos_letter,
)
from rosidl_py_gen.runtime.transport.cyclone.private_layout import bytes_at, payload_array
from rosidl_py_gen.runtime.transport.dds.names import endpoint_user_data
from rosidl_py_gen.runtime.transport.latch import Latch
from rosidl_py_gen.runtime.transport.middleware_threads import ReadyItems
from rosidl_py_gen.runtime.transport.qos import DDS_POLICIES, Durability, History, QoSProfile, Reliability

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneParticipant
    from rosidl_py_gen.runtime.transport.dds.services import SampleIdentity

LARGE_BYTES = 500_000
"""Size in bytes from which a message needs large socket buffers."""
ENOUGH_SOCKET_BYTES = 4 << 20
"""Size in bytes of a socket buffer that is enough for large messages: with 4 MiB, 6 MB images at 30 Hz arrived
completely on loopback; with 1 MiB a fifth of them did not."""
_LIMIT_FILE = Path("/proc/sys/net/core/rmem_max")

_has_warned = False


def warn_about_socket_buffers(size_bytes: int) -> None:
    """Warn at the first large message if Linux limits socket buffers to less than `ENOUGH_SOCKET_BYTES`.

    Such a message is a burst of packets. Packets that do not fit the buffer are lost, or sent again if reliable.
    """
    global _has_warned
    if _has_warned:
        return
    _has_warned = True
    try:
        limit = int(_LIMIT_FILE.read_text())
    except (OSError, ValueError):  # not Linux, or a container that hides it
        return
    if limit < ENOUGH_SOCKET_BYTES:
        get_logger("rosidl_py_gen").warning(
            f"a message of {size_bytes} bytes was sent or received, but net.core.rmem_max limits socket buffers to "
            f"{limit} bytes; large messages will be slow or lost. Increase it: sudo sysctl -w "
            "net.core.rmem_max=33554432"
        )


_NETWORK_ALIGN = Alignment.NETWORK  # an attribute of a class takes 12 ns more
_BATCH = 32
"""Maximum number of samples that one call takes from a reader. A larger number helps only with deeper queues; each
sample costs 72 bytes."""
_ANY_STATE = 127
_LARGE_SAMPLE_BYTES = 65536
"""Size in bytes from which a written sample is copied into Cyclone without the GIL. A received sample of this size is
not copied but exposed as a view; the sample is freed with its last view."""

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
"""Number of a DDS status, and of its total counts, by name of an event of a reader; `_OFFERED` has the events of a
writer."""

_by_reference = ct.byref
_address = ct.c_void_p
_size = ct.c_size_t
_one = ct.c_size_t(1)
_time_ns = time.time_ns
_get_thread_id = threading.get_ident
_info_fields = struct.Struct("=12x?3xq8xQ24x").unpack_from
"""Function that unpacks valid_data, source timestamp and publication handle from the bytes of a dds_sample_info_t (64
bytes)."""
_local_lock = threading.Lock()
local_readers: dict[tuple[int, str], tuple[CycloneReader, ...]] = {}
"""Readers of this process by domain id and DDS topic. `CycloneWriter.write` makes them take a written sample at once.
"""


class _CycloneEndpoint:
    """Base of the writers and readers of the DDS transport.

    `entity` is 0 after `close`, `topic` and `type` are names of DDS.
    """

    _statuses: Mapping[str, tuple[str, int]]

    def __init__(self, owner: CycloneParticipant, entity: int, topic: str, type: str) -> None:
        self._owner = owner
        self._api = owner.api
        self.entity = entity
        self.topic = topic
        self.type = type
        self._key = (owner.domain_id, topic)
        self.guid = owner.api.guid_of(entity)
        self._close_latch = Latch()

    @property
    def is_closed(self) -> bool:
        """True from the beginning of `close` on."""
        return bool(self._close_latch)

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return self._api.counts(self.entity, *self._statuses[event])

    def _delete(self, entity: int) -> None:
        """Delete the endpoint, unless its participant or the domain is being deleted, which deletes the endpoint as
        well.

        Deleting the participant or the domain waits for this call.
        """
        owner, domain, thread_id = self._owner, self._owner.domain, _get_thread_id()
        # Announced before `is_deleted` and `is_closing` are read: this call sees them, or the other thread waits.
        owner.deleting.append(thread_id)
        domain.writing.append(thread_id)
        try:
            if not (owner.is_deleted or domain.is_closing):
                self._api.delete(entity)
                owner.release_topic(self.topic, self.type)
        finally:
            owner.deleting.remove(thread_id)
            domain.writing.remove(thread_id)
            if domain.is_closing:
                domain.end_if_unused()


class CycloneWriter(_CycloneEndpoint):
    """Writer of the DDS transport."""

    _statuses = _OFFERED

    def __init__(self, owner: CycloneParticipant, entity: int, topic: str, type: str) -> None:
        super().__init__(owner, entity, topic, type)
        api = owner.api
        self._copy = api.bare_copy
        address = owner.domain.types[type].address
        self._type_object = _address(address)
        self._identities = owner.domain.fast_dds.identities_of(address)
        self._write = api.bare_write if self._identities is None else self._identities.write_plain
        self._domain = owner.domain
        self._writing = owner.domain.writing
        handle = ct.c_uint64()
        api.check(api.get_instance_handle(entity, ct.byref(handle)), "read an instance handle")
        self.handle = handle.value

    def write(self, data: Payload, identity: SampleIdentity | None = None) -> bool:
        if data.__class__ is not bytes or len(data) % _NETWORK_ALIGN:
            data = pad_to_4_bytes(data)
        size = len(data)
        iov = pack_iov(address_of(data), size)
        if size > LARGE_BYTES:
            warn_about_socket_buffers(size)
        domain, writing, thread_id = self._domain, self._writing, _get_thread_id()
        # A thread that creates a sample uses the type object and the memory pool of the domain. A write during which
        # another thread deleted the domain has crashed; `Domain.leave` waits for this list (docs/internals/dds.md 9).
        writing.append(thread_id)
        try:
            if domain.is_closing:
                raise ClosedError(f"the writer of {self.topic} is closed")
            if identity is not None:
                code = self._write_with_identity(data, identity)
            else:
                # Below this size, reacquiring the GIL costs more than the copy.
                if size < _LARGE_SAMPLE_BYTES:
                    sample = self._copy(self._type_object, SAMPLE_WITH_DATA, _one, iov, _size(size))
                else:
                    sample = self._api.copy_large(self._type_object, SAMPLE_WITH_DATA, 1, iov, size)
                if not sample:
                    text = f"{data[:8].hex()}... ({size} bytes)"
                    raise TransportError(f"Cyclone DDS refused {text}: not a serialized message")
                # The write consumes the reference to the sample, unless it found no writer (docs/internals/dds.md 9).
                code = self._write(self.entity, _address(sample))
                if code in SAMPLE_NOT_CONSUMED:
                    self._api.serdata_unref(sample)
        finally:
            writing.remove(thread_id)
            if domain.is_closing:
                domain.end_if_unused()
        if code == 0 and self._key not in local_readers:
            return True
        return self._is_written(code, data)

    def _write_with_identity(self, data: bytes, identity: SampleIdentity) -> int:
        if self._identities is None:
            reason = self._owner.services_unavailable_reason
            raise TransportError(f"Cyclone DDS cannot send a sample identity: {reason}")
        address = self._type_object.value or 0
        return self._identities.write(self.entity, self.guid[12:], address, data, identity)

    def _is_written(self, code: int, data: Payload) -> bool:
        if code == 0:
            if self._key in local_readers:
                # Cyclone has delivered inside of this process during the write. An immediate take makes KEEP_LAST and
                # `dropped` exact, independent of the event loop.
                for reader in local_readers.get(self._key, ()):
                    reader.fetch()
            return True
        if code == library.TIMEOUT:
            return False
        if self.entity == 0:
            raise ClosedError(f"the writer of {self.topic} is closed")
        self._api.check(code, f"write {len(data)} bytes to {self.topic}")
        return True

    def matched_readers(self) -> list[bytes]:
        return self._owner.discovery.matched(self.entity, is_writer=True)

    def has_readers(self) -> bool:
        status = library.DdsMatchedStatus()
        return self._api.bare_matched(self.entity, _by_reference(status)) == 0 and status.current > 0

    def all_acknowledged(self) -> bool:
        code = self._api.wait_for_acks(self.entity, 0)
        return code == 0 or (code != library.TIMEOUT and self._api.check(code, "wait for acknowledgements") == 0)

    def assert_liveliness(self) -> None:
        self._api.check(self._api.assert_liveliness(self.entity), "assert liveliness")

    def close(self) -> None:
        if not self._close_latch.set():
            return
        entity, self.entity = self.entity, 0
        self._delete(entity)


class TakeBuffers:
    """Arrays into which Cyclone takes samples, shared by all readers of a participant. Lock: `lock` must be held.

    While samples are taken, a signal handler or a finalizer of the user may run in the same thread, and publish or
    close. So the lock is reentrant, and `active_reader` is the reader that is taking.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.active_reader: CycloneReader | None = None
        self.samples: ct.Array[Any] = (ct.c_void_p * _BATCH)()
        self.infos = (ct.c_ubyte * (64 * _BATCH))()
        self.arguments: tuple[Any, ...] = (ct.byref(self.samples), _BATCH, ct.byref(self.infos), _ANY_STATE)
        """Arguments of `dds_takecdr` after the reader. They are converted to C values once, because the conversion
        takes longer than a call."""
        self.info_bytes = memoryview(self.infos)


class CycloneReader(_CycloneEndpoint):
    """Reader of the DDS transport.

    Args:
        first: for a reader of the second topic of a topic, on which publishers of Lyrical send messages with unbounded
            arrays of bytes (buffers): the reader of the first topic, whose queue and sink receive the samples.
    """

    _statuses = _REQUESTED

    def __init__(
        self,
        owner: CycloneParticipant,
        entity: int,
        topic: str,
        type: str,
        qos: QoSProfile,
        *,
        first: CycloneReader | None = None,
    ) -> None:
        super().__init__(owner, entity, topic, type)
        self.is_reliable = qos.reliability is Reliability.RELIABLE
        self.queue: ReceiveQueue = ReceiveQueue(qos) if first is None else first.queue
        self.first = first
        self.sink: Sink | None = None
        self.buffer_spec: EndpointSpec | None = None
        """Specification of the reader `second`, which is created as soon as a publisher that sends buffers is
        discovered; else None."""
        self.second: CycloneReader | None = None
        """Reader of the second topic, to which publishers of Lyrical send messages with unbounded arrays of bytes.

        Source: docs/internals/dds.md 14.
        """
        self._take = owner.api.bare_take
        address, self._payload_offset = owner.domain.types[type]
        self._identities = owner.domain.fast_dds.identities_of(address)
        self._size_of, self._unref = owner.api.serdata_size, owner.api.serdata_unref
        self._buffers = owner.buffers
        self._guids = owner.discovery.guids
        self._large_bytes = 0
        owner.readers[entity] = self
        with _local_lock:
            local_readers[self._key] = (*local_readers.get(self._key, ()), self)

    def set_sink(self, sink: Sink | None) -> None:
        self.sink = sink
        if sink is not None and (self.fetch() or self.queue.items):
            self._owner.pipe.notify(self.entity)

    def fetch(self) -> bool:
        """Move all samples from DDS into the queue; return True if there were any. Thread: any."""
        buffers = self._buffers
        with buffers.lock:
            if buffers.active_reader is not None:
                # Called by a signal handler during a take: newer samples must not overtake those being taken.
                return buffers.active_reader is not self and self._take_all(TakeBuffers())
            buffers.active_reader = self
            try:
                has_samples = self._take_all(buffers)
            finally:
                buffers.active_reader = None
            large, self._large_bytes = self._large_bytes, 0
        if large:
            warn_about_socket_buffers(large)  # logging takes locks: never while our lock is held
        if self.second is not None:
            has_samples = self.second.fetch() or has_samples
        return has_samples

    def _take_all(self, buffers: TakeBuffers) -> bool:
        queue, items, has_samples = self.queue, self.queue.items, False
        size_of, unref, payload_offset = self._size_of, self._unref, self._payload_offset
        identities, samples = self._identities, buffers.samples
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
                if identities is not None and identities.sends:
                    data = identities.with_embedded_identity(sample, size)
                if data is not None:
                    unref(sample)
                elif payload_offset is None:  # not found in this library: docs/internals/cyclone_memory.md 2
                    data = self._copy_payload(sample, size)
                elif size < _LARGE_SAMPLE_BYTES:
                    # Samples of up to 256 bytes return to a pool of their domain, so a view could not outlive it.
                    data = bytes_at(sample + payload_offset, size)
                    unref(sample)
                else:
                    # Inside of a process several readers get the sample that was written: the view is read-only.
                    data = self._view(sample, sample + payload_offset, size)
                items.append((data, source_ns, writer, now, None))  # inlined `ReceiveQueue.push`
                if len(items) > queue.depth:
                    queue.drop_oldest()
                has_samples = True
        return has_samples

    def _view(self, sample: int, address: int, size: int) -> memoryview:
        """Return a read-only view of the serialized message in a sample of Cyclone.

        The sample is freed with its last view.
        """
        if size > LARGE_BYTES:
            self._large_bytes = size
        array = payload_array(address, size)
        # A large sample is ordinary memory and outlives reader, participant and domain (docs/internals/dds.md 9).
        weakref.finalize(array, self._api.drop_large, sample).atexit = False
        return memoryview(array).cast("B").toreadonly()

    def _copy_payload(self, sample: int, size: int) -> bytes:
        copy = (ct.c_ubyte * size)()
        self._api.serdata_to_ser(sample, 0, size, copy)
        self._unref(sample)
        return bytes(copy)

    def matched_writers(self) -> list[bytes]:
        return self._owner.discovery.matched(self.entity, is_writer=False)

    def writer_guid(self, handle: int) -> bytes | None:
        guid = self._guids.get(handle) or self._owner.discovery.endpoint_guid(self.entity, handle, is_writer=False)
        return self.second.writer_guid(handle) if guid is None and self.second is not None else guid

    def close(self) -> None:
        if not self._close_latch.set():
            return
        entity, self.sink = self.entity, None
        if self.second is not None:
            self.second.close()
        with _local_lock:
            remaining = tuple(reader for reader in local_readers[self._key] if reader is not self)
            if remaining:
                local_readers[self._key] = remaining
            else:
                del local_readers[self._key]
        self._owner.readers.pop(entity, None)
        with self._owner.buffers.lock:  # waits for a take of this reader
            self.entity = 0
        self._delete(entity)


# ------------------------------------------------------------------------------------------------------------------ QoS

_UNLIMITED = -1
_XCDR1 = (ct.c_int16 * 1)(0)


@contextmanager
def new_qos(api: CycloneApi, user_data: bytes, properties: Iterable[tuple[bytes, bytes]] = ()) -> Iterator[int]:
    """Yield a Cyclone QoS object with default policies, with `user_data` as USER_DATA, and with `properties` (pairs of
    name and value).
    """
    qos = api.create_qos()
    try:
        if user_data:
            api.qset_userdata(qos, user_data, len(user_data))
        for name, value in properties:
            api.qset_prop(qos, name, value)
        yield qos
    finally:
        api.delete_qos(qos)


_POLICIES = tuple(policy for policies in DDS_POLICIES.values() for policy in policies)
"""Policies of ROS that DDS has."""
_FIELDS = tuple(policy.field for policy in _POLICIES)
_DDS_VALUES = tuple((policy.field, policy.dds_values) for policy in _POLICIES if policy.enum)
"""Fields whose values are members of enums, each with the members in the order of their numbers in DDS."""
_MEMBERS = tuple(
    (
        policy.field,
        {number: member for number, member in enumerate(policy.dds_values) if member is not None},
        policy.enum["UNKNOWN"],
    )
    for policy in _POLICIES
    if policy.enum
)
"""Members of enums by number in DDS, each with the field and the member for other numbers."""
_LIMITS = tuple((policy.field, *policy.limits) for policy in _POLICIES if policy.limits)
"""Fields whose values are numbers, each with the smallest and the largest number."""
# One block of memory and one `unpack` take less time than an object of ctypes for each value.
_CELL_BYTES = 8
_CELL_FORMATS = {"i": "i4x", "b": "?7x", "l": "q"}
"""Formats of `struct` for cells of 8 bytes, by the letter of the C type."""
_CELLS = struct.Struct(f"={''.join(_CELL_FORMATS[qos_letter(policy)] for policy in _POLICIES)}")
"""Format of the values of `_POLICIES`, each in a cell that Cyclone writes."""
_DEFAULT_CELLS = _CELLS.pack(*(0 if policy.enum else policy.unset for policy in _POLICIES)) + bytes(_CELL_BYTES)
"""Cells with the values of missing policies (enums: number 0), and a last cell for other values."""
_CellBlock: type[ct.Array[ct.c_char]] = ct.c_char * len(_DEFAULT_CELLS)


def _more_values(name: str) -> tuple[int, ...]:
    return (library.MORE_QOS_VALUES[name],) if name in library.MORE_QOS_VALUES else ()


def _calls(is_writer: bool) -> Iterator[tuple[str, tuple[str, ...], tuple[int, ...]]]:
    for name, policies in DDS_POLICIES.items():
        if policies[0].is_announced(is_writer=is_writer):
            yield name, tuple(policy.field for policy in policies), _more_values(name)


_SETTERS = tuple(
    tuple((f"qset_{name}", fields, more) for name, fields, more in _calls(is_writer)) for is_writer in (False, True)
)
"""Functions that set the policies of a reader, and of a writer, with the fields and values of their arguments."""
_GETTERS = tuple(
    tuple(
        (f"qget_{name}", [_CELL_BYTES * _FIELDS.index(field) for field in fields] + [_CELLS.size for _ in more])
        for name, fields, more in _calls(is_writer)
    )
    for is_writer in (False, True)
)
"""Functions that read the policies of a reader, and of a writer, with the offsets of the cells of their arguments."""


@contextmanager
def endpoint_qos(api: CycloneApi, spec: EndpointSpec, *, is_writer: bool) -> Iterator[int]:
    """Yield a Cyclone QoS object for a writer or reader; `spec.qos` must be a result of `effective`."""
    profile = spec.qos
    ids = {"client_id": spec.client_id, "service_id": spec.service_id, "service_hash": spec.service_hash}
    user_data = endpoint_user_data(spec.type_hash, **ids)
    with new_qos(api, user_data) as qos:
        values = {field: getattr(profile, field) for field in _FIELDS}
        for field, members in _DDS_VALUES:
            values[field] = members.index(values[field])
        values["depth"] = profile.depth or 1  # 0 with KEEP_ALL, where DDS ignores it
        for setter, fields, more in _SETTERS[is_writer]:
            getattr(api, setter)(qos, *[values[field] for field in fields], *more)
        if profile.durability is Durability.TRANSIENT_LOCAL:
            limits = (_UNLIMITED, _UNLIMITED, _UNLIMITED)
            api.qset_durability_service(qos, 0, values["history"], values["depth"], *limits)
        api.qset_data_representation(qos, 1, _XCDR1)
        if is_writer:
            api.qset_writer_data_lifecycle(qos, False)
        if api.qset_psmx_instances is not None:
            api.qset_psmx_instances(qos, 0, None)
        if spec.ignore_local:
            api.qset_ignorelocal(qos, 1)
        yield qos


def read_user_data(api: CycloneApi, qos: int) -> bytes:
    """Return the USER_DATA in the QoS object of a discovered entity; empty if there is none."""
    pointer, size = ct.c_void_p(), ct.c_size_t()
    exists = api.qget_userdata(qos, ct.byref(pointer), ct.byref(size))
    return _take_copy(api, pointer, size.value) if exists else b""


def read_property(api: CycloneApi, qos: int, name: bytes) -> str:
    """Return a property from the QoS object of a discovered participant; empty if the property does not exist."""
    pointer = ct.c_void_p()
    exists = api.qget_prop(qos, name, ct.byref(pointer))
    return _take_copy(api, pointer, -1).decode(errors="replace") if exists else ""


def _take_copy(api: CycloneApi, pointer: ct.c_void_p, size: int) -> bytes:
    """Return a copy of bytes that the library has allocated, and free the original.

    With size -1, the bytes end at a NUL.
    """
    try:
        return ct.string_at(pointer, size) if pointer else b""
    finally:
        api.free(pointer)


def read_profile(api: CycloneApi, qos: int, *, is_writer: bool) -> QoSProfile:
    """Return the ROS profile in the QoS object of a discovered endpoint; a missing policy has the default of DDS."""
    cells = _CellBlock.from_buffer_copy(_DEFAULT_CELLS)
    for getter, offsets in _GETTERS[is_writer]:
        getattr(api, getter)(qos, *[_by_reference(cells, offset) for offset in offsets])
    values: dict[str, Any] = dict(zip(_FIELDS, _CELLS.unpack_from(cells), strict=True))
    for field, members, unknown in _MEMBERS:
        values[field] = members.get(values[field], unknown)
    for field, lowest, highest in _LIMITS:  # a peer may announce any number
        values[field] = min(max(values[field], lowest), highest)
    values["depth"] = 0 if values["history"] is History.KEEP_ALL else max(1, values["depth"])
    return QoSProfile(**values)


# --------------------------------------------------------------------------------------------------------- wake-up pipe

LOOPS_CAN_WATCH = os.name == "posix"
"""True where event loops can watch pipes. Elsewhere a thread keeps the pipe empty, so writing to the pipe may block."""
_MIN_PIPE_BYTES = 512
"""Minimum capacity of a pipe (PIPE_BUF of POSIX): a pipe with less content was not full."""
_READ_BYTES = 4096
"""Maximum number of bytes in one read. Python allocates this size for each read; if the pipe contains more, it remains
readable."""
_handle = struct.Struct("i")

# The C library that Python itself uses. On Windows the functions of POSIX have an underscore.
_libc = ct.CDLL("ucrtbase" if sys.platform == "win32" else None)
_prefix = "_" if sys.platform == "win32" else ""
_file, _int = ct.c_void_p, ct.c_int
_fdopen = ct.CFUNCTYPE(_file, _int, ct.c_char_p)((f"{_prefix}fdopen", _libc))
_setbuf = ct.CFUNCTYPE(None, _file, ct.c_void_p)(("setbuf", _libc))
_fclose = ct.CFUNCTYPE(_int, _file)(("fclose", _libc))
ferror = ct.CFUNCTYPE(_int, _file)(("ferror", _libc))
"""C function that returns non-zero if a reader's handle did not fit into `WakeupPipe.stream`; the next `drain` reports
that."""
_clearerr = ct.CFUNCTYPE(None, _file)(("clearerr", _libc))
# Used as a listener of Cyclone, so that Cyclone's threads call the C library directly, without Python and the GIL.
putw = ct.CFUNCTYPE(_int, _int, _file)((f"{_prefix}putw", _libc))
"""C function that writes a reader's handle into `WakeupPipe.stream`. Cyclone calls it as a listener. Unlike a listener
it returns an int; the calling conventions of all platforms of Cyclone allow that."""


class WakeupPipe:
    """Pipe with which Cyclone wakes up the event loop of one participant, by writing handles of readers.

    Thread: any.
    """

    def __init__(self) -> None:
        self._read_end, self._write_end = os.pipe()
        if LOOPS_CAN_WATCH:
            # The pipe must never block Cyclone: a handle that does not fit is not written, and the next `drain` reports
            # that some are missing.
            self._set_blocking(False)
        self.stream: int = _fdopen(self._write_end, b"wb")
        """Writing end of the pipe, as an unbuffered C `FILE *`."""
        _setbuf(self.stream, None)
        self._lock = threading.Lock()
        self._closed = False
        self._thread: threading.Thread | None = None
        self._handles: ReadyItems[int] = ReadyItems(has_pipe=False)
        """Handles of readers that the reading thread has taken from the pipe."""
        if not LOOPS_CAN_WATCH:
            self.read_in_thread(None)

    def _set_blocking(self, blocking: bool) -> None:
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, blocking)

    def fileno(self) -> int | None:
        """Return the descriptor that an event loop must watch; None if a thread reads the pipe."""
        return self._read_end if self._thread is None else None

    def notify(self, handle: int) -> None:
        """Write a reader's handle, as Cyclone does when it has received samples for the reader."""
        with self._lock:
            if not self._closed:
                putw(handle, self.stream)

    def drain(self) -> Iterable[int] | None:
        """Return the handles of readers written since the last call; None if some may be missing. Never blocks."""
        if self._thread is not None:
            return self._handles.take()
        with self._lock:
            if self._closed:
                return ()
            try:
                data = os.read(self._read_end, _READ_BYTES)
            except BlockingIOError:
                return ()
            if len(data) == _handle.size:  # by far the most frequent case
                return _handle.unpack(data)
            # `ferror` takes the lock that `putw` holds, so it reports every write that found the pipe full.
            if len(data) >= _MIN_PIPE_BYTES and ferror(self.stream):
                _clearerr(self.stream)
                return None
        return _unique_handles(data)

    def read_in_thread(self, notify: Callable[[], None] | None) -> None:
        """Start a thread that reads the pipe; the thread calls `notify` when `drain` has handles."""
        self._handles.set_wakeup(notify)
        if self._thread is None:
            if LOOPS_CAN_WATCH:
                self._set_blocking(True)
            self._thread = threading.Thread(target=self._run, name="rosidl-py-gen receiver", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while data := os.read(self._read_end, _READ_BYTES):
            for handle in _unique_handles(data):
                self._handles.put(handle)

    def close(self) -> None:
        """Close the pipe, and wait for the end of the thread that reads it.

        No listener of Cyclone may use the stream any more.
        """
        # Cyclone deletes an entity only after its listener has returned, so callers delete the participant before.
        with self._lock:
            self._closed = True
            _fclose(self.stream)
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        os.close(self._read_end)


def _unique_handles(data: bytes) -> dict[int, None]:
    return dict.fromkeys(memoryview(data).cast("i"))
