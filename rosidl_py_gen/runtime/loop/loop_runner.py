"""Public event loop that waiting threads run, for programs that do not use asyncio: interface of a `SharedLoop`."""

from __future__ import annotations

from inspect import iscoroutine
from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.loop.shared_loop import SharedLoop
from rosidl_py_gen.runtime.loop.user_callback import require_callable
from rosidl_py_gen.runtime.time.values import timeout_to_ns

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Coroutine

    from typing_extensions import Self

T = TypeVar("T")


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
