"""Filters of messages: subscriptions as the start of a chain, synchronizers, and a cache.

A filter passes messages to its callbacks; a callback may be the `add` of another filter. Plain callbacks are called at
once, on the thread where the message arrives. `signal_message` returns the coroutine of an async callback, so that the
first caller, usually a subscription, awaits it and reports its failure.

The synchronizers form the same sets as message_filters: the queue of an input has one message for each time, the last
one. When it is full, the message with the lowest time is dropped, whenever it arrived. message_filters tries all
combinations of waiting messages one after the other; `ApproximateTimeSynchronizer` first checks whether one exists.
"""

from __future__ import annotations

import asyncio
import inspect
import threading
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable
from functools import partial
from math import isfinite
from types import CoroutineType
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen import get_message
from rosidl_py_gen.base.callbacks import Registration, RegistrationSet, require_signature
from rosidl_py_gen.base.stamps import NS_PER_S, nanoseconds
from rosidl_py_gen.base.waiters import Waiters, blocking, current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime import CallbackInUseError, Duration, WaitTimeoutError, WouldDeadlockError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from typing_extensions import Self

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Clock, Node, QoSProfile, Subscription
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope

T = TypeVar("T")


class StampError(RosidlError, ValueError):
    """Error of a message without ``header.stamp`` that was passed to a filter which needs the stamp."""


def header_stamp(message: Any) -> int | None:
    """Return the stamp in a message's header in nanoseconds; None if the message has no header."""
    try:
        if isinstance(message, dict):
            stamp = message["header"]["stamp"]
            return int(stamp["sec"]) * NS_PER_S + int(stamp["nanosec"])
        return nanoseconds(message.header.stamp)
    except (AttributeError, KeyError, TypeError):
        return None


class NoNodeScope:
    """Execution environment of a filter without a node, which runs the filter's blocking methods.

    For a node, `EntityScope` has this role.
    """

    def run_blocking(self, coroutine: Coroutine[Any, Any, T], caller: object, name: str) -> T:
        """Run a coroutine to its end in a new event loop, while other threads pass messages to the filter.

        Raises:
            WouldDeadlockError: the thread already runs an event loop.
        """
        if current_loop() is not None:
            coroutine.close()
            raise WouldDeadlockError(
                f"{name}_sync of {caller!r} inside the event loop would deadlock; use 'await ...{name}(...)' in an "
                "async function, or call it from another thread"
            )
        return asyncio.run(coroutine)


class MessageFilter:
    """Filter that passes every message on.

    It is the start of a chain to which a program passes messages, and the base of all filters. Without a callback,
    messages wait to be received; when `queue_size` messages wait, the oldest is dropped.

    Args:
        callback: plain or async function; calls of an async one are awaited one after the other.
        queue_size: maximum number of messages that wait to be received, or for an async callback.
    """

    def __init__(self, callback: Callable[..., object] | None = None, *, queue_size: int = 10) -> None:
        self._setup(callback, queue_size, ())

    def _setup(
        self, callback: Callable[..., object] | None, queue_size: int, inputs: tuple[MessageFilter, ...], width: int = 1
    ) -> None:
        self._width, self._depth = width, check_queue_size("queue_size", queue_size)
        self._outputs: RegistrationSet[_Output] = RegistrationSet()
        self._waiting: deque[Any] = deque(maxlen=self._depth)
        self._waiters = Waiters()
        self._links: list[Registration] = []
        self._closed = False
        self._clock: Clock | None = None
        self.dropped = 0
        """Number of messages or sets that the filter has dropped from full queues."""
        self._inputs = inputs
        self._nodes: tuple[Node, ...] = ()
        self._scope: EntityScope | NoNodeScope = NoNodeScope()
        """Scope of the filter's first node, whose event loop runs the blocking methods."""
        self._use_nodes(*(node for one in inputs for node in one._nodes))
        if callback is not None:
            self.register_callback(callback)

    # ------------------------------------------------------------------------------------------------------- callbacks

    def register_callback(self, callback: Callable[..., object]) -> Registration:
        """Register a plain or async function that is called with each output of the filter.

        Several functions are called in the order of registration.

        Returns:
            Registration, which ends the calls when it is closed.

        Raises:
            CallbackSignatureError, TypeError: the function does not accept the number of messages.
        """
        if not callable(callback):
            raise TypeError(f"the callback of {self!r} must be a function, got {callback!r:.100}")
        arguments = ["the message"] if self._width == 1 else [f"message {number + 1}" for number in range(self._width)]
        require_signature(callback, f"the callback of {type(self).__name__}", *arguments)
        self._waiting.clear()
        return self._outputs.add(_Output(self, callback, self._depth))

    def signal_message(self, *messages: Any) -> Coroutine[Any, Any, None] | None:
        """Pass a message, or a set with one message of each input, to the callbacks or to the queue of the receiver.

        Returns a coroutine of async callbacks to await, or None if no callback is async.
        """
        if self._closed:
            return None
        if not len(self._outputs):
            self._enqueue(self._waiting, messages[0] if self._width == 1 else messages)
            self._waiters.wake()
            return None
        return call_all(partial(output.call, messages) for output in self._outputs)

    def _enqueue(self, queue: deque[Any], item: Any) -> None:
        self.dropped += len(queue) == queue.maxlen
        queue.append(item)

    # ------------------------------------------------------------------------------------------------------- receiving

    def __aiter__(self) -> Self:
        self._require_no_callback()
        return self

    async def __anext__(self) -> Any:
        if not await self._wait(None):
            raise StopAsyncIteration
        return self._waiting.popleft()

    async def receive(self, timeout_s: float | None = None) -> Any:
        """Return the next message, or set of messages, that the filter passes on, oldest first.

        Raises:
            WaitTimeoutError: nothing arrived within `timeout_s`.
            ClosedError: the filter or a node that feeds it is closed.
            CallbackInUseError: the filter has a callback.
        """
        self._require_no_callback()
        if await self._wait(timeout_s):
            return self._waiting.popleft()
        if self._closed:
            raise ClosedError(f"{self!r} is closed")
        raise WaitTimeoutError(f"{self!r} passed nothing for {timeout_s} s", "; ".join(await self._why_silent()))

    receive_sync = blocking(receive)

    async def _why_silent(self) -> list[str]:
        return [reason for one in self._inputs for reason in await one._why_silent()]

    async def _wait(self, timeout_s: float | None) -> bool:
        """Wait for a message, and return True; return False after the timeout or when the filter is closed."""
        for node in self._nodes:
            node._scope.adopt_running_loop()
        await self._waiters.wait(lambda: self._waiting or self._closed, timeout_s)
        return bool(self._waiting)

    def _require_no_callback(self) -> None:
        if len(self._outputs):
            raise CallbackInUseError(f"{self!r} has a callback; its messages cannot be received as well")

    # --------------------------------------------------------------------------------------------------------- chains

    @staticmethod
    def _check_inputs(name: str, *inputs: object) -> tuple[MessageFilter, ...]:
        """Return the inputs of a filter unchanged; raises `TypeError` if one is not a filter."""
        for source in inputs:
            if not isinstance(source, MessageFilter):
                raise TypeError(f"{name} must be a filter, such as Subscriber(node, type, topic), got {source!r:.100}")
        return inputs  # type: ignore[return-value]

    @staticmethod
    def _tolerance_ns(name: str, seconds: object) -> int:
        """Return seconds as nanoseconds; raises `TypeError` or `ValueError` unless they are finite and at least 0."""
        if not isinstance(seconds, int | float) or isinstance(seconds, bool):
            raise TypeError(f"{name} must be a number of seconds, got {seconds!r:.100}")
        if not isfinite(seconds) or seconds < 0:
            raise ValueError(f"{name} must be 0 or more seconds, got {seconds}")
        return round(seconds * NS_PER_S)

    def _use_nodes(self, *nodes: Node) -> None:
        """Set the nodes that feed the filter, which closes when the first of them closes.

        Raises `ClosedError` if a node is closed.
        """
        self._nodes = tuple(dict.fromkeys(nodes))
        for node in self._nodes:
            node._scope.register(self)
        if self._nodes:
            self._scope = self._nodes[0]._scope

    def _use_stamps(
        self, clear: Callable[[], None], allow_headerless: bool = False, clock: Clock | None = None
    ) -> None:
        """Prepare the filter for using stamps: check that messages of the inputs have stamps, or set the clock for
        arrival times.

        When time jumps back, `clear` is called, as earlier messages never match again. Raises `StampError` if an
        input's messages have no stamp and `allow_headerless` is False, or if there is no clock for arrival times.
        """
        if allow_headerless:
            self._clock = clock or (self._nodes[0].clock if self._nodes else None)
            if self._clock is None:
                raise StampError("allow_headerless needs a clock, and no input has a node: pass clock=...")
        else:
            for source in self._inputs:
                _require_stamps(source)
        for node in self._nodes:
            on_jump = node.clock.create_jump_callback(
                post=lambda _: clear(), on_clock_change=True, min_backward=Duration(nanoseconds=-1)
            )
            self._links.append(on_jump)

    def _stamp_of(self, message: Any, where: str = "") -> int:
        """Return the stamp of a message, or with `allow_headerless` the time of arrival; else raise `StampError`."""
        stamp = header_stamp(message)
        if stamp is not None:
            return stamp
        if self._clock is None:
            raise StampError(f"{where}{self!r} got a message without header.stamp: {type(message).__name__}")
        return self._clock.now().nanoseconds

    def close(self) -> None:
        """Stop passing messages on; waiting messages can still be received. May be called repeatedly.

        The inputs stay open.
        """
        self._closed = True
        for link in self._links:
            link.close()
        for node in self._nodes:
            node._scope.unregister(self)
        self._waiters.wake()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}{' closed' if self._closed else ''}>"


class Subscriber(MessageFilter):
    """Subscription of a node as the start of a chain of filters.

    Args:
        node: node that owns the subscription.
        msg_type: a message class, or the name of a type: messages are then dicts.
        topic: as in `Node.create_subscription`.
        qos: a depth or a profile.
        callback: plain or async function that is called with each message.
        options: other arguments of `Node.create_subscription`.
    """

    def __init__(
        self,
        node: Node,
        msg_type: type[Message] | str,
        topic: str,
        qos: QoSProfile | int = 10,
        *,
        callback: Callable[..., object] | None = None,
        **options: Any,
    ) -> None:
        self._setup(None, 10, ())
        self._use_nodes(node)
        self._msg_type = msg_type
        self._has_bytes = bool(options.get("raw"))
        self.subscription: Subscription[Any] = node.create_subscription(
            msg_type, topic, self.signal_message, qos, **options
        )
        """ROS subscription of the filter, with its attributes `dropped`, `publisher_count` and `wait_for_publishers`.
        """
        if callback is not None:
            self.register_callback(callback)

    async def _why_silent(self) -> list[str]:
        try:
            await self.subscription.wait_for_publishers(0)
        except WaitTimeoutError as error:
            return [f"{self.subscription.topic}: {error.reason}"] if error.reason else []
        return []

    def close(self) -> None:
        """Close the filter and its subscription."""
        self.subscription.close()
        super().close()

    def __repr__(self) -> str:
        return f"<Subscriber of {self.subscription.topic}{' closed' if self._closed else ''}>"


def _require_stamps(source: MessageFilter) -> None:
    """Raise `StampError` if a filter is a subscription whose messages have no stamp."""
    if not isinstance(source, Subscriber):
        return
    cls: Any = get_message(source._msg_type) if isinstance(source._msg_type, str) else source._msg_type
    if source._has_bytes or header_stamp(cls()) is None:
        kind = "bytes" if source._has_bytes else source.subscription.message_type
        raise StampError(f"{source.subscription.topic}: {kind} has no header.stamp")


class _Output:
    """Registered callback of a filter; an async callback has a queue, and its calls run one after the other."""

    def __init__(self, owner: MessageFilter, function: Callable[..., Any], depth: int) -> None:
        self._owner, self._function = owner, function
        called = getattr(type(function), "__call__", None)  # noqa: B004 - the method itself, not whether there is one
        self._is_async = inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)
        self._waiting: deque[tuple[Any, ...]] = deque(maxlen=depth)
        self._lock = asyncio.Lock()
        self._runs = 0

    def call(self, messages: tuple[Any, ...]) -> Coroutine[Any, Any, None] | None:
        if not self._is_async:
            result = self._function(*messages)
            return result if isinstance(result, CoroutineType) else None
        self._owner._enqueue(self._waiting, messages)
        if self._runs > len(self._waiting):  # enough coroutines for all waiting messages, and one that runs
            return None
        self._runs += 1
        return self._run()

    async def _run(self) -> None:
        try:
            async with self._lock:
                if self._waiting:
                    await self._function(*self._waiting.popleft())
        finally:
            self._runs -= 1


def call_all(calls: Iterable[Callable[[], Coroutine[Any, Any, None] | None]]) -> Coroutine[Any, Any, None] | None:
    """Call all functions, even if some fail, and raise the first failure.

    If functions return coroutines, returns one coroutine that awaits all of them and then raises the first failure.
    """
    coroutines: list[Coroutine[Any, Any, None]] = []
    failures: list[Exception] = []
    for call in calls:
        try:
            coroutine = call()
        except Exception as error:
            failures.append(error)
            continue
        if coroutine is not None:
            coroutines.append(coroutine)
    if coroutines:
        return coroutines[0] if len(coroutines) == 1 and not failures else _await_all(coroutines, failures)
    if failures:
        raise failures[0]
    return None


async def _await_all(coroutines: list[Coroutine[Any, Any, None]], failures: list[Exception]) -> None:
    results = await asyncio.gather(*coroutines, return_exceptions=True)
    for failure in (*failures, *results):
        if failure is not None:
            raise failure


def check_queue_size(name: str, value: object) -> int:
    """Return a queue size unchanged; raises `TypeError` or `ValueError` if it is not a positive integer."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{name} must be an int, the maximum number of messages, got {value!r:.100}")
    if value < 1:
        raise ValueError(f"{name} must be 1 or more, got {value}")
    return value


# ------------------------------------------------------------------------------------------------------- synchronizers


class TimeSynchronizer(MessageFilter):
    """Filter that passes sets of messages with equal ``header.stamp``, one message of each input.

    A set is passed when its last message arrives. Of each input, the `queue_size` messages with the highest stamps wait
    for their set. If simulated time jumps back, they are removed.

    Args:
        inputs: filters, such as `Subscriber`; callbacks receive the messages in this order.
        callback: plain or async function with as many arguments as there are inputs.
        queue_size: maximum number of waiting messages of each input, and of sets that wait to be received.

    Raises:
        StampError: the messages of an input have no stamp.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        queue_size: int = 10,
    ) -> None:
        self._connect(inputs, callback, queue_size)

    def _connect(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None,
        queue_size: int,
        allow_headerless: bool = False,
        clock: Clock | None = None,
    ) -> None:
        is_single = isinstance(inputs, MessageFilter) or not isinstance(inputs, Iterable)
        filters = self._check_inputs("each input", *([inputs] if is_single else inputs))
        if not filters:
            raise ValueError("inputs must be at least one filter, got none")
        self._setup(callback, queue_size, filters, len(filters))
        self._queues: list[dict[int, Any]] = [{} for _ in filters]
        self._lock = threading.Lock()
        self._use_stamps(self.clear, allow_headerless, clock)
        self._links += [one.register_callback(partial(self.add, index)) for index, one in enumerate(filters)]

    def add(self, index: int, message: Any) -> Coroutine[Any, Any, None] | None:
        """Process a message as if the input with this index had passed it on.

        Returns a coroutine of async callbacks to await, or None. Raises `StampError` for a message without stamp.
        """
        stamp = self._stamp_of(message, f"input {index} of ")
        with self._lock:
            queue = self._queues[index]
            queue[stamp] = message
            while len(queue) > self._depth:
                del queue[min(queue)]
            stamps = self._match(index, stamp) if stamp in queue else None  # the new message may have been the oldest
            if stamps is None:
                return None
            messages = [one.pop(at) for one, at in zip(self._queues, stamps, strict=True)]
        return self.signal_message(*messages)

    def _match(self, index: int, stamp: int) -> list[int] | None:
        """Return the stamps of a set of messages that contains the newest message, in the order of the inputs.

        Returns None if there is no set.
        """
        return [stamp] * len(self._queues) if all(stamp in queue for queue in self._queues) else None

    def clear(self) -> None:
        """Remove all messages that wait for a matching message of another input."""
        with self._lock:
            for queue in self._queues:
                queue.clear()


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Filter that passes sets of messages whose stamps are less than `slop_s` apart, one message of each input.

    A set is passed as soon as one exists with the arriving message: of each other input the message closest to it, or,
    if these are too far apart, the next ones. The filter does not wait for a better set. Otherwise it is like
    `TimeSynchronizer`.

    Args:
        inputs: filters, such as `Subscriber`; callbacks receive the messages in this order.
        callback: plain or async function with as many arguments as there are inputs.
        slop_s: seconds; stamps that are exactly this far apart do not match.
        queue_size: maximum number of waiting messages of each input, and of sets that wait to be received.
        allow_headerless: use the time of arrival for messages without a stamp; its delay is unknown.
        clock: clock for the time of arrival; None means the clock of the first input's node.

    Raises:
        StampError: the messages of an input have no stamp, and `allow_headerless` is False.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        slop_s: float,
        queue_size: int = 10,
        allow_headerless: bool = False,
        clock: Clock | None = None,
    ) -> None:
        self._slop = self._tolerance_ns("slop_s", slop_s)
        self._connect(inputs, callback, queue_size, allow_headerless, clock)

    def _match(self, index: int, stamp: int) -> list[int] | None:
        nearby = []  # times of each other input, closest first
        for number, queue in enumerate(self._queues):
            if number != index:
                near = [one for one in queue if abs(one - stamp) < self._slop]
                if not near:
                    return None
                nearby.append(sorted(near, key=lambda one: abs(one - stamp)))
        rows = [sorted(near) for near in nearby]
        if not self._can_complete(rows, stamp, stamp):
            return None
        stamps: list[int] = []
        lowest = highest = stamp
        for number, near in enumerate(nearby):
            for one in near:
                low, high = min(lowest, one), max(highest, one)
                if self._can_complete(rows[number + 1 :], low, high):
                    lowest, highest = low, high
                    stamps.append(one)
                    break
        stamps.insert(index, stamp)
        return stamps

    def _can_complete(self, rows: list[list[int]], low: int, high: int) -> bool:
        """Return True if each sorted row of times has a time such that these, `low` and `high` are all less than the
        slop apart.

        Such times exist if a window of this length contains a time of each row, `low` and `high`. Only the times of the
        rows and `low` need to be tried as the start of the window.
        """
        slop = self._slop
        if high - low >= slop:
            return False
        if len(rows) < 2:
            return not rows or any(high - slop < one < low + slop for one in rows[0])
        starts = {low, *(one for row in rows for one in row if high - slop < one < low)}
        return any(all(_has_time_in(row, start, start + slop) for row in rows) for start in starts)


def _has_time_in(row: list[int], start: int, end: int) -> bool:
    at = bisect_left(row, start)
    return at < len(row) and row[at] < end


# --------------------------------------------------------------------------------------------------------------- cache


class Cache(MessageFilter):
    """Cache of the last messages in the order of their stamps, which also passes each message on.

    Times in queries are `Time` objects, Time messages or nanoseconds, and inclusive. If simulated time jumps back, all
    messages are removed.

    Args:
        source: a filter, such as `Subscriber`.
        cache_size: maximum number of messages; one more removes the message with the lowest stamp.
        callback: plain or async function that is called with each message.
        allow_headerless: use the time of arrival for messages without a stamp, instead of an error.
        clock: clock for the time of arrival; None means the clock of the input's node.

    Raises:
        StampError: the messages have no stamp, and `allow_headerless` is False.
    """

    def __init__(
        self,
        source: MessageFilter,
        cache_size: int = 1,
        callback: Callable[..., object] | None = None,
        *,
        allow_headerless: bool = False,
        clock: Clock | None = None,
    ) -> None:
        self._size = check_queue_size("cache_size", cache_size)
        self._setup(callback, 1, self._check_inputs("source", source))
        self._stamps: list[int] = []
        self._messages: list[Any] = []
        self._lock = threading.Lock()
        self._use_stamps(self.clear, allow_headerless, clock)
        self._links.append(source.register_callback(self.add))

    def add(self, message: Any) -> Coroutine[Any, Any, None] | None:
        """Store a message as if the input had passed it on, and pass it on to callbacks or the receiver.

        Returns a coroutine of async callbacks to await, or None. Raises `StampError` for a message without stamp.
        """
        stamp = self._stamp_of(message)
        with self._lock:
            if len(self._stamps) >= self._size:
                del self._stamps[0], self._messages[0]
            at = bisect_right(self._stamps, stamp)
            self._stamps.insert(at, stamp)
            self._messages.insert(at, message)
        return self.signal_message(message)

    def interval(self, start: Any, end: Any) -> list[Any]:
        """Return the messages from `start` to `end`, oldest first; raises `ValueError` if `end` is before `start`."""
        first, last = _span(start, end)
        with self._lock:
            return self._messages[bisect_left(self._stamps, first) : bisect_right(self._stamps, last)]

    def surrounding(self, start: Any, end: Any) -> list[Any]:
        """Return the messages from `start` to `end`, and on each side one more unless one is exactly at that time.

        Raises `ValueError` if `end` is before `start`.
        """
        first, last = _span(start, end)
        with self._lock:
            begin = max(0, bisect_right(self._stamps, first) - 1)
            return self._messages[begin : bisect_left(self._stamps, last) + 1]

    def at_or_after(self, time: Any) -> Any:
        """Return the oldest cached message at or after a time; None if none exists."""
        with self._lock:
            at = bisect_left(self._stamps, nanoseconds(time))
            return self._messages[at] if at < len(self._messages) else None

    def at_or_before(self, time: Any) -> Any:
        """Return the newest cached message at or before a time; None if none exists."""
        with self._lock:
            at = bisect_right(self._stamps, nanoseconds(time))
            return self._messages[at - 1] if at else None

    def latest(self) -> Any:
        """Return the cached message with the highest stamp; None if the cache is empty."""
        with self._lock:
            return self._messages[-1] if self._messages else None

    @property
    def oldest_stamp(self) -> int | None:
        """Lowest stamp of the cached messages in nanoseconds; None if the cache is empty."""
        with self._lock:
            return self._stamps[0] if self._stamps else None

    @property
    def latest_stamp(self) -> int | None:
        """Highest stamp of the cached messages in nanoseconds; None if the cache is empty."""
        with self._lock:
            return self._stamps[-1] if self._stamps else None

    def __len__(self) -> int:
        return len(self._messages)

    def clear(self) -> None:
        """Remove all messages from the cache."""
        with self._lock:
            self._stamps.clear()
            self._messages.clear()


def _span(start: Any, end: Any) -> tuple[int, int]:
    first, last = nanoseconds(start), nanoseconds(end)
    if first > last:
        raise ValueError(f"the end, {last} ns, is before the start, {first} ns")
    return first, last
