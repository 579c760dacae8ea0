"""Running a program: an async main function, or nodes that live from callbacks. Ctrl-C and SIGTERM end both cleanly.

Decides what "cleanly" means: tasks are cancelled and awaited, nodes are closed so that peers see them go at once, and
there is no traceback. A second signal is for a program that does not end by itself: SIGINT then raises
KeyboardInterrupt where the program is, unless it follows the first within `REPEAT_S`; SIGTERM ends the process.
`asyncio.run` works just as well for async programs; it raises KeyboardInterrupt, as always.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
import sys
import threading
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from rosidl_py_gen.base.interrupts import REPEAT_S, CommandInterrupts
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.loop.callback_failures import FailureGuard
from rosidl_py_gen.runtime.loop.event_loop import end_tasks, new_event_loop
from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
from rosidl_py_gen.runtime.node import context_registry
from rosidl_py_gen.runtime.node.arguments import RosArgumentError
from rosidl_py_gen.runtime.node.context import Context
from rosidl_py_gen.runtime.parameters.values import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from types import FrameType, TracebackType

    from rosidl_py_gen.runtime.node.node import Node

T = TypeVar("T")

_PATIENCE_S = 1.0
"""How long work of other threads may take after the end without a word about it."""


def run(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> T | None:
    """Run an async function to its end, on an event loop of its own that also serves the nodes made before.

    Work that `asyncio.to_thread` began is waited for, as a thread cannot be stopped; a second signal ends the process
    without it.

    Returns:
        What it returned; None when a signal ended it.

    Raises:
        WrongEventLoopError: an event loop runs already, as in Jupyter.
        TypeError: no async function or coroutine.
        KeyboardInterrupt: at the second SIGINT, 0.4 s or more after the first.
        SystemExit: the ROS arguments of the process, or a parameter file, are wrong; the code is the message.
        Exception: what `main` raised, or the first callback that failed of a node with ``on_error="raise"``.
    """
    coroutine = _coroutine(main)
    loop = new_event_loop()
    with _Signals(loop) as signals:
        try:
            asyncio.set_event_loop(loop)
            return _run_task(loop, signals, loop.create_task(_attached(coroutine)))
        except (RosArgumentError, ParameterError) as error:
            if isinstance(error, ParameterError) and not error.source:
                raise
            raise SystemExit(f"error: {printable(str(error))}") from None  # the mistake of a user of the program
        finally:
            signals.start_shutdown()
            if signals.interrupted_shutdown:  # the callback that had to be interrupted must not be called again
                context_registry.close_served_by(loop)
            try:
                _end_tasks(loop)
            finally:
                coroutine.close()  # a signal may have come before its first step
                Context.close_default()
                asyncio.set_event_loop(None)
                loop.close()


def spin(*nodes: Node) -> None:
    """Deliver to the callbacks of `nodes` until Ctrl-C, SIGTERM, or all of them are closed; then close them.

    Nodes of other contexts can be spun together with these, at the price of a thread for each further context.

    Raises:
        WrongEventLoopError: an event loop runs already, as in Jupyter; nothing is closed then.
        TypeError: no node. KeyboardInterrupt: at the second SIGINT, as `run`. What callbacks raised: as `run`.
    """
    for node in nodes:
        if not isinstance(getattr(node, "context", None), Context):
            raise TypeError(f"spin takes nodes, got {node!r:.100}")
    if not nodes:
        raise TypeError("spin takes at least one node")
    _refuse_running_loop("spin(node)", "async with node: await asyncio.Event().wait()")

    async def forever() -> None:
        for node in nodes:
            if not node.is_closed:
                node.context._core.bridge.running_loop()
        while not all(node.is_closed for node in nodes):
            await asyncio.sleep(0.1)

    try:
        run(forever)
    finally:
        for node in nodes:
            node.close()


# --------------------------------------------------------------------------------------------------------- beginning


def _coroutine(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> Coroutine[Any, Any, T]:
    """What to run; refused when it is something else, or when a loop runs already."""
    try:
        _refuse_running_loop("run(main)", "await main()")
    except WrongEventLoopError:
        if asyncio.iscoroutine(main):
            main.close()
        raise
    coroutine = main() if callable(main) else main
    if not asyncio.iscoroutine(coroutine):
        raise TypeError(f"run takes an async function without arguments, or a coroutine, got {main!r:.100}")
    return coroutine


def _refuse_running_loop(what: str, instead: str) -> None:
    if current_loop() is not None:
        raise WrongEventLoopError(
            f"{what} makes an event loop, but one runs here already (Jupyter always has one): write `{instead}` instead"
        )


def _run_task(loop: asyncio.AbstractEventLoop, signals: _Signals, task: asyncio.Task[T]) -> T | None:
    signals.task = task
    if signals.stopped:  # while there was no task to cancel
        task.cancel()
    try:
        return loop.run_until_complete(task)
    except asyncio.CancelledError:
        if not signals.stopped:
            raise
    except KeyboardInterrupt:
        if signals.interrupted_shutdown:
            raise
    return None


async def _attached(coroutine: Coroutine[Any, Any, T]) -> T:
    context_registry.attach_all()
    loop = asyncio.get_running_loop()
    with FailureGuard(lambda failures: failures.loop_binding.loop is loop):
        return await coroutine


# ----------------------------------------------------------------------------------------------------------- signals


class _Signals:
    """Handlers of SIGINT and SIGTERM: the first signal cancels `task`, the next one insists.

    Python's own handlers, not the loop's: those run on the loop, and a callback that never returns would keep it.
    A signal that comes just before the loop waits, or that the kernel gives to another thread, interrupts no wait, and
    Python calls its handler afterwards only. So each signal writes to a socket that the loop reads.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.task: asyncio.Task[Any] | None = None
        self._ending = False
        self._previous: dict[int, Any] = {}
        self._sockets: tuple[socket.socket, socket.socket] | None = None
        self._previous_descriptor = -1
        self._first_s = -math.inf
        self.stopped = False
        """A signal came."""
        self.interrupted_shutdown = False
        """A second SIGINT came."""

    def __enter__(self) -> _Signals:
        if threading.current_thread() is threading.main_thread():
            if sys.platform != "win32":  # there asyncio's loop does it
                self._wake_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def _wake_loop(self) -> None:
        self._sockets = reading, writing = socket.socketpair()
        for end in self._sockets:
            end.setblocking(False)
        self._loop.add_reader(reading, _drain, reading)
        self._previous_descriptor = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        for number, previous in self._previous.items():
            signal.signal(number, signal.SIG_DFL if previous is None else previous)  # None: not made in Python
        if self._sockets is not None:
            signal.set_wakeup_fd(self._previous_descriptor)
            for end in self._sockets:
                end.close()

    def start_shutdown(self) -> None:
        """What a signal meets from now on is the end itself."""
        self._ending = True

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not (self.stopped or self._ending):
            self.stopped = True
            self._first_s = self._loop.time()
            if self.task is not None:
                self.task.cancel()
            with contextlib.suppress(RuntimeError):  # closed
                self._loop.call_soon_threadsafe(lambda: None)  # wakes it
        elif number == signal.SIGTERM:
            _exit_by_signal(number)
        elif self._loop.time() - self._first_s > REPEAT_S:
            previous = self._previous.get(number)
            if isinstance(previous, CommandInterrupts):
                previous(number, frame)
            else:
                self.interrupted_shutdown = True
                raise KeyboardInterrupt


def _drain(reading: socket.socket) -> None:
    """Read what signals wrote; nothing when an interrupted round of the loop is made up for by the next one."""
    with contextlib.suppress(BlockingIOError, InterruptedError):
        reading.recv(4096)


def _exit_by_signal(number: int) -> NoReturn:
    """End this process as `number` does by default, whatever its threads do."""
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    os._exit(128 + number)  # where a signal is not what ends a process


# --------------------------------------------------------------------------------------------------------------- end


def _end_tasks(loop: asyncio.AbstractEventLoop) -> None:
    """Cancel what is left, wait for it, and tell of what failed meanwhile."""
    _cancel_tasks(loop)
    loop.run_until_complete(loop.shutdown_asyncgens())
    try:
        _end_threads(loop)
    except KeyboardInterrupt:
        # Threads that do not end would keep the interpreter, too. Peers shall see us go nevertheless.
        context_registry.close_all()
        _exit_by_signal(signal.SIGINT)
    _cancel_tasks(loop)  # those of callbacks that were called while it waited for threads


def _cancel_tasks(loop: asyncio.AbstractEventLoop) -> None:
    for task in end_tasks(loop):
        if not task.cancelled() and (error := task.exception()) is not None:
            message = "a task failed while the program ended"
            loop.call_exception_handler({"message": message, "exception": error, "task": task})


def _end_threads(loop: asyncio.AbstractEventLoop) -> None:
    """Wait for what `asyncio.to_thread` began, and say so when it takes long."""

    async def end() -> None:
        ending = asyncio.ensure_future(loop.shutdown_default_executor())
        done, _ = await asyncio.wait((ending,), timeout=_PATIENCE_S)
        if not done:
            get_root_logger().warning(
                "waiting for a function that asyncio.to_thread or run_in_executor began; Ctrl-C ends without it"
            )
        await ending

    loop.run_until_complete(end())
