"""Execution of tasks by Dask: in processes of this machine, or on the workers of a scheduler that the caller names.

Dask's scheduler "processes" uses an executor of loky, which connects the processes by pipes. A local cluster of
`distributed` would listen on a port of the loopback interface: every user of the machine could send it tasks, that is,
run code. A process runs one task at a time, whose memory is bounded by `StagedDataset`.

Anyone who can connect to a scheduler without TLS can run code on its workers, and in this process, which reads their
results with pickle. Therefore this module starts no scheduler.
"""

from __future__ import annotations

import os
import signal
import sys
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, Pipe
from threading import Thread
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.tables.multi_bag.bag_tasks import TaskResult

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.tables.multi_bag.bag_tasks import ResultFunction, Task, TaskFunction, TaskRunner

CONNECT_TIMEOUT_S = 10
"""Time after which a scheduler of Dask counts as not reachable, in seconds."""
_MAX_WINDOWS_PROCESSES = 61
"""Maximum number of processes of an executor on Windows."""
_PROCESS_ENDED = (
    "a process of Dask ended unexpectedly, for this bag or another: it may lack memory; the next run writes only what "
    "is missing, and workers=1 (--workers 1) uses this process"
)


@contextmanager
def local_processes(workers: int) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks in up to `workers` processes, and passes on each result as it arrives."""
    try:
        import dask  # noqa: F401
        import loky
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    if sys.platform == "win32":
        workers = min(workers, _MAX_WINDOWS_PROCESSES)
    # Unlike processes of multiprocessing, processes of loky do not import the main module, which may lack
    # `if __name__ == "__main__":`.
    reader, writer = Pipe(duplex=False)
    with reader, writer, loky.ProcessPoolExecutor(workers, initializer=_start_process, initargs=(reader,)) as pool:
        yield partial(_run_in_processes, pool)


def _run_in_processes(pool: Executor, function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
    import dask
    from dask.callbacks import Callback

    due = {f"task-{number}": task for number, task in enumerate(tasks)}

    def finish(key: str, result: TaskResult, *_: Any) -> None:
        on_result(due.pop(key), result)

    api: Any = dask  # without types
    calls = [api.delayed(function, pure=False)(task, dask_key_name=key) for key, task in due.items()]
    try:
        with Callback(posttask=finish):  # type: ignore[no-untyped-call]
            # By default six tasks would be one, which only one process could do.
            api.compute(*calls, scheduler="processes", pool=pool, chunksize=1, optimize_graph=False)
    except BrokenProcessPool:
        for task in due.values():
            on_result(task, TaskResult(error=_PROCESS_ENDED))


def _start_process(reader: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it at once, without a traceback
    Thread(target=_end_with_parent, args=(reader,), daemon=True).start()


def _end_with_parent(reader: Connection) -> None:
    # Executors leave their processes waiting if the process that started them is killed. Only that process has the
    # other end of the pipe, and writes nothing.
    with suppress(EOFError, OSError):
        reader.recv_bytes()
    os._exit(1)


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks on the workers of a scheduler, as `local_processes`. Raises `BagError`."""
    try:
        import distributed
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    try:
        client: Any = distributed.Client(  # type: ignore[no-untyped-call]
            scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False
        )
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise BagError(f"no scheduler of Dask responds at {scheduler}: {error}") from None
    with client:
        yield partial(_run_on_cluster, client)


def _run_on_cluster(client: Any, function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
    import distributed

    futures = {client.submit(function, task, pure=False): task for task in tasks}
    completed: Any = distributed.as_completed  # without types
    for future, result in completed(futures, loop=client.loop, with_results=True, raise_errors=False):
        if not isinstance(result, TaskResult):  # an exception, possibly with its type and traceback
            error = result[1] if isinstance(result, tuple) else result
            result = TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
        on_result(futures.pop(future), result)
        future.release()
