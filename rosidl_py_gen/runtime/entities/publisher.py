"""Publishers of topics.

If a reliable reader is so slow that the transport makes the writer wait, a sample published on the thread that runs the
event loop goes into a `SendQueue`, which has the depth of the publisher. On any other thread `publish` blocks, without
the GIL.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Generic, Literal, TypeVar

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.errors import EncodeError
from rosidl_py_gen.runtime.entities.entity_scope import Entity, entity_repr
from rosidl_py_gen.runtime.graph.endpoint_events import watch_events
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode
from rosidl_py_gen.runtime.loop.send_queue import RETRY_INTERVAL_S, SendQueue
from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
from rosidl_py_gen.runtime.transport.matching import resolve_best_available
from rosidl_py_gen.runtime.transport.qos import History

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.graph.endpoint_events import PublisherEventCallbacks
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import Writer
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

T = TypeVar("T")


class Publisher(Entity, Generic[T]):
    """Publisher of a topic, created by `Node.create_publisher`."""

    def __init__(
        self,
        scope: EntityScope,
        message_type: MessageType[T],
        topic: str,
        qos: QoSProfile,
        *,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> None:
        mode = checked_mode(type_hash_check, scope.type_hash_check)
        super().__init__(scope)
        self._loop_binding = scope.loop_binding
        self.topic: str = topic
        """Fully qualified name of the topic, after expansion and remapping."""
        self.message_type: str = message_type.ros_name
        """Name of the message type: ``pkg/msg/Name``."""
        self._topic_key = TopicKey.of_topic(topic, qos)
        spec = EndpointSpec(self._topic_key, self.message_type, qos, message_type.type_hash, scope.number)
        scope.discovery.refresh()
        peers = [endpoint.qos for endpoint in scope.graph.endpoints_on(self._topic_key, writers=False)]
        self.qos: QoSProfile = resolve_best_available(qos, publisher=True, peers=peers)
        """QoS profile in use; BEST_AVAILABLE is replaced according to the peers known at creation."""
        self._encode = message_type.encode
        self._writer: Writer = scope.participant.create_writer(replace(spec, qos=self.qos))
        self._write = self._writer.write
        scope.set_type_hash_check(mode, self._writer.guid)
        keep_all = self.qos.history is History.KEEP_ALL
        self._send_queue = SendQueue(
            scope.loop_binding, None if keep_all else max(1, self.qos.depth), scope.report_failure
        )
        self._events = watch_events(
            scope, self._writer, self._writer.matched_readers, event_callbacks, self._described()
        )
        scope.register(self, writer=self._writer.guid)

    def publish(self, message: T) -> None:
        """Send a message, from any thread. On the thread that runs the event loop, the method returns at once.

        Raises:
            EncodeError: the message does not fit its type.
            TypeError: the message has another type.
            ClosedError: the publisher or its node is closed, also while waiting; the message was not sent.
        """
        if self._closed or self._scope.closed:  # a call less for each message
            self._require_open()
        loop = self._loop_binding.bound_loop
        if loop is None or loop.is_closed():  # the node was created before its loop
            self._loop_binding.adopt_running_loop()
        data = self._encode(message)
        if self._send_queue.waiting or not self._write(data):
            self._send_later(partial(self._write, data))

    def publish_raw(self, data: bytes) -> None:
        """Send a serialized message, which begins with the 4-byte encapsulation header.

        Raises:
            EncodeError: the data is shorter than header and one byte, or not little-endian XCDR1, which DDS misreads.
            TypeError: the data is not bytes.
            ClosedError: the publisher or its node is closed.
        """
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError(f"publish_raw takes bytes, got {type(data).__name__}: {data!r:.100}")
        self._require_open()
        if len(data) < 5 or bytes(data[:2]) != b"\x00\x01":
            found = bytes(data[:4]).hex(" ")
            reason = f"expected the header 00 01 xx xx (XCDR1, little endian) and at least one byte, found {found!r}"
            raise EncodeError(self.message_type, f"{reason} in {len(data)} bytes")
        if self._send_queue.waiting or not self._write(data):
            self._send_later(partial(self._write, bytes(data)))

    def _publish_without_waiting(self, message: T) -> None:
        """Publish a message and return at once on every thread; for logging, which must not delay its caller."""
        data = self._encode(message)
        if not self._closed and (self._send_queue.waiting or not self._write(data)):
            self._send_queue.send(partial(self._write, data))

    def _send_later(self, write: Callable[[], bool]) -> None:
        if self._loop_binding.in_loop_thread():
            self._send_queue.send(write)
            return
        while not (self._send_queue.flush() and write()):
            time.sleep(RETRY_INTERVAL_S)
            self._require_open()

    @property
    def subscription_count(self) -> int:
        """Number of matched subscriptions, including readers of programs without ROS; 0 after `close`."""
        return 0 if self._closed else len(self._writer.matched_readers())

    def get_subscription_count(self) -> int:
        """Return `subscription_count`; for compatibility with rclpy."""
        return self.subscription_count

    @property
    def topic_name(self) -> str:
        """Topic name, equal to `topic`; for compatibility with rclpy."""
        return self.topic

    def matched_subscriptions(self) -> list[bytes]:
        """Return the GUIDs of the matched readers."""
        return self._writer.matched_readers()

    @property
    def has_subscriptions(self) -> bool:
        """True if at least one subscription is matched; cheaper than `subscription_count`."""
        return not self._closed and self._writer.has_readers()

    @property
    def dropped(self) -> int:
        """Number of messages that were never sent, because newer messages replaced them in the full send queue
        (keep-last publishers only).
        """
        return self._send_queue.dropped

    @property
    def gid(self) -> bytes:
        """The 16 bytes that identify this publisher in the graph."""
        return self._writer.guid

    async def wait_for_subscribers(self, timeout_s: float | None = None, *, count: int = 1) -> Literal[True]:
        """Wait until at least `count` subscriptions are matched.

        Raises:
            WaitTimeoutError: fewer subscriptions were matched within `timeout_s`.
            ClosedError: the publisher is closed, also while waiting.
        """
        return await self._scope.wait_or_raise(
            lambda: self.subscription_count >= count,
            timeout_s,
            lambda: f"{pluralize(self.subscription_count, 'subscription')} on {self.topic}, expected at least {count},",
            self,
            why=self._why_unmatched,
        )

    wait_for_subscribers_sync = blocking(wait_for_subscribers)

    def _why_unmatched(self) -> str:
        matched = self.matched_subscriptions()
        return self._scope.why_unmatched(self._writer.guid, self._topic_key, is_writer=True, matched=matched).text

    async def wait_for_acknowledged(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until every reliable subscription has acknowledged all messages.

        Raises:
            WaitTimeoutError: a subscription has not acknowledged all messages within `timeout_s`.
        """
        return await self._scope.wait_or_raise(
            lambda: self._send_queue.flush() and self._writer.all_acknowledged(),
            timeout_s,
            lambda: (
                f"messages on {self.topic} were not acknowledged by all "
                f"{pluralize(self.subscription_count, 'subscription')}"
            ),
            self,
            poll_s=0.002,
        )

    wait_for_acknowledged_sync = blocking(wait_for_acknowledged)

    def assert_liveliness(self) -> None:
        """Declare that this publisher is alive; needed with manual liveliness while it publishes nothing.

        The method must be called before the liveliness lease expires. After that, peers accept the publisher again when
        it publishes.
        """
        self._require_open()
        self._writer.assert_liveliness()

    def _described(self) -> str:
        return f"the publisher on {self.topic}"

    def __repr__(self) -> str:
        details = self.topic, self.message_type, self.qos.short()
        return entity_repr(self, *details, peers=lambda: self.subscription_count, peer="subscription")

    def close(self) -> None:
        """Stop publishing; messages that wait to be sent are dropped. May be called twice."""
        if self._begin_close(self._writer.guid):
            if self._events is not None:
                self._events.close()
            self._send_queue.close()
            self._writer.close()
