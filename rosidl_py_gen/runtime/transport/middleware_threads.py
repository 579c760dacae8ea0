"""Threads that the middleware creates: their Python thread states, and their queue, which wakes up the event loop.

`ReadyItems` is a queue of sinks, or of handles of readers, for which samples are ready. Only the first item of a batch
wakes up the loop: by a byte in a pipe that the loop watches, or by a function where the loop cannot watch a pipe
(Windows, virtual time). Later items are only stored.

Thread rules; there are no locks, because the loop would wait for one as soon as it is woken up:

1. `put`: any, including threads of Zenoh and signal handlers. It never blocks. Several calls may each wake up the loop,
   which is harmless.
2. `take`: loop. It clears the flag and then reads the sinks; `put` stores the sink and then reads the flag. So each
   sink is taken, or wakes up the loop again. Operations of a dict are atomic.
3. `fileno` and `set_wakeup`: the thread that binds or detaches a loop, one at a time (`loop/loop_binding`).
4. `close`: any. Later sinks wake up no loop: a closed `FileIO` does not write into a file that reuses its descriptor.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Callable, Hashable
from io import FileIO
from typing import Generic, TypeVar

_ensure_thread_state = ctypes.PYFUNCTYPE(ctypes.c_int)(("PyGILState_Ensure", ctypes.pythonapi))


class _Thread(threading.local):
    is_retained = False


_thread = _Thread()


def retain_thread_state() -> None:
    """Keep the Python thread state of the calling thread, which C code has created, until the process ends.

    Otherwise Python creates and deletes the thread state for each callback, which takes longer than the callback: a
    service call from rclpy takes 363 us, with a permanent state 294 us.
    """
    if not _thread.is_retained:
        _thread.is_retained = True
        _ensure_thread_state()


ItemT = TypeVar("ItemT", bound=Hashable)
_MAX_BYTES = 64


class ReadyItems(Generic[ItemT]):
    """Queue of a participant's ready sinks, or of the handles of its readers that have samples."""

    def __init__(self, *, has_pipe: bool = sys.platform != "win32") -> None:
        self._ready: dict[ItemT, None] = {}
        self._is_notified = False
        """True after the loop was woken up, until it takes the items."""
        self._notify: Callable[[], None] | None = None
        self._ends: tuple[FileIO, FileIO] | None = None
        if has_pipe:
            reading, writing = os.pipe()
            for end in reading, writing:
                os.set_blocking(end, False)
            self._ends = FileIO(reading, "rb"), FileIO(writing, "wb")

    def put(self, item: ItemT) -> None:
        """Add an item, and wake up the loop unless an earlier item already has. Thread: any."""
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
        """Return a descriptor that is readable while items wait; None if the queue has no pipe."""
        return None if self._ends is None else self._ends[0].fileno()

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        """Set a function `notify` that wakes up the loop; with None, the loop is woken up by a byte in the pipe."""
        self._notify = notify
        self._is_notified = False  # the loop that was woken up may be gone; before the list is read, as in `take`
        if self._ready:
            self._is_notified = True
            self._wake_up()

    def close(self) -> None:
        """Remove all items and close the pipe; later items wake up no loop."""
        ends, self._ends, self._notify = self._ends, None, None
        self._ready.clear()
        for end in ends or ():
            end.close()
