"""An event loop for programs that are no asyncio programs: whoever has to wait runs it, for as long as he waits.

Decides which thread runs the loop. The first that waits does; others wait beside, each with its own condition and time
limit, and one of them goes on with the loop when it is left. Nobody waits: nobody runs it, and nothing is taken in. A
thread that runs an asyncio loop already cannot enter a second one: a thread is made, which waits in its place.

A signal handler that raises, as that of Ctrl-C does, ends the wait of the main thread; what it interrupts is mostly the
waiting itself. Others go on.
"""

from __future__ import annotations

import contextlib
import os
import threading
import weakref
from inspect import iscoroutine
from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiting import current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.loop.callbacks import require_callable, start_task
from rosidl_py_gen.runtime.loop.event_loop import end_tasks
from rosidl_py_gen.runtime.loop.turns import LONGEST_S, Call, Turn, Turns
from rosidl_py_gen.runtime.time.values import limit_to_ns

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Coroutine

    from typing_extensions import Self

T = TypeVar("T")

_PATIENCE_S = 5.0
"""How long `close` waits for others to leave the loop."""
_FORKED = "this driver was made before this process was forked, and works in the parent process only"
_drivers: weakref.WeakSet[Driver] = weakref.WeakSet()


class WouldDeadlockError(RosidlError, RuntimeError):
    """The caller would wait, on the event loop's own thread, for something only that loop can bring."""


class Driver:
    """An asyncio event loop that no thread owns: whoever waits runs it, until what he waits for is there.

    For programs with a main loop of their own: a game, a graphical interface, a script that polls. Contexts are given
    one, ``Context(driver=driver)``, and their nodes live while somebody waits: messages are taken in then, timers tick,
    callbacks run, in the thread that happens to run the loop. All methods may be called from any thread.

    Close the contexts first, then the driver; ``with`` does.

    Example:
        >>> with Driver() as driver, Context(driver=driver) as context:  # doctest: +SKIP
        ...     subscription = Node("poller", context=context).create_subscription(String, "chatter")
        ...     message = driver.wait(subscription.take, timeout_s=1.0)
    """

    def __init__(self) -> None:
        self._turns = turns = Turns()
        self.loop: asyncio.AbstractEventLoop = turns.loop
        """The event loop; it runs while somebody waits."""
        self._lock = threading.RLock()
        self._left = threading.Condition(self._lock)
        _drivers.add(self)

    # ------------------------------------------------------------------------------------------------------- waiting

    @overload
    def wait(self, until: None = None, timeout_s: float | None = None) -> None: ...
    @overload
    def wait(self, until: Callable[[], T], timeout_s: float | None = None) -> T: ...
    def wait(self, until: Callable[[], T] | None = None, timeout_s: float | None = None) -> T | None:
        """Run the loop, or wait for the thread that does, until `until()` is true or the time has passed.

        With a time limit of 0 the loop does what there is to do now. What is true at once is answered without running
        it.

        Args:
            until: is asked at first, and whenever the loop has done something, in the thread that runs it. It takes no
                arguments, must not wait, and what it answers is not lost: it may be `Subscription.take`. None: only
                the time counts.
            timeout_s: seconds; None waits for ever.

        Returns:
            What `until` answered last, as `threading.Condition.wait_for` does.

        Raises:
            WouldDeadlockError: called inside this driver's loop, in a callback for example.
            ClosedError: the driver is closed, also while waiting. TypeError, TimeRangeError: for the arguments.
            Exception: what `until` raised, or the first callback that failed of a node with ``on_error="raise"``.
        """
        require_callable(until, "until", " without arguments, or None")
        limit_ns = None if timeout_s is None else limit_to_ns("timeout_s", timeout_s)
        turn: Turn[Any] = Turn(_never if until is None else until)
        if not turn.look():
            if limit_ns is not None:
                turn.end_s = self.loop.time() + limit_ns / NS_PER_S
            self._wait(turn)
        return turn.result()  # type: ignore[no-any-return]

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the loop, and return or raise what it does.

        At once where the loop is left alone or the caller is in it, else as soon as the loop has done what it is at. It
        must not wait; a coroutine belongs into `run`.
        """
        if current_loop() is self.loop:
            return function()
        call = Call(function)
        self._finish(call, lambda: call.is_done)
        return call.value

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the loop to its end, and return or raise what it does.

        Raises:
            WouldDeadlockError: called inside this driver's loop, where ``await`` does it. ClosedError: as `wait`.
            TypeError: it is no coroutine.
        """
        is_one: bool = iscoroutine(coroutine)  # apart, as it would narrow away what the coroutine returns
        if not is_one:
            raise TypeError(f"coroutine must be a coroutine, such as main(), got {coroutine!r:.100}")
        call = Call(lambda: start_task(self.loop, coroutine))
        try:
            self._finish(call, lambda: call.is_done and (call.error is not None or call.value.done()))
        except BaseException:
            if call.is_done and call.error is None:
                self._cancel(call.value)
            raise
        finally:
            coroutine.close()  # not begun
        return call.value.result()

    def wake(self) -> None:
        """Let all that wait ask again: something was changed outside the loop. Signal handlers may call it, too."""
        self._turns.wake()

    # ---------------------------------------------------------------------------------------------------------- turns

    def _finish(self, call: Call[Any], is_over: Callable[[], bool]) -> None:
        """Wait for a call; raises what it raised."""
        calls = self._turns.calls
        calls.append(call)
        try:
            self.wake()
            self.wait(is_over)
        finally:
            with contextlib.suppress(ValueError):  # it was taken
                calls.remove(call)
        if call.error is not None:
            error, call.error = call.error, None
            try:
                raise error
            finally:
                del error  # its traceback holds this frame

    def _cancel(self, task: asyncio.Task[Any]) -> None:
        """Nobody waits for that any more."""
        with contextlib.suppress(RuntimeError, RosidlError):  # closed
            self.loop.call_soon_threadsafe(task.cancel)
            self.wait(task.done, 0)

    def _wait(self, turn: Turn[Any]) -> None:
        here = current_loop()
        if here is self.loop:
            raise WouldDeadlockError(
                "a Driver's wait from inside its own event loop, as in a callback, would wait for ever; return first, "
                "or use await"
            )
        if here is None:
            self._take_part(turn)
            return
        ended = threading.Event()  # an interrupted `join` would take the thread to have ended
        thread = threading.Thread(
            target=self._take_part_for, args=(turn, ended), name="rosidl-py-gen driver", daemon=True
        )
        try:
            thread.start()
            while not ended.wait(LONGEST_S):
                pass
        except BaseException as error:  # a signal handler's, which may come while the thread begins
            turn.fail(error)
            self.wake()
            with contextlib.suppress(RuntimeError):  # it has not begun, and finds the turn done
                thread.join()
            raise
        thread.join()

    def _take_part_for(self, turn: Turn[Any], ended: threading.Event) -> None:
        try:
            self._take_part(turn)
        except BaseException as error:
            turn.fail(error)
        finally:
            ended.set()

    def _take_part(self, turn: Turn[Any]) -> None:
        """Run the loop, or wait beside whoever does, until the turn is done."""
        turns, time = self._turns, self.loop.time
        try:
            turns.waiting.append(turn)
            while not turn.is_done:
                if self._enter(turn):
                    turns.run()
                    break
                assert turn.woken is not None
                left_s = LONGEST_S if turn.end_s is None else min(turn.end_s - time(), LONGEST_S)
                if turn.look() or (turn.end_s is not None and left_s <= 0):
                    break
                turn.woken.wait(left_s)
                turn.woken.clear()
        finally:
            self._leave(turn)
        if not turn.is_done:
            turn.look(last=True)

    def _enter(self, turn: Turn[Any]) -> bool:
        """Whether this thread runs the loop from now on; otherwise it waits for `turn.woken`."""
        turns = self._turns
        with self._lock:
            if turns.closed:
                raise ClosedError(turns.closed)
            if turns.driving is None:
                turns.driving, turns.thread = turn, threading.get_ident()
                return True
            turn.stand_aside()
            return False

    def _leave(self, turn: Turn[Any]) -> None:
        """Give the loop to the next, if the turn had it."""
        turns = self._turns
        with self._lock:
            if turn in turns.waiting:  # not interrupted before that
                turns.waiting.remove(turn)
            if turns.driving is turn:
                turns.driving, turns.thread = None, 0
            if turns.driving is None:
                if turns.waiting and (woken := turns.waiting[0].woken) is not None:
                    woken.set()
                if turns.closed:
                    self._left.notify_all()
                    if not turns.waiting:
                        self._end()

    # ------------------------------------------------------------------------------------------------------------ end

    def _end_wait(self, error: BaseException) -> bool:
        """Let the wait of whoever runs the loop raise this; False when nobody does. In the loop."""
        turn = self._turns.driving
        if turn is None:
            return False
        turn.fail(error)
        self.wake()
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_closed(self) -> bool:
        """True after `close`, and in a forked child."""
        return self._turns.closed != ""

    def close(self) -> None:
        """End all waits with `ClosedError`, cancel what is left in the loop, and close it; may be called twice.

        Called inside the loop, that happens when the loop is left.
        """
        with self._lock:
            if self._turns.closed:
                return
            self._turns.closed = "this driver is closed"
        self.wake()
        if current_loop() is self.loop:
            return
        with self._left:
            if self._left.wait_for(lambda: self._turns.driving is None, _PATIENCE_S):
                self._end()

    def _end(self) -> None:
        if self.loop.is_closed():
            return
        if current_loop() is None:
            end_tasks(self.loop)
        else:
            ending = threading.Thread(target=end_tasks, args=(self.loop,), name="rosidl-py-gen driver", daemon=True)
            ending.start()
            ending.join()
        self.loop.close()


def _never() -> None:
    """What only a time limit ends."""


def _after_fork() -> None:
    """In the child: the loop's descriptors are the parent's."""
    for driver in list(_drivers):
        driver._turns.closed = _FORKED


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
