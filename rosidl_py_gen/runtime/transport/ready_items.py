"""Sinks, or handles of readers, that are ready, and the wake-up of the event loop, where no descriptor does that.

Only the first sink of a batch wakes up the loop: by a byte in a pipe that the loop watches, or by a function where it
cannot (Windows, virtual time). Later sinks are only stored.

Thread rules; there are no locks, because the loop would wait for one as soon as it is woken up:

1. `put`: any, including threads of Zenoh and signal handlers. It never blocks. Several calls may each wake up the loop,
   which is harmless.
2. `take`: loop. It clears the flag and then reads the sinks; `put` stores the sink and then reads the flag. So each
   sink is taken, or wakes up the loop again. Operations of a dict are atomic.
3. `fileno` and `set_wakeup`: the thread that binds or detaches a loop, one at a time (`loop/loop_binding`).
4. `close`: any. Later sinks are discarded: a closed file does not write into another one that has got its number.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Hashable
from io import FileIO
from typing import Generic, TypeVar

ItemT = TypeVar("ItemT", bound=Hashable)
_MAX_BYTES = 64


class ReadyItems(Generic[ItemT]):
    """Ready sinks of one participant, or handles of its readers that have samples."""

    def __init__(self, *, has_pipe: bool = sys.platform != "win32") -> None:
        self._ready: dict[ItemT, None] = {}
        self._is_notified = False
        """The loop was woken up and has not taken the sinks yet."""
        self._notify: Callable[[], None] | None = None
        self._ends: tuple[FileIO, FileIO] | None = None
        if has_pipe:
            reading, writing = os.pipe()
            for end in reading, writing:
                os.set_blocking(end, False)
            self._ends = FileIO(reading, "rb"), FileIO(writing, "wb")

    def put(self, item: ItemT) -> None:
        """Add an item. Thread: any."""
        self._ready[item] = None  # before the flag is read: `take` has the opposite order
        if not self._is_notified:
            self._is_notified = True
            self._wake_up()

    def _wake_up(self) -> None:
        notify, ends = self._notify, self._ends
        if notify is not None:
            notify()
        elif ends is not None:
            with contextlib.suppress(ValueError):  # closed by another thread
                ends[1].write(b"\0")

    def take(self) -> list[ItemT]:
        """Return all items added since the last call, each once, in their order."""
        ends = self._ends
        if ends is not None:
            ends[0].read(_MAX_BYTES)
        self._is_notified = False
        ready = list(self._ready)
        for item in ready:  # other threads may add some at any time
            self._ready.pop(item, None)
        return ready

    def fileno(self) -> int | None:
        """Return a descriptor that is readable while there are items; None if there is none."""
        return None if self._ends is None else self._ends[0].fileno()

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        """Call `notify` instead of writing into the pipe."""
        self._notify = notify
        self._is_notified = False  # the loop that was woken up may be gone; before the list is read, as in `take`
        if self._ready:
            self._is_notified = True
            self._wake_up()

    def close(self) -> None:
        """Discard items from now on."""
        ends, self._ends, self._notify = self._ends, None, None
        self._ready.clear()
        for end in ends or ():
            end.close()
