"""Handling of SIGINT in the commands of this package: one or two signals let a command finish its clean-up.

`timeout -s INT` and shells send SIGINT twice within milliseconds: to the process, and to its group. A user presses
Ctrl-C again if a command takes long to end. Neither must interrupt the code that closes files and leaves the network.

Python ignores a KeyboardInterrupt in a callback of a weak reference, as the import system has them; `repeat_ignored`
sends that signal again.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import Any

REPEAT_S = 0.4
"""Time after a SIGINT in which another SIGINT counts as the same request. A larger value ignores a user who insists;
with a smaller one, a second signal that a busy machine delivers late interrupts the shutdown."""


class CommandInterrupts:
    """Handler of SIGINT for the process of a command.

    The first signal raises KeyboardInterrupt. Later signals are ignored for `REPEAT_S`; then a signal ends the process
    with exit code 130, without a traceback.

    Attributes:
        ignores_first: the first signal raises nothing. True while `run` is active, which has its own handler and passes
            a second signal to this handler; after the command; and at the end of a process that ran `ignore_next`.
    """

    BROKEN_PIPE = 141
    """Exit code that a shell reports for a program ended by SIGPIPE. Python ignores that, so commands return it."""

    def __init__(self) -> None:
        self.ignores_first = False
        self._first_s: float | None = None

    @contextlib.contextmanager
    def handling(self, is_process: bool) -> Iterator[None]:
        """Handle SIGINT by this object inside a block that runs a command; do nothing if `is_process` is False.

        `is_process` is True if this process was started for the command, not if a program calls the command.
        """
        if not is_process:
            yield
            return
        signal.signal(signal.SIGINT, self)
        try:
            yield
        finally:
            self.ignores_first = True

    def ignore_next(self) -> None:
        """Become the handler of SIGINT for the end of a process: ignore the first signal from now on.

        Raises ValueError outside of the main thread.
        """
        before = self.ignores_first, self._first_s
        self.ignores_first, self._first_s = True, None  # first, because a signal may arrive at once
        try:
            signal.signal(signal.SIGINT, self)
        except ValueError:
            self.ignores_first, self._first_s = before
            raise

    @staticmethod
    def is_same_request(elapsed_s: float) -> bool:
        """Return True if a SIGINT that arrives `elapsed_s` after the first one counts as the same request."""
        return elapsed_s <= REPEAT_S

    def note(self) -> None:
        """Record that another signal handler has received the first SIGINT now."""
        self._first_s = time.monotonic()

    def repeat_ignored(self, unraisable: Any) -> None:
        """Send SIGINT again if Python has ignored its KeyboardInterrupt; this method is a `sys.unraisablehook`."""
        if unraisable.exc_type is not KeyboardInterrupt or os.name == "nt":  # there, `os.kill` ends the process
            sys.__unraisablehook__(unraisable)
            return
        self._first_s = None
        threading.Thread(target=_interrupt_again, args=(sys._getframe(),), daemon=True).start()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a SIGINT: raise KeyboardInterrupt for the first one, end the process for a late repetition."""
        if self._first_s is None:
            self.note()
            if not self.ignores_first:
                raise KeyboardInterrupt
        elif not self.is_same_request(time.monotonic() - self._first_s):
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(Exception):
                    stream.flush()
            os._exit(130)


def _interrupt_again(hook: FrameType) -> None:
    """Wait until the main thread has left the function `hook`, in which Python would ignore a KeyboardInterrupt, then
    send SIGINT again.
    """
    from traceback import walk_stack  # slow to import

    while hook in (frame for frame, _ in walk_stack(sys._current_frames().get(threading.main_thread().ident or 0))):
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGINT)


command_interrupts = CommandInterrupts()
