"""Removable registrations of objects such as callbacks, and the check of a callback's signature.

The signature is checked when the callback is registered, because its first call may be much later. A function without a
signature, such as some builtins, is accepted. For a decorated function, the signature of the wrapper counts, which may
pass other arguments. Thread: any.
"""

from __future__ import annotations

import inspect
from types import FunctionType, MethodType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

T = TypeVar("T")


class Registration:
    """Handle of a registered object, such as a callback; `close` or the end of a ``with`` block removes the object."""

    __slots__ = ("_pending_removal",)

    def __init__(self, remove: Callable[[], object]) -> None:
        self._pending_removal = [remove]

    def close(self) -> None:
        """Remove the registered object; may be called repeatedly."""
        try:
            remove = self._pending_removal.pop()  # one of several threads gets the function
        except IndexError:
            return
        remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RegistrationSet(Generic[T]):
    """Set of registered objects, oldest first. An iteration skips objects that are removed while it runs."""

    def __init__(self) -> None:
        self._items: dict[object, T] = {}

    def add(self, item: T) -> Registration:
        """Add an object and return a registration whose `close` removes the object.

        An object may be added several times.
        """
        key = object()
        self._items[key] = item
        return Registration(lambda: self._items.pop(key, None))

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[T]:
        items = list(self._items.items())  # not `tuple`, which fails without the GIL if another thread adds an item
        return self._all(items) if len(items) > 1 else iter([item for _, item in items])

    def _all(self, items: list[tuple[object, T]]) -> Iterator[T]:
        for key, item in items:
            if key in self._items:
                yield item


class CallbackSignatureError(RosidlError, TypeError):
    """Error of a callback that does not accept the arguments that it would be called with."""


def require_signature(function: Callable[..., Any], subject: str, *arguments: str, hint: str = "") -> None:
    """Raise `CallbackSignatureError` unless a function can be called with the given positional arguments.

    Args:
        subject: name of the callback in the error text.
        arguments: descriptions of the arguments.
        hint: end of the error text.
    """
    if _accepts_arguments(function, len(arguments)):
        return
    try:
        signature = inspect.signature(function, follow_wrapped=False)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*arguments)
    except TypeError as error:
        name = getattr(function, "__name__", type(function).__name__)
        count = f"{len(arguments)} argument{'s' * (len(arguments) > 1)}"
        given = f"{count} ({', '.join(arguments)})" if arguments else "no argument"
        display = f"{name}{signature}"
        raise CallbackSignatureError(
            f"{subject} gets {given}, which {display:.200} cannot take: {error}{hint}"
        ) from None


def _accepts_arguments(function: object, count: int) -> bool:
    """Return True if a plain function certainly accepts `count` arguments; `inspect.signature` would take 15 us."""
    if isinstance(function, MethodType):
        function, count = function.__func__, count + 1
    code = function.__code__ if isinstance(function, FunctionType) else None
    return code is not None and code.co_argcount == count and not code.co_kwonlyargcount
