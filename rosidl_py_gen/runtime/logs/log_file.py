"""Log files: folder, name and lines.

They are those of rcl_logging_spdlog, except that the name begins with the program's name where ROS says ``python3``,
and that lines are written at once. Whether there is a file is decided by `logs/outputs.py`. May import this room only.

Source: docs/internals/protocol.md 10.6.
"""

from __future__ import annotations

import logging
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.console import DEFAULT_FORMAT, format_record

if TYPE_CHECKING:
    from collections.abc import Mapping


class LogFileError(RosidlError, OSError):
    """A log file was asked for and cannot be written; the text says where and why."""


def get_logging_directory(environ: Mapping[str, str] | None = None) -> Path:
    """The folder for log files, which may not exist yet; a leading ``~`` is the home folder.

    ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``.

    Args:
        environ: None means the environment of this process.

    Raises:
        LogFileError: nobody knows where the home folder is.
    """
    environ = os.environ if environ is None else environ
    chosen = environ.get("ROS_LOG_DIR")
    folder = Path(chosen) if chosen else Path(environ.get("ROS_HOME") or "~/.ros") / "log"
    try:
        return folder.expanduser()
    except RuntimeError as error:
        raise LogFileError(f"the folder for log files, {folder}, is unknown: {error}; set ROS_LOG_DIR") from error


def log_file_name(prefix: str, process_id: int, now_ns: int) -> str:
    """``<prefix>_<process>_<milliseconds since 1970>.log``."""
    return f"{prefix}_{process_id}_{now_ns // 1_000_000}.log"


def program_prefix(program: str) -> str:
    """What a log file is called after when nobody says: the program's name without folder and ``.py``."""
    if program in ("", "-", "-c", "-m"):
        return "python"
    path = Path(program)
    if path.name == "__main__.py" and path.parent.name:
        path = path.parent
    return re.sub(r"[^\w.-]", "_", path.name.removesuffix(".py")) or "python"


class LogFile(logging.Handler):
    """Appends records to a file, line by line, in the format of the console and without colour."""

    def __init__(self, path: Path, format_text: str = DEFAULT_FORMAT) -> None:
        """Creates folder and file; raises `LogFileError`."""
        super().__init__()
        self.path = path
        self._format = format_text
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Line buffered, so that a crash loses nothing.
            self._stream = path.open("a", buffering=1, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise LogFileError(
                f"the log file {path} cannot be written: {error.strerror or error}; "
                "set ROS_LOG_DIR to another folder, or use --ros-args --disable-external-lib-logs"
            ) from error

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record; a full disk is reported as `logging` reports failures of handlers."""
        try:
            self._stream.write(format_record(record, self._format) + "\n")
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        """May be called twice."""
        self._stream.close()
        super().close()
