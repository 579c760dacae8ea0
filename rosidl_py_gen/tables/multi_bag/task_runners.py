"""Execution of tasks by processes of this machine, or by the workers of a Dask scheduler.

Socket pairs connect them, which no other process can open: a port on the loopback interface would let every user of the
machine send tasks, that is, run code. A process runs one task at a time. A process that dies is replaced, and its task
is repeated; after `MAX_DEATHS` deaths the task fails.

Anyone who can connect to a scheduler without TLS can run code on its workers, and in this process, which reads their
results with pickle. Therefore this module starts no scheduler.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections import deque
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, Pipe, wait
from queue import SimpleQueue
from subprocess import DEVNULL, Popen
from threading import Thread
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.python_processes import python_command
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.tables.multi_bag.bag_tasks import TaskResult

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.tables.multi_bag.bag_tasks import Task, TaskFunction, TaskRunner

IS_POSIX = os.name == "posix"
MAX_DEATHS = 4
"""Number of processes that a task may kill before it is given up; Dask has the same limit."""
CONNECT_TIMEOUT_S = 10
"""Time after which a scheduler of Dask counts as not reachable, in seconds."""
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of the processes, unless it is set: one thread each, as there is a process for each core."""


@contextmanager
def process_pool(workers: int) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks in `workers` processes, and yields each with its result as it finishes."""
    if not IS_POSIX:
        raise BagError(f"found workers={workers} on {sys.platform}; expected workers=1: several processes need POSIX")
    idle: list[WorkerProcess] = []
    try:
        yield lambda function, tasks: _run(function, tasks, workers, idle)
    finally:
        for worker in idle:
            worker.close()


def _run(
    function: TaskFunction, tasks: list[Task], workers: int, idle: list[WorkerProcess]
) -> Iterator[tuple[Task, TaskResult]]:
    due = deque((task, 0) for task in tasks)
    busy: dict[Any, tuple[WorkerProcess, Task, int]] = {}
    try:
        while due or busy:
            while due and len(busy) < workers:
                task, deaths = due.popleft()
                worker = idle.pop() if idle else WorkerProcess()
                busy[worker.connection] = worker, task, deaths
                worker.send(function, task)
            for connection in wait(list(busy)):
                worker, task, deaths = busy.pop(connection)
                result = worker.receive()
                if result is not None:
                    idle.append(worker)
                    yield task, result
                    continue
                worker.close()
                if deaths + 1 < MAX_DEATHS:
                    due.append((task, deaths + 1))
                    continue
                code = worker.process.returncode
                how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
                yield task, TaskResult(error=f"the process of this task {how}, {MAX_DEATHS} times in a row")
    finally:
        for worker, _, _ in busy.values():
            worker.close()


class WorkerProcess:
    """Process that waits for tasks. It ends at once when this process closes its connection, or ends."""

    def __init__(self) -> None:
        self.connection, other = Pipe()
        # Unlike multiprocessing, this does not import the main module, which may have no `if __name__ == "__main__"`.
        command = python_command(f"from {__name__} import serve; serve({other.fileno()})")
        environment = {**_ONE_THREAD, **os.environ}
        with other:
            self.process = Popen(command, env=environment, pass_fds=[other.fileno()], stdin=DEVNULL, stdout=DEVNULL)

    def send(self, function: TaskFunction, task: Task) -> None:
        with suppress(OSError):  # the process has died, which `receive` detects
            self.connection.send((function, task))

    def receive(self) -> TaskResult | None:
        """Return the result of the task; None if the process has died."""
        try:
            result = self.connection.recv()
        except (EOFError, OSError):
            return None
        assert isinstance(result, TaskResult)
        return result

    def close(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.wait()


def serve(descriptor: int) -> None:
    """Run the tasks that arrive on a connection; the main function of the processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the parent handles it
    connection = Connection(descriptor)
    requests: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_receive, args=(connection, requests), daemon=True).start()
    while True:
        connection.send(_result(requests.get()))


def _receive(connection: Any, requests: SimpleQueue[bytes]) -> None:
    try:
        while True:
            requests.put(connection.recv_bytes())
    except (EOFError, OSError):
        os._exit(1)


def _result(request: bytes) -> TaskResult:
    try:
        function, task = pickle.loads(request)
        result = function(task)
        assert isinstance(result, TaskResult)
        return result
    except Exception as error:
        return TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")


# ----------------------------------------------------------------------------------------------------------------- Dask


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks on the workers of a scheduler, as `process_pool`. Raises `BagError`."""
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
        yield partial(_run_by_dask, client)


def _run_by_dask(client: Any, function: TaskFunction, tasks: list[Task]) -> Iterator[tuple[Task, TaskResult]]:
    import distributed

    futures = {client.submit(function, task, pure=False): task for task in tasks}
    completed: Any = distributed.as_completed  # without types
    for future, result in completed(futures, loop=client.loop, with_results=True, raise_errors=False):
        if not isinstance(result, TaskResult):  # an exception, possibly with its type and traceback
            error = result[1] if isinstance(result, tuple) else result
            result = TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
        yield futures.pop(future), result
        future.release()
