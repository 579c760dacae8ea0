"""asyncio event loop that no thread owns: threads that wait for a condition run it by turns (Leader/Followers).

The first thread that waits becomes the leader and runs the loop; the others are followers and sleep. The leader checks
the conditions of all waits. When its own wait ends, the oldest follower becomes the next leader. While no thread waits,
no thread runs the loop, and nothing is received.

`LoopRunner` is the public interface, for programs that do not use asyncio.
States and thread rules: docs/internals/event_loop.md, "Leader and followers".
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import selectors
import sys
import threading
import weakref
from collections import deque
from contextvars import copy_context
from inspect import iscoroutine
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.loop.callbacks import require_callable, start_task
from rosidl_py_gen.runtime.loop.event_loop import end_tasks
from rosidl_py_gen.runtime.time_values import timeout_to_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from contextvars import Context

    from typing_extensions import Self, TypeVarTuple, Unpack

if sys.platform == "linux":
    from rosidl_py_gen.runtime.loop.event_loop import EventLoop as _Loop
    from rosidl_py_gen.runtime.loop.event_loop import PriorityReaderSelector as _Selector
else:
    from asyncio import SelectorEventLoop as _Loop
    from selectors import DefaultSelector as _Selector


T = TypeVar("T")

MAX_BLOCKING_S = 0.1 if sys.platform == "win32" else 1.0
"""Maximum time that a thread blocks in one call, in seconds: signal handlers run after the call. On Windows Ctrl-C
interrupts neither a lock nor a select. Elsewhere, a signal that arrives just before the call, or that the kernel
delivers to another thread, interrupts neither of them."""
_MAX_ITERATIONS_AFTER_TIMEOUT = 10
"""Maximum number of iterations after the timeout of the thread that runs the loop, if callbacks are always ready."""
_CLOSE_TIMEOUT_S = 5.0
"""Maximum time that `SharedLoop.close` waits until the thread that runs the loop has left it, in seconds."""
_FORKED = "this LoopRunner was created before the process was forked, and works only in the parent process"
_shared_loops: weakref.WeakSet[SharedLoop] = weakref.WeakSet()


class WouldDeadlockError(RosidlError, RuntimeError):
    """Raised if a thread that runs an event loop would block for an event that only this loop can handle."""


class _Outcome(Generic[T]):
    """Value or exception that one thread stores and another thread reads; `is_done` is True once it is stored."""

    __slots__ = ("error", "is_done", "value")

    def __init__(self) -> None:
        self.value: T
        self.error: BaseException | None = None
        self.is_done = False

    def result(self) -> T:
        """Return the stored value, or raise the stored exception."""
        error, self.error = self.error, None
        if error is not None:
            try:
                raise error
            finally:
                del error  # its traceback refers to this frame
        return self.value


class ThreadWait(_Outcome[T]):
    """Wait of one thread until a condition is true, in a `SharedLoop`.

    Attributes:
        end_s: loop time at which the wait times out; None: never.
        iterations_left: iterations of the loop that the thread may still make after `end_s` if it runs the loop.
        wake_event: event on which the thread sleeps while another thread runs the loop; set when it has to check the
            condition or to run the loop. None if the thread has never slept.
    """

    __slots__ = ("_condition", "_lock", "end_s", "iterations_left", "wake_event")

    def __init__(self, condition: Callable[[], T]) -> None:
        super().__init__()
        self._condition = condition
        self._lock: threading.RLock | None = None
        self.end_s: float | None = None
        self.iterations_left = _MAX_ITERATIONS_AFTER_TIMEOUT
        self.wake_event: threading.Event | None = None

    def become_follower(self) -> None:
        """Prepare for sleeping while another thread (the leader) runs the loop and checks the condition."""
        if self.wake_event is None:
            # Only the waiting thread checks a wait that does not follow, so that wait needs no lock. Reentrant, because
            # a signal handler may run inside the condition and check all waits.
            self._lock = threading.RLock()
            self.wake_event = threading.Event()

    def check(self, final: bool = False) -> bool:
        """Check the condition; return True if the wait is done, because the condition was true or has raised.

        A `final` check ends the wait with any value. A condition that was true is not called again, because it may have
        taken a message. Thread: any, one at a time.
        """
        lock = self._lock
        if lock is not None:
            lock.acquire()
        try:
            if not self.is_done:
                self.value = value = self._condition()
                if value or final:
                    self.is_done = True
        except Exception as error:  # others, such as KeyboardInterrupt, end the wait of the thread that checks
            self.error, self.is_done = error, True
        finally:
            if lock is not None:
                lock.release()
        return self.is_done

    def set_error(self, error: BaseException) -> None:
        """End the wait with an exception, unless it is done. Thread: the one that runs the loop, or that waits."""
        if not self.is_done:
            self.error, self.is_done = error, True


class LoopCall(_Outcome[T]):
    """Function that the thread that runs a `SharedLoop` calls in the loop on behalf of another thread.

    The function is called in the `contextvars` context of the thread that requested the call.
    """

    __slots__ = ("_context", "_function")

    def __init__(self, function: Callable[[], T]) -> None:
        super().__init__()
        self._function = function
        self._context = copy_context()

    def run(self) -> None:
        """Call the function and store its value or exception.

        `KeyboardInterrupt` and other exceptions that are not an `Exception` are also raised here.
        """
        try:
            self.value = self._context.run(self._function)
        except BaseException as error:
            self.error = error
            if not isinstance(error, Exception):
                raise
        finally:
            self.is_done = True


class SharedLoop:
    """Event loop, the thread that runs it (the leader), and the waiting threads that sleep (the followers).

    Attributes:
        loop: the event loop.
        waits: the waits of all threads in order of arrival, the leader's among them.
        closed_reason: text of the `ClosedError` that waiting raises; empty while the loop is open.
        is_polling_outside_loop: True while the leader polls descriptors itself, outside run_forever().
        is_selecting: True while the leader is in `select`, so that only a system call wakes it up.
    """

    def __init__(self) -> None:
        self.is_polling_outside_loop = False
        self.is_selecting = False
        self.loop = SharedEventLoop(self)
        self.waits: list[ThreadWait[Any]] = []
        self.closed_reason = ""
        self._leader: ThreadWait[Any] | None = None
        self._leader_thread = 0
        self._calls: deque[LoopCall[Any]] = deque()
        self._changed = threading.Condition()
        """Lock for `_leader` and `closed_reason`; notified when the leader leaves a closed loop."""
        self._is_checking = False
        self._is_idle = False
        """True if asyncio had no callback to run before the time `_due_s` when it last polled for events."""
        self._due_s: float | None = None
        self._stops_polling = False
        _shared_loops.add(self)

    # ------------------------------------------------------------------------------------------------------- waiting

    def wait(self, condition: Callable[[], T], timeout_s: float | None = None) -> T:
        """Run the loop, or sleep while another thread runs it, until the condition is true or the timeout is over.

        Returns:
            The condition's last value.

        Raises:
            WouldDeadlockError: the caller runs in this loop.
            ClosedError: the loop is closed, also while waiting.
            Exception: the exception of the condition.
        """
        wait = ThreadWait(condition)
        # The most frequent case, for example a message that arrived before: needs no leader and no system call.
        if wait.check():
            return wait.result()
        if timeout_s is not None:
            wait.end_s = self.loop.time() + timeout_s
        running = current_loop()
        if running is None:
            self._lead_or_follow(wait)
        elif running is not self.loop:
            # asyncio cannot enter a second loop in one thread.
            self._wait_in_helper_thread(wait)
        else:
            raise WouldDeadlockError(
                "wait() called inside the runner's own event loop (for example in a callback) would deadlock; use "
                "await instead"
            )
        return wait.result()

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the loop, and return its value or raise its exception; at once if called in the loop.

        Raises:
            ClosedError: the loop is closed, also while waiting for the call.
        """
        if current_loop() is self.loop:
            return function()
        call = LoopCall(function)
        return self._finish(call, lambda: call.is_done)

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the loop to its end, and return its value or raise its exception.

        Raises:
            WouldDeadlockError: the caller runs in this loop.
            ClosedError: the loop is closed, also while the coroutine runs.
        """
        call = LoopCall(lambda: start_task(self.loop, coroutine))
        try:
            task = self._finish(call, lambda: call.is_done and (call.error is not None or call.value.done()))
        except BaseException:
            if call.is_done and call.error is None:
                self._cancel(call.value)
            raise
        finally:
            coroutine.close()  # not started
        return task.result()

    def wake(self) -> None:
        """Make all waits check their conditions again. Thread: any, and signal handlers."""
        if self._leader is None:
            # The next leader checks all conditions before it blocks.
            return
        if threading.get_ident() == self._leader_thread:  # needs no system call
            self.check_waits()
            if not self.is_selecting:
                return
            # A signal handler may run while the leader blocks. The system call is resumed after it (PEP 475), so only
            # readable data ends it.
        with contextlib.suppress(RuntimeError):  # closed in the meantime
            self.loop.call_soon_threadsafe(_do_nothing)

    def fail_leader(self, error: BaseException) -> bool:
        """Make the wait of the thread that runs the loop raise `error`. Thread: loop.

        Returns:
            False if no thread runs the loop.
        """
        leader = self._leader
        if leader is None:
            return False
        leader.set_error(error)
        self.wake()
        return True

    def _finish(self, call: LoopCall[T], is_over: Callable[[], bool]) -> T:
        """Queue a call for the thread that runs the loop, wait until the call has ended, and return its value or raise
        its exception.
        """
        calls = self._calls
        calls.append(call)
        try:
            self.wake()
            # Without a leader this thread leads, and runs its own call before it blocks.
            self.wait(is_over)
        finally:
            with contextlib.suppress(ValueError):  # the leader took it
                calls.remove(call)
        return call.result()

    def _cancel(self, task: asyncio.Task[Any]) -> None:
        """Cancel a task of the loop because no thread waits for its result any more."""
        with contextlib.suppress(RuntimeError, RosidlError):  # closed
            self.loop.call_soon_threadsafe(task.cancel)
            self.wait(task.done, 0)

    def _wait_in_helper_thread(self, wait: ThreadWait[Any]) -> None:
        """Wait in a new thread, because the calling thread runs another asyncio loop and cannot run a second one."""
        # Thread.join() interrupted by a signal may mark a live thread as stopped, so an event tells the end.
        ended = threading.Event()

        def lead_or_follow() -> None:
            try:
                self._lead_or_follow(wait)
            except BaseException as error:
                wait.set_error(error)
            finally:
                ended.set()

        thread = threading.Thread(target=lead_or_follow, name="rosidl-py-gen loop runner", daemon=True)
        try:
            thread.start()
            # In slices, so that a signal handler runs after `MAX_BLOCKING_S` at the latest.
            while not ended.wait(MAX_BLOCKING_S):
                pass
        except BaseException as error:  # of a signal handler, perhaps while the thread starts
            wait.set_error(error)
            self.wake()
            with contextlib.suppress(RuntimeError):  # it has not started, and will find the wait done
                thread.join()
            raise
        thread.join()

    # ------------------------------------------------------------------------------------------ leader and followers

    def _lead_or_follow(self, wait: ThreadWait[Any]) -> None:
        """Run the loop, or sleep while another thread does, until the wait is done or its timeout is over."""
        try:
            # Inside of `try`: a signal handler may raise after the wait was added.
            self.waits.append(wait)
            while not wait.is_done:
                if self._try_lead(wait):
                    self._lead()
                    break
                assert wait.wake_event is not None
                left_s = MAX_BLOCKING_S if wait.end_s is None else min(wait.end_s - self.loop.time(), MAX_BLOCKING_S)
                # The leader skips a wait without `wake_event`, so a change before `_try_lead` is noticed here only.
                if wait.check() or (wait.end_s is not None and left_s <= 0):
                    break
                # Set when the leader finds the condition true, or when this thread has to lead.
                wait.wake_event.wait(left_s)
                wait.wake_event.clear()
        finally:
            self._hand_over(wait)
        if not wait.is_done:
            # The time has passed: return the last value of the condition, true or not.
            wait.check(final=True)

    def _try_lead(self, wait: ThreadWait[Any]) -> bool:
        """Make the caller the leader, which runs the loop; return False if another thread is the leader.

        In this case the wait is prepared to follow: the leader checks its condition.

        Raises:
            ClosedError: the loop is closed.
        """
        with self._changed:
            if self.closed_reason:
                raise ClosedError(self.closed_reason)
            if self._leader is None:
                self._leader, self._leader_thread = wait, threading.get_ident()
                return True
            wait.become_follower()
            return False

    def _hand_over(self, wait: ThreadWait[Any]) -> None:
        """Remove a wait; if no thread runs the loop then, wake up the oldest sleeping thread to run it.

        If the loop was closed, the last wait ends it.
        """
        with self._changed:
            if wait in self.waits:  # not interrupted before it was added
                self.waits.remove(wait)
            if self._leader is wait:
                self._leader, self._leader_thread = None, 0
            if self._leader is None:
                # Invariant: while a thread waits, there is a leader, or a follower was woken up to lead. A wait without
                # `wake_event` is not a follower yet, and its thread tries to lead next.
                if self.waits and (wake_event := self.waits[0].wake_event) is not None:
                    wake_event.set()
                if self.closed_reason:
                    self._changed.notify_all()
                    if not self.waits:  # the last thread that leaves a closed loop closes it
                        self._end()

    def _lead(self) -> None:
        """Run the loop until the wait of the calling thread (the leader) is over, or the user stops the loop."""
        loop = self.loop
        # Entering and leaving `run_forever` costs more than handling one sample. So on Linux, while asyncio has nothing
        # to do, the leader polls the descriptors itself.
        if sys.platform == "linux" and self._is_idle and not loop.has_new_callbacks and self._poll_outside_loop():
            return
        try:
            loop.run_forever()
        except BaseException:
            loop.has_new_callbacks = True  # callbacks that were due may be left
            raise

    def _poll_outside_loop(self) -> bool:
        """Wait for events as the loop would, and call its priority readers, without an iteration of asyncio.

        Returns:
            True if the leader's wait is over; False once asyncio has callbacks to run.
        """
        loop, run_priority_readers = self.loop, self.loop.run_priority_readers
        self._stops_polling, self.is_polling_outside_loop = False, True
        # Functions of `EventLoop.add_priority_reader` see the same running loop as inside `run_forever`. This function
        # is documented as one for event loops; besides it, only public parts of asyncio are used.
        asyncio._set_running_loop(loop)
        try:
            while True:
                due_s = self._due_s
                left_s = None if due_s is None else due_s - loop.time()
                if left_s is not None and left_s <= 0:  # a timer of asyncio is due
                    return False
                has_more = self.select(run_priority_readers, left_s)
                if self._stops_polling:
                    return True
                if has_more or loop.has_new_callbacks:
                    return False
        finally:
            asyncio._set_running_loop(None)
            self.is_polling_outside_loop = False

    def _stop(self) -> None:
        """Make the thread that runs the loop leave it after this iteration."""
        if self.is_polling_outside_loop:
            self._stops_polling = True
        else:
            self.loop.stop_from_shared_loop()

    def select(self, wait_for_events: Callable[[float | None], T], timeout_s: float | None) -> T:
        """Wait for events on behalf of the loop's selector, at most for `timeout_s`, which asyncio chose.

        First calls the functions that other threads have queued, and checks the conditions of all waits. Returns the
        result of `wait_for_events`, which gets the remaining timeout.

        Thread: leader, or the thread that ends the loop's tasks.
        """
        loop, leader = self.loop, self._leader
        is_idle = timeout_s is None or timeout_s > 0  # asyncio passes 0 if callbacks are ready
        if not self.is_polling_outside_loop:
            # State of asyncio for `_lead` and `_poll_outside_loop`, which itself passes the remaining time.
            self._is_idle = is_idle
            self._due_s = None if timeout_s is None else loop.time() + timeout_s
        is_last = False
        self.is_selecting = True
        try:
            if leader is not None:
                # Noted again by every callback that queued functions, conditions or priority readers schedule.
                loop.has_new_callbacks = False
                while self._calls:
                    self._calls.popleft().run()
                self.check_waits()
                left_s = None if leader.end_s is None else leader.end_s - loop.time()
                if leader.is_done or loop.has_new_callbacks:
                    # asyncio chose its timeout before the conditions and queued functions ran.
                    timeout_s = 0
                elif left_s is not None and left_s <= 0:
                    # The leader's time has passed. Readable data is still processed, in iterations with timeout 0: they
                    # end as soon as one finds no event and no new callback, or if their number is used up.
                    timeout_s, is_last = 0, is_idle
                    leader.iterations_left -= 1
                    if leader.iterations_left == 0:
                        self._stop()
                else:
                    # The leader's own time, in slices of `MAX_BLOCKING_S`, so that signal handlers run.
                    if left_s is not None and (timeout_s is None or left_s < timeout_s):
                        timeout_s = left_s
                    if timeout_s is None or timeout_s > MAX_BLOCKING_S:
                        timeout_s = MAX_BLOCKING_S
            events = wait_for_events(timeout_s)
        finally:
            self.is_selecting = False
        if is_last and not events and not loop.has_new_callbacks:
            self._stop()
        return events

    def check_waits(self) -> None:
        """Check the condition of every waiting thread: stop the loop if the leader's holds, wake up each follower whose
        condition holds.

        Thread: leader.
        """
        if self._is_checking:  # a condition calls `wake`
            return
        self._is_checking = True
        try:
            leader = self._leader
            # A copy, because other threads add and remove waits. A single wait is the leader's and is not copied.
            for wait in tuple(self.waits) if len(self.waits) > 1 else self.waits:
                if wait is not leader and wait.wake_event is None:
                    continue  # not a follower yet: its own thread checks next
                if self.closed_reason:
                    wait.set_error(ClosedError(self.closed_reason))
                if wait.check() and wait.wake_event is not None:
                    wait.wake_event.set()
            if leader is not None and leader.is_done:
                self._stop()
        finally:
            self._is_checking = False

    # ------------------------------------------------------------------------------------------------------- closing

    def close(self) -> None:
        """End all waits with `ClosedError`, cancel the loop's tasks, and close the loop.

        A call inside the loop takes effect when the loop is left.
        """
        with self._changed:
            if self.closed_reason:
                return
            self.closed_reason = "this LoopRunner is closed"
        self.wake()
        if current_loop() is self.loop:
            return
        with self._changed:
            if self._changed.wait_for(lambda: self._leader is None, _CLOSE_TIMEOUT_S):
                self._end()

    def _end(self) -> None:
        if self.loop.is_closed():
            return
        if current_loop() is None:
            end_tasks(self.loop)
        else:
            # Ending the tasks runs the loop, and this thread runs another one.
            ending = threading.Thread(
                target=end_tasks, args=(self.loop,), name="rosidl-py-gen loop runner", daemon=True
            )
            ending.start()
            ending.join()
        self.loop.close()


class SharedEventLoop(_Loop):
    """Event loop of a `SharedLoop`, which sets `has_new_callbacks` whenever a callback or timer is added."""

    if TYPE_CHECKING:
        Ts = TypeVarTuple("Ts")

    def __init__(self, shared: SharedLoop) -> None:
        self.has_new_callbacks = False
        self._shared = shared
        super().__init__(_ConditionSelector(shared))

    def is_running(self) -> bool:
        """Return True if a thread runs the loop, or polls its descriptors outside run_forever()."""
        return self._shared.is_polling_outside_loop or super().is_running()

    def stop(self) -> None:
        self.has_new_callbacks = True
        super().stop()

    def stop_from_shared_loop(self) -> None:
        """Stop the loop after this iteration on behalf of `SharedLoop`, without setting `has_new_callbacks`."""
        super().stop()

    def call_soon(
        self, callback: Callable[[Unpack[Ts]], object], *args: Unpack[Ts], context: Context | None = None
    ) -> asyncio.Handle:
        self.has_new_callbacks = True
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self, when: float, callback: Callable[[Unpack[Ts]], object], *args: Unpack[Ts], context: Context | None = None
    ) -> asyncio.TimerHandle:
        self.has_new_callbacks = True
        return super().call_at(when, callback, *args, context=context)


class _ConditionSelector(_Selector):
    """Selector that makes a `SharedLoop` check the conditions of its waits before the selector blocks."""

    def __init__(self, shared: SharedLoop) -> None:
        super().__init__()
        self._shared = shared
        self._wait_for_events = super().select
        if sys.platform == "linux":
            poll = self._poll

            # `select` calls priority readers after the poll and before it returns; there `wake` needs no system call.
            def poll_and_note(timeout: float | None = None, maxevents: int = -1) -> list[tuple[int, int]]:
                found = poll(timeout, maxevents)
                shared.is_selecting = False  # functions that are called for these events may call `wake`
                return found

            self._poll = poll_and_note

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        return self._shared.select(self._wait_for_events, timeout)


def _do_nothing() -> None:
    """Callback that only wakes up the loop."""


def _after_fork() -> None:
    """Mark all shared loops as closed in a forked child, because the parent uses their descriptors."""
    for shared in list(_shared_loops):
        shared.closed_reason = _FORKED


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


# ----------------------------------------------------------------------------------------------------- public interface


class LoopRunner:
    """asyncio event loop that no thread owns: threads that wait for a condition run it.

    For programs with a main loop of their own: a game, a graphical interface, a script that polls. Nodes of a
    ``Context(loop_runner=runner)`` receive messages and call callbacks only while a thread waits, in one of the
    waiting threads. An exception of a signal handler, such as KeyboardInterrupt, ends the wait of the main thread.

    Close the contexts first, then the runner, as ``with`` does. Thread: any.

    Example:
        >>> with LoopRunner() as runner, Context(loop_runner=runner) as context:  # doctest: +SKIP
        ...     subscription = Node("poller", context=context).create_subscription(String, "chatter")
        ...     message = runner.wait(subscription.take, timeout_s=1.0)
    """

    def __init__(self) -> None:
        self._shared_loop = SharedLoop()
        self.loop: asyncio.AbstractEventLoop = self._shared_loop.loop
        """Event loop of asyncio; it runs while a thread waits."""

    @overload
    def wait(self, until: None = None, timeout_s: float | None = None) -> None: ...
    @overload
    def wait(self, until: Callable[[], T], timeout_s: float | None = None) -> T: ...
    def wait(self, until: Callable[[], T] | None = None, timeout_s: float | None = None) -> T | None:
        """Run the loop, or wait for the thread that does, until `until()` is true or the timeout is over.

        With timeout 0 the loop does all that can be done now. If `until()` is true at first, the loop does not run.

        Args:
            until: function without arguments that must not wait. It is called at first and after each iteration, in the
                thread that runs the loop. No true value is lost, so it may be `Subscription.take`. None: wait for the
                timeout.
            timeout_s: in seconds; None: no timeout.

        Returns:
            The last value of `until`.

        Raises:
            WouldDeadlockError: called inside this runner's loop, for example in a callback.
            ClosedError: the runner is closed, also while waiting.
            TypeError, TimeRangeError: an argument is invalid.
            Exception: the exception of `until`, or of a callback of a node with ``on_error="raise"``.
        """
        require_callable(until, "until", " without arguments, or None")
        timeout_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        return self._shared_loop.wait(
            (lambda: None) if until is None else until, None if timeout_ns is None else timeout_ns / NS_PER_S
        )

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the loop, and return its value or raise its exception. The function must not wait."""
        return self._shared_loop.call(function)

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the loop to its end, and return its value or raise its exception.

        Raises:
            WouldDeadlockError: called inside this runner's loop; use ``await`` there.
            ClosedError: the runner is closed.
            TypeError: the argument is not a coroutine.
        """
        is_coroutine: bool = iscoroutine(coroutine)  # a variable, because the check would narrow the return type
        if not is_coroutine:
            raise TypeError(f"coroutine must be a coroutine, such as main(), got {coroutine!r:.100}")
        return self._shared_loop.run(coroutine)

    def wake(self) -> None:
        """Make all waits call their `until` again, after a change outside the loop. Signal handlers may call `wake`."""
        self._shared_loop.wake()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_closed(self) -> bool:
        """True after `close`, and in a forked child."""
        return self._shared_loop.closed_reason != ""

    def close(self) -> None:
        """End all waits with `ClosedError`, cancel the loop's tasks, and close the loop; may be called twice.

        A call inside the loop takes effect when the loop is left.
        """
        self._shared_loop.close()


def shared_loop_of(runner: LoopRunner) -> SharedLoop:
    """Return the loop that the waiting threads of a runner share."""
    return runner._shared_loop
