"""Cache of the last messages of a filter, in the order of their stamps."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import nanoseconds
from rosidl_py_gen.message_filters.filters import MessageFilter, check_filters, check_queue_size

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime import Clock


class Cache(MessageFilter):
    """Cache of the last messages in the order of their stamps, which also passes each message on.

    Times in queries are `Time` objects, Time messages or nanoseconds, and inclusive. If simulated time jumps back, all
    messages are removed.

    Args:
        source: a filter, such as `Subscriber`.
        cache_size: maximum number of messages; one more removes the message with the lowest stamp.
        callback: see `MessageFilter`.
        allow_headerless: use the time of arrival for messages without a stamp, instead of an error.
        clock: clock for the time of arrival; None means that of the input's node.

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
        self._setup(callback, 1, check_filters("source", source))
        self._stamps: list[int] = []
        self._messages: list[Any] = []
        self._lock = threading.Lock()
        self._use_stamps(self.clear, allow_headerless, clock)
        self._links.append(source.register_callback(self.add))

    def add(self, message: Any) -> Coroutine[Any, Any, None] | None:
        """Store a message as if the input had passed it, and pass it on as `signal_message`; raises `StampError`."""
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
        """Return the messages of `interval`, and on each side without a message at that very time one more."""
        first, last = _span(start, end)
        with self._lock:
            begin = max(0, bisect_right(self._stamps, first) - 1)
            return self._messages[begin : bisect_left(self._stamps, last) + 1]

    def at_or_after(self, time: Any) -> Any:
        """Return the oldest message at or after a time; None if none exists."""
        with self._lock:
            at = bisect_left(self._stamps, nanoseconds(time))
            return self._messages[at] if at < len(self._messages) else None

    def at_or_before(self, time: Any) -> Any:
        """Return the newest message at or before a time; None if none exists."""
        with self._lock:
            at = bisect_right(self._stamps, nanoseconds(time))
            return self._messages[at - 1] if at else None

    def latest(self) -> Any:
        """Return the message with the highest stamp; None if the cache is empty."""
        with self._lock:
            return self._messages[-1] if self._messages else None

    @property
    def oldest_stamp(self) -> int | None:
        """Lowest stamp in nanoseconds; None if the cache is empty."""
        with self._lock:
            return self._stamps[0] if self._stamps else None

    @property
    def latest_stamp(self) -> int | None:
        """Highest stamp in nanoseconds; None if the cache is empty."""
        with self._lock:
            return self._stamps[-1] if self._stamps else None

    def __len__(self) -> int:
        return len(self._messages)

    def clear(self) -> None:
        """Remove all messages."""
        with self._lock:
            self._stamps.clear()
            self._messages.clear()


def _span(start: Any, end: Any) -> tuple[int, int]:
    first, last = nanoseconds(start), nanoseconds(end)
    if first > last:
        raise ValueError(f"the end, {last} ns, is before the start, {first} ns")
    return first, last
