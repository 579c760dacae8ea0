"""Log files: folder, name and lines.

They equal those of rcl_logging_spdlog, but their name begins with the program's name instead of ``python3``, and each
line is written at once. Source: docs/internals/protocol.md 10.6.
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
    """Raised if a log file cannot be written."""


def get_logging_directory(environ: Mapping[str, str] | None = None) -> Path:
    """Return the folder for log files: ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``.

    Args:
        environ: environment variables; None: those of this process.

    Raises:
        LogFileError: the home folder is unknown.
    """
    environ = os.environ if environ is None else environ
    folder = Path(environ.get("ROS_LOG_DIR") or Path(environ.get("ROS_HOME") or "~/.ros") / "log")
    try:
        return folder.expanduser()
    except RuntimeError as error:
        raise LogFileError(f"the folder for log files, {folder}, is unknown: {error}; set ROS_LOG_DIR") from error


def log_file_name(prefix: str, process_id: int, now_ns: int) -> str:
    """Return ``<prefix>_<process>_<milliseconds since 1970>.log``."""
    return f"{prefix}_{process_id}_{now_ns // 1_000_000}.log"


def program_prefix(program: str) -> str:
    """Return the program's name without folder and ``.py``, the default prefix of a log file."""
    if program in ("", "-", "-c", "-m"):
        return "python"
    path = Path(program)
    if path.name == "__main__.py" and path.parent.name:
        path = path.parent
    return re.sub(r"[^\w.-]", "_", path.name.removesuffix(".py")) or "python"


class LogFile(logging.Handler):
    """Handler that appends records to a file, in the format of the console without colours; raises `LogFileError`."""

    def __init__(self, path: Path, format_text: str = DEFAULT_FORMAT) -> None:
        super().__init__()
        self.path = path
        self._format = format_text
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Line buffered, so that no line is lost in a crash.
            self._stream = path.open("a", buffering=1, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise LogFileError(
                f"the log file {path} cannot be written: {error.strerror or error}; "
                "set ROS_LOG_DIR to another folder, or use --ros-args --disable-external-lib-logs"
            ) from error

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        try:
            self._stream.write(format_record(record, self._format) + "\n")
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._stream.close()
        super().close()
