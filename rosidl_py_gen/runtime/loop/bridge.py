"""The one crossing from the transport to asyncio.

Decides which event loop serves a context, and how what arrived gets onto it. An `EventLoop` calls `dispatch` while it
still waits; others watch the transport's file descriptor with `add_reader`, or, where there is none or the loop cannot
watch it, the transport calls `_notified` from any thread. All end in calling sinks, batched: one wake-up for all that
is ready.

Only public functions of asyncio are used, so that any loop will do. Sinks are called one after the other; one that
raises is logged and the others still run. What calls functions of the user always runs as a callback of the loop.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import os
import threading
from collections import deque
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.base.registration import Registrations
from rosidl_py_gen.base.waiting import current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.logs.loggers import report_failure
from rosidl_py_gen.runtime.loop.event_loop import EventLoop
from rosidl_py_gen.runtime.loop.portal import Portal

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.registration import Registration
    from rosidl_py_gen.runtime.loop.driver import Driver
    from rosidl_py_gen.runtime.transport.port import Participant
    from rosidl_py_gen.runtime.transport.samples import Sink

T = TypeVar("T")

_LOOP_ENDED_S = 0.2
"""How often a thread that waits for the loop looks whether there still is one."""
_SINK = "an internal receive function"
_MISMATCH = (
    "this context already belongs to another running event loop; give the nodes of each loop a Context of their own: "
    "Node(..., context=Context())"
)
_DRIVEN = (
    "this context has a Driver, whose loop is the only one that serves it: use driver.wait, driver.run(main()) or the "
    "blocking methods, and contexts without driver for other loops"
)


class LoopMismatchError(RosidlError, RuntimeError):
    """The caller used one context from two running event loops."""


class Bridge:
    """Connects one participant with one event loop at a time."""

    def __init__(self, participant: Participant, driver: Driver | None = None) -> None:
        """`driver`: its loop is the only one."""
        self._participant = participant
        self.attached: asyncio.AbstractEventLoop | None = None
        """The newest loop, closed or not; a plain attribute, because every publish looks at it."""
        self.portal = Portal(self, driver)
        """Runs coroutines for plain code."""
        self._watched: int | None = None
        """A duplicate of the participant's descriptor, so that either of us may close first."""
        self._scheduled = False
        self._closed = False
        self._closed_reason = "this context is closed"
        self._lock = threading.RLock()
        self._rest: deque[Callable[[], None]] = deque()
        """What sinks left to do: functions of the user have to be called."""
        self._starts: Registrations[Callable[[], None]] = Registrations()

    @property
    def loop(self) -> asyncio.AbstractEventLoop | None:
        """The loop that sinks run on; None while nobody runs one."""
        loop = self.attached
        return None if loop is None or loop.is_closed() else loop

    def running_loop(self) -> asyncio.AbstractEventLoop:
        """The running loop, attached.

        Raises:
            RuntimeError: no loop runs here. LoopMismatchError: another one is attached and runs.
            ClosedError: the bridge is closed.
        """
        loop = asyncio.get_running_loop()
        if loop is not self.attached:
            self.attach(loop)
        return loop

    def adopt_running_loop(self) -> None:
        """Attach the loop this thread runs, if it runs one and no other one is in charge."""
        loop = current_loop()
        if loop is None or self._closed or loop is self.attached or self.portal.given is not None:
            return
        if not self.is_running or self.attached is self.portal.loop:
            self.attach(loop)

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Deliver on `loop` from now on; call it on the loop's thread, or while the loop does not run.

        Raises:
            LoopMismatchError: another loop is attached and still running, or has to be.
            ClosedError: the bridge is closed.
        """
        if self.attached is loop:
            return
        if self._closed:
            raise ClosedError(self._closed_reason)
        if loop is self.portal.loop:
            self._change_to(loop)
            return
        if self.portal.given is not None:
            raise LoopMismatchError(_DRIVEN)
        with self.portal.drained() as drained:
            if not drained or self.is_running:
                raise LoopMismatchError(_MISMATCH)
            self._change_to(loop)

    def _change_to(self, loop: asyncio.AbstractEventLoop) -> None:
        self.detach()
        self.attached = loop
        if not self._watch(loop):
            self._participant.set_notify(self._notified)
        for start in self._starts:
            start()

    def _watch(self, loop: asyncio.AbstractEventLoop) -> bool:
        """Let the loop wait for the participant's descriptor; False where that cannot be."""
        descriptor = self._participant.fileno()
        if descriptor is None:
            return False
        watched = os.dup(descriptor)
        try:
            if isinstance(loop, EventLoop):
                early = self._take_in if self.portal.driver is None else self._dispatch_early
                loop.watch(watched, early, self._call_back)
            else:
                loop.add_reader(watched, self.dispatch)
        except NotImplementedError:  # Windows' proactor
            os.close(watched)
            return False
        self._watched = watched
        return True

    def detach(self) -> None:
        """Stop delivering; data stays where it is until another loop comes."""
        loop, watched = self.attached, self._watched
        self.attached = self._watched = None
        self._participant.set_notify(None)
        self._scheduled = False  # what the old loop was asked to do, it may never come to
        if watched is None or loop is None:
            return

        def unwatch() -> None:
            if isinstance(loop, EventLoop):
                loop.unwatch(watched)
            else:
                loop.remove_reader(watched)
            os.close(watched)

        if loop.is_running() and loop is not current_loop():
            with contextlib.suppress(RuntimeError):  # closed in the meantime
                loop.call_soon_threadsafe(unwatch)
                return
        unwatch()

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self.portal.close()
        self.detach()

    def abandon(self, reason: str) -> None:
        """In a forked child: be closed without touching loop or transport; errors give the reason."""
        self._closed, self._closed_reason, self._watched, self.attached = True, reason, None, None

    def on_start(self, start: Callable[[], None]) -> Registration:
        """Call `start` now if a loop is attached, and whenever one will be, until the answer is closed."""
        registration = self._starts.add(start)
        if self.loop is not None:
            start()
        return registration

    def call_soon(self, function: Callable[[], None]) -> None:
        """Run `function` on the loop, from any thread; dropped when there is no loop."""
        loop = self.loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # closed in the meantime
                if current_loop() is loop:
                    loop.call_soon(function)
                else:
                    loop.call_soon_threadsafe(function)

    def call_in_loop(self, function: Callable[[], T]) -> T:
        """As `run_on_loop`, for a function that needs a running loop: where none runs, one is entered for it.

        Raises `ClosedError`, and what the function raises.
        """
        if self.portal.given is None and not self.is_running:
            if current_loop() is None:

                async def call() -> T:
                    return function()

                return self.portal.run(call())
            self.running_loop()
        return self.run_on_loop(function)

    def run_on_loop(self, function: Callable[[], T]) -> T:
        """Run `function` on the loop's thread and return what it returns; here and now when no loop runs (any more)."""
        loop, driver = self.loop, self.portal.driver
        if driver is not None and loop is driver.loop and not driver.is_closed:
            return driver.call(function)
        if loop is None or not loop.is_running() or self.in_loop_thread():
            return function()
        done: concurrent.futures.Future[T] = concurrent.futures.Future()

        def call() -> None:
            if done.set_running_or_notify_cancel():
                try:
                    done.set_result(function())
                except BaseException as error:
                    done.set_exception(error)

        try:
            loop.call_soon_threadsafe(call)
        except RuntimeError:  # closed in the meantime
            return function()
        while not concurrent.futures.wait((done,), _LOOP_ENDED_S).done:
            if not loop.is_running() and done.cancel():
                return function()
        return done.result()

    @property
    def is_running(self) -> bool:
        """Whether a loop is attached and runs, in whatever thread."""
        loop = self.attached
        return loop is not None and loop.is_running()

    def in_loop_thread(self) -> bool:
        """Whether the caller runs on the attached loop's thread, while that loop runs."""
        # Not a matter of thread numbers: a loop may be run by one thread after the other.
        loop = self.attached
        return loop is not None and current_loop() is loop

    def _notified(self) -> None:
        """Something is ready to be collected; called from any thread."""
        loop = self.attached
        if loop is None or loop.is_closed():
            return
        with self._lock:
            if self._scheduled:
                return
            self._scheduled = True
        schedule = loop.call_soon if current_loop() is loop else loop.call_soon_threadsafe
        try:
            schedule(self._run_scheduled)
        except RuntimeError:  # the loop was closed in the meantime
            self._scheduled = False

    def _run_scheduled(self) -> None:
        if self._scheduled:
            self._scheduled = False
            self.dispatch()

    def dispatch(self) -> None:
        """Call every sink that has something to do, and what is left to do then."""
        if self._take_in():
            self._call_back()

    def _dispatch_early(self) -> bool:
        """For a `Driver`, whose loop is mostly entered for one arrival and left again: `dispatch`, without another way
        round through asyncio; whether that left something for `_call_back`.
        """
        self.dispatch()
        return bool(self._rest)

    def _take_in(self) -> bool:
        """Call every sink that has something to do; whether that left something for `_call_back`."""
        sinks: list[Sink] = []
        try:
            sinks = self._participant.collect()
        except Exception:
            report_failure("taking in what arrived")
        for sink in sinks:
            try:
                rest = sink()
                if rest is not None:
                    self._rest.append(rest)
            except (Exception, asyncio.CancelledError):  # the latter would end the loop
                report_failure(_SINK)
        return bool(self._rest)

    def _call_back(self) -> None:
        for _ in range(len(self._rest)):
            try:
                self._rest.popleft()()
            except (Exception, asyncio.CancelledError):
                report_failure(_SINK)
