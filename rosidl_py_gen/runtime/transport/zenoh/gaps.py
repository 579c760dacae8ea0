"""Messages that never came, known by the numbers that each publisher gives its own."""

from __future__ import annotations

_PUBLISHERS = 1024


class Gaps:
    """Counts what is missing between the numbers that arrived; source: docs/internals/zenoh.md 8.

    Samples of one publisher come one after the other, those of several may come in several threads.
    """

    def __init__(self) -> None:
        self._publishers: dict[bytes, list[int]] = {}
        """The highest number so far, and how many were missing below it."""
        self._forgotten = 0

    @property
    def lost(self) -> int:
        """How many were missing so far, from the first number of each publisher on."""
        return self._forgotten + sum(missing for _, missing in list(self._publishers.values()))

    def note(self, publisher: bytes, number: int) -> None:
        """A sample has arrived; one that was overtaken counts as missing, as in rmw_zenoh."""
        known = self._publishers.get(publisher)
        if known is None:
            if len(self._publishers) >= _PUBLISHERS:
                self._forgotten += self._publishers.pop(next(iter(self._publishers)))[1]
            self._publishers[publisher] = [number, 0]
        elif number > known[0]:
            known[1] += number - known[0] - 1
            known[0] = number
