"""Reading of keys with which the user controls a running command in a terminal.

The mode of the terminal is restored at the end, and on every signal that ends or stops this process. No keys are read
if standard input is not a terminal, or if the process is in the background.
"""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

_ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_KEY = re.compile(rb"\x1b[\[O]([A-D])|( )")
_INCOMPLETE_KEY = re.compile(rb"\x1b[\[O]?\Z")
_GIVING_UP = "SIGHUP", "SIGQUIT", "SIGTSTP"
"""Signals that end or stop this process without running its clean-up code, unlike SIGINT and SIGTERM."""


def keys_of(data: bytes) -> tuple[list[str], bytes]:
    """Return the names of keys in bytes from a terminal, such as ``up``, and the bytes of an incomplete key."""
    keys = [_ARROWS[one[1]] if one[1] else "space" for one in _KEY.finditer(data)]
    incomplete = _INCOMPLETE_KEY.search(data)
    return keys, incomplete[0] if incomplete else b""


@contextmanager
def read_keys(actions: Mapping[str, Callable[[], object]]) -> Iterator[bool]:
    """Call the action of each pressed key on the running loop while the block runs.

    Yields True, or False if no keys can be read.
    """
    try:
        import termios

        stream = sys.stdin.fileno()
        terminal = _Terminal(stream, termios) if _is_foreground(stream) else None
    except (ImportError, OSError, ValueError):  # Windows; no terminal; closed
        terminal = None
    if terminal is None:
        yield False
        return
    loop = asyncio.get_running_loop()
    rest = b""

    def read() -> None:
        nonlocal rest
        if not _is_foreground(stream):
            return
        data = b""
        with suppress(OSError):
            data = os.read(stream, 1024)
        if not data:  # the terminal was closed
            loop.remove_reader(stream)
        names, rest = keys_of(rest + data)
        for name in names:
            if name in actions:
                actions[name]()

    with terminal:
        loop.add_reader(stream, read)
        try:
            yield True
        finally:
            loop.remove_reader(stream)


def _is_foreground(stream: int) -> bool:
    """Return True if this process may access its terminal; the kernel would stop a background process."""
    try:
        return os.isatty(stream) and os.tcgetpgrp(stream) == os.getpgrp()
    except OSError:
        return False


class _Terminal:
    """Terminal in raw mode: keys are reported when they are pressed, and not printed."""

    def __init__(self, stream: int, termios: Any) -> None:
        self._stream = stream
        self._termios = termios
        self._original_mode = termios.tcgetattr(stream)
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            handlers = {
                **dict.fromkeys(_GIVING_UP, self._give_up),
                "SIGCONT": lambda number, frame: self._set_raw_mode(),
            }
            for name, handler in handlers.items():
                number = getattr(signal, name)
                self._handlers[number] = signal.signal(number, handler)
        self._set_raw_mode()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._restore_mode()

    def _set_raw_mode(self) -> None:
        import tty

        if _is_foreground(self._stream):
            with suppress(self._termios.error):
                tty.setcbreak(self._stream, self._termios.TCSADRAIN)

    def _restore_mode(self) -> None:
        if _is_foreground(self._stream):
            with suppress(self._termios.error):
                self._termios.tcsetattr(self._stream, self._termios.TCSADRAIN, self._original_mode)

    def _give_up(self, number: int, _: object) -> None:
        self._restore_mode()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)  # of SIGTSTP, returns after SIGCONT
        signal.signal(number, self._give_up)
