"""Whether a function that is handed in can be called with what it will get.

Decides that this is asked when it is handed in, and not at its first call, which may come much later, where nobody
listens. What `inspect.signature` cannot tell, as of some builtins, is let pass. A decorator is judged by what it takes
itself: it may hand on something else than it gets.
"""

from __future__ import annotations

import inspect
from types import FunctionType, MethodType
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable


class CallbackSignatureError(RosidlError, TypeError):
    """The caller handed in a function that cannot be called with what it would get."""


def require_signature(function: Callable[..., Any], what: str, *gets: str, hint: str = "") -> None:
    """Raise `CallbackSignatureError` unless `function`, which `what` names, can be called with so many arguments.

    `gets` says in words what they are; `hint` ends the message.
    """
    if _accepts_arguments(function, len(gets)):
        return
    try:
        signature = inspect.signature(function, follow_wrapped=False)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*gets)
    except TypeError as error:
        name = getattr(function, "__name__", type(function).__name__)
        given = f"{len(gets)} argument{'s' * (len(gets) > 1)} ({', '.join(gets)})" if gets else "no argument"
        shown = f"{name}{signature}"
        raise CallbackSignatureError(f"{what} gets {given}, which {shown:.200} cannot take: {error}{hint}") from None


def _accepts_arguments(function: object, count: int) -> bool:
    """Whether it certainly can; a node serves a dozen functions of ours, and a signature takes 15 us to make."""
    if isinstance(function, MethodType):
        function, count = function.__func__, count + 1
    code = function.__code__ if isinstance(function, FunctionType) else None
    return code is not None and code.co_argcount == count and not code.co_kwonlyargcount
