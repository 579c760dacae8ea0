"""The last messages of an input, found by their stamps."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import nanoseconds
from rosidl_py_gen.message_filters.filters import MessageFilter, check_queue_size, require_stamps
from rosidl_py_gen.message_filters.stamps import StampError, header_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime import Clock


class Cache(MessageFilter):
    """Keeps the last messages in the order of their stamps, and hands on each as it comes.

    What is asked for, `Time` objects, Time messages or nanoseconds, includes messages of that very time. When simulated
    time jumps back, all are forgotten.

    Args:
        source: a filter, such as `Subscriber`.
        cache_size: how many are kept; the one with the lowest stamp goes when another comes.
        callback: see `MessageFilter`.
        allow_headerless: messages without a stamp count as of the time they come.
        clock: tells that time; None means that of the input's node.

    Raises:
        StampError: the messages have no stamp, and nothing was said of that.
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
        if not isinstance(source, MessageFilter):
            raise TypeError(f"source must be a filter, such as Subscriber(node, type, topic), got {source!r:.100}")
        self._size = check_queue_size("cache_size", cache_size)
        self._setup(callback, 1, 1, (source,))
        self._stamps: list[int] = []
        self._messages: list[Any] = []
        self._lock = threading.Lock()
        self._now = (clock or self._clock()) if allow_headerless else None
        if allow_headerless and self._now is None:
            raise StampError("allow_headerless goes by a clock, and the input has no node: give clock=...")
        if not allow_headerless:
            require_stamps(source)
        self._links.append(source.register_callback(self.add))
        self._clear_on_time_jump(self.clear)

    def add(self, message: Any) -> Coroutine[Any, Any, None] | None:
        """Keep a message, as if it had come from the input, and hand it on; answers as `signal`.

        Raises:
            StampError: it has no stamp.
        """
        stamp = header_stamp(message)
        if stamp is None:
            if self._now is None:
                raise StampError(f"a message without header.stamp: {type(message).__name__}")
            stamp = self._now.now().nanoseconds
        with self._lock:
            if len(self._stamps) >= self._size:
                del self._stamps[0], self._messages[0]
            at = bisect_right(self._stamps, stamp)
            self._stamps.insert(at, stamp)
            self._messages.insert(at, message)
        return self.signal_message(message)

    def interval(self, start: Any, end: Any) -> list[Any]:
        """The messages from `start` to `end`, oldest first; raises `ValueError` when `end` is before `start`."""
        first, last = nanoseconds(start), nanoseconds(end)
        if first > last:
            raise ValueError(f"the end, {last} ns, is before the start, {first} ns")
        with self._lock:
            return self._messages[bisect_left(self._stamps, first) : bisect_right(self._stamps, last)]

    def surrounding(self, start: Any, end: Any) -> list[Any]:
        """As `interval`, and one more on each side that has none of that very time, if there is one."""
        first, last = nanoseconds(start), nanoseconds(end)
        if first > last:
            raise ValueError(f"the end, {last} ns, is before the start, {first} ns")
        with self._lock:
            begin = max(0, bisect_right(self._stamps, first) - 1)
            return self._messages[begin : bisect_left(self._stamps, last) + 1]

    def at_or_after(self, time: Any) -> Any:
        """The oldest message of that time or later; None when there is none."""
        with self._lock:
            at = bisect_left(self._stamps, nanoseconds(time))
            return self._messages[at] if at < len(self._messages) else None

    def at_or_before(self, time: Any) -> Any:
        """The newest message of that time or earlier; None when there is none."""
        with self._lock:
            at = bisect_right(self._stamps, nanoseconds(time))
            return self._messages[at - 1] if at else None

    def latest(self) -> Any:
        """The message with the highest stamp; None when there is none."""
        with self._lock:
            return self._messages[-1] if self._messages else None

    @property
    def oldest_stamp(self) -> int | None:
        """Nanoseconds; None when there is nothing."""
        with self._lock:
            return self._stamps[0] if self._stamps else None

    @property
    def latest_stamp(self) -> int | None:
        """Nanoseconds; None when there is nothing."""
        with self._lock:
            return self._stamps[-1] if self._stamps else None

    def __len__(self) -> int:
        return len(self._messages)

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._stamps.clear()
            self._messages.clear()
