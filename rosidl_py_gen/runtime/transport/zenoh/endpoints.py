"""Publishers and subscribers of topics.

Decides what a quality of service means to Zenoh (docs/internals/zenoh.md 5): only endpoints that are transient local
are "advanced" ones, with a cache or a history; everybody else's are on the same key and exchange samples with them all
the same.

Publishers of Lyrical and later send messages with an unbounded array of bytes on another key, and nothing at all to a
subscriber that does not say it listens there. So ours do, and say so, always: earlier distributions read a token
no further than they know it, never send on that key, and have no use for the GID of a subscriber, which is all that
changes for them. Waiting until somebody of Lyrical is there would mean another token, and samples lost meanwhile.

Who may call what, on which thread; there are no locks here, and Zenoh holds its own while it calls us:

1. `write`: any thread, several at once; a counter gives each message its number in one step. A reliable keep-all writer
   waits for slow peers, without the GIL; no other does.
2. `_take`, `receive` and `read_attachment`: a thread of Zenoh, or that of whoever publishes in this process. They put
   the sample into the queue and say so to `Arrivals`, nothing else: no log, no call of Zenoh, no function of a user.
   Whoever blocks that thread stops everything that arrives.
3. Sinks and `_log_bad_attachment`: the thread of the loop, which gets them from `Arrivals`. Only there the queue is
emptied.
4. `set_sink`: the thread of the loop, or of whoever closes. A sample under way may come later: `receive` reads the sink
   once, and a sink finds that its endpoint is closed.
5. `close`: any thread but those of 2; the second one does nothing.
6. `detach_after_fork`: the one thread of a forked child, where those of Zenoh are not.
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
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.qos import Durability, History, Reliability
from rosidl_py_gen.runtime.transport.samples import ReceiveQueue
from rosidl_py_gen.runtime.transport.zenoh.attachment import AttachmentError, pack, unpack
from rosidl_py_gen.runtime.transport.zenoh.keys import cpu_buffer_key
from rosidl_py_gen.runtime.transport.zenoh.qos import DEFAULT_DEPTH

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.samples import Payload, Sink
    from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant

_HEARTBEAT_S = 0.5
_MAX_GAP_PUBLISHERS = 1024
_time_ns = time.time_ns


class SequenceGaps:
    """Counts what is missing between the numbers that arrived; source: docs/internals/zenoh.md 8.

    Samples of one publisher come one after the other, those of several may come in several threads.
    """

    def __init__(self) -> None:
        self._publishers: dict[bytes, list[int]] = {}
        """The highest number so far, and how many were missing below it."""
        self._forgotten = 0

    @property
    def lost(self) -> int:
        """Number of samples missing so far, from the first sequence number of each publisher on."""
        return self._forgotten + sum(missing for _, missing in list(self._publishers.values()))

    def on_sample(self, publisher: bytes, number: int) -> None:
        """A sample has arrived; one that was overtaken counts as missing, as in rmw_zenoh."""
        known = self._publishers.get(publisher)
        if known is None:
            if len(self._publishers) >= _MAX_GAP_PUBLISHERS:
                self._forgotten += self._publishers.pop(next(iter(self._publishers)))[1]
            self._publishers[publisher] = [number, 0]
        elif number > known[0]:
            known[1] += number - known[0] - 1
            known[0] = number


class _Thread(threading.local):
    """What is known of a thread."""

    is_known = False


_thread = _Thread()
_ensure_thread_state = ctypes.PYFUNCTYPE(ctypes.c_int)(("PyGILState_Ensure", ctypes.pythonapi))
"""Called once in a thread of Zenoh: Python keeps what it knows of it, and does not make that anew for each call."""


def zenoh_handler(function: Callable[[Any], None], drop: Callable[[], None] | None = None) -> Any:
    """A function that Zenoh calls on its own thread; otherwise there would be a thread for each."""

    def call(thing: Any) -> None:
        if not _thread.is_known:
            _thread.is_known = True
            _ensure_thread_state()
        function(thing)

    return zenoh.handlers.Callback(call, drop=drop, indirect=False)


def leak_after_fork(*things: object) -> None:
    """Never delete these: in a forked child that would wait for threads which are not there."""
    for thing in things:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))


# -------------------------------------------------------------------------------------------------------------- topics


def declare_publisher(session: Any, key: str, qos: QoSProfile) -> Any:
    """What publishes on a key with that profile."""
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
    """What receives the samples of a key, with that profile."""
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


class ZenohWriter:
    """See `port.Writer`."""

    def __init__(self, owner: ZenohParticipant, info: DiscoveredEndpoint, key: str) -> None:
        self._owner = owner
        self.info = info
        self.guid = info.guid
        self.handle = int.from_bytes(info.guid, "little")
        self._key = key
        self._numbers = itertools.count(1)
        self._publisher = declare_publisher(owner.session, key, info.qos)
        self._put = self._publisher.put
        self._closed = False

    def write(self, data: Payload) -> bool:
        """See `port.Writer`. A reliable keep-all writer waits here for slow peers, without the GIL."""
        if self._closed:
            raise ClosedError(f"the writer of {self.info.channel.name} is closed")
        attachment = pack(next(self._numbers), _time_ns(), self.guid)
        try:
            self._put(data if data.__class__ is bytes else bytes(data), attachment=attachment)
        except zenoh.ZError as error:
            raise TransportError(f"write {len(data)} bytes to {self.info.channel.name}: {error}") from None
        return True

    def matched_readers(self) -> list[bytes]:
        return list(self._owner.graph.connected(self.info))

    def has_readers(self) -> bool:
        return bool(self._owner.graph.connected(self.info))

    def all_acknowledged(self) -> bool:
        """Zenoh tells nothing of that; reliable links pass on what they took."""
        return True

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def assert_liveliness(self) -> None:
        """Nobody looks for it."""

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._owner.undeclare_token(self.guid)
            self._publisher.undeclare()

    def detach_after_fork(self) -> None:
        """In a forked child: touch nothing."""
        self._closed = True
        leak_after_fork(self._publisher, self._put)


class ZenohReader:
    """See `port.Reader`; the queue is filled by `_take`."""

    def __init__(
        self, owner: ZenohParticipant, info: DiscoveredEndpoint, key: str, *, ignore_local: bool = False
    ) -> None:
        self._owner = owner
        self.info = info
        self.guid = info.guid
        self.queue = ReceiveQueue(info.qos)
        self._ignore_local = ignore_local
        self._sink: Sink | None = None
        self._gaps: SequenceGaps | None = None
        self._complaint = ""
        self._closed = False
        self._subscriber = self._declare(key)

    def _declare(self, key: str) -> Any:
        session, qos = self._owner.session, self.info.qos
        return declare_subscriber(session, key, qos, self._take, ignore_local=self._ignore_local)

    def _take(self, sample: Any) -> None:
        """Called by Zenoh with each sample."""
        told = self.read_attachment(sample)
        data = sample.payload.to_bytes()
        if told is not None and self._gaps is not None:
            self._gaps.on_sample(told[2], told[0])
        if told is not None and data:
            self.receive((data, told[1], int.from_bytes(told[2], "little"), _time_ns(), told[0]))

    def receive(self, sample: Any) -> None:
        """Take a sample, or what else is received here, into the queue."""
        self.queue.push(sample)
        sink = self._sink  # another thread may take it away
        if sink is not None:
            self._owner.arrivals.put(sink)

    def read_attachment(self, thing: Any) -> tuple[int, int, bytes] | None:
        """Number, time and GID beside a sample or query; None, and a word in the log, when they are not there."""
        attached = thing.attachment
        try:
            if attached is None:
                raise AttachmentError("expected an attachment of 33 bytes, found none")
            return unpack(attached.to_bytes())
        except AttachmentError as error:
            self._complaint = self._complaint or f"dropped what came on {thing.key_expr}: {error}"
            self._owner.arrivals.put(self._log_bad_attachment)
            return None

    def _log_bad_attachment(self) -> None:
        """On the loop's thread: an output may block, and log handlers have locks."""
        complaint, self._complaint = self._complaint, ""
        internal_logger().warning(complaint, throttle_s=1.0)

    def set_sink(self, sink: Sink | None) -> None:
        self._sink = sink
        if sink is not None and self.queue.items:
            self._owner.arrivals.put(sink)

    def fetch(self) -> bool:
        """Everything is in the queue already."""
        return bool(self.queue.items)

    def matched_writers(self) -> list[bytes]:
        connected = self._owner.graph.connected(self.info)
        own = self.info.participant_guid if self._ignore_local else None
        return [guid for guid, one in connected.items() if one.participant_guid != own]

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        if event != "message_lost":
            return None
        if self._gaps is None:  # what nobody asks for is not counted
            self._gaps = SequenceGaps()
        return (self._gaps.lost,)

    def writer_guid(self, handle: int) -> bytes | None:
        """The handle is the GUID as a number, 0 where it is not known."""
        return handle.to_bytes(16, "little") if handle else None

    def close(self) -> None:
        if not self._closed:
            self._closed, self._sink = True, None
            self._owner.undeclare_token(self.guid)
            self._subscriber.undeclare()

    def detach_after_fork(self) -> None:
        """In a forked child: touch nothing."""
        self._closed, self._sink = True, None
        leak_after_fork(self._subscriber)


class BufferReader(ZenohReader):
    """A reader that listens on the key for buffers, too; each sample comes on one of the two."""

    def __init__(
        self, owner: ZenohParticipant, info: DiscoveredEndpoint, key: str, *, ignore_local: bool = False
    ) -> None:
        super().__init__(owner, info, key, ignore_local=ignore_local)
        try:
            self._channel = self._declare(cpu_buffer_key(key))
        except BaseException:
            self._subscriber.undeclare()
            raise

    def close(self) -> None:
        if not self._closed:
            super().close()
            self._channel.undeclare()

    def detach_after_fork(self) -> None:
        super().detach_after_fork()
        leak_after_fork(self._channel)
