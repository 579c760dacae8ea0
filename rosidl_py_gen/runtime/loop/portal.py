"""Waiting calls from plain code: who runs the event loop while several threads wait.

Decides between two cases. Somebody else's loop runs (in another thread): the coroutine goes there; should that loop
stop, the call ends with an error. None runs: a private loop does, in one of the waiting threads; when that thread has
its result while others still wait, one of them takes over, so that nobody waits longer than needed and no thread of
ours is left behind. The private loop gives way: a real one that starts waits for the calls under way, later ones go
there, and a real one that was only paused gets the context back.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import threading
import time
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.errors import ClosedError

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from rosidl_py_gen.runtime.loop.bridge import Bridge

T = TypeVar("T")

_PATIENCE_S = 5.0
"""How long a real loop waits for calls under way."""
_LOOK_S = 0.1
_PAUSE_S = 0.3
"""A loop that does not run for so long has stopped; a program may run one loop several times."""


class SyncCalls:
    """The private loop of one context."""

    def __init__(self, bridge: Bridge) -> None:
        self._bridge = bridge
        self.loop: asyncio.AbstractEventLoop | None = None
        """See `bridge.PoliteLoop`."""
        self._turn = threading.Condition()
        self._driving = False
        self._under_way = 0
        self._paused: asyncio.AbstractEventLoop | None = None
        self._claims = 0
        bridge.polite = self

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end; not to be called where an event loop runs.

        Raises:
            ClosedError: the loop that had to run it ended.
        """
        with self._turn:
            self._turn.wait_for(lambda: self._claims == 0)
            before = self._bridge.loop
            if before is not None and before is not self.loop and before.is_running():
                own = None
            else:
                own = self.loop
                if own is None or own.is_closed():
                    own = self.loop = asyncio.new_event_loop()
                if self._under_way == 0:
                    self._paused = before if before is not own else None
                self._under_way += 1
        if own is None:
            assert before is not None
            return _wait(asyncio.run_coroutine_threadsafe(coroutine, before), before)
        try:
            return self._run_here(coroutine, own)
        finally:
            with self._turn:
                self._under_way -= 1
                if self._under_way == 0:
                    self._give_back()
                self._turn.notify_all()

    def _give_back(self) -> None:
        """Attach the loop that was attached before: when it runs again, nothing there would notice that it lost us."""
        paused, self._paused = self._paused, None
        if paused is not None and not paused.is_closed():
            with contextlib.suppress(ClosedError):  # the context was closed meanwhile
                self._bridge.attach(paused)

    def give_way(self) -> bool:
        """See `bridge.PoliteLoop`."""
        with self._turn:
            self._claims += 1
            if self._turn.wait_for(lambda: self._under_way == 0, _PATIENCE_S):
                return True
            self._claims -= 1
            return False

    def go_on(self) -> None:
        """See `bridge.PoliteLoop`."""
        with self._turn:
            self._claims -= 1
            self._turn.notify_all()

    def _run_here(self, coroutine: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop) -> T:
        future = asyncio.run_coroutine_threadsafe(coroutine, loop)
        future.add_done_callback(self._tell)
        try:
            while self._take_over(future):
                self._drive(loop, future)
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
        loop = self.loop
        if loop is None or loop.is_closed() or loop.is_running() or asyncio._get_running_loop() is not None:
            return
        tasks = asyncio.all_tasks(loop)
        for task in tasks:
            task.cancel()
        if tasks:
            loop.run_until_complete(asyncio.wait(tasks))
        loop.close()


def _wait(future: concurrent.futures.Future[T], loop: asyncio.AbstractEventLoop) -> T:
    """The result of what runs on somebody else's loop."""
    ran_s = time.monotonic()
    while not future.done():
        concurrent.futures.wait((future,), timeout=_LOOK_S)
        if loop.is_running():
            ran_s = time.monotonic()
        elif time.monotonic() - ran_s > _PAUSE_S:
            future.cancel()
            break
    if not future.done() or future.cancelled():
        raise ClosedError("the event loop that had to make this call has ended")
    return future.result()
