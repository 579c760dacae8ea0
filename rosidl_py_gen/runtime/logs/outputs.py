"""Console and log file of the process.

The first open context selects them; different settings of another context are reported. Unlike ROS, a file is only
written on request, by ``--log-file-name``, ``--enable-external-lib-logs`` or ``ROS_LOG_DIR``, and not with
``--disable-external-lib-logs``. Each context sets its log levels, for the whole process.
Source: docs/internals/protocol.md 10.4, 10.6.
"""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.logs.console import install_console, read_console_environment
from rosidl_py_gen.runtime.logs.log_file import LogFile, get_logging_directory, log_file_name, program_prefix
from rosidl_py_gen.runtime.logs.loggers import get_root_logger, set_logger_level

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class LogSettings:
    """Logging options of a command line.

    Attributes:
        level: level of the root logger; None: INFO.
        levels: (logger name, level) in order.
        file_name: prefix of the name of the log file; empty: the program's name.
        stdout, rosout: the switches ``--enable-…-logs`` and ``--disable-…-logs``; the last one counts.
        external_lib: the same switch for log files; None if absent.
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
    """Outputs of this process, which exist from the first open context to the last."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._users = 0
        self._selected: tuple[bool, tuple[Path, str] | None] = (True, None)
        self._file: LogFile | None = None

    def open(self, settings: LogSettings, program: str, environ: Mapping[str, str]) -> None:
        """Open the outputs for a context, and set its log levels; raises `LogFileError`.

        Args:
            program: name of the program, for the log file.
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
            self._file = LogFile(folder / log_file_name(prefix, os.getpid(), time.time_ns()), settings.format)
            get_root_logger().addHandler(self._file)
        install_console(settings, prints=stdout)
        self._selected = stdout, location

    def close(self) -> None:
        """Undo one `open`; the last one closes the file, but not the console."""
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
        """Reset the state in a forked child: a thread of the parent may hold the lock, and the file is the parent's."""
        self._lock, self._users = threading.RLock(), 0
        if self._file is not None:
            self._drop_file()


outputs = LogOutputs()
