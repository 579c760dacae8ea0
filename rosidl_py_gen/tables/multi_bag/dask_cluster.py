"""The workers of a Dask scheduler, for `datasets`.

A worker that is killed is replaced, and its task is repeated by another one; a task that kills four is given up, and
its outcome says so. Whoever can connect to a scheduler without TLS can run code on its workers, and in this process,
which reads their answers with pickle: nothing here starts a scheduler.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.tables.multi_bag.bag_tasks import TaskResult

try:
    import distributed as _distributed
except ModuleNotFoundError as missing:
    raise missing_extra_message(missing) or missing from None

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.tables.multi_bag.bag_tasks import Function, Run, Task

distributed: Any = _distributed
_CONNECT_S = 10


@contextmanager
def running(scheduler: str) -> Iterator[Run]:
    """A function that runs tasks, and yields each with its outcome as they end.

    Raises:
        BagError: no scheduler answers.
    """
    with _connected(scheduler) as client:
        yield _on(client)


def _connected(scheduler: str) -> Any:
    try:
        return distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise BagError(f"no scheduler of Dask answers at {scheduler}: {error}") from None


def _on(client: Any) -> Run:
    def run(function: Function, tasks: list[Task]) -> Iterator[tuple[Task, TaskResult]]:
        futures = {client.submit(function, task, pure=False): task for task in tasks}
        done = distributed.as_completed(futures, loop=client.loop, with_results=True, raise_errors=False)
        for future, answer in done:
            if not isinstance(answer, TaskResult):  # what was raised, with where
                error = answer[1] if isinstance(answer, tuple) else answer
                answer = TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
            yield futures.pop(future), answer
            future.release()

    return run
