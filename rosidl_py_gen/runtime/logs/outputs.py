"""Where the log records of one context's nodes go, besides ``/rosout``: the console, a log file.

Decides that the switches of a context count for its own nodes, although ROS loggers belong to the process. Records that
belong to no node are printed unless every open context said ``--disable-stdout-logs``, and go to every open log file.
Contexts that want the same file share it. Log levels belong to the process, as in ROS.
"""

from __future__ import annotations

import os
import threading
import time
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.logs.console import install_console, read_console_environment
from rosidl_py_gen.runtime.logs.file import LogFile, log_file_is_wanted, log_file_name, log_folder, program_prefix
from rosidl_py_gen.runtime.logs.loggers import get_root_logger, logger_name, set_logger_level
from rosidl_py_gen.runtime.logs.owners import LogOwners

if TYPE_CHECKING:
    import logging
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from rosidl_py_gen.runtime.node.arguments import RosArguments


class ContextLogs:
    """The log outputs of one context, from its opening to its closing."""

    def __init__(self, arguments: RosArguments, environ: Mapping[str, str]) -> None:
        """Applies log levels, too; raises `LogFileError` when a file is asked for and cannot be written."""
        self.prints = arguments.stdout_logs
        """Whether the nodes' records reach the console."""
        self._removers: dict[str, list[Callable[[], None]]] = {}
        settings = read_console_environment(environ)
        with _process.lock:
            self.file = _process.file(arguments, environ, settings.format)
            """The log file; None when nobody asked for one."""
            _process.contexts.append(self)
            _process.prints_ownerless = any(context.prints for context in _process.contexts)
        install_console(settings, _is_printed)
        if arguments.log_level is not None:
            set_logger_level("", arguments.log_level)
        for name, level in arguments.log_levels:
            set_logger_level(name, level)

    def adopt(self, fully_qualified_node_name: str) -> None:
        """The records of this node, and of its logger's children, are this context's."""
        remove = _process.owners.add(logger_name(fully_qualified_node_name), self)
        self._removers.setdefault(fully_qualified_node_name, []).append(remove)

    def release(self, fully_qualified_node_name: str) -> None:
        """Undo `adopt`; nothing when it was not called."""
        removers = self._removers.get(fully_qualified_node_name)
        if removers:
            removers.pop()()

    def close(self) -> None:
        """Close the file when no other context writes to it. May be called twice."""
        with _process.lock:
            if self not in _process.contexts:
                return
            _process.contexts.remove(self)
            if _process.contexts:  # else what was last goes on
                _process.prints_ownerless = any(context.prints for context in _process.contexts)
            file = self.file
            if file is not None and all(context.file is not file for context in _process.contexts):
                get_root_logger().removeHandler(file)
                file.close()
                _process.files = {key: open_one for key, open_one in _process.files.items() if open_one is not file}


class _Process:
    """What the contexts of this process share."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.contexts: list[ContextLogs] = []
        self.owners: LogOwners[ContextLogs] = LogOwners()
        self.files: dict[tuple[int, Path, str], LogFile] = {}
        self.prints_ownerless = True

    def file(self, arguments: RosArguments, environ: Mapping[str, str], format_text: str) -> LogFile | None:
        """The file with this folder and name, opened when it is not open yet; None when none is wanted."""
        if not log_file_is_wanted(arguments, environ):
            return None
        prefix = arguments.log_file_name or program_prefix(next(iter(arguments.program), ""))
        key = (os.getpid(), log_folder(environ), prefix)
        if key not in self.files:
            file = LogFile(key[1] / log_file_name(prefix, key[0], time.time_ns()), format_text)
            file.addFilter(lambda record: _is_written(record, file))
            self.files[key] = file
            get_root_logger().addHandler(file)
        return self.files[key]

    def after_fork(self) -> None:
        """In the child: contexts and files are the parent's; the lock may be held by a thread that is not here."""
        self.lock = threading.RLock()
        for file in self.files.values():
            get_root_logger().removeHandler(file)
        self.contexts, self.owners, self.files = [], LogOwners(), {}


_process = _Process()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_process.after_fork)


def _is_printed(record: logging.LogRecord) -> bool:
    owner = _process.owners.find(record.name)
    return _process.prints_ownerless if owner is None else owner.prints


def _is_written(record: logging.LogRecord, file: LogFile) -> bool:
    owner = _process.owners.find(record.name)
    return owner is None or owner.file is file
