"""Outputs of log records: the console, and the log file of the process.

The first open context selects the outputs; a warning reports different settings of another context. Unlike in ROS, a
log file is written only on request, by ``--log-file-name``, ``--enable-external-lib-logs`` or ``ROS_LOG_DIR``, and not
with ``--disable-external-lib-logs``. Files have the format of rcl_logging_spdlog; only the name prefix differs: the
name of the program instead of ``python3``. Each line is written at once. The console prints nothing while the root
logger of Python has handlers: these handlers get all records, which would appear twice.
Source: docs/internals/protocol.md 9.7, 10.4, 10.6.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import threading
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.loggers import (
    DEBUG,
    ERROR,
    FATAL,
    LEVEL_NAMES,
    WARN,
    get_root_logger,
    message_text,
    ros_level,
    set_logger_level,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

DEFAULT_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_TOKEN = re.compile(r"\{([a-z_]+)\}")
_COLORS = {DEBUG: "\x1b[32m", WARN: "\x1b[33m", ERROR: "\x1b[31m", FATAL: "\x1b[31m"}
_COLOR_END = "\x1b[0m"


@dataclass(frozen=True, slots=True)
class ConsoleSettings:
    """Settings for printing log records on the console.

    Attributes:
        format: text with ``{tokens}``, as in ``RCUTILS_CONSOLE_OUTPUT_FORMAT``.
        colorized: print colours; None: only on a terminal.
        use_stdout: print on stdout instead of stderr.
    """

    format: str = DEFAULT_FORMAT
    colorized: bool | None = None
    use_stdout: bool = False


def read_console_environment(environ: Mapping[str, str]) -> ConsoleSettings:
    """Return the console settings of the ``RCUTILS_...`` variables; a switch counts only if its value is 0 or 1."""
    colorized = {"0": False, "1": True}.get(environ.get("RCUTILS_COLORIZED_OUTPUT", ""))
    return ConsoleSettings(
        environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT_FORMAT,
        colorized,
        environ.get("RCUTILS_LOGGING_USE_STDOUT") == "1",
    )


def format_record(record: logging.LogRecord, format_text: str = DEFAULT_FORMAT) -> str:
    """Return a log record as text: replace the known ``{tokens}`` of a format; unknown tokens remain, as in rcutils."""
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
    """Handler that writes log records to the file object that is `sys.stderr` or `sys.stdout` at the time of the
    record.
    """

    def __init__(self, settings: ConsoleSettings | None = None) -> None:
        super().__init__()
        self.settings = settings or ConsoleSettings()

    def emit(self, record: logging.LogRecord) -> None:
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


console_handler = ConsoleHandler()
"""Handler that prints all ROS log records; attached to the ROS root logger while printing is switched on."""


def print_logs() -> None:
    """Start to print log records on the console, with the settings of the ``RCUTILS_...`` variables.

    Opening the first context does so, too; a program calls this function if it logs before that. A context with
    ``--disable-stdout-logs`` stops the printing.
    """
    install_console(read_console_environment(os.environ))


def install_console(settings: ConsoleSettings, *, prints: bool = True) -> None:
    """Start to print all ROS log records on the console, or stop that with ``prints=False``."""
    console_handler.settings = settings
    root = get_root_logger()
    if prints:
        root.addHandler(console_handler)
    else:
        root.removeHandler(console_handler)


class LogFileError(RosidlError, OSError):
    """Raised if a log file cannot be written."""


def get_logging_directory(environ: Mapping[str, str] | None = None) -> Path:
    """Return the folder for log files: ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``.

    Args:
        environ: environment variables; None means the environment of this process.

    Raises:
        LogFileError: the home folder is unknown.
    """
    environ = os.environ if environ is None else environ
    folder = Path(environ.get("ROS_LOG_DIR") or Path(environ.get("ROS_HOME") or "~/.ros") / "log")
    try:
        return folder.expanduser()
    except RuntimeError as error:
        raise LogFileError(f"the folder for log files, {folder}, is unknown: {error}; set ROS_LOG_DIR") from error


def program_prefix(program: str) -> str:
    """Return the default prefix of a log file: the program's name without folder and ``.py``."""
    if program in ("", "-", "-c", "-m"):
        return "python"
    path = Path(program)
    if path.name == "__main__.py" and path.parent.name:
        path = path.parent
    return re.sub(r"[^\w.-]", "_", path.name.removesuffix(".py")) or "python"


class LogFile(logging.FileHandler):
    """Handler that appends log records to a file, in the format of the console without colours.

    Raises:
        LogFileError: the file cannot be created.
    """

    def __init__(self, path: Path, format_text: str = DEFAULT_FORMAT) -> None:
        self._format = format_text
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            super().__init__(path, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise LogFileError(
                f"the log file {path} cannot be written: {error.strerror or error}; "
                "set ROS_LOG_DIR to another folder, or use --ros-args --disable-external-lib-logs"
            ) from error

    def format(self, record: logging.LogRecord) -> str:
        return format_record(record, self._format)


@dataclass(frozen=True, slots=True)
class LogSettings:
    """Logging options of a command line.

    Attributes:
        level: level of the root logger; None: INFO.
        levels: (logger name, level) in the order of the command line.
        file_name: prefix of the name of the log file; empty: the program's name.
        stdout, rosout: the switches ``--enable-…-logs`` and ``--disable-…-logs``; the last switch counts.
        external_lib: the switches ``--enable-external-lib-logs`` and ``--disable-external-lib-logs``, which enable the
            log file; None if absent.
    """

    level: int | None = None
    levels: tuple[tuple[str, int], ...] = ()
    file_name: str = ""
    stdout: bool = True
    rosout: bool = True
    external_lib: bool | None = None

    def wants_file(self, environ: Mapping[str, str]) -> bool:
        """Return True if the command line or the environment requests a log file."""
        if self.external_lib is False:
            return False
        return bool(self.external_lib or self.file_name or environ.get("ROS_LOG_DIR"))


class LogOutputs:
    """Log outputs of this process, which exist while at least one context is open."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._users = 0
        self._selected: tuple[bool, tuple[Path, str] | None] = (True, None)
        self._file: LogFile | None = None

    def open(self, settings: LogSettings, program: str, environ: Mapping[str, str]) -> None:
        """Open the log outputs for a context, and set the levels of its command line.

        Raises:
            LogFileError: the log file cannot be created.
        """
        location = None
        if settings.wants_file(environ):
            location = get_logging_directory(environ), settings.file_name or program_prefix(program)
        with self._lock:
            if self._users == 0:
                self._select(settings.stdout, location, environ)
            self._users += 1
        if settings.level is not None:
            set_logger_level("", settings.level)
        for name, level in settings.levels:
            set_logger_level(name, level)
        if (settings.stdout, location) not in ((True, None), self._selected):
            get_root_logger().warning(
                "log switches and log file of this context are ignored: a process has one console and one log file, "
                "which the first context has selected"
            )

    def _select(self, stdout: bool, location: tuple[Path, str] | None, environ: Mapping[str, str]) -> None:
        settings = read_console_environment(environ)
        if location is not None:
            folder, prefix = location
            name = f"{prefix}_{os.getpid()}_{time.time_ns() // 1_000_000}.log"
            self._file = LogFile(folder / name, settings.format)
            get_root_logger().addHandler(self._file)
        install_console(settings, prints=stdout)
        self._selected = stdout, location

    def close(self) -> None:
        """Undo one call of `open`; the last call closes the log file, but not the console."""
        with self._lock:
            self._users -= 1
            if self._users == 0 and self._file is not None:
                self._drop_file().close()

    def _drop_file(self) -> LogFile:
        assert self._file is not None
        file, self._file = self._file, None
        get_root_logger().removeHandler(file)
        return file

    def after_fork(self) -> None:
        """Reset the log outputs in a forked child, because the parent owns the log file and its threads may hold the
        lock.
        """
        self._lock, self._users = threading.RLock(), 0
        if self._file is not None:
            self._drop_file()


outputs = LogOutputs()
