"""Tasks for processes of `tables.many.pool`, in a module that is imported quickly there."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import psutil

from rosidl_py_gen.tables.many.tasks import Outcome


def pid(task: object) -> Outcome:
    """The process, and its sockets of the internet."""
    return Outcome(error=str(os.getpid()), warnings=tuple(map(str, psutil.Process().net_connections())))


def die_once(task: str) -> Outcome:
    """Kill the first process that does it."""
    if not Path(task).exists():
        Path(task).touch()
        die(task)
    return pid(task)


def die(task: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(task: object) -> None:
    raise KeyError(task)
