"""Synchronizers: filters with several inputs that pass sets of messages, one of each input.

The sets are those of message_filters: the queue of an input has one message for each time, the last one. When it is
full, the message with the lowest time is dropped, whenever it arrived. message_filters tries all combinations of
waiting messages one after the other; `ApproximateTimeSynchronizer` first checks whether one exists.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.message_filters.filters import MessageFilter, check_filters, slop_to_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime import Clock


class TimeSynchronizer(MessageFilter):
    """Filter that passes sets of messages with equal ``header.stamp``, one of each input.

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
        filters = check_filters("each input", *([inputs] if is_single else inputs))
        if not filters:
            raise ValueError("inputs must be at least one filter, got none")
        self._setup(callback, queue_size, filters, len(filters))
        self._queues: list[dict[int, Any]] = [{} for _ in filters]
        self._lock = threading.Lock()
        self._use_stamps(self.clear, allow_headerless, clock)
        self._links += [one.register_callback(partial(self.add, index)) for index, one in enumerate(filters)]

    def add(self, index: int, message: Any) -> Coroutine[Any, Any, None] | None:
        """Process a message as if an input had passed it; returns as `signal_message`. Raises `StampError`."""
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
        """Return the times of a set with the newest message, in the order of the inputs; None if it does not exist."""
        return [stamp] * len(self._queues) if all(stamp in queue for queue in self._queues) else None

    def clear(self) -> None:
        """Remove the messages that wait for others."""
        with self._lock:
            for queue in self._queues:
                queue.clear()


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Filter that passes sets of messages whose stamps are less than `slop_s` apart, one of each input.

    A set is passed as soon as one exists with the arriving message: of each other input the message closest to it, or,
    if these are too far apart, the next ones. It does not wait for a better set. Otherwise as `TimeSynchronizer`.

    Args:
        inputs: as for `TimeSynchronizer`, and so are `callback` and `queue_size`.
        slop_s: seconds; stamps that are exactly this far apart do not match.
        allow_headerless: use the time of arrival for messages without a stamp; its delay is unknown.
        clock: clock for the time of arrival; None means that of the first input's node.

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
        self._slop = slop_to_ns("slop_s", slop_s)
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
        """Return True if one time of each sorted row fits with the others and with `low` and `high`.

        A set exists if a window of length slop contains a time of each row and both ends. Only times of the rows and
        `low` can be the start of such a window.
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
