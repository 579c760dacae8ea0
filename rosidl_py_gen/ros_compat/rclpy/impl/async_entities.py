"""Tasks of the entities of asyncio nodes. Each task takes the items that arrive, and calls the entity's callback."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import InvalidHandle

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine

    from rclpy.handles import Handle

TaskGroup: Any = getattr(asyncio, "TaskGroup", None)
"""Class `asyncio.TaskGroup`; None in Python 3.10, which lacks it, so that type checkers accept this module there."""


class Arrivals:
    """Items (messages, requests) that arrive at an endpoint, for the task of its entity."""

    def __init__(self, handle: Handle[Any], take: Callable[[], Any]) -> None:
        self._handle, self._take = handle, take
        self._event = asyncio.Event()

    async def items(self) -> AsyncIterator[Any]:
        """Yield each item that arrives, until the task is cancelled or the endpoint destroyed."""
        loop, event = asyncio.get_running_loop(), self._event

        def notify() -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(event.set)

        self._handle.on_arrival = notify
        while True:
            event.clear()  # before the check, because another thread reports arrivals
            try:
                item = self._take()
            except InvalidHandle:  # the callback has destroyed the entity
                return
            if item is None:
                await event.wait()
            else:
                yield item
                await asyncio.sleep(0)  # else other tasks would wait while items arrive


class EntityTask:
    """Task of an entity, which runs while the entity's node runs; the entity is destroyed when the task ends.

    Args:
        run: coroutine function of the task.
        on_end: function that is called when the task ends.
        task_group: `asyncio.TaskGroup` of the node; None before the node runs.
    """

    def __init__(
        self,
        run: Callable[[], Coroutine[Any, Any, None]],
        on_end: Callable[[], None],
        task_group: Any = None,
    ) -> None:
        self._run, self._on_end = run, on_end
        self._task: asyncio.Task[None] | None = None
        if task_group is not None:
            self.start(task_group)

    def start(self, task_group: Any) -> None:
        self._task = task_group.create_task(self._run_to_end())

    def cancel(self) -> None:
        """Cancel the task; a callback that the task runs may call the method."""
        if self._task is not None:
            self._task.cancel()

    async def _run_to_end(self) -> None:
        try:
            await self._run()
        finally:
            self._task = None
            self._on_end()


async def call_for_each(
    items: AsyncIterator[Any], call: Callable[[Any], Coroutine[Any, Any, None]], *, concurrent: bool
) -> None:
    """Call a coroutine function for each item: one after the other, or if `concurrent`, in a task for each item."""
    if not concurrent:
        async for item in items:
            await call(item)
        return
    async with TaskGroup() as tasks:
        async for item in items:
            tasks.create_task(call(item))
