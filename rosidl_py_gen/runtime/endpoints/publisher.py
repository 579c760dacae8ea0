"""Publishers: encode, write, and never make the event loop wait.

Decides what happens when a reliable reader is so slow that DDS wants the writer to wait: on the event loop's thread the
sample goes into a backlog that a helper thread sends, in order; on any other thread `publish` itself waits, without the
GIL. A keep-last backlog drops its oldest sample and counts it, a keep-all backlog grows.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.errors import EncodeError, RosidlError
from rosidl_py_gen.runtime.names.dds import endpoint_user_data, topic_name, type_name
from rosidl_py_gen.runtime.transport.matching import resolve_best_available
from rosidl_py_gen.runtime.transport.qos import History

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import MessageType
    from rosidl_py_gen.runtime.transport.interface import Writer
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

T = TypeVar("T")

_log = logging.getLogger(__name__)
_RETRY_S = 0.001


class Publisher(Generic[T]):
    """Made by `Node.create_publisher`."""

    def __init__(self, scope: Scope, message_type: MessageType[T], topic: str, qos: QoSProfile) -> None:
        self._scope = scope
        self._bridge = scope.bridge
        self._closed = False
        self.topic = topic
        """Fully qualified name, after expansion and remapping."""
        self.message_type = message_type.ros_name
        """``pkg/msg/Name``."""
        dds_topic = topic_name(topic, prefix=not qos.avoid_ros_namespace_conventions)
        scope.discovery.refresh()
        peers = [endpoint.info.qos for endpoint in scope.graph.on_topic(dds_topic, writers=False)]
        self.qos = resolve_best_available(qos, publisher=True, peers=peers)
        """The profile in use; BEST_AVAILABLE was replaced by what the peers known at creation allow."""
        self._encode = message_type.encode
        self._writer: Writer = scope.participant.create_writer(
            dds_topic, type_name(message_type.ros_name), self.qos, endpoint_user_data(message_type.type_hash)
        )
        self._write = self._writer.write
        keep_all = self.qos.history is History.KEEP_ALL
        self._backlog = _Backlog(self._writer, None if keep_all else max(1, self.qos.depth))
        scope.add(self._writer.guid)

    def publish(self, message: T) -> None:
        """Send a message; from any thread. On the event loop's thread it returns at once.

        Raises:
            EncodeError: the message does not fit its type. TypeError: it is of another type.
            ClosedError: the publisher or its node is closed, also while waiting; the message was not sent then.
        """
        if self._closed or self._scope.closed:
            self._scope.require_open(True, f"the publisher on {self.topic}")
        loop = self._bridge.attached
        if loop is None or loop.is_closed():  # the node was made before its loop
            self._bridge.adopt_running_loop()
        data = self._encode(message)
        if self._backlog.items or not self._write(data):
            self._send_later(data)

    def publish_raw(self, data: bytes) -> None:
        """Send a message that is serialized already, 4-byte encapsulation header included.

        Raises:
            EncodeError: shorter than header and one byte, or not little-endian XCDR1 (DDS would misread it).
            TypeError: not bytes. ClosedError.
        """
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError(f"publish_raw takes bytes, got {type(data).__name__}: {data!r:.100}")
        self._scope.require_open(self._closed, f"the publisher on {self.topic}")
        if len(data) < 5 or bytes(data[:2]) != b"\x00\x01":
            found = bytes(data[:4]).hex(" ")
            reason = f"expected the header 00 01 xx xx (XCDR1, little endian) and at least one byte, found {found!r}"
            raise EncodeError(self.message_type, f"{reason} in {len(data)} bytes")
        if self._backlog.items or not self._write(data):
            self._send_later(bytes(data))

    def publish_without_waiting(self, message: T) -> None:
        """`publish` that returns at once on every thread; for logging, which must not hold up its caller."""
        data = self._encode(message)
        if not self._closed and (self._backlog.items or not self._write(data)):
            self._backlog.add(data)

    def _send_later(self, data: bytes) -> None:
        if self._scope.bridge.in_loop_thread():
            self._backlog.add(data)
            return
        while self._backlog.items or not self._write(data):
            time.sleep(_RETRY_S)
            self._scope.require_open(self._closed, f"the publisher on {self.topic}")

    @property
    def subscription_count(self) -> int:
        """How many subscriptions receive what is published, bare DDS readers included; 0 when it is closed."""
        return 0 if self._closed else len(self._writer.matched_readers())

    @property
    def has_subscriptions(self) -> bool:
        """Whether anybody receives what is published; cheaper than `subscription_count`."""
        return not self._closed and self._writer.has_readers()

    @property
    def dropped(self) -> int:
        """Messages that were overtaken in the backlog (keep-last only) and never sent."""
        return self._backlog.dropped

    @property
    def gid(self) -> bytes:
        """The 16 bytes that identify this publisher in the graph."""
        return self._writer.guid

    async def wait_for_subscribers(self, timeout_s: float | None = None, *, count: int = 1) -> bool:
        """Wait until at least `count` subscriptions are connected; False when the time passed."""
        return await self._scope.wait_until(lambda: self.subscription_count >= count, timeout_s, lambda: self._closed)

    async def wait_for_acknowledged(self, timeout_s: float | None = None) -> bool:
        """Wait until every reliable subscription confirmed all that was published; False when the time passed."""
        return await self._scope.wait_until(
            lambda: not self._backlog.items and self._writer.all_acknowledged(),
            timeout_s,
            lambda: self._closed,
            poll_s=0.002,
        )

    def assert_liveliness(self) -> None:
        """Say that this publisher is alive; needed with manual liveliness when nothing is published.

        It has to come before the lease ends: peers that gave the publisher up take it back when it publishes.
        """
        self._scope.require_open(self._closed, f"the publisher on {self.topic}")
        self._writer.assert_liveliness()

    def close(self) -> None:
        """Stop publishing; may be called twice. A backlog that was not sent yet is dropped."""
        if self._closed:
            return
        self._closed = True
        self._scope.disown(self)
        self._backlog.close()
        self._scope.remove(self._writer.guid)
        self._writer.close()


class _Backlog:
    """Samples that DDS did not accept at once, and the thread that keeps trying; the thread lives while there are
    any.
    """

    def __init__(self, writer: Writer, depth: int | None) -> None:
        self._writer = writer
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closed = False
        self.items: deque[bytes] = deque(maxlen=depth)
        self.dropped = 0

    def add(self, data: bytes) -> None:
        """Send `data` after everything that is waiting already."""
        with self._lock:
            if len(self.items) == self.items.maxlen:
                self.dropped += 1
            self.items.append(data)
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="rosidl-py-gen backlog", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while True:
            with self._lock:
                # Written under the lock, so that a keep-last overflow cannot take the sample being sent. DDS does not
                # block here (max_blocking_time is 0).
                try:
                    while self.items and not self._closed and self._writer.write(self.items[0]):
                        self.items.popleft()
                except RosidlError:
                    _log.exception("a message that had to wait could not be sent; it is dropped")
                    self.items.popleft()
                    self.dropped += 1
                if not self.items or self._closed:
                    self._thread = None
                    return
            time.sleep(_RETRY_S)

    def close(self) -> None:
        """Forget what is waiting; returns when the thread has ended."""
        with self._lock:
            self._closed = True
            self.items.clear()
            thread = self._thread
        if thread is not None:
            thread.join()
