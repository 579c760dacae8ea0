"""What Cyclone's builtin topics say about participants and endpoints, as discovery events.

Decides nothing about ROS: names and types are only spelled in its way. It also remembers which GUID
belongs to which local instance handle, because samples and matched lists carry handles only; the handle in the builtin
sample of an endpoint is the publication handle of its samples.

Source: docs/internals/protocol.md 11.7.
"""

from __future__ import annotations

import ctypes as ct
import struct
import threading
from collections import deque
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.transport.cyclone import c_api
from rosidl_py_gen.runtime.transport.cyclone.c_api import (
    DCPS_PARTICIPANT,
    BuiltinEndpoint,
    BuiltinParticipant,
    cast_loan,
)
from rosidl_py_gen.runtime.transport.cyclone.qos import read_profile, read_property, read_user_data
from rosidl_py_gen.runtime.transport.cyclone.wakeup_pipe import putw
from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR
from rosidl_py_gen.runtime.transport.dds.names import channel_of, parse_user_data
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, EntityLost, ParticipantDiscovered
from rosidl_py_gen.runtime.transport.type_names import ros_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FastDdsInterop
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent

_BATCH = 64
"""Of all arrays that a builtin reader is given: 0.10 fills in as many pointers as it has ever lent."""
_REMEMBERED = 4096
"""Handles of lost endpoints that are still known: their last samples may lie in a queue."""
_ALIVE = 16
_PREFIX_BYTES = 12
_NEW = 2 | 4 | 8 | _ALIVE
"""Samples that were not read yet, of whatever view, that have data."""
_info = struct.Struct("=8xI?3x8xQ32x").unpack_from
"""instance_state, valid_data and instance_handle of dds_sample_info_t (64 bytes)."""
_ADDRESSES = b"__NetworkAddresses"
"""A property that Cyclone adds to what a participant said of itself."""
_OF_DDS = "DCPS"
"""Begins the names of the topics by which DDS itself works."""
_TOPICS = (DCPS_PARTICIPANT, c_api.DCPS_PUBLICATION, c_api.DCPS_SUBSCRIPTION)


class BuiltinTopicReaders:
    """The three builtin readers of a participant."""

    def __init__(
        self,
        api: c_api.CycloneApi,
        fast_dds: FastDdsInterop,
        participant: int,
        listener: int,
        stream: int,
        greet: Callable[[bytes, str], None],
    ) -> None:
        """`listener` puts handles into the pipe behind `stream`; that of participants has more to do. `greet` gets the
        GUID and the addresses of participants on Fast DDS that were found.
        """
        self._api = api
        self._greet = greet
        self._fast_dds = fast_dds
        self._addresses: dict[bytes, str] = {}
        """Of participants on Fast DDS, by their GUIDs without the last four bytes."""
        self._on_participants_function = ct.CFUNCTYPE(None, ct.c_int32, ct.c_void_p)(self._on_participants)
        of_participants: int = api.create_listener(None)
        api.lset_data_available_arg(of_participants, self._on_participants_function, stream, True)
        self._readers: dict[int, int] = {}
        try:
            for topic in _TOPICS:
                own = of_participants if topic == DCPS_PARTICIPANT else listener
                code = api.create_reader(participant, topic, None, own)
                self._readers[topic] = api.check(code, "create a discovery reader")
        finally:
            api.delete_listener(of_participants)
        self.entities = tuple(self._readers.values())
        fast_dds.on_participants_pending(self._readers[DCPS_PARTICIPANT])
        self.sink: Callable[[list[DiscoveryEvent]], None] | None = None
        self._lock = threading.RLock()
        self._is_stopped = False
        self.guids: dict[int, bytes] = {}
        """By local handle, what is known so far; to be looked at first, then `endpoint_guid` asked."""
        self._lost_handles: deque[int] = deque()

    def _loaned_samples(
        self, reader: int, look: Callable[..., int], *states: int
    ) -> Iterator[tuple[int, int, bool, int]]:
        """All that a reader has: where it lies until the next one, its state, whether it has data, and its handle."""
        count = _BATCH
        while count == _BATCH:
            pointers, infos = (ct.c_void_p * _BATCH)(), (ct.c_ubyte * (64 * _BATCH))()  # asks for loans
            count = look(reader, pointers, infos, _BATCH, _BATCH, *states)
            try:
                for index in range(count):
                    yield pointers[index] or 0, *_info(infos, 64 * index)
            finally:
                if count > 0:
                    self._api.return_loan(reader, pointers, count)

    def _on_participants(self, reader: int, stream: int) -> None:
        """Called by Cyclone in a thread of its own, before it takes anything else from those that it has found."""
        self._fast_dds.on_participants_pending(reader)
        try:
            for pointer, *_ in self._loaned_samples(reader, self._api.read_mask, _NEW):
                self._record_participant(cast_loan(pointer, BuiltinParticipant))  # before the loop takes it
        finally:
            putw(reader, stream)

    def _record_participant(self, participant: BuiltinParticipant) -> None:
        """Note the addresses of one on Fast DDS, and greet it when it is new."""
        guid = bytes(participant.key)
        if guid.startswith(FAST_DDS_VENDOR):
            prefix = guid[:_PREFIX_BYTES]
            is_new = prefix not in self._addresses
            self._addresses[prefix] = read_property(self._api, participant.qos, _ADDRESSES)
            if is_new:
                self._greet(guid, self._addresses[prefix])

    # ---------------------------------------------------------------------------------------------------- events

    def report(self) -> None:
        """Pass all news to the sink."""
        with self._lock:
            news = [] if self._is_stopped else list(self._read_events())
        for complaint in self._fast_dds.new_warnings():
            get_root_logger().warning(complaint)
        if news and self.sink is not None:
            self.sink(news)

    def _read_events(self) -> Iterator[DiscoveryEvent]:
        for topic, reader in self._readers.items():
            is_participant = topic == DCPS_PARTICIPANT
            if is_participant:
                self._fast_dds.begin_read(reader)
            events: list[DiscoveryEvent] = []
            for pointer, state, is_valid, handle in self._loaned_samples(reader, self._api.take):
                if is_valid:
                    events += self._participant(pointer) if is_participant else self._endpoint(topic, pointer, handle)
                if not is_valid or state != _ALIVE:  # or came and went since the last look; nothing else will tell
                    guid = bytes(cast_loan(pointer, BuiltinParticipant).key)  # where all builtin samples have theirs
                    events.append(EntityLost(guid))
                    if is_participant:
                        self._addresses.pop(guid[:_PREFIX_BYTES], None)
                    else:
                        self._forget_later(handle)
            if is_participant:
                self._fast_dds.end_read(reader, events)
            yield from events

    def _participant(self, pointer: int) -> Iterator[ParticipantDiscovered]:
        participant = cast_loan(pointer, BuiltinParticipant)
        self._record_participant(participant)  # perhaps before Cyclone's thread has come to it
        told = parse_user_data(read_user_data(self._api, participant.qos))
        yield ParticipantDiscovered(bytes(participant.key), told.get("enclave"))

    def _endpoint(self, topic: int, pointer: int, handle: int) -> Iterator[DiscoveredEndpoint]:
        endpoint = cast_loan(pointer, BuiltinEndpoint)
        self.guids[handle] = guid = bytes(endpoint.key)
        name, type = endpoint.topic_name.decode(errors="replace"), endpoint.type_name.decode(errors="replace")
        if name.startswith(_OF_DDS):
            return
        is_writer = topic == c_api.DCPS_PUBLICATION
        told = parse_user_data(read_user_data(self._api, endpoint.qos))
        yield DiscoveredEndpoint(
            guid,
            bytes(endpoint.participant_key),
            is_writer,
            channel_of(name),
            ros_type(type),
            read_profile(self._api, endpoint.qos, is_writer=is_writer),
            told.get("typehash", ""),
            told.get("serviceid") or told.get("clientid") or "",
            wire_name=name,
            wire_type=type,
        )

    def _forget_later(self, handle: int) -> None:
        self._lost_handles.append(handle)
        if len(self._lost_handles) > _REMEMBERED:
            self.guids.pop(self._lost_handles.popleft(), None)

    def stop(self) -> None:
        """The readers are about to be deleted, and what they lent with them: wait for a thread that looks at it."""
        with self._lock:
            self._is_stopped = True

    def close(self) -> None:
        """The participant and its readers are deleted."""
        self._fast_dds.forget_reader(self._readers[DCPS_PARTICIPANT])

    # --------------------------------------------------------------------------------------------------- handles

    def fast_dds_addresses(self, endpoint: bytes) -> str | None:
        """The addresses of the participant that an endpoint is of, if it is on Fast DDS and was greeted."""
        return self._addresses.get(endpoint[:_PREFIX_BYTES])

    def matched(self, entity: int, *, is_writer: bool) -> list[bytes]:
        """GUIDs of the endpoints that a writer or reader of ours is connected with."""
        api = self._api
        count_of = api.get_matched_subscriptions if is_writer else api.get_matched_publications
        room = 64
        while True:
            handles = (ct.c_uint64 * room)()
            count = count_of(entity, handles, room)
            if count <= room:
                break
            room = count
        guids = (self.endpoint_guid(entity, handle, is_writer=is_writer) for handle in handles[: max(0, count)])
        return [guid for guid in guids if guid is not None]

    def endpoint_guid(self, entity: int, handle: int, *, is_writer: bool) -> bytes | None:
        """The GUID behind a handle; asks Cyclone when discovery has not been read that far."""
        guid = self.guids.get(handle)
        if guid is None:
            api = self._api
            look_up = api.get_matched_subscription_data if is_writer else api.get_matched_publication_data
            pointer = look_up(entity, handle)
            if not pointer:
                return None
            guid = self.guids[handle] = bytes(cast_loan(pointer, BuiltinEndpoint).key)
            api.builtintopic_free_endpoint(pointer)
        return guid
