"""Selection of log messages, and their text, which is that of the console of a node."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import sec_nanosec, stamp_ns
from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.ros_cli import CommandError, terminal_output

if TYPE_CHECKING:
    from collections.abc import Sequence

LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_NAMES = {number: name.upper() for name, number in LEVELS.items()}
_STYLES = {10: "green", 30: "yellow", 40: "red", 50: "bold red"}


class LogPrinter:
    """Prints messages of ``rcl_interfaces/msg/Log``.

    Args:
        level: minimum level.
        nodes: patterns for names of nodes; empty means all.
        pattern: regular expression for texts.
        times: number of messages after which `is_done` is True; None means no limit.
    """

    def __init__(
        self,
        level: str,
        nodes: Sequence[str],
        pattern: str | None,
        *,
        times: int | None,
        verbose: bool,
        as_json: bool,
    ) -> None:
        self._level = LEVELS[level.lower()]
        # Names of loggers have dots in place of slashes, and a node may have child loggers.
        self._names = [one.strip("/").replace("/", ".") for one in nodes]
        try:
            self._pattern = re.compile(pattern) if pattern else None
        except re.error as error:
            raise CommandError(f"--text {pattern!r:.100} is not a regular expression: {error}") from None
        self._left, self._verbose, self._as_json = times, verbose, as_json

    @property
    def is_done(self) -> bool:
        """True once the requested number of messages has been printed."""
        return self._left == 0

    def show(self, message: Any) -> None:
        """Print a message, if it is selected."""
        if self.is_done or not self._is_selected(message):
            return
        if self._left is not None:
            self._left -= 1
        if self._as_json:
            terminal_output.document(_row(message), in_stream=True)
            return
        seconds, rest = sec_nanosec(stamp_ns(message.stamp))
        head = printable_line(f"[{_level_name(message.level)}] [{seconds}.{rest:09}] [{message.name}]: ")
        rows = [head + message.msg]
        if self._verbose and message.file:
            rows.append(printable_line(f"at {message.file}:{message.line} in {message.function}"))
        terminal_output.block("\n".join(rows).replace("\n", "\n    "), _STYLES.get(message.level // 10 * 10, ""))

    def _is_selected(self, message: Any) -> bool:
        return (
            message.level >= self._level
            and (not self._names or any(_matches(message.name, pattern) for pattern in self._names))
            and (self._pattern is None or self._pattern.search(message.msg) is not None)
        )


def _matches(logger: str, pattern: str) -> bool:
    return fnmatchcase(logger, pattern) or fnmatchcase(logger, f"{pattern}.*")


def _level_name(level: int) -> str:
    return _NAMES.get(level, str(level))


def _row(message: Any) -> dict[str, Any]:
    return {
        "time_ns": stamp_ns(message.stamp),
        "level": _level_name(message.level),
        "name": message.name,
        "text": message.msg,
        "file": message.file,
        "line": message.line,
        "function": message.function,
    }
