"""Blocking forms of awaitable methods, such as ``receive_sync`` for ``receive``."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")


def blocking(method: Callable[Concatenate[S, P], Coroutine[Any, Any, R]]) -> Callable[Concatenate[S, P], R]:
    """Return the blocking form of a method of a class whose ``_scope`` has ``run_blocking``, as `EntityScope` has.

    It raises `WouldDeadlockError` on the event loop's thread, and else as the method.
    """
    name = method.__name__

    @functools.wraps(method)
    def run(self: S, /, *arguments: P.args, **keywords: P.kwargs) -> R:
        coroutine = getattr(self, name)(*arguments, **keywords)  # the method of a subclass, if it has one
        result: R = self._scope.run_blocking(coroutine, self, name)  # type: ignore[attr-defined]
        return result

    run.__name__, run.__qualname__ = f"{name}_sync", f"{method.__qualname__}_sync"
    run.__doc__ = f"Call `{name}` in plain code; raises `WouldDeadlockError` on the event loop's thread."
    return run
