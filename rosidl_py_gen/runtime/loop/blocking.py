"""Blocking forms of awaitable methods, for plain code: ``receive_sync`` in addition to ``receive``.

`EntityScope.run_blocking` runs the coroutine. A call on the event loop's own thread is refused, as it would deadlock.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")


def blocking(method: Callable[Concatenate[S, P], Coroutine[Any, Any, R]]) -> Callable[Concatenate[S, P], R]:
    """Return the blocking form of a method, for scripts, notebooks and other threads than the loop's.

    ``receive_sync = blocking(receive)``. The class has a `Scope` as ``_scope``.

    Raises:
        WouldDeadlockError: called on the event loop's thread. Others as the method.
    """
    name = method.__name__

    @functools.wraps(method)
    def run(self: S, /, *arguments: P.args, **keywords: P.kwargs) -> R:
        coroutine = getattr(self, name)(*arguments, **keywords)  # a subclass may have its own
        answer: R = self._scope.run_blocking(  # type: ignore[attr-defined]
            coroutine, f"{name}_sync of {self!r}", f"'await ...{name}(...)'"
        )
        return answer

    run.__name__, run.__qualname__ = f"{name}_sync", f"{method.__qualname__}_sync"
    run.__doc__ = f"`{name}` for plain code; raises `WouldDeadlockError` on the event loop's thread."
    return run
