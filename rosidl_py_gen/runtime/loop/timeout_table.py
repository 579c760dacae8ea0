"""Ends of many things under way, with one timer of the loop for all of them.

Most of what has a time limit is over long before it. Decides that the timer stays then, and looks what is next when it
fires: making and cancelling a timer for each call would be a tenth of what a call costs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

_COALESCE_S = 0.001
"""Between two looks: many that end one shortly after the other cost no more than that."""


class TimeoutTable:
    """Calls `expire` with the number of what did not end in time, on the loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop, expire: Callable[[int], None]) -> None:
        self.loop = loop
        self._expire = expire
        self._ends_s: dict[int, float] = {}
        self._timer: asyncio.TimerHandle | None = None

    def add(self, number: int, left_s: float) -> None:
        """Something that has that many seconds."""
        end_s = self._ends_s[number] = self.loop.time() + left_s
        if self._timer is None or end_s < self._timer.when():
            self._look_at(end_s)

    def remove(self, number: int) -> None:
        """Forget what is over; one that is not known has no effect."""
        self._ends_s.pop(number, None)

    def _look_at(self, time_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(time_s, self._look)

    def _look(self) -> None:
        self._timer = None
        now_s = self.loop.time()
        # In their order, also when the loop was held up and several are due.
        for _, number in sorted(
            (end_s, number) for number, end_s in self._ends_s.items() if end_s <= now_s + _COALESCE_S
        ):
            if self._ends_s.pop(number, None) is not None:  # another one that expired may have removed it
                self._expire(number)
        if self._ends_s:
            self._look_at(max(min(self._ends_s.values()), now_s + _COALESCE_S))
