"""Tasks for processes of `tables.many.pool`, in a module that is imported quickly there."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import psutil

from rosidl_py_gen.tables.multi_bag.bag_tasks import TaskResult


def pid(task: object) -> TaskResult:
    """The process, and its sockets of the internet."""
    return TaskResult(error=str(os.getpid()), warnings=tuple(map(str, psutil.Process().net_connections())))


def die_once(task: str) -> TaskResult:
    """Kill the first process that does it."""
    if not Path(task).exists():
        Path(task).touch()
        die(task)
    return pid(task)


def die(task: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(task: object) -> None:
    raise KeyError(task)
