"""Awaitable methods for plain code: ``receive_sync`` beside ``receive``.

Decides that they all are the awaitable method, run where `Scope.run` runs it: on the loop that runs in another thread,
or on one that is kept for the purpose. On the loop's own thread that would wait for ever, and is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, TypeVar, overload

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from typing_extensions import Self

S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")


class blocking(Generic[S, P, R]):
    """``receive_sync = blocking(receive)``: the method for scripts, notebooks and other threads than the loop's.

    The owner has a `Scope` as ``_scope`` or ``scope``.

    Raises:
        WouldDeadlockError: called on the event loop's thread. Others as the method.
    """

    def __init__(self, method: Callable[Concatenate[S, P], Coroutine[Any, Any, R]]) -> None:
        self._method = method
        self._name = method.__name__
        self.__doc__ = f"`{self._name}` for plain code; raises `WouldDeadlockError` on the event loop's thread."

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Self: ...
    @overload
    def __get__(self, instance: S, owner: type[Any]) -> Callable[P, R]: ...
    def __get__(self, instance: S | None, owner: type[Any]) -> Self | Callable[P, R]:
        if instance is None:
            return self
        method, name = getattr(instance, self._name), self._name
        scope = instance._scope  # type: ignore[attr-defined]

        def run(*arguments: P.args, **keywords: P.kwargs) -> R:
            answer: R = scope.run(
                method(*arguments, **keywords), f"{name}_sync of {instance!r}", f"'await ...{name}(...)'"
            )
            return answer

        return run
