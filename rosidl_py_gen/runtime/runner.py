"""Running a program: an async main function, or nodes that live from callbacks. Ctrl-C and SIGTERM end both cleanly.

Decides what "cleanly" means: tasks are cancelled and awaited, nodes are closed so that peers see them go at once, and
there is no traceback. `asyncio.run` works just as well for async programs; it raises KeyboardInterrupt, as always.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.runtime.context import Context

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

    from rosidl_py_gen.runtime.node import Node

T = TypeVar("T")


def run(main: Callable[[], Coroutine[Any, Any, T]] | Coroutine[Any, Any, T]) -> T | None:
    """Run an async function to its end, on an event loop of its own.

    Returns:
        What it returned; None when a signal ended it.
    """
    coroutine = main() if callable(main) else main
    loop = asyncio.new_event_loop()
    try:
        asyncio.set_event_loop(loop)
        task = loop.create_task(coroutine)
        stopped = threading.Event()

        def stop() -> None:
            stopped.set()
            task.cancel()

        with _signals(loop, stop):
            try:
                return loop.run_until_complete(task)
            except (asyncio.CancelledError, KeyboardInterrupt) as err:
                if not stopped.is_set() and not isinstance(err, KeyboardInterrupt):
                    raise
                _finish(loop, task)
                return None
    finally:
        _shut_down(loop)


def spin(*nodes: Node) -> None:
    """Deliver to the callbacks of `nodes` until Ctrl-C, SIGTERM, or all of them are closed; then close them.

    Nodes of other contexts cannot be spun together with these: one event loop waits for one context.
    """

    async def forever() -> None:
        for node in nodes:
            node.context.bridge.running_loop()
        while not all(node.is_closed for node in nodes):
            await asyncio.sleep(0.1)

    try:
        run(forever)
    finally:
        for node in nodes:
            node.close()


@contextlib.contextmanager
def _signals(loop: asyncio.AbstractEventLoop, stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on SIGINT and SIGTERM; where asyncio cannot do that (Windows), KeyboardInterrupt is raised
    instead.
    """
    installed = []
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(NotImplementedError):
                loop.add_signal_handler(number, stop)
                installed.append(number)
    try:
        yield
    finally:
        for number in installed:
            loop.remove_signal_handler(number)


def _finish(loop: asyncio.AbstractEventLoop, task: asyncio.Task[Any]) -> None:
    """Let a task that is being cancelled run to its end."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        loop.run_until_complete(task)


def _shut_down(loop: asyncio.AbstractEventLoop) -> None:
    try:
        for task in asyncio.all_tasks(loop):
            _finish(loop, task)
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.run_until_complete(loop.shutdown_default_executor())
    finally:
        Context.close_default()
        asyncio.set_event_loop(None)
        loop.close()
