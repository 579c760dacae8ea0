"""Connection of a context to the event loop that serves it, which delivers samples from the transport on that loop.

A context is bound to one loop at a time. This is the user's loop on which the context is used, or the loop of a
`LoopRunner`. While blocking calls are in progress and no loop of the user runs, it is a `SharedLoop` of the context.
States, transitions and thread rules: docs/internals/event_loop.md.

Functions that take received samples (sinks) run on the thread of the bound loop only. One wake-up serves all samples
that are ready.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.callbacks import RegistrationSet
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.logs import report_failure
from rosidl_py_gen.runtime.loop.event_loop import EventLoop
from rosidl_py_gen.runtime.loop.shared_loop import SharedLoop, shared_loop_of

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.base.callbacks import Registration
    from rosidl_py_gen.runtime.loop.shared_loop import LoopRunner
    from rosidl_py_gen.runtime.transport.api import Participant, Sink

T = TypeVar("T")

_DRAIN_TIMEOUT_S = 5.0
"""Maximum time in seconds that `attach` and `close` wait for the end of blocking calls in progress."""
_CHECK_INTERVAL_S = 0.1
"""Interval in which a thread that waits for the user's loop checks whether the loop still runs, in seconds."""
_PAUSED_AFTER_S = 0.3
"""Time without running after which the user's loop counts as stopped, in seconds. Shorter breaks are normal: a program
may run a loop repeatedly."""
_SINK = "an internal receive function"
_MISMATCH = (
    "this context already belongs to another running event loop; create a Context for the nodes of each loop: "
    "Node(..., context=Context())"
)
_HAS_RUNNER = (
    "this context has a LoopRunner, whose loop is the only one that serves it; use its wait() or run(main()), the "
    "blocking methods, or for other loops a context without loop_runner"
)


class WrongEventLoopError(RosidlError, RuntimeError):
    """Raised if one context is used from two running event loops."""


class LoopBinding:
    """Connection of one participant to the event loop on which its sinks run, the functions that take received samples.

    Attributes:
        bound_loop: the loop that was bound last, closed or not; a plain attribute, because every publish reads it.
        has_user_runner: True if the user passed a `LoopRunner`, whose loop is the only one that may be bound.
        shared: loop that blocking calls run: the loop of the user's `LoopRunner`, or the context's own, which is None
            before the first blocking call.
    """

    def __init__(self, participant: Participant, loop_runner: LoopRunner | None = None) -> None:
        self._participant = participant
        self.bound_loop: asyncio.AbstractEventLoop | None = None
        self.has_user_runner = loop_runner is not None
        self.shared: SharedLoop | None = None if loop_runner is None else shared_loop_of(loop_runner)
        self._changed = threading.Condition()
        """Lock of `shared`, `_blocking_calls`, `_loops_to_bind` and `_paused_loop`; notified when a number falls."""
        self._blocking_calls = 0
        self._loops_to_bind = 0
        self._paused_loop: asyncio.AbstractEventLoop | None = None
        """Loop of the user that is bound again after the last blocking call in progress; None if there was none."""
        self._closed_reason = ""
        self._watched: int | None = None
        """Duplicate of the participant's file descriptor for the bound loop to watch, because loop and participant may
        close in any order."""
        self._is_scheduled = False
        self._deferred_calls: deque[Callable[[], None]] = deque()
        """Functions that sinks have returned and that wait to be called; they may run code of the user."""
        self._on_bind_hooks: RegistrationSet[Callable[[], None]] = RegistrationSet()

    # ----------------------------------------------------------------------------------------------------- the state

    @property
    def loop(self) -> asyncio.AbstractEventLoop | None:
        """Event loop on which received samples are handled.

        The value is None if no loop was bound, or if the bound loop is closed.
        """
        loop = self.bound_loop
        return None if loop is None or loop.is_closed() else loop

    @property
    def is_running(self) -> bool:
        """True if an event loop is bound and runs, in any thread."""
        loop = self.bound_loop
        return loop is not None and loop.is_running()

    def in_loop_thread(self) -> bool:
        """Return True if the caller runs in the thread that runs the bound event loop at this moment."""
        # Not a comparison of thread numbers: one loop may be run by one thread after the other.
        loop = self.bound_loop
        return loop is not None and current_loop() is loop

    def is_shared(self, loop: asyncio.AbstractEventLoop) -> bool:
        """Return True if `loop` is the loop of the user's `LoopRunner`, or the loop that blocking calls run."""
        shared = self.shared
        return shared is not None and loop is shared.loop

    # ------------------------------------------------------------------------------------------- loops of the user

    def running_loop(self) -> asyncio.AbstractEventLoop:
        """Return the event loop that runs in this thread, after binding it if it is not bound.

        Raises:
            RuntimeError: no loop runs in this thread.
            WrongEventLoopError: another loop is bound and runs.
            ClosedError: the context is closed.
        """
        loop = asyncio.get_running_loop()
        if loop is not self.bound_loop:
            self.attach(loop)
        return loop

    def adopt_running_loop(self) -> None:
        """Bind the event loop that runs in this thread, unless another loop of the user is bound and runs.

        Does nothing if no loop runs in this thread, if the context is closed, or if the user passed a `LoopRunner`.
        """
        loop = current_loop()
        if loop is None or self._closed_reason or loop is self.bound_loop or self.has_user_runner:
            return
        bound = self.bound_loop
        if bound is None or not bound.is_running() or self.is_shared(bound):
            self.attach(loop)

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Bind `loop` to the context: received samples are handled on it from now on.

        Waits until the blocking calls in progress have ended; calls that start in the meantime wait for the new loop.
        Thread: the thread of the loop, or any while the loop does not run.

        Raises:
            WrongEventLoopError: another loop is bound and still runs, or only the loop of a `LoopRunner` may be bound.
            ClosedError: the context is closed.
        """
        if loop is self.bound_loop:
            return
        if self._closed_reason:
            raise ClosedError(self._closed_reason)
        if self.is_shared(loop):
            self._bind(loop)
            return
        if self.has_user_runner:
            raise WrongEventLoopError(_HAS_RUNNER)
        with self._changed:
            # `run` lets no new blocking call start while this number is not 0, so the wait ends.
            self._loops_to_bind += 1
            try:
                if not self._wait_for_blocking_calls() or self.is_running:
                    raise WrongEventLoopError(_MISMATCH)
                self._bind(loop)
            finally:
                self._loops_to_bind -= 1
                self._changed.notify_all()

    def on_bind(self, function: Callable[[], None]) -> Registration:
        """Register a function that is called whenever a loop is bound, and immediately if one is bound.

        Closing the returned registration ends the calls.
        """
        registration = self._on_bind_hooks.add(function)
        if self.loop is not None:
            function()
        return registration

    def _bind(self, loop: asyncio.AbstractEventLoop) -> None:
        self.detach()
        self.bound_loop = loop
        # Without a descriptor, or on a loop that cannot watch it, the transport calls from its own threads.
        if not self._watch(loop):
            self._participant.set_wakeup(self._on_transport_ready)
        for function in self._on_bind_hooks:
            function()

    def _watch(self, loop: asyncio.AbstractEventLoop) -> bool:
        """Register the participant's file descriptor with the loop.

        Returns False on platforms where that is not possible.
        """
        descriptor = self._participant.fileno()
        if descriptor is None:
            return False
        watched = os.dup(descriptor)
        try:
            if isinstance(loop, EventLoop):
                # Sinks run inside the select of the loop. The loop of blocking calls also runs what sinks return there:
                # it is mostly entered for one sample, and this saves an iteration of asyncio.
                early = self._dispatch_before_select if self.is_shared(loop) else self._run_sinks
                loop.add_priority_reader(watched, early, self._run_deferred)
            else:
                loop.add_reader(watched, self.dispatch)
        except NotImplementedError:  # Windows' proactor
            os.close(watched)
            return False
        self._watched = watched
        return True

    def detach(self) -> None:
        """Unbind the loop. Received samples are not handled and stay in the transport until another loop is bound."""
        loop, watched = self.bound_loop, self._watched
        self.bound_loop = self._watched = None
        self._participant.set_wakeup(None)
        self._is_scheduled = False  # the old loop may never run what was scheduled on it
        if watched is None or loop is None:
            return

        def unwatch() -> None:
            if isinstance(loop, EventLoop):
                loop.remove_priority_reader(watched)
            else:
                loop.remove_reader(watched)
            os.close(watched)

        # The selector of a loop belongs to the thread that runs it.
        if loop.is_running() and loop is not current_loop():
            with contextlib.suppress(RuntimeError):  # closed in the meantime
                loop.call_soon_threadsafe(unwatch)
                return
        unwatch()

    # ------------------------------------------------------------------------------------------------ blocking calls

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end on the context's loop. Thread: any in which no event loop runs.

        If another thread runs the user's loop, the coroutine is submitted to it. Otherwise the first call binds the
        context's own shared loop, and the last one binds the user's paused loop again, if there was one.

        Raises:
            ClosedError: the loop that had to run the coroutine has ended or was closed.
        """
        if self.has_user_runner:
            assert self.shared is not None
            return self.shared.run(coroutine)
        with self._changed:
            # A loop that waits to be bound goes first: otherwise calls that follow each other would keep it waiting.
            self._changed.wait_for(lambda: self._loops_to_bind == 0)
            loop = self.loop
            is_served = loop is not None and loop.is_running() and not self.is_shared(loop)
            shared = None if is_served else self._begin_call(loop)
        if shared is None:
            assert loop is not None
            return _run_on_user_loop(coroutine, loop)
        try:
            return shared.run(coroutine)
        finally:
            self._end_call()

    def _begin_call(self, before: asyncio.AbstractEventLoop | None) -> SharedLoop:
        """Record that a blocking call begins, and return the shared loop; the first call in progress binds this loop.

        Lock: _changed must be held.
        """
        if self.shared is None:
            self.shared = SharedLoop()
        self._blocking_calls += 1
        if self._blocking_calls == 1:
            self._paused_loop = before if before is not self.shared.loop else None
            if self.bound_loop is not self.shared.loop and not self._closed_reason:
                self._bind(self.shared.loop)
        return self.shared

    def _end_call(self) -> None:
        """Record that a blocking call has ended.

        If it was the last call in progress, the user's paused loop is bound again.
        """
        with self._changed:
            self._blocking_calls -= 1
            if self._blocking_calls == 0:
                # Rebind now, because nothing notices when the paused loop runs again.
                paused, self._paused_loop = self._paused_loop, None
                if self._closed_reason:
                    self._end_shared_loop()
                elif paused is not None and not paused.is_closed():
                    self._bind(paused)
            self._changed.notify_all()

    def _wait_for_blocking_calls(self) -> bool:
        """Wait until no blocking call is in progress; return False on timeout. Lock: _changed must be held."""
        return self._changed.wait_for(lambda: self._blocking_calls == 0, _DRAIN_TIMEOUT_S)

    def _end_shared_loop(self) -> None:
        shared, self.shared = self.shared, None
        if shared is not None:
            shared.close()

    # -------------------------------------------------------------------------------------- functions for the loop

    def call_soon(self, function: Callable[[], None]) -> None:
        """Call a function on the bound loop later; do nothing if no loop is bound. Thread: any."""
        loop = self.loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # closed in the meantime
                if current_loop() is loop:
                    loop.call_soon(function)
                else:
                    loop.call_soon_threadsafe(function)

    def call_in_loop(self, function: Callable[[], T]) -> T:
        """Call a function that needs a running loop on the loop's thread, and return its value.

        If no loop runs, the context's shared loop is run for the call.

        Raises:
            ClosedError: the context is closed.
            Exception: the exception that the function raises.
        """
        if not self.has_user_runner and not self.is_running:
            if current_loop() is None:

                async def call() -> T:
                    return function()

                return self.run(call())
            self.running_loop()
        return self.run_on_loop(function)

    def run_on_loop(self, function: Callable[[], T]) -> T:
        """Call a function on the bound loop's thread and return its value; in this thread if no loop runs."""
        loop, shared = self.loop, self.shared
        if shared is not None and loop is shared.loop and not shared.closed_reason:
            return shared.call(function)
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
        if not _wait_while_running(done, loop) and done.cancel():
            return function()
        return done.result()

    # ------------------------------------------------------------------------------------------------------- samples

    def _on_transport_ready(self) -> None:
        """Schedule `dispatch` on the bound loop; the transport calls this method when received samples are ready.

        Thread: any.
        """
        loop = self.bound_loop
        if loop is None or loop.is_closed() or self._is_scheduled:
            return
        # Unlocked: if two threads schedule at once, the second call of `_run_scheduled` does nothing.
        self._is_scheduled = True
        schedule = loop.call_soon if current_loop() is loop else loop.call_soon_threadsafe
        try:
            schedule(self._run_scheduled)
        except RuntimeError:  # the loop was closed in the meantime
            self._is_scheduled = False

    def _run_scheduled(self) -> None:
        if self._is_scheduled:
            self._is_scheduled = False
            self.dispatch()

    def dispatch(self) -> None:
        """Call all sinks of the participant for which samples are ready, then the functions that the sinks returned."""
        if self._run_sinks():
            self._run_deferred()

    def _dispatch_before_select(self) -> bool:
        """Call `dispatch` while a shared loop polls its descriptors.

        Returns True if functions for `_run_deferred` are left.
        """
        self.dispatch()
        return bool(self._deferred_calls)

    def _run_sinks(self) -> bool:
        """Call all sinks of the participant for which samples are ready.

        Returns True if they left functions for `_run_deferred`.
        """
        sinks: list[Sink] = []
        try:
            sinks = self._participant.take_ready_sinks()
        except Exception:
            report_failure("receiving samples")
        # A sink that raises is logged, and the others still run.
        for sink in sinks:
            try:
                # A sink may run inside of select, so it calls no function of the user: it returns a function that does.
                deferred = sink()
                if deferred is not None:
                    self._deferred_calls.append(deferred)
            except (Exception, asyncio.CancelledError):  # the latter would end the loop
                report_failure(_SINK)
        return bool(self._deferred_calls)

    def _run_deferred(self) -> None:
        # Only the calls that are queued now: a call may queue others, and asyncio shall run its callbacks in between.
        for _ in range(len(self._deferred_calls)):
            try:
                self._deferred_calls.popleft()()
            except (Exception, asyncio.CancelledError):
                report_failure(_SINK)

    # ----------------------------------------------------------------------------------------------------------- end

    def close(self) -> None:
        """Unbind the loop for good, and close the context's own shared loop.

        Waits for the blocking calls in progress, which end because all they wait for is closed. A call of `close` in
        the context's own shared loop does not wait: the last blocking call closes the loop.
        """
        self._closed_reason = self._closed_reason or "this context is closed"
        shared = self.shared
        if not self.has_user_runner and (shared is None or current_loop() is not shared.loop):
            with self._changed:
                if self._wait_for_blocking_calls():
                    self._end_shared_loop()
        self.detach()

    def abandon(self, reason: str) -> None:
        """Mark the binding as closed in a forked child, without touching loop or transport; errors quote `reason`."""
        self._closed_reason, self._watched, self.bound_loop = reason, None, None


def _run_on_user_loop(coroutine: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop) -> T:
    """Run a coroutine on the user's loop, which another thread runs, and return its result.

    Raises:
        ClosedError: the loop has ended before the coroutine.
        Exception: the exception that the coroutine raises.
    """
    future = asyncio.run_coroutine_threadsafe(coroutine, loop)
    if not _wait_while_running(future, loop):
        future.cancel()
    if not future.done() or future.cancelled():
        raise ClosedError("the event loop that ran this blocking call has ended")
    return future.result()


def _wait_while_running(future: concurrent.futures.Future[Any], loop: asyncio.AbstractEventLoop) -> bool:
    """Wait for a future that another thread's `loop` completes; return False if the loop stops before that."""
    ran_s = time.monotonic()
    while not concurrent.futures.wait((future,), _CHECK_INTERVAL_S).done:
        if loop.is_running():
            ran_s = time.monotonic()
        elif time.monotonic() - ran_s > _PAUSED_AFTER_S:
            return False
    return True
