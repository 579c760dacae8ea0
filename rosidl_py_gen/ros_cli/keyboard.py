"""Keys of a terminal that steer a command while it runs.

Decides that the terminal is as before whenever this process does not have it: at the end, on whatever signal ends or
stops it. Where standard input is no terminal, or belongs to somebody else, as in the background, no keys are read.
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
_BEGUN = re.compile(rb"\x1b[\[O]?\Z")
_ENDING = "SIGHUP", "SIGQUIT"
"""Signals that end this process at once; SIGINT and SIGTERM end it in order."""


def keys_of(data: bytes) -> tuple[list[str], bytes]:
    """Which keys these bytes of a terminal are, of ``space up down right left``; and what may be the begin of one."""
    found = [_ARROWS[one[1]] if one[1] else "space" for one in _KEY.finditer(data)]
    begun = _BEGUN.search(data)
    return found, begun[0] if begun else b""


@contextmanager
def read_keys(actions: Mapping[str, Callable[[], object]]) -> Iterator[bool]:
    """Call an action for each of its keys; on the running loop. Gives whether keys are read."""
    try:
        import termios

        stream = sys.stdin.fileno()
        terminal = _Terminal(stream, termios) if _is_ours(stream) else None
    except (ImportError, OSError, ValueError):  # Windows; no terminal; closed
        terminal = None
    if terminal is None:
        yield False
        return
    loop = asyncio.get_running_loop()
    rest = b""

    def read() -> None:
        nonlocal rest
        if not _is_ours(stream):
            return
        data = b""
        with suppress(OSError):
            data = os.read(stream, 1024)
        if not data:  # the terminal is gone
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


def _is_ours(stream: int) -> bool:
    """Whether this process is in the foreground of its terminal; others are stopped when they touch it."""
    try:
        return os.isatty(stream) and os.tcgetpgrp(stream) == os.getpgrp()
    except OSError:
        return False


class _Terminal:
    """Gives keys as they are pressed, and does not show them, while this process has it."""

    def __init__(self, stream: int, termios: Any) -> None:
        self._stream = stream
        self._termios = termios
        self._before = termios.tcgetattr(stream)
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for name, handler in (
                *((name, self._end) for name in _ENDING),
                ("SIGTSTP", self._stop),
                ("SIGCONT", self._on_continue),
            ):
                number = getattr(signal, name)
                self._handlers[number] = signal.signal(number, handler)
        self._set_raw_mode()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._restore_mode()

    def _set_raw_mode(self) -> None:
        if not _is_ours(self._stream):
            return
        with suppress(self._termios.error):
            raw = self._termios.tcgetattr(self._stream)
            raw[3] &= ~(self._termios.ECHO | self._termios.ICANON)
            raw[6] = [*raw[6]]
            raw[6][self._termios.VMIN], raw[6][self._termios.VTIME] = 1, 0
            self._termios.tcsetattr(self._stream, self._termios.TCSADRAIN, raw)

    def _restore_mode(self) -> None:
        if _is_ours(self._stream):
            with suppress(self._termios.error):
                self._termios.tcsetattr(self._stream, self._termios.TCSADRAIN, self._before)

    def _end(self, number: int, _: object) -> None:
        self._restore_mode()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    def _stop(self, number: int, _: object) -> None:
        self._restore_mode()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)  # until somebody lets it go on
        signal.signal(number, self._stop)

    def _on_continue(self, number: int, _: object) -> None:
        self._set_raw_mode()
