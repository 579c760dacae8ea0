"""Execution of tasks by the workers of a Dask scheduler.

Dask replaces a worker that is killed, and another one repeats its task; after four deaths the task fails. Anyone who
can connect to a scheduler without TLS can run code on its workers, and in this process, which reads their results with
pickle. Therefore this module starts no scheduler.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
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

    from rosidl_py_gen.tables.multi_bag.bag_tasks import Task, TaskFunction, TaskRunner

distributed: Any = _distributed
_CONNECT_TIMEOUT_S = 10


@contextmanager
def connect(scheduler: str) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks, and yields each with its result as it finishes. Raises `BagError`."""
    try:
        client = distributed.Client(scheduler, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise BagError(f"no scheduler of Dask responds at {scheduler}: {error}") from None
    with client:
        yield partial(_run, client)


def _run(client: Any, function: TaskFunction, tasks: list[Task]) -> Iterator[tuple[Task, TaskResult]]:
    futures = {client.submit(function, task, pure=False): task for task in tasks}
    for future, result in distributed.as_completed(futures, loop=client.loop, with_results=True, raise_errors=False):
        if not isinstance(result, TaskResult):  # an exception, possibly with its type and traceback
            error = result[1] if isinstance(result, tuple) else result
            result = TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
        yield futures.pop(future), result
        future.release()
