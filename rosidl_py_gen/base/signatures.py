"""Check of the signatures of callbacks when they are registered, because their first call may be much later.

A function without a signature, such as some builtins, is accepted. For a decorated function, the signature of the
wrapper counts, which may pass other arguments.
"""

from __future__ import annotations

import inspect
from types import FunctionType, MethodType
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable


class CallbackSignatureError(RosidlError, TypeError):
    """A callback does not accept the arguments that it would be called with."""


def require_signature(function: Callable[..., Any], subject: str, *arguments: str, hint: str = "") -> None:
    """Raise `CallbackSignatureError` unless a function can be called with some positional arguments.

    Args:
        function: the callback.
        subject: its name in the error text.
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
    """Return True for a plain function that accepts the arguments: `inspect.signature` takes 15 us."""
    if isinstance(function, MethodType):
        function, count = function.__func__, count + 1
    code = function.__code__ if isinstance(function, FunctionType) else None
    return code is not None and code.co_argcount == count and not code.co_kwonlyargcount
