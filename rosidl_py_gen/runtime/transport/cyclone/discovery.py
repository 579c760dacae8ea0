"""Discovery events from Cyclone's builtin topics.

Also maps local instance handles to GUIDs, because samples and lists of matched endpoints contain handles only.

Source: docs/internals/protocol.md 11.7.
"""

from __future__ import annotations

import ctypes as ct
import struct
import threading
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial

from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, DiscoveryEvent, EntityLost, ParticipantDiscovered
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.endpoints import putw, read_profile, read_property, read_user_data
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsPeers
from rosidl_py_gen.runtime.transport.cyclone.library import (
    DCPS_PARTICIPANT,
    BuiltinEndpoint,
    BuiltinParticipant,
    cast_loan,
)
from rosidl_py_gen.runtime.transport.dds.names import parse_user_data, ros_type, topic_key_of

_BATCH = 64
"""Length of the arrays into which samples of a builtin reader are read. All have this length, because Cyclone 0.10
writes as many pointers as it has ever lent."""
_MAX_LOST_HANDLES = 4096
"""Maximum number of handles of lost endpoints that are remembered, because last samples of these endpoints may still be
in a queue."""
_ALIVE = 16
_UNREAD = 2 | 4 | 8 | _ALIVE
"""State mask that selects samples of alive instances that were not read yet, with any view state."""
_info = struct.Struct("=8xI?3x8xQ32x").unpack_from
"""Unpack instance_state, valid_data and instance_handle from a dds_sample_info_t (64 bytes)."""
_BUILTIN_PREFIX = "DCPS"
"""Prefix of the names of DDS builtin topics."""
_TOPICS = (DCPS_PARTICIPANT, library.DCPS_PUBLICATION, library.DCPS_SUBSCRIPTION)


class BuiltinTopicReaders:
    """Readers of the three builtin topics of DDS (participants, writers, readers) for one participant.

    Args:
        listener: Cyclone listener that writes the handle of a builtin reader into the pipe whose writing end is
            `stream`.
        fast_dds: the participant's peers on Fast DDS, to which new and lost participants are reported.
        new_warnings: returns texts to log, each once.
    """

    def __init__(
        self,
        api: library.CycloneApi,
        participant: int,
        listener: int,
        stream: int,
        fast_dds: FastDdsPeers,
        new_warnings: Callable[[], list[str]],
    ) -> None:
        self._api = api
        self._new_warnings = new_warnings
        self._fast_dds = fast_dds
        self._on_participants_function = ct.CFUNCTYPE(None, ct.c_int32, ct.c_void_p)(self._on_participants)
        participant_listener: int = api.create_listener(None)
        api.lset_data_available_arg(participant_listener, self._on_participants_function, stream, True)
        self._readers: dict[int, int] = {}
        try:
            for topic in _TOPICS:
                topic_listener = participant_listener if topic == DCPS_PARTICIPANT else listener
                code = api.create_reader(participant, topic, None, topic_listener)
                self._readers[topic] = api.check(code, "create a discovery reader")
        finally:
            api.delete_listener(participant_listener)
        self.entities = tuple(self._readers.values())
        fast_dds.on_builtin_reader(self._readers[DCPS_PARTICIPANT])
        self.sink: Callable[[list[DiscoveryEvent]], None] | None = None
        self.report_lock = threading.RLock()
        """Lock that is held from reading events until the sink has applied them, because without a loop several threads
        report."""
        self._lock = threading.RLock()
        """Lock of the builtin readers. It is not held while the sink runs, because a sink may call functions of the
        user."""
        self._is_stopped = False
        self.guids: dict[int, bytes] = {}
        """GUIDs of discovered endpoints by local handle; `endpoint_guid` finds GUIDs that are missing here."""
        self._lost_handles: deque[int] = deque()

    def _loaned_samples(
        self, reader: int, function: Callable[..., int], *states: int
    ) -> Iterator[tuple[int, int, bool, int]]:
        """Yield address, instance state, validity and instance handle of each sample of a builtin reader.

        `function` is `dds_take` or `dds_read_mask`. An address is valid until the next sample is requested.
        """
        count = _BATCH
        while count == _BATCH:
            pointers, infos = (ct.c_void_p * _BATCH)(), (ct.c_ubyte * (64 * _BATCH))()  # null pointers request loans
            count = function(reader, pointers, infos, _BATCH, _BATCH, *states)
            try:
                for index in range(count):
                    yield pointers[index] or 0, *_info(infos, 64 * index)
            finally:
                if count > 0:
                    self._api.return_loan(reader, pointers, count)

    def _on_participants(self, reader: int, stream: int) -> None:
        """Record new participants. Called by Cyclone's thread, before it processes anything else of a participant."""
        self._fast_dds.on_participants_pending()
        try:
            for pointer, *_ in self._loaned_samples(reader, self._api.read_mask, _UNREAD):
                self._record_participant(cast_loan(pointer, BuiltinParticipant))  # earlier than the loop
        finally:
            putw(reader, stream)

    def _record_participant(self, participant: BuiltinParticipant) -> None:
        self._fast_dds.on_participant(bytes(participant.key), partial(read_property, self._api, participant.qos))

    def report(self) -> None:
        """Pass all new discovery events to the sink, and log new warnings."""
        with self.report_lock:
            with self._lock:
                events = [] if self._is_stopped else list(self._read_events())
            for warning in self._new_warnings():
                get_root_logger().warning(warning)
            if events and self.sink is not None:
                self.sink(events)

    def _read_events(self) -> Iterator[DiscoveryEvent]:
        for topic, reader in self._readers.items():
            is_participant = topic == DCPS_PARTICIPANT
            if is_participant:
                self._fast_dds.begin_read()
            events: list[DiscoveryEvent] = []
            for pointer, state, is_valid, handle in self._loaned_samples(reader, self._api.take):
                if is_valid:
                    events += self._participant(pointer) if is_participant else self._endpoint(topic, pointer, handle)
                if not is_valid or state != _ALIVE:  # also if it appeared and disappeared since the last call
                    guid = bytes(cast_loan(pointer, BuiltinParticipant).key)  # all builtin samples begin with the key
                    events.append(EntityLost(guid))
                    if is_participant:
                        self._fast_dds.on_participant_lost(guid)
                    else:
                        # Not removed at once: the last samples of the endpoint may still be in a queue.
                        self._lost_handles.append(handle)
                        if len(self._lost_handles) > _MAX_LOST_HANDLES:
                            self.guids.pop(self._lost_handles.popleft(), None)
            if is_participant:
                self._fast_dds.end_read(events)
            yield from events

    def _participant(self, pointer: int) -> Iterator[ParticipantDiscovered]:
        participant = cast_loan(pointer, BuiltinParticipant)
        self._record_participant(participant)  # perhaps earlier than Cyclone's thread
        user_data = parse_user_data(read_user_data(self._api, participant.qos))
        guid = bytes(participant.key)
        yield ParticipantDiscovered(guid, user_data.get("enclave"), self._fast_dds.vendor_of(guid))

    def _endpoint(self, topic: int, pointer: int, handle: int) -> Iterator[DiscoveredEndpoint]:
        endpoint = cast_loan(pointer, BuiltinEndpoint)
        # The handle of a writer's builtin sample is the publication handle of the samples of that writer.
        self.guids[handle] = guid = bytes(endpoint.key)
        name, type = endpoint.topic_name.decode(errors="replace"), endpoint.type_name.decode(errors="replace")
        if name.startswith(_BUILTIN_PREFIX):
            return
        is_writer = topic == library.DCPS_PUBLICATION
        user_data = parse_user_data(read_user_data(self._api, endpoint.qos))
        yield DiscoveredEndpoint(
            guid,
            bytes(endpoint.participant_key),
            is_writer,
            topic_key_of(name),
            ros_type(type),
            read_profile(self._api, endpoint.qos, is_writer=is_writer),
            user_data.get("typehash", ""),
            user_data.get("serviceid") or user_data.get("clientid") or "",
            user_data.get("sertypehash", ""),
            wire_name=name,
            wire_type=type,
        )

    def stop(self) -> None:
        """Stop reading builtin topics, and wait for a thread that reads.

        Deleting a builtin reader also frees the samples that such a thread has on loan.
        """
        with self._lock:
            self._is_stopped = True

    def matched(self, entity: int, *, is_writer: bool) -> list[bytes]:
        """Return the GUIDs of the endpoints that are matched with a writer or reader of this participant."""
        api = self._api
        count_of = api.get_matched_subscriptions if is_writer else api.get_matched_publications
        capacity = 64
        while True:
            handles = (ct.c_uint64 * capacity)()
            count = count_of(entity, handles, capacity)
            if count <= capacity:
                break
            capacity = count
        known, find = self.guids.get, self.endpoint_guid
        return [
            guid
            for handle in handles[: max(0, count)]
            if (guid := known(handle) or find(entity, handle, is_writer=is_writer)) is not None
        ]

    def endpoint_guid(self, entity: int, handle: int, *, is_writer: bool) -> bytes | None:
        """Return the GUID of the endpoint that has a local handle and is matched with `entity`; None if it is unknown.

        If the endpoint's discovery event was not read yet, Cyclone is queried.
        """
        guid = self.guids.get(handle)
        if guid is None:
            api = self._api
            get_data = api.get_matched_subscription_data if is_writer else api.get_matched_publication_data
            pointer = get_data(entity, handle)
            if not pointer:
                return None
            guid = self.guids[handle] = bytes(cast_loan(pointer, BuiltinEndpoint).key)
            api.builtintopic_free_endpoint(pointer)
        return guid
