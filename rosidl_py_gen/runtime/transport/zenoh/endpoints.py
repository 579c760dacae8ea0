"""Publishers and subscribers of topics on Zenoh.

Only endpoints that are transient local are "advanced" ones of Zenoh, with a cache or a history
(docs/internals/zenoh.md 5); they exchange samples with all others on the same key.

Publishers of Lyrical and later send messages with an unbounded array of bytes on another key, and nothing to a
subscriber that does not announce that it listens on that key. So subscribers of this package always announce it;
earlier distributions ignore the announcement.

Thread rules; this module has no locks, and Zenoh holds locks while it calls functions of this module:

1. `write`: any, several at once; an atomic counter numbers the messages. A reliable keep-all writer waits for slow
   peers without the GIL; no other writer waits.
2. `_take`, `receive` and `read_attachment`: a thread of Zenoh, or one that publishes in this process. They add the
   sample to the queue and the sink to `ReadyItems`, and must not log, call Zenoh or call functions of the user: a
   blocked thread of Zenoh stops all reception.
3. Sinks and `_log_bad_attachment`: loop, by `ReadyItems`. Only there the queue is emptied.
4. `set_sink`: loop, or the closing thread. A sample may arrive during it: `receive` reads the sink once, and a sink
   detects that its endpoint is closed.
5. `close`: any thread but the threads of 2; the second call does nothing.
6. `detach_after_fork`: the only thread of a forked child, which has no thread of Zenoh.
"""

from __future__ import annotations

import ctypes
import itertools
import threading
import time
from typing import TYPE_CHECKING, Any

import zenoh
import zenoh.ext
import zenoh.handlers

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.logs import internal_logger
from rosidl_py_gen.runtime.transport.api import Payload, ReceiveQueue, Sink, TransportError
from rosidl_py_gen.runtime.transport.middleware_threads import retain_thread_state
from rosidl_py_gen.runtime.transport.qos import Durability, History, QoSProfile, Reliability
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    DEFAULT_DEPTH,
    AttachmentError,
    Infos,
    cpu_buffer_key,
    pack_attachment,
    unpack_attachment,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant

_HEARTBEAT_S = 0.5
_MAX_GAP_PUBLISHERS = 1024
_time_ns = time.time_ns


class SequenceGaps:
    """Counter of samples that did not arrive, found by gaps in their sequence numbers (docs/internals/zenoh.md 8).

    Samples of one publisher arrive one after the other, samples of several publishers maybe in several threads.
    """

    def __init__(self) -> None:
        self._publishers: dict[bytes, list[int]] = {}
        """Highest sequence number that has arrived from each publisher, and the number of lower ones that are missing.
        """
        self._lost_of_removed = 0

    @property
    def lost(self) -> int:
        """Number of missing samples, from the first sequence number of each publisher on."""
        return self._lost_of_removed + sum(missing for _, missing in list(self._publishers.values()))

    def on_sample(self, publisher: bytes, number: int) -> None:
        """Record the sequence number of a sample.

        A sample that arrives after a later one stays counted as missing, as in rmw_zenoh.
        """
        entry = self._publishers.get(publisher)
        if entry is None:
            if len(self._publishers) >= _MAX_GAP_PUBLISHERS:
                self._lost_of_removed += self._publishers.pop(next(iter(self._publishers)))[1]
            self._publishers[publisher] = [number, 0]
        elif number > entry[0]:
            entry[1] += number - entry[0] - 1
            entry[0] = number


def zenoh_handler(function: Callable[[Any], None], drop: Callable[[], None] | None = None) -> Any:
    """Return a handler that Zenoh calls in one of its own threads.

    Zenoh would otherwise create a thread for each handler.
    """

    def call(argument: Any) -> None:
        retain_thread_state()
        function(argument)

    return zenoh.handlers.Callback(call, drop=drop, indirect=False)


def leak_after_fork(*objects: object) -> None:
    """Prevent Python from deleting objects of Zenoh: in a forked child, deletion would wait for threads that do not
    exist.
    """
    for leaked in objects:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(leaked))


def declare_publisher(session: Any, key: str, qos: QoSProfile) -> Any:
    """Declare a Zenoh publisher with the given QoS profile."""
    is_reliable = qos.reliability is Reliability.RELIABLE
    reliability = zenoh.Reliability.RELIABLE if is_reliable else zenoh.Reliability.BEST_EFFORT
    blocks = is_reliable and qos.history is History.KEEP_ALL
    congestion_control = zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP
    if qos.durability is not Durability.TRANSIENT_LOCAL:
        return session.declare_publisher(key, reliability=reliability, congestion_control=congestion_control)
    misses = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S) if is_reliable else None
    return zenoh.ext.declare_advanced_publisher(
        session,
        key,
        reliability=reliability,
        congestion_control=congestion_control,
        cache=zenoh.ext.CacheConfig(qos.depth or DEFAULT_DEPTH),
        sample_miss_detection=misses,
        publisher_detection=True,
    )


def declare_subscriber(
    session: Any, key: str, qos: QoSProfile, take: Callable[[Any], None], *, ignore_local: bool
) -> Any:
    """Declare a Zenoh subscriber with the given QoS profile; Zenoh calls `take` with each sample."""
    origin = zenoh.Locality.REMOTE if ignore_local else zenoh.Locality.ANY
    if qos.durability is not Durability.TRANSIENT_LOCAL:
        return session.declare_subscriber(key, zenoh_handler(take), allowed_origin=origin)
    is_reliable = qos.reliability is Reliability.RELIABLE
    return zenoh.ext.declare_advanced_subscriber(
        session,
        key,
        zenoh_handler(take),
        allowed_origin=origin,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth or DEFAULT_DEPTH),
        recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if is_reliable else None,
        subscriber_detection=True,
    )


class _ZenohEndpoint:
    """Base of the writers and readers of the Zenoh transport; `infos` are their endpoints in the graph."""

    def __init__(self, owner: ZenohParticipant, infos: Infos) -> None:
        self._owner = owner
        self.infos = infos
        self.info = infos[0]
        self.guid = self.info.guid
        self.token: Any = None
        """Liveliness token that announces the endpoint; None if the endpoint belongs to no node."""
        self._closed = False


class ZenohWriter(_ZenohEndpoint):
    """Writer of the Zenoh transport."""

    def __init__(self, owner: ZenohParticipant, infos: Infos, key: str) -> None:
        super().__init__(owner, infos)
        self.handle = int.from_bytes(self.guid, "little")
        self._numbers = itertools.count(1)
        self._publisher = declare_publisher(owner.session, key, self.info.qos)
        self._put = self._publisher.put

    def write(self, data: Payload) -> bool:
        if self._closed:
            raise ClosedError(f"the writer of {self.info.topic_key.name} is closed")
        attachment = pack_attachment(next(self._numbers), _time_ns(), self.guid)
        try:
            self._put(data if data.__class__ is bytes else bytes(data), attachment=attachment)
        except zenoh.ZError as error:
            raise TransportError(
                f"Zenoh could not write {len(data)} bytes to {self.info.topic_key.name}: {error}"
            ) from None
        return True

    def matched_readers(self) -> list[bytes]:
        return list(self._owner.graph.connected(self.info))

    def has_readers(self) -> bool:
        return bool(self._owner.graph.connected(self.info))

    def all_acknowledged(self) -> bool:
        return True  # Zenoh does not report acknowledgements; reliable links forward what they accepted

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def assert_liveliness(self) -> None:
        """Do nothing: no peer checks liveliness."""

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._owner.undeclare_token(self.guid)
            self._publisher.undeclare()

    def detach_after_fork(self) -> None:
        """Stop using resources that were inherited from the parent process; called in a forked child."""
        self._closed = True
        leak_after_fork(self._publisher, self._put)


class ZenohReader(_ZenohEndpoint):
    """Reader of the Zenoh transport; with `has_buffer`, each sample arrives on one of two keys."""

    def __init__(
        self,
        owner: ZenohParticipant,
        infos: Infos,
        key: str,
        *,
        ignore_local: bool = False,
        has_buffer: bool = False,
    ) -> None:
        super().__init__(owner, infos)
        self.queue = ReceiveQueue(self.info.qos)
        self._push_lock = threading.RLock()
        """Lock held while a sample is added, because several threads of Zenoh may receive samples of different writers.
        """
        self._ignore_local = ignore_local
        self._sink: Sink | None = None
        self._gaps: SequenceGaps | None = None
        self._bad_attachment = ""
        self._key = key
        self._declarations = [self._declare(key)]
        if has_buffer:
            try:
                self._declarations.append(self._declare(cpu_buffer_key(key)))
            except BaseException:
                self._declarations[0].undeclare()
                raise

    def _declare(self, key: str) -> Any:
        session, qos = self._owner.session, self.info.qos
        return declare_subscriber(session, key, qos, self._take, ignore_local=self._ignore_local)

    def _take(self, sample: Any) -> None:
        """Add a received sample to the queue. Called by Zenoh with each sample; must not block or log."""
        attachment = self.read_attachment(sample)
        data = sample.payload.to_bytes()
        if attachment is not None:
            number, source_ns, gid = attachment
            if self._gaps is not None:
                self._gaps.on_sample(gid, number)
            if data:
                self.receive((data, source_ns, int.from_bytes(gid, "little"), _time_ns(), number))

    def receive(self, item: Any) -> None:
        """Add a sample, request or reply to the queue."""
        with self._push_lock:
            self.queue.push(item)
        sink = self._sink  # another thread may remove it
        if sink is not None:
            self._owner.ready_sinks.put(sink)

    def read_attachment(self, received: Any) -> tuple[int, int, bytes] | None:
        """Return number, time and GID of a sample or query; None, with a warning, if the attachment is invalid."""
        attachment = received.attachment
        try:
            if attachment is None:
                raise AttachmentError("expected an attachment of 33 bytes, found none")
            return unpack_attachment(attachment.to_bytes())
        except AttachmentError as error:
            self._bad_attachment = self._bad_attachment or f"dropped a sample on {received.key_expr}: {error}"
            self._owner.ready_sinks.put(self._log_bad_attachment)  # in the loop: log handlers may block
            return None

    def _log_bad_attachment(self) -> None:
        text, self._bad_attachment = self._bad_attachment, ""
        internal_logger().warning(text, throttle_s=1.0)

    def set_sink(self, sink: Sink | None) -> None:
        self._sink = sink
        if sink is not None and self.queue.items:
            self._owner.ready_sinks.put(sink)

    def fetch(self) -> bool:
        return bool(self.queue.items)  # samples are received into the queue

    def matched_writers(self) -> list[bytes]:
        own = self.info.participant_guid if self._ignore_local else None
        connected = self._owner.graph.connected(self.info)
        return [guid for guid, writer in connected.items() if writer.participant_guid != own]

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        if event != "message_lost":
            return None
        if self._gaps is None:  # not counted before the first request
            self._gaps = SequenceGaps()
        return (self._gaps.lost,)

    def writer_guid(self, handle: int) -> bytes | None:
        return handle.to_bytes(16, "little") if handle else None  # 0 if unknown

    def close(self) -> None:
        if not self._closed:
            self._closed, self._sink = True, None
            self._owner.undeclare_token(self.guid)
            while self._declarations:
                self._declarations.pop().undeclare()

    def detach_after_fork(self) -> None:
        """Stop using resources that were inherited from the parent process; called in a forked child."""
        self._closed, self._sink = True, None
        leak_after_fork(*self._declarations)
