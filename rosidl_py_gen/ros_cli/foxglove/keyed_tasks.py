"""Tasks that show a changing set of things: topics, services, nodes, and channels of viewers."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Coroutine

K = TypeVar("K")


class KeyedTasks(Generic[K]):
    """Task for each wanted key, by `run`; it is cancelled when the key is not wanted any more.

    `limiter` is for the part of a task that sends requests to nodes.
    """

    def __init__(self, run: Callable[[K], Coroutine[Any, Any, None]], max_concurrent: int = 8) -> None:
        self._run = run
        self.limiter = asyncio.Semaphore(max_concurrent)
        self._tasks: dict[K, asyncio.Task[None]] = {}

    def update(self, wanted: Collection[K]) -> None:
        """Start the tasks of new keys, and cancel the tasks of keys that have disappeared."""
        for key in self._tasks.keys() - wanted:
            self._tasks.pop(key).cancel()
        for key in wanted:
            if key not in self._tasks:
                self._tasks[key] = asyncio.ensure_future(self._run(key))

    def forget(self, key: K) -> None:
        """Make the next `update` start the task of a key again."""
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
