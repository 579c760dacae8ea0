"""Which readers have something, and how the event loop learns of it from a thread of Zenoh.

Decides that only the first of a batch wakes the loop: by a byte in a pipe that the loop watches, or, where it cannot
(Windows), by a call. What comes before the loop has looked adds itself to the list and costs nothing more.

Who may call what, on which thread; there are no locks, which the loop would have to wait for as soon as it is woken:

1. `put`: any thread, those of Zenoh and a signal handler in the middle of anything included. It never waits. Several at
   once may each wake the loop, which does no harm.
2. `take`: the thread of the loop. It lowers the flag, and looks at the list then; `put` adds to the list, and looks at
   the flag then. So whatever is added is taken, or wakes the loop once more. Operations of a deque are single ones.
3. `fileno` and `set_wakeup`: the thread that binds or detaches a loop, one at a time (`loop/loop_binding`).
4. `close`: any thread. What comes later goes nowhere: a closed file writes into no other one that has got its number.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections import deque
from io import FileIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.samples import Sink

_MAX_BYTES = 64


class ReadySinks:
    """The sinks of one participant that have something to do."""

    def __init__(self) -> None:
        self._ready: deque[Sink] = deque()
        self._is_told = False
        """Somebody has woken the loop, and it has not looked yet."""
        self._notify: Callable[[], None] | None = None
        self._ends: tuple[FileIO, FileIO] | None = None
        if sys.platform != "win32":
            reading, writing = os.pipe()
            for end in reading, writing:
                os.set_blocking(end, False)
            self._ends = FileIO(reading, "rb"), FileIO(writing, "wb")

    def put(self, sink: Sink) -> None:
        """Note that `sink` has something to do; from any thread."""
        self._ready.append(sink)  # before looking: `take` looks in the other order
        if not self._is_told:
            self._is_told = True
            self._wake()

    def _wake(self) -> None:
        notify, ends = self._notify, self._ends
        if notify is not None:
            notify()
        elif ends is not None:
            with contextlib.suppress(ValueError):  # closed meanwhile
                ends[1].write(b"\0")

    def take(self) -> list[Sink]:
        """All that were put since the last time, each once."""
        ends = self._ends
        if ends is not None:
            ends[0].read(_MAX_BYTES)
        self._is_told = False
        ready = self._ready
        return list(dict.fromkeys([ready.popleft() for _ in range(len(ready))]))

    def fileno(self) -> int | None:
        """What is readable while there is something to take."""
        return None if self._ends is None else self._ends[0].fileno()

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        """Call `notify` in place of writing into the pipe."""
        self._notify = notify
        self._is_told = False  # whom the last one woke may be gone; before looking, as in `take`
        if self._ready:
            self._is_told = True
            self._wake()

    def close(self) -> None:
        """Tell nobody any more."""
        ends, self._ends, self._notify = self._ends, None, None
        for end in ends or ():
            end.close()
