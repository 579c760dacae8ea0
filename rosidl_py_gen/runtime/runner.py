"""Functions that run a program: `run` for an async main function, `spin` for nodes with callbacks.

Ctrl-C and SIGTERM end both without traceback: tasks are cancelled and awaited, and nodes are closed, so that peers
notice at once. A second signal ends a program that does not react: SIGINT raises KeyboardInterrupt at the current line,
unless it follows the first signal within `interrupts.REPEAT_S`; SIGTERM ends the process. Async programs may also use
`asyncio.run`, which raises KeyboardInterrupt.
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

from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.loop.callbacks import FailureGuard
from rosidl_py_gen.runtime.loop.event_loop import end_tasks, new_event_loop
from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
from rosidl_py_gen.runtime.node.context import Context, attach_all, close_all, close_served_by, core_of
from rosidl_py_gen.runtime.node.settings import RosArgumentError
from rosidl_py_gen.runtime.parameters.values import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from types import FrameType, TracebackType

    from rosidl_py_gen.runtime.node.node import Node

T = TypeVar("T")

_EXECUTOR_WARNING_DELAY_S = 1.0
"""Time for which `run` waits at its end for threads of `asyncio.to_thread` before it logs a warning."""


def run(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> T | None:
    """Run an async function on a new event loop, which also serves the nodes that were created before.

    At the end, `run` waits for threads of `asyncio.to_thread`, because a thread cannot be stopped; a second
    signal ends the process without waiting.

    Returns:
        The result of the function; None if a signal has ended it.

    Raises:
        WrongEventLoopError: an event loop runs already, as in Jupyter.
        TypeError: `main` is not an async function or coroutine.
        KeyboardInterrupt: a second SIGINT arrived, 0.4 s or more after the first.
        SystemExit: the ROS arguments of the process, or a parameter file, are invalid; the code is the message.
        Exception: raised by `main`, or by the first failed callback of a node with ``on_error="raise"``.
    """
    coroutine = _as_coroutine(main)
    loop = new_event_loop()
    with _Signals(loop) as signals:
        try:
            asyncio.set_event_loop(loop)
            return _run_task(loop, signals, loop.create_task(_attached(coroutine)))
        except (RosArgumentError, ParameterError) as error:
            if isinstance(error, ParameterError) and not error.source:
                raise
            raise SystemExit(f"error: {printable(str(error))}") from None  # a mistake of the program's user
        finally:
            signals.is_shutdown = True
            if signals.interrupted_shutdown:  # the callback that was interrupted must not be called again
                close_served_by(loop)
            try:
                _end_tasks(loop)
            finally:
                coroutine.close()  # a signal may have arrived before its first step
                Context.close_default()
                asyncio.set_event_loop(None)
                loop.close()


def spin(*nodes: Node) -> None:
    """Run the callbacks of `nodes` until Ctrl-C or SIGTERM arrives, or all nodes are closed; then close them.

    Nodes of several contexts may be combined, at the cost of a thread for each further context.

    Raises:
        WrongEventLoopError: an event loop runs already, as in Jupyter; nothing is closed then.
        TypeError: an argument is not a node, or there is no argument.
        KeyboardInterrupt: a second SIGINT arrived, 0.4 s or more after the first.
        Exception: raised by the first failed callback of a node with ``on_error="raise"``.
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
                core_of(node.context).loop_binding.running_loop()
        while not all(node.is_closed for node in nodes):
            await asyncio.sleep(0.1)

    try:
        run(forever)
    finally:
        for node in nodes:
            node.close()


def _as_coroutine(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> Coroutine[Any, Any, T]:
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


def _refuse_running_loop(call: str, alternative: str) -> None:
    if current_loop() is not None:
        raise WrongEventLoopError(
            f"{call} starts an event loop, but one runs here already (Jupyter always has one); use `{alternative}`"
        )


def _run_task(loop: asyncio.AbstractEventLoop, signals: _Signals, task: asyncio.Task[T]) -> T | None:
    signals.task = task
    if signals.is_stopped:  # while there was no task to cancel
        task.cancel()
    try:
        return loop.run_until_complete(task)
    except asyncio.CancelledError:
        if not signals.is_stopped:
            raise
    except KeyboardInterrupt:
        if signals.interrupted_shutdown:
            raise
    return None


async def _attached(coroutine: Coroutine[Any, Any, T]) -> T:
    attach_all()
    loop = asyncio.get_running_loop()
    with FailureGuard(lambda failures: failures.loop_binding.loop is loop):
        return await coroutine


class _Signals:
    """Handlers of SIGINT and SIGTERM: the first signal cancels `task`, the second one ends the program by force.

    The handlers are Python's, not the loop's, which a callback that never returns would block. A signal that arrives
    just before the loop waits, or in another thread, does not interrupt the wait, and Python calls the handler only
    after the wait. So each signal also writes to a socket that the loop reads.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.task: asyncio.Task[Any] | None = None
        self.is_shutdown = False
        """True when the main task has ended: then SIGINT raises KeyboardInterrupt and SIGTERM ends the process."""
        self._previous: dict[int, Any] = {}
        self._sockets: tuple[socket.socket, socket.socket] | None = None
        self._previous_descriptor = -1
        self._first_s = -math.inf
        self.is_stopped = False
        """True after the first SIGINT or SIGTERM."""
        self.interrupted_shutdown = False
        """True after a second SIGINT, which has raised KeyboardInterrupt."""

    def __enter__(self) -> _Signals:
        if threading.current_thread() is threading.main_thread():
            if sys.platform != "win32":  # on Windows asyncio's loop does it
                self._add_wakeup_socket()
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def _add_wakeup_socket(self) -> None:
        self._sockets = receiver, sender = socket.socketpair()
        receiver.setblocking(False)
        sender.setblocking(False)
        self._loop.add_reader(receiver, drain, receiver)
        self._previous_descriptor = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        for number, previous in self._previous.items():
            signal.signal(number, signal.SIG_DFL if previous is None else previous)  # None: not set by Python
        if self._sockets is not None:
            signal.set_wakeup_fd(self._previous_descriptor)
            for endpoint in self._sockets:
                endpoint.close()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not (self.is_stopped or self.is_shutdown):
            self.is_stopped = True
            self._first_s = self._loop.time()
            if self.task is not None:
                self.task.cancel()
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(lambda: None)  # wakes up the loop
        elif number == signal.SIGTERM:
            _exit_by_signal(number)
        elif not command_interrupts.is_same_request(self._loop.time() - self._first_s):
            previous = self._previous.get(number)
            if previous is command_interrupts:
                command_interrupts(number, frame)
            else:
                self.interrupted_shutdown = True
                raise KeyboardInterrupt


def drain(receiver: socket.socket) -> None:
    """Read and discard all signal numbers that Python has written to its wakeup socket."""
    with contextlib.suppress(BlockingIOError, InterruptedError):  # the previous iteration may have read all
        receiver.recv(4096)


def _exit_by_signal(number: int) -> NoReturn:
    """End the process by the default action of a signal, without waiting for the process's threads."""
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    os._exit(128 + number)  # on Windows the signal does not end the process


def _end_tasks(loop: asyncio.AbstractEventLoop) -> None:
    """Cancel the remaining tasks of a loop, wait for them and for executor threads, and report exceptions of tasks."""
    _cancel_tasks(loop)
    loop.run_until_complete(loop.shutdown_asyncgens())
    try:
        _end_threads(loop)
    except KeyboardInterrupt:
        # Threads that do not end would block the interpreter's exit, too.
        close_all()
        _exit_by_signal(signal.SIGINT)
    _cancel_tasks(loop)  # tasks of callbacks that were called while it waited for threads


def _cancel_tasks(loop: asyncio.AbstractEventLoop) -> None:
    for task in end_tasks(loop):
        if not task.cancelled() and (error := task.exception()) is not None:
            message = "a task failed while the program ended"
            loop.call_exception_handler({"message": message, "exception": error, "task": task})


def _end_threads(loop: asyncio.AbstractEventLoop) -> None:
    """Wait for threads of `asyncio.to_thread` and executors of a loop, with a warning if that takes long."""

    async def end() -> None:
        shutdown = asyncio.ensure_future(loop.shutdown_default_executor())
        done, _ = await asyncio.wait((shutdown,), timeout=_EXECUTOR_WARNING_DELAY_S)
        if not done:
            get_root_logger().warning(
                "waiting for a function started by asyncio.to_thread or run_in_executor; press Ctrl-C to end without it"
            )
        await shutdown

    loop.run_until_complete(end())
