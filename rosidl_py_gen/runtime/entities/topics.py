"""Publishers and subscriptions of topics.

If a reliable reader is so slow that the transport makes the writer wait, a sample published on the thread that runs the
event loop goes into a `SendQueue`, which has the depth of the publisher. On any other thread `publish` blocks, without
the GIL.

The program iterates over the messages of a subscription, or passes a callback. Messages are decoded when they are taken
from the receive queue, not when they arrive, so that dropped messages cost nothing. A sample that cannot be decoded is
counted, logged at most once per second, and skipped.

A plain callback is called for each message on the event loop. An async callback is awaited for one message after the
other, or for `concurrency` messages at once, while new messages wait in the queue. The first messages that the queue
drops are logged, unless its depth is 1, which means that only the newest message is needed.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Generic, Literal, NamedTuple, TypeVar, cast

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import Waiters, blocking, current_loop
from rosidl_py_gen.errors import ClosedError, DecodeError, EncodeError
from rosidl_py_gen.runtime.entities.endpoint_events import watch_events
from rosidl_py_gen.runtime.entities.entity_scope import (
    QOS_HINT,
    Entity,
    PollableEntity,
    Throttle,
    entity_repr,
    user_callback,
)
from rosidl_py_gen.runtime.entities.message_types import TypeHashFilter, has_unbounded_bytes
from rosidl_py_gen.runtime.graph import checked_mode
from rosidl_py_gen.runtime.loop.callbacks import UserCallback, require_concurrency
from rosidl_py_gen.runtime.loop.queues import RETRY_INTERVAL_S, SendQueue
from rosidl_py_gen.runtime.time_values import Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
from rosidl_py_gen.runtime.transport.qos import History, resolve_best_available

if TYPE_CHECKING:
    from collections import deque
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.entities.endpoint_events import PublisherEventCallbacks, SubscriptionEventCallbacks
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.transport.api import Payload, Reader, Sample, Writer
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


# -------------------------------------------------------------------------------------------------------- subscriptions

_INFO_HINT = "; receive_with_info() of a subscription without callback returns the origin of a message"


class MessageInfo(NamedTuple):
    """Times and origin of a message.

    Attributes:
        source_timestamp_ns: time of publishing, by the publisher's clock, ns since the epoch.
        received_timestamp_ns: time when this process took the message from the transport, ns since the epoch.
        publisher_gid: 16 bytes that identify the publisher in the graph; zeros if it left before it was discovered.
        publication_sequence_number: number of the message, counted by the publisher; None on DDS, whose C library does
            not provide it.
    """

    source_timestamp_ns: int
    received_timestamp_ns: int
    publisher_gid: bytes
    publication_sequence_number: int | None = None


class Subscription(PollableEntity, Generic[T]):
    """Subscription to a topic, created by `Node.create_subscription`."""

    def __init__(
        self,
        scope: EntityScope,
        message_type: MessageType[T],
        topic: str,
        callback: Callable[[T], object] | None,
        qos: QoSProfile,
        *,
        ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> None:
        mode = checked_mode(type_hash_check, scope.type_hash_check)
        require_concurrency(concurrency)
        subject = f"the callback of {topic}"
        checked = user_callback(scope, callback, subject, "the message", hint=_INFO_HINT, type_hint=QOS_HINT)
        super().__init__(scope)
        self.topic: str = topic
        """Fully qualified name of the topic, after expansion and remapping."""
        self.message_type: str = message_type.ros_name
        """Name of the message type: ``pkg/msg/Name``."""
        self.undecodable: int = 0
        """Number of samples that could not be decoded."""
        self._count_lock = threading.RLock()
        self._decode: Callable[[Payload], T] = message_type.decode
        self._callback = checked
        self._concurrency = concurrency
        self._running_calls = 0
        """Number of calls of an async callback that have not ended."""
        self._waiters = Waiters()
        self._latest: T | None = None
        self._throttle = Throttle(scope.clocks)
        self._topic_key = TopicKey.of_topic(topic, qos)
        spec = EndpointSpec(
            self._topic_key,
            self.message_type,
            qos,
            message_type.type_hash,
            scope.number,
            ignore_local=ignore_local,
            has_buffer=has_unbounded_bytes(message_type),
        )
        scope.discovery.refresh()
        peers = [endpoint.qos for endpoint in scope.graph.endpoints_on(self._topic_key, writers=True)]
        self.qos: QoSProfile = resolve_best_available(qos, publisher=False, peers=peers)
        """QoS profile in use; BEST_AVAILABLE is replaced according to the peers known at creation."""
        self._reader: Reader = scope.participant.create_reader(replace(spec, qos=self.qos))
        self._items = self._reader.queue.items
        self._type_hash_filter = TypeHashFilter(scope, mode, self._reader.writer_guid, message_type, topic)
        self._accepted_writers = self._type_hash_filter.accepted_writers
        scope.set_type_hash_check(mode, self._reader.guid, self._type_hash_filter.remember)
        depth = self._reader.queue.depth
        self._warning_length = depth if depth > 1 else -1
        """Queue length at which a dropped message causes a warning; -1 after the warning, or if the depth is 1."""
        self._events = watch_events(
            scope, self._reader, self._reader.matched_writers, event_callbacks, self._described()
        )
        self._reader.set_sink(self._on_data)
        scope.register(self, reader=self._reader.guid)

    def __aiter__(self) -> Subscription[T]:
        self._require_no_callback()
        return self

    async def __anext__(self) -> T:
        while not self._closed:
            taken = self._take()
            if taken is not None:
                self._latest = taken[0]
                return taken[0]
            await self._arrival()
        raise StopAsyncIteration

    async def receive(self, timeout_s: float | None = None) -> T:
        """Return the oldest message that was not taken yet; wait for a message if there is none.

        Raises:
            WaitTimeoutError: no message arrived within `timeout_s`; a `TimeoutError`.
            ClosedError: the subscription was closed, also while waiting.
        """
        return (await self._receive(timeout_s))[0]

    receive_sync = blocking(receive)

    async def receive_with_info(self, timeout_s: float | None = None) -> tuple[T, MessageInfo]:
        """Return the message of `receive`, with its `MessageInfo` (timestamps, GID of the publisher).

        Raises:
            WaitTimeoutError: no message arrived within `timeout_s`; a `TimeoutError`.
            ClosedError: the subscription was closed, also while waiting.
        """
        message, sample = await self._receive(timeout_s)
        return message, self._info(sample)

    receive_with_info_sync = blocking(receive_with_info)

    def take(self) -> T | None:
        """Return the oldest message that was not taken yet, or None, without waiting; from any thread.

        Received messages are available without an event loop, except if the context has a `LoopRunner`: its loop must
        run to receive. If messages are not taken, the oldest messages are dropped according to the depth.

        Raises:
            CallbackInUseError: the subscription has a callback.
            ClosedError: the subscription or its node is closed.
        """
        taken = self._take_next()
        return None if taken is None else taken[0]

    def take_with_info(self) -> tuple[T, MessageInfo] | None:
        """Return the message of `take`, with its `MessageInfo` (timestamps, GID of the publisher), or None.

        Raises:
            CallbackInUseError: the subscription has a callback.
            ClosedError: the subscription or its node is closed.
        """
        taken = self._take_next()
        return None if taken is None else (taken[0], self._info(taken[1]))

    def _take_next(self) -> tuple[T, Sample] | None:
        if self._callback is not None or self._closed or self._scope.closed:
            self._require_takeable()
        taken = self._take()
        if taken is None and not self._scope.loop_binding.has_user_runner and self._reader.fetch():
            taken = self._take()
        if taken is not None:
            self._latest = taken[0]
        return taken

    def _set_definition(self, message_type: MessageType[T], taken: deque[tuple[T, MessageInfo]]) -> None:
        """Set the definition of raw messages that was not known at creation.

        From then on messages of other definitions are dropped.

        Args:
            taken: raw messages that were taken before, of this or an earlier subscription; messages of other
                definitions are removed.
        """
        self._type_hash_filter.set_definition(message_type)
        for _ in range(len(taken)):
            data, info = taken.popleft()
            if self._type_hash_filter.accepts_from(info.publisher_gid, cast("Payload", data)):
                taken.append((data, info))

    def _info(self, sample: Sample) -> MessageInfo:
        _, source_ns, handle, received_ns, number = sample
        return MessageInfo(source_ns, received_ns, self._reader.writer_guid(handle) or bytes(16), number)

    async def _receive(self, timeout_s: float | None) -> tuple[T, Sample]:
        self._require_no_callback()
        deadline = Deadline(timeout_s)
        self._require_open()
        while not self._closed:
            taken = self._take()
            if taken is not None:
                self._latest = taken[0]
                return taken
            if not await self._arrival(deadline.remaining_s()):
                raise WaitTimeoutError(f"no message on {self.topic} in {timeout_s} s", self._why_silent())
        raise ClosedError(f"{self._described()} of node {self._scope.node_name} is closed")

    def _take(self, newest_of: list[Sample] | None = None) -> tuple[T, Sample] | None:
        """Return the oldest received message that can be decoded, or None.

        Several threads may call this method at the same time.

        Args:
            newest_of: list of samples; return the newest message of the list instead, and remove the samples from its
                end.
        """
        items = self._items if newest_of is None else newest_of
        while items and not self._closed:
            try:
                sample = self._items.popleft() if newest_of is None else newest_of.pop()
            except IndexError:  # another thread was faster
                return None
            try:
                if sample[2] in self._accepted_writers or self._type_hash_filter.accepts(sample[2], sample[0]):
                    return self._decode(sample[0]), sample
            except DecodeError as err:
                self._count_undecodable(err)
        return None

    def latest(self) -> T | None:
        """Return the newest message without waiting, or None before the first message; older messages are skipped.

        If `receive` or an iteration has returned the newest message, the same object is returned again.

        Raises:
            CallbackInUseError: the subscription has a callback.
            ClosedError: the subscription or its node is closed.
        """
        self._require_takeable()
        self._reader.fetch()
        waiting = []
        for _ in range(len(self._items)):  # not `clear`, which would also drop a message that arrives in the meantime
            with suppress(IndexError):  # another thread was faster
                waiting.append(self._items.popleft())
        taken = self._take(newest_of=waiting)
        if taken is not None:
            self._latest = taken[0]
        return self._latest

    def _arrival(self, timeout_s: float | None = None) -> Awaitable[bool]:
        """Wait until the receive queue is not empty or the subscription is closed; return False after the timeout."""
        self._scope.loop_binding.running_loop()
        return self._waiters.wait(self._has_news, timeout_s)

    def _has_news(self) -> bool:
        return bool(self._items) or self._closed

    def _is_ready(self) -> bool:
        if self._items:
            return True
        return not self._scope.loop_binding.has_user_runner and self._reader.fetch()

    def _described(self) -> str:
        return f"the subscription on {self.topic}"

    def _deliver(self) -> None:
        """Call the callback for the samples that DDS has received, without waiting until the event loop takes them."""
        self._reader.fetch()
        self._call_back()

    def _deliver_without_loop(self) -> None:
        """Call the callback for the received messages, unless an event loop runs, which would call it. Thread: any."""
        scope = self._scope
        if self._closed or scope.closed or scope.loop_binding.is_running or not self._is_ready():
            return

        async def call_back() -> None:
            self._call_back()

        with suppress(ClosedError):  # by another thread
            if current_loop() is None:
                scope.run_blocking(call_back(), self, "callbacks")
            else:
                scope.loop_binding.call_in_loop(self._call_back)

    def _on_data(self) -> Callable[[], None] | None:
        """Wake up waiting tasks, and return a function that handles received messages, or None.

        The transport calls this method. Thread: loop.
        """
        if self._callback is not None:
            return self._call_back
        self._waiters.wake()
        return self._on_arrival

    def _warn_drops(self) -> None:
        if self._running_calls:
            reason = f"{self._running_calls} calls of its async callback are running (concurrency={self._concurrency})"
            fix = "pass a larger concurrency= or a larger depth in qos="
        else:
            reason = "the event loop was busy, perhaps with a plain callback"
            fix = "pass a larger depth in qos=, and do slow work in asyncio.to_thread"
        self._scope.logger.warning(
            f"messages on {self.topic} are dropped: {self._warning_length} are waiting, and {reason}; {fix}. "
            "subscription.dropped counts them; this is logged once"
        )

    def _call_back(self) -> None:
        callback = self._callback
        if len(self._items) == self._warning_length and self.dropped:
            self._warn_drops()
            self._warning_length = -1
        if callback is None or self._running_calls >= self._concurrency:
            return  # a call that ends continues with the queue
        if callback.is_async:
            for _ in range(min(len(self._items), self._concurrency - self._running_calls)):
                self._running_calls += 1
                self._scope.create_task(self._await_callback(callback))
            return
        # Only the messages that are queued now: a callback that publishes on its own topic must not block the loop.
        for _ in range(len(self._items)):
            taken = self._take()
            if taken is None:
                return
            task = callback.call(taken[0])
            if task is not None:
                self._running_calls += 1
                task.add_done_callback(self._on_call_ended)
                if self._running_calls >= self._concurrency:
                    return
        if self._items and not self._closed:
            self._scope.loop_binding.call_soon(self._call_back)

    async def _await_callback(self, callback: UserCallback) -> None:
        try:
            while (taken := self._take()) is not None:
                await callback.run(taken[0])
        finally:
            self._running_calls -= 1

    def _on_call_ended(self, _: object) -> None:
        self._running_calls -= 1
        self._call_back()

    def _count_undecodable(self, error: DecodeError) -> None:
        with self._count_lock:  # several threads may take
            self.undecodable += 1
        if self._throttle.allows():
            self._scope.logger.warning(
                f"dropped a sample on {self.topic} that is not a {self.message_type} "
                f"({self.undecodable} so far): {error}"
            )

    @property
    def dropped(self) -> int:
        """Number of messages that the full queue dropped before they were taken; undecodable messages do not count.

        If a callback is too slow, the first drop is logged, unless the depth is 1.
        """
        return self._reader.queue.dropped

    @property
    def incompatible_dropped(self) -> int:
        """Number of messages dropped because their publisher has another definition of the type."""
        return self._type_hash_filter.incompatible_dropped

    @property
    def publisher_count(self) -> int:
        """Number of matched publishers; 0 after `close`."""
        return 0 if self._closed else len(self._reader.matched_writers())

    def get_publisher_count(self) -> int:
        """Return `publisher_count`; for compatibility with rclpy."""
        return self.publisher_count

    @property
    def topic_name(self) -> str:
        """Topic name, equal to `topic`; for compatibility with rclpy."""
        return self.topic

    @property
    def gid(self) -> bytes:
        """The 16 bytes that identify this subscription in the graph."""
        return self._reader.guid

    async def wait_for_publishers(self, timeout_s: float | None = None, *, count: int = 1) -> Literal[True]:
        """Wait until at least `count` publishers are matched.

        Raises:
            WaitTimeoutError: fewer publishers were matched within `timeout_s`.
            ClosedError: the subscription is closed, also while waiting.
        """
        return await self._scope.wait_or_raise(
            lambda: self.publisher_count >= count,
            timeout_s,
            lambda: f"{pluralize(self.publisher_count, 'publisher')} on {self.topic}, expected at least {count},",
            self,
            why=self._why_unmatched,
        )

    wait_for_publishers_sync = blocking(wait_for_publishers)

    def _why_unmatched(self) -> str:
        matched = self._reader.matched_writers()
        return self._scope.why_unmatched(self._reader.guid, self._topic_key, is_writer=False, matched=matched).text

    def _why_silent(self) -> str:
        """Return a text with the reason why no message has been received; "" if the reason is unknown."""
        if not (count := self.publisher_count):
            return self._why_unmatched()
        if self.incompatible_dropped and (
            reason := self._scope.discovery.unmatched.disagreeing(self._reader.guid, self._topic_key)
            or self._type_hash_filter.drop_reason
        ):
            return f"{reason}; dropped {pluralize(self.incompatible_dropped, 'message')}"
        silent = f"{pluralize(count, 'publisher')} connected, but sent nothing"
        return (
            f"{silent} that can be decoded ({pluralize(self.undecodable, 'message')} cannot)"
            if self.undecodable
            else silent
        )

    def __repr__(self) -> str:
        details = self.topic, self.message_type, self.qos.short()
        return entity_repr(self, *details, peers=lambda: self.publisher_count, peer="publisher")

    def close(self) -> None:
        """Stop receiving: iterators end, `receive` raises `ClosedError`. From any thread; may be called twice."""
        if self._begin_close(self._reader.guid):
            if self._events is not None:
                self._events.close()
            self._reader.close()
            self._waiters.wake()
            if self._callback is not None:
                self._callback.close()
