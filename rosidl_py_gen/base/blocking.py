"""Blocking forms of coroutine methods, such as ``receive_sync`` for ``receive``."""

from __future__ import annotations

import functools
import inspect
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")


def blocking(method: Callable[Concatenate[S, P], Coroutine[Any, Any, R]]) -> Callable[Concatenate[S, P], R]:
    """Return the blocking form of a coroutine method, named ``<method>_sync``.

    The class must have an attribute ``_scope`` with a method ``run_blocking``, as `EntityScope` has. The blocking form
    raises `WouldDeadlockError` on the event loop's thread, and else the same errors as the method.
    """
    name = method.__name__

    @functools.wraps(method)
    def run(self: S, /, *arguments: P.args, **keywords: P.kwargs) -> R:
        coroutine = getattr(self, name)(*arguments, **keywords)  # the method of a subclass, if it has one
        result: R = self._scope.run_blocking(coroutine, self, name)  # type: ignore[attr-defined]
        return result

    run.__name__, run.__qualname__ = f"{name}_sync", f"{method.__qualname__}_sync"
    run.__doc__ = _docstring(name, inspect.getdoc(method) or f"Call `{name}`.")
    return run


def _docstring(name: str, text: str) -> str:
    """Return the docstring of a blocking form: the method's docstring, and the exception that only this form raises."""
    before, _, errors = text.partition("\nRaises:\n")
    raises = [*filter(None, [errors.rstrip()]), "    WouldDeadlockError: it is called on the thread of the event loop."]
    return "\n".join([before.rstrip(), "", f"Blocking form of `{name}`, for plain code.", "", "Raises:", *raises])
