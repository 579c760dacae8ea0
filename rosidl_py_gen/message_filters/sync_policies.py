"""Matching of messages by stamps, without nodes and callbacks. Times are nanoseconds.

The results are those of message_filters: the queue of an input has one message for each time, the last one. When it is
full, the message with the lowest time is dropped, whenever it arrived. message_filters tries all combinations of
waiting messages one after the other; `ApproximateMatcher` first checks whether one exists.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from typing import Any


class SyncPolicy(ABC):
    """Queues of waiting messages, one for each input; each message is used in at most one set."""

    def __init__(self, inputs: int, queue_size: int) -> None:
        self._size = queue_size
        self.queues: list[dict[int, Any]] = [{} for _ in range(inputs)]

    def add(self, index: int, stamp: int, message: Any) -> tuple[Any, ...] | None:
        """Insert a message of an input; returns the set that it completes, or None."""
        queue = self.queues[index]
        queue[stamp] = message
        while len(queue) > self._size:
            del queue[min(queue)]
        if stamp not in queue:  # the new message was the oldest
            return None
        stamps = self._match(index, stamp)
        return None if stamps is None else tuple(one.pop(at) for one, at in zip(self.queues, stamps, strict=True))

    @abstractmethod
    def _match(self, index: int, stamp: int) -> list[int] | None:
        """Return the times of a set with the newest message, in the order of the inputs; None if it does not exist."""

    def clear(self) -> None:
        """Remove all waiting messages."""
        for queue in self.queues:
            queue.clear()


class ExactMatcher(SyncPolicy):
    """Matcher of messages with equal stamps."""

    def _match(self, index: int, stamp: int) -> list[int] | None:
        return [stamp] * len(self.queues) if all(stamp in queue for queue in self.queues) else None


class ApproximateMatcher(SyncPolicy):
    """Matcher of messages less than `slop_ns` apart: those closest to the newest message, if they fit."""

    def __init__(self, inputs: int, queue_size: int, slop_ns: int) -> None:
        super().__init__(inputs, queue_size)
        self._slop = slop_ns

    def _match(self, index: int, stamp: int) -> list[int] | None:
        slop = self._slop
        if slop <= 0:
            return None
        nearby = []  # times of each other input, closest first
        for number, queue in enumerate(self.queues):
            if number != index:
                near = [one for one in queue if abs(one - stamp) < slop]
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
