"""Tasks for a changing set of keys, such as the topics, services or nodes of the graph: one task for each key."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Coroutine

K = TypeVar("K")


class KeyedTasks(Generic[K]):
    """Tasks by key: ``run(key)`` runs as a task while the key is wanted.

    A task acquires the semaphore `limiter` while it sends requests to nodes.
    """

    def __init__(self, run: Callable[[K], Coroutine[Any, Any, None]], max_concurrent: int = 8) -> None:
        self._run = run
        self.limiter = asyncio.Semaphore(max_concurrent)
        self._tasks: dict[K, asyncio.Task[None]] = {}

    def update(self, wanted: Collection[K]) -> None:
        """Start a task for each new key in `wanted`, and cancel the tasks of keys that `wanted` does not contain."""
        for key in self._tasks.keys() - wanted:
            self._tasks.pop(key).cancel()
        for key in wanted:
            if key not in self._tasks:
                self._tasks[key] = asyncio.ensure_future(self._run(key))

    def forget(self, key: K) -> None:
        """Make the next `update` start a new task for a key, without cancelling the old task."""
        self._tasks.pop(key, None)

    def __contains__(self, key: K) -> bool:
        return key in self._tasks

    async def wait(self, timeout_s: float) -> None:
        """Wait until all tasks have ended, or the timeout has passed."""
        if self._tasks:
            await asyncio.wait(self._tasks.values(), timeout=timeout_s)

    async def close(self) -> None:
        """Cancel all tasks, and wait until they have ended."""
        tasks = [*self._tasks.values()]
        self.update(())
        await asyncio.gather(*tasks, return_exceptions=True)
