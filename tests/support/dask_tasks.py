"""Tasks for processes of Dask, in a module that is imported quickly there."""

from __future__ import annotations

import os
import signal
import time

import psutil

from rosidl_py_gen.tables.bag_tasks import Task, TaskResult, run_task


def pid(task: object) -> TaskResult:
    """The process, and its sockets of the internet."""
    return TaskResult(error=str(os.getpid()), warnings=tuple(map(str, psutil.Process().net_connections())))


def die(task: object) -> TaskResult:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def run_or_die(task: Task) -> TaskResult:
    return die(task) if task.name == "b" else run_task(task)


def last_a_minute(task: object) -> TaskResult:
    """Sleep, unless the task is "a"."""
    time.sleep(0 if task == "a" else 60)
    return TaskResult()


def fail(task: object) -> TaskResult:
    raise KeyError(task)
