"""How DDS tells an event loop that samples arrived: it writes the handle of their reader into a pipe.

Decides who writes and who reads. The writer is the C library's `putw`: it has the shape of a listener of Cyclone's, so
that Cyclone's threads call it directly, without Python and its lock. The reader is whoever watches `fileno`, or a
thread of ours where no loop can do that (Windows).

What holds, each with a test:

- A wake-up may be for nothing: a writer of this process takes what it delivers itself, and a loop may be late.
- The pipe never blocks Cyclone. What does not fit is not written, and the next `drain` names every reader instead.
- Cyclone deletes an entity only when its listener has returned, so the pipe is closed after the participant.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

_LOOPS_CAN_WATCH = os.name == "posix"
"""Elsewhere pipes can only be read in a thread, which then never leaves a pipe full, so that it may be a blocking one.
"""
_SMALLEST_BYTES = 512
"""No system's pipe is smaller (PIPE_BUF of POSIX), so that less than this was not a full one."""
_READ_BYTES = 4096
"""At a time: Python allocates as much for each read, and a pipe that is not empty yet stays readable."""
_one = struct.Struct("i")

# The C library that Python itself uses. On Windows the functions of POSIX have an underscore.
_libc = ct.CDLL("ucrtbase" if sys.platform == "win32" else None)
_prefix = "_" if sys.platform == "win32" else ""
_file, _int = ct.c_void_p, ct.c_int
_fdopen = ct.CFUNCTYPE(_file, _int, ct.c_char_p)((f"{_prefix}fdopen", _libc))
_setbuf = ct.CFUNCTYPE(None, _file, ct.c_void_p)(("setbuf", _libc))
_fclose = ct.CFUNCTYPE(_int, _file)(("fclose", _libc))
_ferror = ct.CFUNCTYPE(_int, _file)(("ferror", _libc))
_clearerr = ct.CFUNCTYPE(None, _file)(("clearerr", _libc))
putw = ct.CFUNCTYPE(_int, _int, _file)((f"{_prefix}putw", _libc))
"""Write a handle into `WakeupPipe.stream`. Declared as returning an int where Cyclone expects nothing: by the calling
conventions of all its platforms the caller does not look.
"""


class WakeupPipe:
    """The pipe of one participant. From any thread."""

    def __init__(self) -> None:
        self._read_end, self._write_end = os.pipe()
        if _LOOPS_CAN_WATCH:
            self._set_blocking(False)
        self.stream: int = _fdopen(self._write_end, b"wb")
        """The writing end, as a C `FILE *` without buffer."""
        _setbuf(self.stream, None)
        self._lock = threading.Lock()
        self._closed = False
        self._thread: threading.Thread | None = None
        self._notify: Callable[[], None] | None = None
        self._named: dict[int, None] = {}
        if not _LOOPS_CAN_WATCH:
            self.read_in_thread(None)

    def _set_blocking(self, blocking: bool) -> None:
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, blocking)

    def fileno(self) -> int | None:
        """What a loop can watch; None once a thread reads."""
        return self._read_end if self._thread is None else None

    def notify(self, handle: int) -> None:
        """Name a reader, as Cyclone does when samples for it arrive."""
        with self._lock:
            if not self._closed:
                putw(handle, self.stream)

    def drain(self) -> Iterable[int] | None:
        """The readers named since the last time; None when some names may be missing. Never blocks."""
        if self._thread is not None:
            named = self._named
            return [named.popitem()[0] for _ in range(len(named))]  # the thread may add at any time
        with self._lock:
            if self._closed:
                return ()
            try:
                data = os.read(self._read_end, _READ_BYTES)
            except BlockingIOError:
                return ()
            if len(data) == _one.size:  # by far the most frequent case
                return _one.unpack(data)
            # `ferror` takes the lock that `putw` holds, and so knows of every write that found the pipe full.
            if len(data) >= _SMALLEST_BYTES and _ferror(self.stream):
                _clearerr(self.stream)
                return None
        return _unique_handles(data)

    def read_in_thread(self, notify: Callable[[], None] | None) -> None:
        """Let a thread read from now on, and call `notify` there whenever `drain` has something."""
        self._notify = notify
        if self._thread is None:
            if _LOOPS_CAN_WATCH:
                self._set_blocking(True)
            self._thread = threading.Thread(target=self._run, name="rosidl-py-gen receiver", daemon=True)
            self._thread.start()
        elif notify is not None and self._named:
            notify()

    def _run(self) -> None:
        while data := os.read(self._read_end, _READ_BYTES):
            self._named.update(_unique_handles(data))
            notify = self._notify
            if notify is not None:
                notify()

    def close(self) -> None:
        """Once nobody has the stream any more; ends the thread."""
        with self._lock:
            self._closed = True
            _fclose(self.stream)
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        os.close(self._read_end)


def _unique_handles(data: bytes) -> dict[int, None]:
    return dict.fromkeys(memoryview(data).cast("i"))
