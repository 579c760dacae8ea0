"""Helpers around functions that users hand in: plain or async, on which thread, and what their code mentions."""

from __future__ import annotations

import concurrent.futures
import functools
import inspect
from types import CodeType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.bridge import Bridge

T = TypeVar("T")

_CANCEL_NAMES = frozenset({"cancel_requested", "wait_for_cancel"})


async def result_of(callback: Callable[..., Any], *arguments: object) -> Any:
    """What a plain or async callback answers."""
    answer = callback(*arguments)
    return await answer if inspect.isawaitable(answer) else answer


def on_loop(bridge: Bridge, function: Callable[[], T]) -> T:
    """Run `function` on the loop's thread and return what it returns; here and now when no loop runs."""
    loop = bridge.loop
    if loop is None or not loop.is_running() or bridge.in_loop_thread():
        return function()
    done: concurrent.futures.Future[T] = concurrent.futures.Future()

    def call() -> None:
        try:
            done.set_result(function())
        except BaseException as error:
            done.set_exception(error)

    loop.call_soon_threadsafe(call)
    return done.result()


def mentions_cancel(handler: Callable[..., Any]) -> bool:
    """Whether the handler's own code reads `cancel_requested`; functions it calls are not looked into."""
    while isinstance(handler, functools.partial):
        handler = handler.func
    function: Any = inspect.unwrap(handler)
    if not inspect.isroutine(function):
        function = type(function).__call__
    code = getattr(function, "__code__", None)
    return isinstance(code, CodeType) and _reads(code)


def _reads(code: CodeType) -> bool:
    inner = (item for item in code.co_consts if isinstance(item, CodeType))
    return not _CANCEL_NAMES.isdisjoint(code.co_names) or any(_reads(item) for item in inner)
