"""An event loop that threads enter by turns, and what those that wait want to see.

Decides when the loop is left: before it waits for something, the selector asks whether what somebody waits for holds,
and does what other threads want to have done in the loop. Only public ways into asyncio are used: its selector, which
is handed to the constructor, `stop`, and `_set_running_loop`, which is there for those who write loops.

Entering and leaving asyncio's loop costs more than what most arrivals need. So on Linux, while asyncio has nothing to
do before a certain time, whoever waits stays in front of the loop: `Turns.serve` waits for the same descriptors and
calls the same functions of `EventLoop.watch`, and the loop itself is entered only when there is something else.

Who may call what, on which thread:

1. `Turns.run`, and within it `begin` and `has_waited`: the thread that runs the loop. It also looks on behalf of all
   that wait, and wakes those whose condition holds.
2. `Turn.look`: any thread; one at a time asks, and what was found once stays, so that a condition may take something.
3. `Turns.wake`: any thread, and signal handlers in the middle of anything.
"""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import sys
import threading
from collections import deque
from contextvars import copy_context
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import ClosedError

if sys.platform == "linux":
    from rosidl_py_gen.runtime.loop.event_loop import EarlySelector as _Base
    from rosidl_py_gen.runtime.loop.event_loop import EventLoop as _Loop
else:
    from asyncio import SelectorEventLoop as _Loop
    from selectors import DefaultSelector as _Base

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextvars import Context

    from typing_extensions import TypeVarTuple, Unpack

    Ts = TypeVarTuple("Ts")

T = TypeVar("T")

LONGEST_S = 0.1 if sys.platform == "win32" else 1.0
"""At a time that a thread waits. On Windows neither a lock nor a select is interrupted by Ctrl-C, and elsewhere neither
is by a signal that comes just before, or that the kernel gives to another thread. Its handler runs afterwards.
"""
_ROUNDS = 10
"""So many rounds of the loop are made at most when the time is over and there always is something to do."""


class Turn(Generic[T]):
    """One wait of one thread.

    Attributes:
        end_s: by the loop's time; None: there is no end.
        is_done: `value` or `error` is what came of it.
        woken: set when there is a reason to go on, for one that does not run the loop; None for who does.
        rounds_left: when the time is over.
    """

    __slots__ = ("_lock", "_until", "end_s", "error", "is_done", "rounds_left", "value", "woken")

    def __init__(self, until: Callable[[], T]) -> None:
        self._until = until
        self._lock: threading.RLock | None = None
        """While several threads may look."""
        self.end_s: float | None = None
        self.value: T
        self.error: BaseException | None = None
        self.is_done = False
        self.woken: threading.Event | None = None
        self.rounds_left = _ROUNDS

    def stand_aside(self) -> None:
        """Another thread runs the loop, and looks for this one, too."""
        if self.woken is None:
            self._lock = threading.RLock()
            self.woken = threading.Event()

    def look(self, last: bool = False) -> bool:
        """Whether it is done, because the condition holds or raises; the `last` look ends it either way."""
        lock = self._lock
        if lock is not None:
            lock.acquire()
        try:
            if not self.is_done:
                self.value = value = self._until()
                if value or last:
                    self.is_done = True
        except Exception as error:
            self.error, self.is_done = error, True
        finally:
            if lock is not None:
                lock.release()
        return self.is_done

    def fail(self, error: BaseException) -> None:
        """End it with an error, unless it is done; whoever runs the loop does that, or whose it is."""
        if not self.is_done:
            self.error, self.is_done = error, True

    def result(self) -> T:
        """What the condition answered; raises what it raised."""
        error, self.error = self.error, None
        if error is not None:
            try:
                raise error
            finally:
                del error  # its traceback holds this frame
        return self.value


class Call(Generic[T]):
    """A function that is to be called in the loop, in the context of who wants that."""

    __slots__ = ("_context", "_function", "error", "is_done", "value")

    def __init__(self, function: Callable[[], T]) -> None:
        self._function = function
        self._context = copy_context()
        self.value: T
        self.error: BaseException | None = None
        self.is_done = False

    def run(self) -> None:
        """Call it; what ends a program is raised here, too."""
        try:
            self.value = self._context.run(self._function)
        except BaseException as error:
            self.error = error
            if not isinstance(error, Exception):
                raise
        finally:
            self.is_done = True


class Turns:
    """Who runs the loop, who waits beside, and what is to be called in it."""

    def __init__(self) -> None:
        self.is_serving = False
        """The loop runs, as all that is called can tell, but asyncio was not entered."""
        self.loop = _DrivenLoop(self)
        self.driving: Turn[Any] | None = None
        """That of the thread that runs the loop."""
        self.thread = 0
        """That thread."""
        self.waiting: list[Turn[Any]] = []
        """All, in order of arrival, `driving` among them."""
        self.calls: deque[Call[Any]] = deque()
        self.closed = ""
        """Why nobody may wait any more; empty while all may."""
        self.may_wait = False
        self._may_end = False
        self._looks = False
        self._is_idle = self._was_idle = False
        """asyncio has nothing to do before `_due_s`, unless it was given something since."""
        self._due_s: float | None = None
        self._is_over = False
        """What `stop` says to `serve`."""

    def run(self) -> None:
        """Run the loop until the wait of who drives is over, or somebody stops it."""
        if sys.platform == "linux" and self._is_idle and not self.loop.has_news and self.serve():
            return
        self._is_idle = False
        self.loop.run_forever()
        self._is_idle = self._was_idle and not self.loop.has_news

    def serve(self) -> bool:
        """Wait as the loop would, and call what is to be called early; False when asyncio has something to do."""
        loop, look = self.loop, self.loop.look_early
        self._is_over, self.is_serving = False, True
        asyncio._set_running_loop(loop)
        try:
            while True:
                due_s = self._due_s
                left_s = None if due_s is None else due_s - loop.time()
                if left_s is not None and left_s <= 0:
                    return False
                has_more = True
                try:
                    has_more = look(self.begin(left_s))
                finally:
                    self.has_waited(has_more)
                if self._is_over:
                    return True
                if has_more or loop.has_news:
                    return False
        finally:
            asyncio._set_running_loop(None)
            self.is_serving = False

    def stop(self) -> None:
        """Leave the loop after this round."""
        if self.is_serving:
            self._is_over = True
        else:
            self.loop.leave()

    def begin(self, timeout_s: float | None) -> float | None:
        """Before the loop waits: how long it may."""
        self.may_wait, turn, loop = True, self.driving, self.loop
        if not self.is_serving:
            self._was_idle = timeout_s is None or timeout_s > 0
            self._due_s = None if timeout_s is None else loop.time() + timeout_s
        if turn is None:
            return timeout_s
        loop.has_news = False
        while self.calls:
            self.calls.popleft().run()
        self.look()
        if turn.is_done or loop.has_news:
            return 0
        if turn.end_s is not None:
            left_s = turn.end_s - loop.time()
            if left_s <= 0:
                turn.rounds_left -= 1
                if turn.rounds_left == 0:
                    self.stop()
                self._may_end = timeout_s is None or timeout_s > 0
                return 0
            timeout_s = left_s if timeout_s is None else min(timeout_s, left_s)
        return LONGEST_S if timeout_s is None else min(timeout_s, LONGEST_S)

    def has_waited(self, has_events: bool) -> None:
        """The loop has waited; whether there is something that asyncio is told of."""
        self.may_wait = False
        if self._may_end:
            self._may_end = False
            if not has_events and not self.loop.has_news:
                self.stop()

    def look(self) -> None:
        """Leave the loop, or wake others, when what is waited for holds; in the loop."""
        if self._looks:  # a condition wakes us
            return
        self._looks = True
        try:
            driving = self.driving
            for turn in tuple(self.waiting) if len(self.waiting) > 1 else self.waiting:
                if turn is not driving and turn.woken is None:
                    continue  # it is about to look by itself
                if self.closed:
                    turn.fail(ClosedError(self.closed))
                if turn.look() and turn.woken is not None:
                    turn.woken.set()
            if driving is not None and driving.is_done:
                self.stop()
        finally:
            self._looks = False

    def wake(self) -> None:
        """Let all look again."""
        if self.driving is None:
            return
        if threading.get_ident() == self.thread:  # a question that costs no call of the system
            self.look()
            if not self.may_wait:
                return
        with contextlib.suppress(RuntimeError):  # closed meanwhile
            self.loop.call_soon_threadsafe(_nothing)


def _nothing() -> None:
    """Only wakes the loop."""


class _Selector(_Base):
    """Asks `Turns` before it waits."""

    def __init__(self, turns: Turns) -> None:
        super().__init__()
        self._turns = turns
        if sys.platform == "linux":
            poll = self._poll

            def poll_first(timeout: float | None = None, maxevents: int = -1) -> list[tuple[int, int]]:
                found = poll(timeout, maxevents)
                turns.may_wait = False  # what is called for what was found may wake us
                return found

            self._poll = poll_first

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        turns, events = self._turns, list[Any]()
        timeout = turns.begin(timeout)
        try:
            events = super().select(timeout)
            return events
        finally:
            turns.has_waited(bool(events))


class _DrivenLoop(_Loop):
    """asyncio's event loop, which notes that something was given to it: conditions may do that."""

    def __init__(self, turns: Turns) -> None:
        self.has_news = False
        self._turns = turns
        super().__init__(_Selector(turns))

    def is_running(self) -> bool:
        """Whether somebody waits, also in front of it."""
        return self._turns.is_serving or super().is_running()

    def stop(self) -> None:
        self.has_news = True
        super().stop()

    def leave(self) -> None:
        """Stop after this round, on behalf of `Turns`: asyncio need not do any more for that."""
        super().stop()

    def call_soon(
        self, callback: Callable[[Unpack[Ts]], object], *args: Unpack[Ts], context: Context | None = None
    ) -> asyncio.Handle:
        self.has_news = True
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self, when: float, callback: Callable[[Unpack[Ts]], object], *args: Unpack[Ts], context: Context | None = None
    ) -> asyncio.TimerHandle:
        self.has_news = True
        return super().call_at(when, callback, *args, context=context)
