"""Waiting calls from plain code: who runs the event loop while several threads wait.

Decides between two cases. Somebody else's loop runs (in another thread): the coroutine goes there. None runs: a private
loop does, in one of the waiting threads; when that thread has its result while others still wait, one of them takes
over, so that nobody waits longer than needed and no thread of ours is left behind.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from rosidl_py_gen.runtime.bridge import Bridge

T = TypeVar("T")


class SyncCalls:
    """The private loop of one context."""

    def __init__(self, bridge: Bridge) -> None:
        self._bridge = bridge
        self._loop: asyncio.AbstractEventLoop | None = None
        self._turn = threading.Condition()
        self._driving = False

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end; not to be called where an event loop runs."""
        loop = self._bridge.loop
        if loop is not None and loop is not self._loop and loop.is_running():
            return asyncio.run_coroutine_threadsafe(coroutine, loop).result()
        with self._turn:
            if self._loop is None or self._loop.is_closed():
                self._loop = asyncio.new_event_loop()
            own = self._loop
            future = asyncio.run_coroutine_threadsafe(coroutine, own)
        future.add_done_callback(self._tell)
        try:
            while self._take_over(future):
                self._drive(own, future)
        except BaseException:
            future.cancel()
            raise
        return future.result()

    def _take_over(self, future: concurrent.futures.Future[T]) -> bool:
        """Wait until the result is in (False), or until nobody runs the loop and we have to (True)."""
        with self._turn:
            self._turn.wait_for(lambda: future.done() or not self._driving)
            if future.done():
                return False
            self._driving = True
            return True

    def _drive(self, loop: asyncio.AbstractEventLoop, future: concurrent.futures.Future[T]) -> None:
        async def until_done() -> None:
            self._bridge.running_loop()
            done = asyncio.Event()
            future.add_done_callback(lambda _: loop.call_soon_threadsafe(done.set))
            await done.wait()

        try:
            loop.run_until_complete(until_done())
        finally:
            with self._turn:
                self._driving = False
                self._turn.notify_all()

    def _tell(self, _: concurrent.futures.Future[Any]) -> None:
        with self._turn:
            self._turn.notify_all()

    def close(self) -> None:
        """End what still runs on the loop and close it, unless a thread is in it."""
        loop = self._loop
        if loop is None or loop.is_closed() or loop.is_running() or asyncio._get_running_loop() is not None:
            return
        tasks = asyncio.all_tasks(loop)
        for task in tasks:
            task.cancel()
        if tasks:
            loop.run_until_complete(asyncio.wait(tasks))
        loop.close()
