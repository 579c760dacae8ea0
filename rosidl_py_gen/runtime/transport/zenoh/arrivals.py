"""Which readers have something, and how the event loop learns of it from a thread of Zenoh.

Decides that only the first of a batch wakes the loop: by a byte in a pipe that the loop watches, or, where it cannot
(Windows), by a call. What comes before the loop has looked adds itself to the list and costs nothing more.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.interface import Sink

_MOST_BYTES = 64


class Arrivals:
    """The sinks of one participant that have something to do."""

    def __init__(self) -> None:
        self._ready: dict[Sink, None] = {}
        self._notify: Callable[[], None] | None = None
        # A signal handler may publish in the middle of a change, in the same thread.
        self._lock = threading.RLock()
        self._ends: tuple[int, int] | None = None
        if sys.platform != "win32":
            self._ends = os.pipe()
            for end in self._ends:
                os.set_blocking(end, False)

    def put(self, sink: Sink) -> None:
        """Note that `sink` has something to do; from any thread."""
        with self._lock:
            is_first = not self._ready
            self._ready[sink] = None
        if is_first:
            self._wake()

    def _wake(self) -> None:
        notify = self._notify
        if notify is not None:
            notify()
            return
        with self._lock:  # a descriptor that is closed may be somebody else's already
            if self._ends is not None:
                with contextlib.suppress(BlockingIOError):
                    os.write(self._ends[1], b"\0")

    def take(self) -> list[Sink]:
        """All that were put since the last time, each once."""
        if self._ends is not None:
            with contextlib.suppress(BlockingIOError):
                os.read(self._ends[0], _MOST_BYTES)
        with self._lock:
            ready = list(self._ready)
            self._ready.clear()
        return ready

    def fileno(self) -> int | None:
        """What is readable while there is something to take."""
        return None if self._ends is None else self._ends[0]

    def set_notify(self, notify: Callable[[], None] | None) -> None:
        """Call `notify` in place of writing into the pipe."""
        self._notify = notify
        if self._ready:
            self._wake()

    def close(self) -> None:
        """Tell nobody any more."""
        with self._lock:
            ends, self._ends, self._notify = self._ends, None, None
            for end in ends or ():
                os.close(end)
