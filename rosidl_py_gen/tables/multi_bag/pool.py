"""Processes of this machine, for `datasets`.

They are connected by socket pairs, which no other process can open: a port on the loopback interface would let every
user of the machine send tasks, that is, run code. A process runs one task at a time. One that dies is replaced, and
its task is repeated; after `_MAX_DEATHS` the task is given up, and its outcome says so.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections import deque
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, Pipe, wait
from queue import SimpleQueue
from subprocess import DEVNULL, Popen
from threading import Thread
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.tables.multi_bag.bag_tasks import TaskResult

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.tables.multi_bag.bag_tasks import Function, Run, Task

IS_POSIX = os.name == "posix"
_MAX_DEATHS = 4
"""Number of processes that a task may kill before it is given up; Dask has the same limit."""
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of the processes, unless it is set: there is one for each core already."""


@contextmanager
def running(workers: int) -> Iterator[Run]:
    """Yield a function that runs tasks in `workers` processes, and yields each with its outcome as they end.

    Raises:
        BagError: the platform is not POSIX: processes inherit no socket there.
    """
    if not IS_POSIX:
        raise BagError(f"found workers={workers} on {sys.platform}; expected workers=1: several processes need POSIX")
    idle: list[_Worker] = []
    try:
        yield lambda function, tasks: _run(function, tasks, workers, idle)
    finally:
        for worker in idle:
            worker.close()


def _run(function: Function, tasks: list[Task], workers: int, idle: list[_Worker]) -> Iterator[tuple[Task, TaskResult]]:
    due = deque((task, 0) for task in tasks)
    busy: dict[Any, tuple[_Worker, Task, int]] = {}
    try:
        while due or busy:
            while due and len(busy) < workers:
                task, deaths = due.popleft()
                worker = idle.pop() if idle else _Worker()
                busy[worker.connection] = worker, task, deaths
                worker.send(function, task)
            for connection in wait(list(busy)):
                worker, task, deaths = busy.pop(connection)
                outcome = worker.receive()
                if outcome is not None:
                    idle.append(worker)
                    yield task, outcome
                    continue
                worker.close()
                if deaths + 1 < _MAX_DEATHS:
                    due.append((task, deaths + 1))
                    continue
                code = worker.process.returncode
                how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
                yield task, TaskResult(error=f"the process of this task {how}, {_MAX_DEATHS} times in a row")
    finally:
        for worker, _, _ in busy.values():
            worker.close()


class _Worker:
    """A process that waits for tasks. It ends at once when this process closes its connection, or ends."""

    def __init__(self) -> None:
        self.connection, other = Pipe()
        code = (
            f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve({other.fileno()})"
            # The main module of the program is not imported: it may have no `if __name__ == "__main__"`.
        )
        command, environment = [sys.executable, "-c", code], {**_ONE_THREAD, **os.environ}
        with other:
            self.process = Popen(command, env=environment, pass_fds=[other.fileno()], stdin=DEVNULL, stdout=DEVNULL)

    def send(self, function: Function, task: Task) -> None:
        with suppress(OSError):  # it has died, which `receive` finds
            self.connection.send((function, task))

    def receive(self) -> TaskResult | None:
        """Return the outcome of the task; None when the process has died."""
        try:
            outcome = self.connection.recv()
        except (EOFError, OSError):
            return None
        assert isinstance(outcome, TaskResult)
        return outcome

    def close(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.wait()


def serve(descriptor: int) -> None:
    """Run the tasks that arrive on a connection; the main function of the processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the first one decides
    connection = Connection(descriptor)
    requests: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_receive, args=(connection, requests), daemon=True).start()
    while True:
        connection.send(_outcome(requests.get()))


def _receive(connection: Any, requests: SimpleQueue[bytes]) -> None:
    try:
        while True:
            requests.put(connection.recv_bytes())
    except (EOFError, OSError):
        os._exit(1)


def _outcome(request: bytes) -> TaskResult:
    try:
        function, task = pickle.loads(request)
        outcome = function(task)
        assert isinstance(outcome, TaskResult)
        return outcome
    except Exception as error:
        return TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
