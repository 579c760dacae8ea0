"""The public face of a loop that threads share, for programs that are no asyncio programs: `SharedLoop` does the work.

A signal handler that raises, as that of Ctrl-C does, ends the wait of the main thread; it mostly interrupts the waiting
itself. Other threads continue.
"""

from __future__ import annotations

from inspect import iscoroutine
from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.loop.callable_checks import require_callable
from rosidl_py_gen.runtime.loop.shared_loop import SharedLoop
from rosidl_py_gen.runtime.time.values import timeout_to_ns

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Coroutine

    from typing_extensions import Self

T = TypeVar("T")


class LoopRunner:
    """An asyncio event loop that no thread owns: whoever waits runs it, until what he waits for is there.

    For programs with a main loop of their own: a game, a graphical interface, a script that polls. Contexts are given
    one, ``Context(loop_runner=runner)``, and their nodes live while somebody waits: messages are taken in then, timers
    tick, callbacks run, in the thread that happens to run the loop. All methods may be called from any thread.

    Close the contexts first, then the runner; ``with`` does.

    Example:
        >>> with LoopRunner() as runner, Context(loop_runner=runner) as context:  # doctest: +SKIP
        ...     subscription = Node("poller", context=context).create_subscription(String, "chatter")
        ...     message = runner.wait(subscription.take, timeout_s=1.0)
    """

    def __init__(self) -> None:
        self._shared_loop = SharedLoop()
        self.loop: asyncio.AbstractEventLoop = self._shared_loop.loop
        """The event loop; it runs while somebody waits."""

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
        limit_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        return self._shared_loop.wait(
            _never if until is None else until, None if limit_ns is None else limit_ns / NS_PER_S
        )

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the loop, and return or raise what it does.

        At once where the loop is left alone or the caller is in it, else as soon as the loop has done what it is at. It
        must not wait; a coroutine belongs into `run`.
        """
        return self._shared_loop.call(function)

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the loop to its end, and return or raise what it does.

        Raises:
            WouldDeadlockError: called inside this driver's loop, where ``await`` does it. ClosedError: as `wait`.
            TypeError: it is no coroutine.
        """
        is_one: bool = iscoroutine(coroutine)  # apart, as it would narrow away what the coroutine returns
        if not is_one:
            raise TypeError(f"coroutine must be a coroutine, such as main(), got {coroutine!r:.100}")
        return self._shared_loop.run(coroutine)

    def wake(self) -> None:
        """Let all that wait ask again: something was changed outside the loop. Signal handlers may call it, too."""
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
        """End all waits with `ClosedError`, cancel what is left in the loop, and close it; may be called twice.

        Called inside the loop, that happens when the loop is left.
        """
        self._shared_loop.close()


def _never() -> None:
    """Condition that never holds, so that only a time limit ends the wait."""
