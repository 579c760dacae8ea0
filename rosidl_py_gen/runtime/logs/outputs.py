"""Where log records go besides ``/rosout``: the console, a log file. One choice for the process, as in ROS.

Decides that the first open context chooses, and that another wish meanwhile is a warning; that a file is written only
when somebody asks for one, with ``--log-file-name``, ``--enable-external-lib-logs`` or ``ROS_LOG_DIR``
(``--disable-external-lib-logs`` wins). ROS writes one for every process; a script that uses this package need not leave
files behind. Log levels are set by every context, for the process. May import this room and names.

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
    """What a command line says about logging.

    Attributes:
        level: for all loggers; None leaves INFO.
        levels: (logger name, level) in order.
        file_name: what the name of a log file begins with; empty leaves the program's name.
        stdout, rosout: the switches ``--enable-…-logs`` and ``--disable-…-logs``; of several the last counts.
        external_lib: the switch for log files; None when it was not given.
    """

    level: int | None = None
    levels: tuple[tuple[str, int], ...] = ()
    file_name: str = ""
    stdout: bool = True
    rosout: bool = True
    external_lib: bool | None = None

    def wants_file(self, environ: Mapping[str, str]) -> bool:
        """Whether the command line or the environment asks for a log file."""
        if self.external_lib is False:
            return False
        return bool(self.external_lib or self.file_name or environ.get("ROS_LOG_DIR"))


class LogOutputs:
    """The outputs of this process; every context opens and closes them, the first and the last one really."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._users = 0
        self._chosen: tuple[bool, tuple[Path, str] | None] = (True, None)
        self._file: LogFile | None = None

    def open(self, settings: LogSettings, program: str, environ: Mapping[str, str]) -> None:
        """Applies log levels, too; `program` may name the log file.

        Raises `LogFileError` when a file is asked for and cannot be written.
        """
        place = None
        if settings.wants_file(environ):
            place = get_logging_directory(environ), settings.file_name or program_prefix(program)
        with self._lock:
            if self._users == 0:
                self._choose(settings.stdout, place, environ)
            self._users += 1
        if settings.level is not None:
            set_logger_level("", settings.level)
        for name, level in settings.levels:
            set_logger_level(name, level)
        if (settings.stdout, place) not in ((True, None), self._chosen):
            get_root_logger().warning(
                "a process has one console and one log file, and the first context has chosen them: the log switches "
                "and the log file of a further context have no effect"
            )

    def _choose(self, stdout: bool, place: tuple[Path, str] | None, environ: Mapping[str, str]) -> None:
        settings = read_console_environment(environ)
        if place is not None:
            folder, prefix = place
            self._file = LogFile(folder / log_file_name(prefix, os.getpid(), time.time_ns()), settings.format)
            get_root_logger().addHandler(self._file)
        install_console(settings, prints=stdout)
        self._chosen = stdout, place

    def close(self) -> None:
        """Undo one `open`; the last one closes the file. What comes afterwards is still printed, or not, as before."""
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
        """In the child: contexts and file are the parent's; the lock may be held by a thread that is not here."""
        self._lock, self._users = threading.RLock(), 0
        if self._file is not None:
            self._drop_file()


outputs = LogOutputs()
