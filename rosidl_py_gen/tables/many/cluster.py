"""Dask, for `datasets`: nobody else imports it.

Tasks go to the workers of a scheduler, or to processes of this machine. A worker that is killed is replaced, and what
it was about is done by another; a task that kills four is given up, and its answer says so.
"""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.resources import extra_missing
from rosidl_py_gen.tables.many.tasks import Outcome

try:
    import distributed as _distributed
except ModuleNotFoundError as missing:
    raise extra_missing(missing) or missing from None

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.tables.many.tasks import Function, Run, Task

distributed: Any = _distributed
_CONNECT_S = 10


@contextmanager
def running(scheduler: str | None, workers: int | None) -> Iterator[Run]:
    """What runs tasks and gives each with its answer, in the order in which they end.

    Raises:
        BagError: no scheduler answers.
    """
    if scheduler is not None:
        with _connected(scheduler) as client:
            yield _on(client)
        return
    local = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.ERROR,
    )
    with local, distributed.Client(local) as client:
        yield _on(client)


def _connected(scheduler: str) -> Any:
    try:
        return distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise BagError(f"no scheduler of Dask answers at {scheduler}: {error}") from None


def _on(client: Any) -> Run:
    def run(function: Function, tasks: list[Task]) -> Iterator[tuple[Task, Outcome]]:
        futures = {client.submit(function, task, pure=False): task for task in tasks}
        done = distributed.as_completed(futures, loop=client.loop, with_results=True, raise_errors=False)
        for future, answer in done:
            if not isinstance(answer, Outcome):  # what was raised, with where
                error = answer[1] if isinstance(answer, tuple) else answer
                answer = Outcome(error=f"the worker failed: {type(error).__name__}: {error}")
            yield futures.pop(future), answer
            future.release()

    return run
