"""The one crossing from the transport to asyncio.

Decides which thread waits, and how what arrived gets onto the event loop, batched: one wake-up for all that is ready.

direct  The loop's own thread waits for data, inside `select`, while it has nothing else to do. Used when the loop has a
        selector to wrap (the default on Linux and macOS) and this is the only context on it.
thread  One thread per context waits, and calls the loop. Used on all other loops (uvloop, Windows' proactor).
none    Nobody waits: the writer notifies the loop. For transports that need no waiting (memory).

Direct mode exists for latency: a round trip of two processes took 1.1-1.25 times that of a bare WaitSet loop, thread
mode 1.8-2.2 times, because each message wakes two threads and moves the GIL. Its price is one helper thread that waits
for the loop's file descriptors while the loop waits for DDS; nothing runs there but a poll.

The mode follows from the loop; environment or users do not choose. Sinks are called one after the other; one that
raises is logged and the others still run.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import threading
from typing import TYPE_CHECKING, Protocol

from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.loop.wakeup import DirectSelector, WaitingThread

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.interface import Participant

_log = logging.getLogger(__name__)

_numbers = itertools.count()
_MISMATCH = (
    "this context already belongs to another running event loop; give the nodes of each loop a Context of their own: "
    "Node(..., context=Context())"
)


class LoopMismatchError(RosidlError, RuntimeError):
    """The caller used one context from two running event loops."""


class PoliteLoop(Protocol):
    """A loop that ends for others; see `portal.py`."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop | None:
        """None before it is needed."""

    def give_way(self) -> bool:
        """Begin nothing new until `go_on`, and return when what is under way has ended; False when it does not."""

    def go_on(self) -> None:
        """The other loop is attached, or was not."""


class Bridge:
    """Connects one participant with one event loop at a time."""

    def __init__(self, participant: Participant) -> None:
        self._participant = participant
        self.attached: asyncio.AbstractEventLoop | None = None
        """The newest loop, closed or not; a plain attribute, because every publish looks at it."""
        self._pump: DirectSelector | WaitingThread | None = None
        self._scheduled = False
        self._closed = False
        self._closed_reason = "this context is closed"
        self.polite: PoliteLoop | None = None
        """The loop of plain code, which gives way to every other one."""
        self._lock = threading.RLock()
        self._starts: dict[int, Callable[[], None]] = {}
        participant.set_notify(self._notified)

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
        loop = asyncio._get_running_loop()
        if loop is None or self._closed or loop is self.attached:
            return
        if not self.is_running or (self.polite is not None and self.attached is self.polite.loop):
            self.attach(loop)

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Deliver on `loop` from now on; call it on the loop's thread.

        Raises:
            LoopMismatchError: another loop is attached and still running.
            ClosedError: the bridge is closed; a closed participant would wake the loop for ever.
        """
        if self.attached is loop:
            return
        if self._closed:
            raise ClosedError(self._closed_reason)
        polite = self.polite if self.polite is not None and loop is not self.polite.loop else None
        if polite is not None and not polite.give_way():
            raise LoopMismatchError(_MISMATCH)
        try:
            if self.is_running:
                raise LoopMismatchError(_MISMATCH)
            self._change_to(loop)
        finally:
            if polite is not None:
                polite.go_on()

    def _change_to(self, loop: asyncio.AbstractEventLoop) -> None:
        self.detach()
        self.attached = loop
        if self._participant.must_wait:
            wrapped = DirectSelector.wrap(loop, self._participant, self.dispatch)
            self._pump = wrapped or WaitingThread(self._participant, self._notified)
        for start in list(self._starts.values()):
            start()
        self._notified()

    def detach(self) -> None:
        """Stop delivering; data stays where it is until another loop comes."""
        pump, self._pump, self.attached = self._pump, None, None
        self._scheduled = False  # what the old loop was asked to do, it may never come to
        if pump is not None:
            pump.close()

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self._participant.set_notify(None)
        self.detach()

    def abandon(self, reason: str) -> None:
        """In a forked child: be closed without touching loop or transport; errors give the reason."""
        self._closed, self._closed_reason, self._pump, self.attached = True, reason, None, None

    def on_start(self, start: Callable[[], None]) -> Callable[[], None]:
        """Call `start` now if a loop is attached, and whenever one will be; returns the function that ends this."""
        key = next(_numbers)
        self._starts[key] = start
        if self.loop is not None:
            start()
        starts = self._starts
        return lambda: (starts.pop(key, None), None)[1]

    def call_soon(self, function: Callable[[], None]) -> None:
        """Run `function` on the loop, from any thread; dropped when there is no loop."""
        loop = self.loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # closed in the meantime
                if asyncio._get_running_loop() is loop:
                    loop.call_soon(function)
                else:
                    loop.call_soon_threadsafe(function)

    @property
    def is_running(self) -> bool:
        """Whether a loop is attached and runs, in whatever thread."""
        loop = self.attached
        return loop is not None and loop.is_running()

    def in_loop_thread(self) -> bool:
        """Whether the caller runs on the attached loop's thread, while that loop runs."""
        # Not a matter of thread numbers: a loop may be run by one thread after the other.
        loop = self.attached
        return loop is not None and asyncio._get_running_loop() is loop

    def _notified(self) -> None:
        """Something is ready to be collected; called from any thread."""
        loop = self.attached
        if loop is None or loop.is_closed():
            return
        here = asyncio._get_running_loop() is loop
        if not here and isinstance(self._pump, DirectSelector):
            self._participant.wake()  # every wait is followed by a dispatch
            return
        with self._lock:
            if self._scheduled:
                return
            self._scheduled = True
        try:
            if here:
                loop.call_soon(self._run_scheduled)
            else:
                loop.call_soon_threadsafe(self._run_scheduled)
        except RuntimeError:  # the loop was closed in the meantime
            self._scheduled = False

    def _run_scheduled(self) -> None:
        if self._scheduled:
            self._scheduled = False
            self.dispatch()

    def dispatch(self) -> None:
        """Call every sink that has something to do."""
        for sink in self._participant.collect():
            try:
                sink()
            except (Exception, asyncio.CancelledError):  # the latter would end the loop that waits in here
                _log.exception("an internal receive function failed; other endpoints are not affected")
