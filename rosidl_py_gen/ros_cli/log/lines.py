"""Which log messages are wanted, and how they look: as on the console of a node."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.output import printable_line
from rosidl_py_gen.base.stamps import sec_nanosec, stamp_ns
from rosidl_py_gen.ros_cli import ToolError, terminal_output

if TYPE_CHECKING:
    from collections.abc import Sequence

LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_NAMES = {number: name.upper() for name, number in LEVELS.items()}
_STYLES = {10: "green", 30: "yellow", 40: "red", 50: "bold red"}


class Lines:
    """Prints messages of ``rcl_interfaces/msg/Log``.

    Args:
        level: the name of the lowest.
        nodes: patterns; none means all.
        times: after so many `is_done`; None means never.
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
        # Loggers have dots where nodes have slashes, and a node's may have others below it.
        self._names = [one.strip("/").replace("/", ".") for one in nodes]
        try:
            self._pattern = re.compile(pattern) if pattern else None
        except re.error as error:
            raise ToolError(f"--text: no regular expression: {error}: {pattern!r:.100}") from None
        self._left, self._verbose, self._as_json = times, verbose, as_json

    @property
    def is_done(self) -> bool:
        """Whether there are enough."""
        return self._left == 0

    def show(self, message: Any) -> None:
        """Print it, if it is wanted."""
        if self.is_done or not self._wants(message):
            return
        if self._left is not None:
            self._left -= 1
        if self._as_json:
            terminal_output.document(_plain(message), in_stream=True)
            return
        seconds, rest = sec_nanosec(stamp_ns(message.stamp))
        head = printable_line(f"[{_level_name(message.level)}] [{seconds}.{rest:09}] [{message.name}]: ")
        rows = [head + message.msg]
        if self._verbose and message.file:
            rows.append(printable_line(f"at {message.file}:{message.line} in {message.function}"))
        terminal_output.block("\n".join(rows).replace("\n", "\n    "), _STYLES.get(message.level // 10 * 10, ""))

    def _wants(self, message: Any) -> bool:
        return (
            message.level >= self._level
            and (not self._names or any(_is_of(message.name, one) for one in self._names))
            and (self._pattern is None or self._pattern.search(message.msg) is not None)
        )


def _is_of(logger: str, pattern: str) -> bool:
    return fnmatchcase(logger, pattern) or fnmatchcase(logger, f"{pattern}.*")


def _level_name(level: int) -> str:
    return _NAMES.get(level, str(level))


def _plain(message: Any) -> dict[str, Any]:
    return {
        "time_ns": stamp_ns(message.stamp),
        "level": _level_name(message.level),
        "name": message.name,
        "text": message.msg,
        "file": message.file,
        "line": message.line,
        "function": message.function,
    }
