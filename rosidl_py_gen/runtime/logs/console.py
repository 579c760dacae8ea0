"""Console output of log records in the format of ROS.

Nothing is printed while Python's root logger has handlers: they get all records, which would appear twice.
Source: docs/internals/protocol.md 9.7, 10.6.
"""

from __future__ import annotations

import logging
import os
import re
import sys
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, TextIO

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.runtime.logs.loggers import DEBUG, ERROR, FATAL, LEVEL_NAMES, WARN, get_root_logger, ros_level
from rosidl_py_gen.runtime.logs.rosout import message_text

if TYPE_CHECKING:
    from collections.abc import Mapping

DEFAULT_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_TOKEN = re.compile(r"\{([a-z_]+)\}")
_COLORS = {DEBUG: "\x1b[32m", WARN: "\x1b[33m", ERROR: "\x1b[31m", FATAL: "\x1b[31m"}
_COLOR_END = "\x1b[0m"


@dataclass(frozen=True, slots=True)
class ConsoleSettings:
    """Settings of the console; `colorized` None: only on a terminal."""

    format: str = DEFAULT_FORMAT
    colorized: bool | None = None
    use_stdout: bool = False


def read_console_environment(environ: Mapping[str, str]) -> ConsoleSettings:
    """Read the RCUTILS_* variables; values other than 0 and 1 are ignored."""
    colorized = {"0": False, "1": True}.get(environ.get("RCUTILS_COLORIZED_OUTPUT", ""))
    return ConsoleSettings(
        environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT_FORMAT,
        colorized,
        environ.get("RCUTILS_LOGGING_USE_STDOUT") == "1",
    )


def format_record(record: logging.LogRecord, format_text: str = DEFAULT_FORMAT) -> str:
    """Replace the known ``{tokens}`` of the format; unknown ones remain, as in rcutils."""
    values = {
        "severity": LEVEL_NAMES[ros_level(record.levelno)],
        "name": record.name,
        "message": message_text(record),
        "function_name": record.funcName or "",
        "file_name": record.pathname,
        "line_number": str(record.lineno),
    }
    now_ns = round(record.created * NS_PER_S)
    seconds, nanoseconds = sec_nanosec(now_ns)
    values["time"] = f"{seconds}.{nanoseconds:09d}"
    values["time_as_nanoseconds"] = str(now_ns)
    values["date_time_with_ms"] = datetime.fromtimestamp(record.created).isoformat(" ", "milliseconds")
    return _TOKEN.sub(lambda match: values.get(match.group(1), match.group()), format_text)


class ConsoleHandler(logging.Handler):
    """Handler that writes to the current `sys.stderr`, or `sys.stdout`."""

    def __init__(self, settings: ConsoleSettings | None = None) -> None:
        super().__init__()
        self.settings = settings or ConsoleSettings()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record, unless Python's root logger has handlers."""
        if logging.getLogger().handlers:
            return
        stream = sys.stdout if self.settings.use_stdout else sys.stderr
        try:
            stream.write(self._line(record, stream) + "\n")
            stream.flush()
        except Exception:
            self.handleError(record)

    def _line(self, record: logging.LogRecord, stream: TextIO) -> str:
        line = format_record(record, self.settings.format)
        colorized = stream.isatty() if self.settings.colorized is None else self.settings.colorized
        color = _COLORS.get(ros_level(record.levelno), "")
        return f"{color}{line}{_COLOR_END}" if colorized and color else line


_handler = ConsoleHandler()


def print_logs() -> None:
    """Print log records on the console from now on, with the settings of the ``RCUTILS_...`` variables.

    The first context does that, too; call this to log before. A context with ``--disable-stdout-logs`` ends it.
    """
    install_console(read_console_environment(os.environ))


def install_console(settings: ConsoleSettings, *, prints: bool = True) -> None:
    """Print all ROS records, or none, until the next call."""
    _handler.settings = settings
    root = get_root_logger()
    if prints:
        root.addHandler(_handler)
    else:
        root.removeHandler(_handler)
