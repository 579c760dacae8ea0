"""SIGINT in the commands of this package: one Ctrl-C ends a command in order, and so do two.

`timeout -s INT` and shells send SIGINT twice within milliseconds: to the process, and to its group. A person presses
Ctrl-C again when a command takes long to end. Neither may interrupt the code that closes files and leaves the network.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from types import FrameType

REPEAT_S = 0.4
"""Time after a signal in which SIGINT counts as the same request. Longer: a person who insists is not heard; shorter:
a busy machine that delivers the second of two signals late interrupts the shutdown."""


class CommandInterrupts:
    """Handler of SIGINT for a process that is one of our commands.

    The first signal raises KeyboardInterrupt. Later ones are ignored for `REPEAT_S`; then one ends the process with
    exit code 130, without a traceback.

    Attributes:
        ignores_first: True while `run` is active, which has a handler of its own and passes a second signal to this
            one; and when the command is done.
    """

    def __init__(self) -> None:
        self.ignores_first = False
        self._first_s: float | None = None

    @contextlib.contextmanager
    def handling(self, is_process: bool) -> Iterator[None]:
        """A block that is the command; the handler stays until the interpreter has ended.

        Args:
            is_process: False where a command is called inside a program of somebody else: no handler is set.
        """
        if not is_process:
            yield
            return
        signal.signal(signal.SIGINT, self)
        try:
            yield
        finally:
            self.ignores_first = True

    def note(self) -> None:
        """Count a signal that another handler got as the first one."""
        self._first_s = time.monotonic()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal; raises KeyboardInterrupt."""
        if self._first_s is None:
            self.note()
            if not self.ignores_first:
                raise KeyboardInterrupt
        elif time.monotonic() - self._first_s > REPEAT_S:
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(Exception):
                    stream.flush()
            os._exit(130)


command_interrupts = CommandInterrupts()
