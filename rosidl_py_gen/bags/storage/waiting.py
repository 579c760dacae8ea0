"""Messages of chunks that overlap in time, while they wait for earlier ones."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from heapq import heappop, heappush
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.storage.storage_api import LOG_TIME

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.bags.storage.storage_api import Raw

_MESSAGE_BYTES = 200
"""Memory of a message besides its data: a tuple, two integers and a slice."""


class Waiting:
    """Runs of messages, each by log time, which are merged by a heap: n messages of m chunks take n log m steps.

    Attributes:
        size: memory that the messages take, in bytes.
    """

    def __init__(self) -> None:
        self.size = 0
        self._count = 0
        self._runs: list[tuple[int, int, int, list[Raw]]] = []  # next log time, number, position of the next message

    @property
    def is_empty(self) -> bool:
        """True if no message waits."""
        return not self._runs

    def add(self, run: list[Raw]) -> None:
        """Add messages; of equal log times, those that were added first come first."""
        if run:
            heappush(self._runs, (run[0][2], self._count, 0, run))
            self._count += 1
            self.size += _size(run)

    def before(self, end: int | None) -> Iterator[Raw]:
        """Remove and yield the messages with ``log_time < end`` by log time, all for None."""
        runs = self._runs
        while runs and (end is None or runs[0][0] < end):
            _, number, at, run = heappop(runs)
            to = len(run) if end is None else bisect_left(run, end, at, key=LOG_TIME)
            if runs and run[to - 1][2] >= runs[0][0]:
                find = bisect_right if number < runs[0][1] else bisect_left
                to = find(run, runs[0][0], at, to, key=LOG_TIME)
            due = run[at:to]
            if to < len(run):
                heappush(runs, (run[to][2], number, to, run))
            self.size -= _size(due)
            del run
            yield from due


def _size(messages: list[Raw]) -> int:
    return _MESSAGE_BYTES * len(messages) + sum(len(one[1]) for one in messages)
