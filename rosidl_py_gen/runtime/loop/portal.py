"""Waiting calls from plain code, which drive a loop of their own while they are under way.

Decides between two cases. Somebody else's loop runs (in another thread): the coroutine goes there; should that loop
stop, the call ends with an error. None runs: the calls drive one that is kept for the purpose (`driver.py`), where the
user gave the context none of his. A real loop that starts meanwhile waits until the calls under way have ended; later
ones wait for it and then go there. A real one that was only paused gets the context back.

Who may call what, on which thread, under which lock; there is one, `_changed`, of this context:

1. `run`: any thread in which no event loop runs. It takes the lock to choose a loop, and to count its call in and out,
   but not while the call is under way.
2. `drained`: whoever attaches another loop, until that is attached, with the lock; it is free while calls under way are
   waited for. Calls that begin meanwhile wait. `_leave` comes back to it when it gives a paused loop the context: the
   lock may be taken twice by one thread.
3. `close`: any thread. One that runs the own loop neither takes the lock nor waits: the last call ends the loop.
4. What calls do in the loop never takes the lock.
5. What a `Portal` has is changed with the lock, but `_closed`, which is set once. `Bridge` compares `loop` without it.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import threading
import time
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rosidl_py_gen.base.waiting import current_loop
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.loop.driver import Driver

if TYPE_CHECKING:
    from collections.abc import Coroutine, Iterator

T = TypeVar("T")

_PATIENCE_S = 5.0
"""How long a real loop waits for calls under way."""
_LOOK_S = 0.1
_PAUSE_S = 0.3
"""A loop that does not run for so long has stopped; a program may run one loop several times."""


class LoopOwner(Protocol):
    """What is attached to one loop after the other: a `Bridge`."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop | None:
        """The loop in charge."""

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Put `loop` in charge. Raises `ClosedError`."""


class Portal:
    """The loop that one context has for plain code: the user's `Driver`, or one of its own."""

    def __init__(self, host: LoopOwner, given: Driver | None = None) -> None:
        """`given`: the user's, which no other loop takes over from."""
        self._host = host
        self.given = given
        self._own: Driver | None = None
        """None before it is needed."""
        self._changed = threading.Condition()
        self._calls = 0
        self._attaching = 0
        self._paused: asyncio.AbstractEventLoop | None = None
        self._closed = False

    @property
    def driver(self) -> Driver | None:
        """The user's or the own one, if there is one."""
        return self._own if self.given is None else self.given

    @property
    def loop(self) -> asyncio.AbstractEventLoop | None:
        """The loop of that one."""
        driver = self.driver
        return None if driver is None else driver.loop

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end; not to be called where an event loop runs.

        Raises:
            ClosedError: the loop that had to run it ended.
        """
        if self.given is not None:
            return self.given.run(coroutine)
        with self._changed:
            self._changed.wait_for(lambda: self._attaching == 0)
            loop = self._host.loop
            served = loop is not None and loop is not self.loop and loop.is_running()
            own = None if served else self._enter(loop)
        if own is None:
            assert loop is not None
            return _wait(asyncio.run_coroutine_threadsafe(coroutine, loop), loop)
        try:
            return own.run(coroutine)
        finally:
            self._leave()

    def _enter(self, before: asyncio.AbstractEventLoop | None) -> Driver:
        if self._own is None:
            self._own = Driver()
        own = self._own
        self._calls += 1
        if self._calls == 1:
            self._paused = before if before is not own.loop else None
            with contextlib.suppress(ClosedError):  # the calls will say so
                self._host.attach(own.loop)
        return own

    def _leave(self) -> None:
        with self._changed:
            self._calls -= 1
            if self._calls == 0:
                # When the paused loop runs again, nothing there would notice that it lost the context.
                paused, self._paused = self._paused, None
                if paused is not None and not paused.is_closed():
                    with contextlib.suppress(ClosedError):
                        self._host.attach(paused)
                if self._closed:
                    self._end()
            self._changed.notify_all()

    @contextlib.contextmanager
    def drained(self) -> Iterator[bool]:
        """While a real loop is attached: no call is under way and none begins. False when calls do not end in time."""
        with self._changed:
            self._attaching += 1
            try:
                yield self._changed.wait_for(lambda: self._calls == 0, _PATIENCE_S)
            finally:
                self._attaching -= 1
                self._changed.notify_all()

    def close(self) -> None:
        """Wait for the calls under way, which end because everything they wait for is closed; then end the own loop."""
        self._closed = True
        if self._own is not None and current_loop() is self._own.loop:
            return  # the last call does it
        with self._changed:
            if self._changed.wait_for(lambda: self._calls == 0, _PATIENCE_S):
                self._end()

    def _end(self) -> None:
        own, self._own = self._own, None
        if own is not None:
            own.close()


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
