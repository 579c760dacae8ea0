"""Subscriptions: an async iterator, or a callback, over what arrives on a topic.

Decides how samples leave the receive queue. Messages are decoded when they are taken, not when they arrive, so that
what keep-last drops costs nothing. A sample that does not decode is counted, logged at most once a second, and dropped.

A plain callback is called for each message on the event loop. An async one is awaited message by message, in order, or
with `concurrency` so many at once; while it runs, new messages wait in the queue as its depth allows. The first ones
that are dropped then are worth a warning, unless the depth of 1 says that only the newest counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Generic, Literal, NamedTuple, TypeVar

from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.errors import ClosedError, DecodeError
from rosidl_py_gen.runtime.entities.entity_scope import Throttle, entity_repr, pluralize
from rosidl_py_gen.runtime.entities.message_types import has_unbounded_bytes
from rosidl_py_gen.runtime.entities.pollable import CallbackInUseError, PollableEntity
from rosidl_py_gen.runtime.entities.type_hash_filter import TypeHashFilter
from rosidl_py_gen.runtime.graph.endpoint_events import watch_events
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.loop.callable_checks import require_callable
from rosidl_py_gen.runtime.loop.concurrency import drops_warning, require_concurrency
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.time.deadline import Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.transport.api import EndpointSpec
from rosidl_py_gen.runtime.transport.qos_matching import resolve_best_available

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.graph.endpoint_events import SubscriptionEventCallbacks
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import Reader
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.samples import Payload, Sample

T = TypeVar("T")

_INFO_HINT = "; where a message came from is told by receive_with_info(), of a subscription without callback"


class MessageInfo(NamedTuple):
    """Where and when a message came from.

    Attributes:
        source_timestamp_ns: when it was published, by the publisher's clock, ns since the epoch.
        received_timestamp_ns: when this process took it from the transport, ns since the epoch.
        publisher_gid: the publisher's 16 bytes as in the graph; 16 zeros when it vanished before it was known.
        publication_sequence_number: how many messages the publisher had published with it, by its own count; None
            on DDS, whose C library does not tell.
    """

    source_timestamp_ns: int
    received_timestamp_ns: int
    publisher_gid: bytes
    publication_sequence_number: int | None = None


class Subscription(PollableEntity, Generic[T]):
    """Made by `Node.create_subscription`."""

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
        require_callable(callback, f"the callback of {topic}", "; QoS is given as qos=...")
        if callback is not None:
            require_signature(callback, f"the callback of {topic}", "the message", hint=_INFO_HINT)
        super().__init__(scope)
        self.topic = topic
        """Fully qualified name, after expansion and remapping."""
        self.message_type = message_type.ros_name
        """``pkg/msg/Name``."""
        self.undecodable = 0
        """How many samples did not decode."""
        self._decode: Callable[[Payload], T] = message_type.decode
        self._callback = None if callback is None else UserCallback(scope, callback, f"the callback of {topic}")
        self._concurrency = concurrency
        self._under_way = 0
        """How many calls of an async callback wait for something."""
        self._waiters = Waiters()
        self._latest: T | None = None
        self._throttle = Throttle(scope.clocks)
        spec = EndpointSpec(
            topic,
            self.message_type,
            qos,
            message_type.type_hash,
            scope.number,
            avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
            ignore_local=ignore_local,
            has_buffer=has_unbounded_bytes(message_type),
        )
        scope.discovery.refresh()
        peers = [endpoint.qos for endpoint in scope.graph.endpoints_on(spec.channel, writers=True)]
        self.qos = resolve_best_available(qos, publisher=False, peers=peers)
        """The profile in use; BEST_AVAILABLE was replaced by what the peers known at creation allow."""
        self._channel = spec.channel
        self._reader: Reader = scope.participant.create_reader(replace(spec, qos=self.qos))
        self._items = self._reader.queue.items
        self._check = TypeHashFilter(scope, mode, self._reader.writer_guid, message_type.type_hash)
        self._agreeing = self._check.accepted_writers
        scope.set_type_hash_check(mode, self._reader.guid)
        depth = self._items.maxlen or 0
        self._full = depth if depth > 1 else -1
        """How many items there are when some may have been dropped; -1 until nobody has to be told any more."""
        matched, what = self._reader.matched_writers, f"the subscription on {topic}"
        self._events = watch_events(scope, self._reader, matched, event_callbacks, what)
        self._reader.set_sink(self._on_data)
        scope.register(self, reader=self._reader.guid)

    # --------------------------------------------------------------------------------------------------- receiving

    def __aiter__(self) -> Subscription[T]:
        self._require_no_callback()
        return self

    async def __anext__(self) -> T:
        while not self._closed:
            found = self._take()
            if found is not None:
                self._latest = found[0]
                return found[0]
            await self._arrival()
        raise StopAsyncIteration

    async def receive(self, timeout_s: float | None = None) -> T:
        """The next message, oldest first.

        Raises:
            WaitTimeoutError: none came in `timeout_s` seconds; a `TimeoutError`.
            ClosedError: the subscription was closed, also while waiting.
        """
        return (await self._next_good(timeout_s))[0]

    receive_sync = blocking(receive)

    async def receive_with_info(self, timeout_s: float | None = None) -> tuple[T, MessageInfo]:
        """Like `receive`: the message, and its timestamps and publisher's GID."""
        message, sample = await self._next_good(timeout_s)
        return message, self._info(sample)

    receive_with_info_sync = blocking(receive_with_info)

    def take(self) -> T | None:
        """The next message, oldest first, without waiting; None when there is none. From any thread.

        What has arrived is there without an event loop, too, but where the context has a `Driver`: there it is what was
        taken in while somebody waited. As long as nobody takes it the oldest is dropped for the newest, as the depth
        says.

        Raises:
            CallbackInUseError: the subscription has a callback. ClosedError: it, or its node, is closed.
        """
        found = self._take_next()
        return None if found is None else found[0]

    def take_with_info(self) -> tuple[T, MessageInfo] | None:
        """Like `take`: the message, and its timestamps and publisher's GID."""
        found = self._take_next()
        return None if found is None else (found[0], self._info(found[1]))

    def _take_next(self) -> tuple[T, Sample] | None:
        if self._callback is not None or self._closed or self._scope.closed:
            self._require_takeable()
        found = self._take()
        if found is None and not self._scope.bridge.has_user_runner and self._reader.fetch():
            found = self._take()
        if found is not None:
            self._latest = found[0]
        return found

    def _info(self, sample: Sample) -> MessageInfo:
        _, source_ns, handle, received_ns, number = sample
        return MessageInfo(source_ns, received_ns, self._reader.writer_guid(handle) or bytes(16), number)

    async def _next_good(self, timeout_s: float | None) -> tuple[T, Sample]:
        self._require_no_callback()
        deadline = Deadline(timeout_s)
        self._scope.require_open(self._closed, f"the subscription on {self.topic}")
        while not self._closed:
            found = self._take()
            if found is not None:
                self._latest = found[0]
                return found
            if not await self._arrival(deadline.remaining_s()):
                raise WaitTimeoutError(f"no message on {self.topic} in {timeout_s} s", self._why_silent())
        raise ClosedError(f"the subscription on {self.topic} of node {self._scope.node_name} is closed")

    def _take(self) -> tuple[T, Sample] | None:
        """The oldest message that decodes; None when there is none. Several threads may share what there is."""
        while self._items and not self._closed:
            try:
                sample = self._items.popleft()
            except IndexError:  # another thread was faster
                return None
            if sample[2] not in self._agreeing and not self._check.accepts(sample[2]):
                continue
            try:
                return self._decode(sample[0]), sample
            except DecodeError as err:
                self._count_undecodable(err)
        return None

    def latest(self) -> T | None:
        """The newest message so far, without waiting; older ones that were waiting are skipped.

        Also one that `receive` or an iteration has taken already: it is the same object then. None before the first.

        Raises:
            ClosedError: the subscription or its node is closed.
        """
        self._require_takeable()
        self._reader.fetch()
        while self._items:
            try:
                sample = self._items.pop()
            except IndexError:  # another thread was faster
                break
            if sample[2] not in self._agreeing and not self._check.accepts(sample[2]):
                continue
            try:
                self._latest = self._decode(sample[0])
            except DecodeError as err:
                self._count_undecodable(err)
                continue
            self._items.clear()
        return self._latest

    def _arrival(self, timeout_s: float | None = None) -> Awaitable[bool]:
        """Wait until there is something in the queue, or the subscription is closed; False when the time passed."""
        self._scope.bridge.running_loop()
        return self._waiters.wait(self._has_news, timeout_s)

    def _has_news(self) -> bool:
        return bool(self._items) or self._closed

    def _is_ready(self) -> bool:
        if self._items:
            return True
        return not self._scope.bridge.has_user_runner and self._reader.fetch()

    def _described(self) -> str:
        return f"the subscription on {self.topic}"

    def _require_takeable(self) -> None:
        self._require_no_callback()
        if self._closed or self._scope.closed:
            self._scope.require_open(True, self._described())

    def _require_no_callback(self) -> None:
        if self._callback is not None:
            raise CallbackInUseError(f"the subscription on {self.topic} has a callback; it cannot be received from too")

    # ---------------------------------------------------------------------------------------------------- callbacks

    def _deliver(self) -> None:
        """Call back for what DDS has received already, without waiting for the loop to come round to it."""
        self._reader.fetch()
        self._call_back()

    def _on_data(self) -> Callable[[], None] | None:
        """The sink of the reader; runs on the loop."""
        if self._callback is not None:
            return self._call_back
        self._waiters.wake()
        return self._tell

    def _call_back(self) -> None:
        callback = self._callback
        if len(self._items) == self._full:
            self._tell_of_drops()
        if callback is None or self._under_way >= self._concurrency:
            return  # it looks again when it is done
        if callback.is_async:
            for _ in range(min(len(self._items), self._concurrency - self._under_way)):
                self._under_way += 1
                self._scope.create_task(self._await_back(callback))
            return
        # Only what is here now: a callback that publishes on its own topic must not keep the loop for itself.
        for _ in range(len(self._items)):
            found = self._take()
            if found is None:
                return
            task = callback.call(found[0])
            if task is not None:
                self._under_way += 1
                task.add_done_callback(self._ended)
                if self._under_way >= self._concurrency:
                    return
        if self._items and not self._closed:
            self._scope.bridge.call_soon(self._call_back)

    async def _await_back(self, callback: UserCallback) -> None:
        try:
            while (found := self._take()) is not None:
                await callback.run(found[0])
        finally:
            self._under_way -= 1

    def _ended(self, _: object) -> None:
        self._under_way -= 1
        self._call_back()

    def _tell_of_drops(self) -> None:
        if self.dropped:
            self._scope.logger.warning(drops_warning(self.topic, self._full, self._concurrency, self._under_way))
            self._full = -1

    def _count_undecodable(self, error: DecodeError) -> None:
        self.undecodable += 1
        if self._throttle.allows():
            self._scope.logger.warning(
                f"dropped a sample on {self.topic} that is no {self.message_type} ({self.undecodable} so far): {error}"
            )

    # ------------------------------------------------------------------------------------------------------- state

    @property
    def dropped(self) -> int:
        """Messages that keep-last dropped because they were not taken in time; undecodable ones are not counted.

        The first ones that a callback is too slow for are logged, once, unless the depth is 1.
        """
        return self._reader.queue.dropped

    @property
    def incompatible_dropped(self) -> int:
        """Messages that were not handed out because their publisher announces another definition of the type."""
        return self._check.incompatible_dropped

    @property
    def publisher_count(self) -> int:
        """How many publishers this subscription is connected with; 0 when it is closed."""
        return 0 if self._closed else len(self._reader.matched_writers())

    def get_publisher_count(self) -> int:
        """Return `publisher_count`; the name in rclpy."""
        return self.publisher_count

    @property
    def topic_name(self) -> str:
        """The same as `topic`; the name in rclpy."""
        return self.topic

    @property
    def gid(self) -> bytes:
        """The 16 bytes that identify this subscription in the graph."""
        return self._reader.guid

    async def wait_for_publishers(self, timeout_s: float | None = None, *, count: int = 1) -> Literal[True]:
        """Wait until at least `count` publishers are connected; raises `WaitTimeoutError` when the time passed."""
        return await self._scope.wait_or_raise(
            lambda: self.publisher_count >= count,
            timeout_s,
            lambda: self._closed,
            lambda: f"{self.publisher_count} publishers on {self.topic}, expected at least {count},",
            why=self._why_unmatched,
        )

    wait_for_publishers_sync = blocking(wait_for_publishers)

    def _why_unmatched(self) -> str:
        matched = self._reader.matched_writers()
        return self._scope.why_unmatched(self._reader.guid, self._channel, is_writer=False, matched=matched).text

    def _why_silent(self) -> str:
        """Return why no message was handed out."""
        if not (count := self.publisher_count):
            return self._why_unmatched()
        if self.incompatible_dropped and (
            reason := self._scope.discovery.unmatched.disagreeing(self._reader.guid, self._channel)
        ):
            return f"{reason}; {self.incompatible_dropped} messages were withheld"
        silent = f"{pluralize(count, 'publisher')} connected, but sent nothing"
        return f"{silent}; {self.undecodable} messages did not decode" if self.undecodable else silent

    def __repr__(self) -> str:
        parts = self.topic, self.message_type, self.qos.short()
        return entity_repr(self, *parts, peers=lambda: self.publisher_count, peer="publisher")

    def close(self) -> None:
        """Stop receiving: iterators end, `receive` raises `ClosedError`. From any thread; may be called twice."""
        if self._begin_close(self._reader.guid):
            if self._events is not None:
                self._events.close()
            self._reader.close()
            self._waiters.wake()
            if self._callback is not None:
                self._callback.close()
