"""Which messages make a set, as plain objects: no node, no callback. Times are nanoseconds.

Decides what message_filters decides: a queue of each input has one message of a time, the last one, and when it holds
too many, those of the lowest times go, whenever they came. Where message_filters tries all combinations of what waits,
one after the other, this looks first whether there is any; which one is found is the same.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from typing import Any


class SyncPolicy(ABC):
    """One queue for each input; each message is in one set at most."""

    def __init__(self, inputs: int, queue_size: int) -> None:
        self._size = queue_size
        self.queues: list[dict[int, Any]] = [{} for _ in range(inputs)]

    def add(self, index: int, stamp: int, message: Any) -> tuple[Any, ...] | None:
        """Take a message of an input in; the set that it completes."""
        queue = self.queues[index]
        queue[stamp] = message
        while len(queue) > self._size:
            del queue[min(queue)]
        if stamp not in queue:  # it was too old itself
            return None
        stamps = self._match(index, stamp)
        return None if stamps is None else tuple(one.pop(at) for one, at in zip(self.queues, stamps, strict=True))

    @abstractmethod
    def _match(self, index: int, stamp: int) -> list[int] | None:
        """The times of a set with the newest message, in the order of the inputs."""

    def clear(self) -> None:
        """Forget what waits."""
        for queue in self.queues:
            queue.clear()


class ExactMatcher(SyncPolicy):
    """Messages of one time."""

    def _match(self, index: int, stamp: int) -> list[int] | None:
        return [stamp] * len(self.queues) if all(stamp in queue for queue in self.queues) else None


class ApproximateMatcher(SyncPolicy):
    """Messages that are less than `slop_ns` apart: of each input the one closest to the newest message, if they fit."""

    def __init__(self, inputs: int, queue_size: int, slop_ns: int) -> None:
        super().__init__(inputs, queue_size)
        self._slop = slop_ns

    def _match(self, index: int, stamp: int) -> list[int] | None:
        slop = self._slop
        if slop <= 0:
            return None
        nearby = []  # of each other input, the closest first
        for number, queue in enumerate(self.queues):
            if number != index:
                near = [one for one in queue if abs(one - stamp) < slop]
                if not near:
                    return None
                nearby.append(sorted(near, key=lambda one: abs(one - stamp)))
        rows = [sorted(near) for near in nearby]
        if not self._can_complete(rows, stamp, stamp):
            return None
        chosen: list[int] = []
        lowest = highest = stamp
        for number, near in enumerate(nearby):
            for one in near:
                low, high = min(lowest, one), max(highest, one)
                if self._can_complete(rows[number + 1 :], low, high):
                    lowest, highest = low, high
                    chosen.append(one)
                    break
        chosen.insert(index, stamp)
        return chosen

    def _can_complete(self, rows: list[list[int]], low: int, high: int) -> bool:
        """Whether one of each row, which are sorted, is less than the slop apart from the others and from both ends."""
        slop = self._slop
        if high - low >= slop:
            return False
        if len(rows) < 2:
            return not rows or any(high - slop < one < low + slop for one in rows[0])
        starts = {low, *(one for row in rows for one in row if high - slop < one < low)}
        return any(all(_has_stamp_in(row, start, start + slop) for row in rows) for start in starts)


def _has_stamp_in(row: list[int], start: int, end: int) -> bool:
    """Whether a sorted row has something from `start` to before `end`."""
    at = bisect_left(row, start)
    return at < len(row) and row[at] < end
