"""Table of the timeouts of many operations, which use one timer of the event loop.

Most operations end long before their timeout. So `remove` does not touch the timer, which finds the next timeout when
it fires: a timer for each operation would be a tenth of the cost of a service call.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

OperationT = TypeVar("OperationT")

_COALESCE_S = 0.001
"""Minimum time between two checks of timeouts, in seconds, so that many timeouts in sequence share one check."""


class TimeoutTable(Generic[OperationT]):
    """Timeouts of operations, which are hashable objects.

    `expire` is called on the loop with each operation whose timeout is over.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, expire: Callable[[OperationT], None]) -> None:
        self.loop = loop
        self._expire = expire
        self._ends_s: dict[OperationT, float] = {}
        self._timer: asyncio.TimerHandle | None = None

    def add(self, operation: OperationT, timeout_s: float) -> None:
        """Add an operation; its timeout of this many seconds starts now."""
        end_s = self._ends_s[operation] = self.loop.time() + timeout_s
        if self._timer is None or end_s < self._timer.when():
            self._schedule_check(end_s)

    def remove(self, operation: OperationT) -> None:
        """Remove an operation, so that it does not expire; without effect for an unknown operation."""
        self._ends_s.pop(operation, None)

    def _schedule_check(self, time_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(time_s, self._check)

    def _check(self) -> None:
        self._timer = None
        now_s = self.loop.time()
        due = [(end_s, operation) for operation, end_s in self._ends_s.items() if end_s <= now_s + _COALESCE_S]
        # In the order of their timeouts, if the loop was blocked and several are due.
        for _, operation in sorted(due, key=lambda item: item[0]):
            if self._ends_s.pop(operation, None) is not None:  # `expire` may have removed it
                self._expire(operation)
        if self._ends_s:
            self._schedule_check(max(min(self._ends_s.values()), now_s + _COALESCE_S))
