"""Pipe with which DDS wakes up an event loop: Cyclone writes the handles of readers that have samples into it.

The loop that watches `fileno` reads the pipe; on Windows, where loops cannot watch pipes, a thread reads it. A wake-up
may find no samples: a writer in the same process moves the samples that it delivers into the reader's queue, maybe
before the loop does.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
import sys
import threading
from collections.abc import Callable, Iterable

from rosidl_py_gen.runtime.transport.ready_items import ReadyItems

LOOPS_CAN_WATCH = os.name == "posix"
"""True where event loops can watch pipes. Elsewhere a thread keeps the pipe empty, so writing to the pipe may block."""
_MIN_PIPE_BYTES = 512
"""Minimum capacity of a pipe (PIPE_BUF of POSIX): a pipe with less content was not full."""
_READ_BYTES = 4096
"""Maximum number of bytes in one read. Python allocates this size for each read; if the pipe contains more, it remains
readable."""
_handle = struct.Struct("i")

# The C library that Python itself uses. On Windows the functions of POSIX have an underscore.
_libc = ct.CDLL("ucrtbase" if sys.platform == "win32" else None)
_prefix = "_" if sys.platform == "win32" else ""
_file, _int = ct.c_void_p, ct.c_int
_fdopen = ct.CFUNCTYPE(_file, _int, ct.c_char_p)((f"{_prefix}fdopen", _libc))
_setbuf = ct.CFUNCTYPE(None, _file, ct.c_void_p)(("setbuf", _libc))
_fclose = ct.CFUNCTYPE(_int, _file)(("fclose", _libc))
ferror = ct.CFUNCTYPE(_int, _file)(("ferror", _libc))
"""C function that returns non-zero if a reader's handle did not fit into `WakeupPipe.stream`; the next `drain` reports
that."""
_clearerr = ct.CFUNCTYPE(None, _file)(("clearerr", _libc))
# Used as a listener of Cyclone, so that Cyclone's threads call the C library directly, without Python and the GIL.
putw = ct.CFUNCTYPE(_int, _int, _file)((f"{_prefix}putw", _libc))
"""C function that writes a reader's handle into `WakeupPipe.stream`. Cyclone calls it as a listener. Unlike a listener
it returns an int; the calling conventions of all platforms of Cyclone allow that."""


class WakeupPipe:
    """Pipe with which Cyclone wakes up the event loop of one participant, by writing handles of readers.

    Thread: any.
    """

    def __init__(self) -> None:
        self._read_end, self._write_end = os.pipe()
        if LOOPS_CAN_WATCH:
            # The pipe must never block Cyclone: a handle that does not fit is not written, and the next `drain` reports
            # that some are missing.
            self._set_blocking(False)
        self.stream: int = _fdopen(self._write_end, b"wb")
        """Writing end of the pipe, as an unbuffered C `FILE *`."""
        _setbuf(self.stream, None)
        self._lock = threading.Lock()
        self._closed = False
        self._thread: threading.Thread | None = None
        self._handles: ReadyItems[int] = ReadyItems(has_pipe=False)
        """Handles of readers that the reading thread has taken from the pipe."""
        if not LOOPS_CAN_WATCH:
            self.read_in_thread(None)

    def _set_blocking(self, blocking: bool) -> None:
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, blocking)

    def fileno(self) -> int | None:
        """Return the descriptor that an event loop must watch; None if a thread reads the pipe."""
        return self._read_end if self._thread is None else None

    def notify(self, handle: int) -> None:
        """Write a reader's handle, as Cyclone does when it has received samples for the reader."""
        with self._lock:
            if not self._closed:
                putw(handle, self.stream)

    def drain(self) -> Iterable[int] | None:
        """Return the handles of readers written since the last call; None if some may be missing. Never blocks."""
        if self._thread is not None:
            return self._handles.take()
        with self._lock:
            if self._closed:
                return ()
            try:
                data = os.read(self._read_end, _READ_BYTES)
            except BlockingIOError:
                return ()
            if len(data) == _handle.size:  # by far the most frequent case
                return _handle.unpack(data)
            # `ferror` takes the lock that `putw` holds, so it reports every write that found the pipe full.
            if len(data) >= _MIN_PIPE_BYTES and ferror(self.stream):
                _clearerr(self.stream)
                return None
        return _unique_handles(data)

    def read_in_thread(self, notify: Callable[[], None] | None) -> None:
        """Start a thread that reads the pipe; the thread calls `notify` when `drain` has handles."""
        self._handles.set_wakeup(notify)
        if self._thread is None:
            if LOOPS_CAN_WATCH:
                self._set_blocking(True)
            self._thread = threading.Thread(target=self._run, name="rosidl-py-gen receiver", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while data := os.read(self._read_end, _READ_BYTES):
            for handle in _unique_handles(data):
                self._handles.put(handle)

    def close(self) -> None:
        """Close the pipe, and wait for the end of the thread that reads it.

        No listener of Cyclone may use the stream any more.
        """
        # Cyclone deletes an entity only after its listener has returned, so callers delete the participant before.
        with self._lock:
            self._closed = True
            _fclose(self.stream)
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        os.close(self._read_end)


def _unique_handles(data: bytes) -> dict[int, None]:
    return dict.fromkeys(memoryview(data).cast("i"))
