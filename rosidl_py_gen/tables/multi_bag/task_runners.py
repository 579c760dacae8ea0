"""Execution of tasks by Dask: in processes of this machine, or on the workers of a scheduler that the caller names.

Dask's scheduler "processes" uses an executor of loky, which connects the processes by pipes. A local cluster of
`distributed` would listen on a port of the loopback interface: every user of the machine could send it tasks, that is,
run code. A process runs one task at a time, whose memory is bounded by `StagedDataset`.

Anyone who can connect to a scheduler without TLS can run code on its workers, and in this process, which reads their
results with pickle. Therefore this module starts no scheduler.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
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
"""Time in seconds after which a Dask scheduler that does not respond is reported as not reachable."""
_MAX_WINDOWS_PROCESSES = 61
"""Maximum number of processes of a process pool on Windows."""
_PROCESS_ENDED = (
    "the process that read this bag ended unexpectedly, twice; it may lack memory, or a library crashed; the next run "
    "tries again"
)


@contextmanager
def local_processes(workers: int) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks in up to `workers` processes, and passes each result to its callback.

    Raises:
        BagError: this process must not start processes.
        ExtraMissingError: Dask or loky is not installed.
    """
    try:
        import dask  # noqa: F401
        import loky  # noqa: F401
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    if multiprocessing.current_process().daemon:
        raise BagError(
            f"workers={workers}: this is a daemonic process, such as a worker of multiprocessing.Pool or of Dask, and "
            "must not start processes; use workers=1"
        )
    if sys.platform == "win32":
        workers = min(workers, _MAX_WINDOWS_PROCESSES)
    processes = _LocalProcesses(workers)
    try:
        yield processes.run
    finally:
        processes.close()


class _LocalProcesses:
    """Pool of worker processes on this machine; if one process ends unexpectedly, all are replaced."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: Any = None  # without types
        self._reader, self._writer = Pipe(duplex=False)

    def run(self, function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
        """Run tasks in the processes, and call `on_result` with each result.

        A task fails if its process ends unexpectedly while no other task runs.
        """
        due = {f"task-{number}": task for number, task in enumerate(tasks)}
        while due:
            count = len(due)
            suspects = self._compute(function, due, due.copy(), on_result)
            if len(due) == count:  # the processes do not start, or end before they have done anything
                suspects = due.copy()
            for key, task in suspects.items():  # each alone, to find the task that ends its process
                if self._compute(function, due, {key: task}, on_result):
                    on_result(due.pop(key), TaskResult(error=_PROCESS_ENDED))

    def _compute(
        self, function: TaskFunction, due: dict[str, Task], tasks: dict[str, Task], on_result: ResultFunction
    ) -> dict[str, Task]:
        """Run `tasks`, and remove completed tasks from `due`.

        Returns the tasks that were running when a process crashed.
        """
        import dask
        import loky

        started: list[str] = []

        def start(key: str, *_: Any) -> None:
            started.append(key)

        def finish(key: str, result: TaskResult, *_: Any) -> None:
            on_result(due.pop(key), result)

        # Unlike processes of multiprocessing, processes of loky do not import the main module, which may lack
        # `if __name__ == "__main__":`.
        if self._pool is None:
            self._pool = loky.ProcessPoolExecutor(self._workers, initializer=_start_process, initargs=(self._reader,))
        api: Any = dask  # without types
        run = api.delayed(_run_without_exception, pure=False)
        try:
            api.compute(
                *[run(function, task, dask_key_name=key) for key, task in tasks.items()],
                scheduler="processes",
                pool=self._pool,
                chunksize=1,  # by default six tasks would be one, which only one process could do
                optimize_graph=False,
                # Callbacks of Dask's `Callback` would be called for the tasks of all threads of this process.
                callbacks=[(None, None, start, finish, None)],
            )
        except BrokenProcessPool:
            self._end_pool()
            return {key: tasks[key] for key in started if key in due}
        return {}

    def _end_pool(self) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(kill_workers=True)  # after an interrupt, tasks may still run

    def close(self) -> None:
        """End the worker processes."""
        self._end_pool()
        self._reader.close()
        self._writer.close()


def _run_without_exception(function: TaskFunction, task: Task) -> TaskResult:
    try:
        return function(task)
    except Exception as error:
        return TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")


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
    """Yield a function that runs tasks on a Dask scheduler's workers, and passes each result to its callback.

    Raises:
        BagError: the scheduler does not respond.
        ExtraMissingError: Dask's package ``distributed`` is not installed.
    """
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
