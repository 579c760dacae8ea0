"""The functions that users hand in around a set: keeping them, calling them, judging what they answer.

Decides what callbacks and validators may be and may answer, and what becomes of one that raises: the set is refused
with a reason that names the function, and the traceback is logged, unless whoever added it wants its errors to go on to
whoever sets; a set that is stored already stays. When they are called is `store.py`'s. All run on the thread that sets,
post-set callbacks without any lock; each in a copy of the `contextvars` context of whoever sets, so that it knows for
whom it is called and leaves nothing behind.
"""

from __future__ import annotations

import inspect
from contextvars import copy_context
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.base.registration import RegistrationSet
from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.runtime.loop.callable_checks import is_async
from rosidl_py_gen.runtime.parameters.validation import EMPTY_LIST_REASON
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValueError,
    Parameter,
    ParameterError,
    SetResult,
    checked_parameter,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.base.registration import Registration

    Commit: TypeAlias = Callable[[], None]

ACCEPTED = SetResult(True)


class CallbackAnswerError(ParameterError, TypeError):
    """The author of a parameter callback has to change it: it answered something it must not."""


class RefusedError(ParameterError):
    """Why a set is refused; `failed` names a function that raised, whose traceback is worth a log entry."""

    def __init__(self, reason: str, failed: str = "") -> None:
        super().__init__(reason)
        self.failed = failed


def require_plain(function: object, what: str, gets: str) -> None:
    """Raises `TypeError` for what cannot be called with `gets`, and for async functions: a set waits for nobody."""
    if not callable(function):
        raise TypeError(f"{what} must be a function, got {function!r}")
    if is_async(function):
        raise TypeError(
            f"{what} {_name_of(function)!r} is async, but a set cannot wait for it; give a plain function, which may "
            "start a task"
        )
    require_signature(function, f"{what} {_name_of(function)!r}", gets)


def validate(what: str, validator: Callable[[Any], str | None], value: Any) -> None:
    """Raises `RefusedError` with the validator's text, or because it raised, and `CallbackAnswerError`."""
    answer = call_checked(what, validator, value)
    if answer is None:
        return
    if not isinstance(answer, str):
        raise _wrong_answer(what, answer, "None or a text")
    if answer:
        raise RefusedError(answer)


def call_checked(what: str, function: Callable[..., Any], *arguments: object) -> Any:
    """What the function answers; raises `RefusedError` when it raises."""
    try:
        return copy_context().run(function, *arguments)
    except Exception as error:
        raise _raised(what, error) from error


def _raised(what: str, error: Exception) -> RefusedError:
    return RefusedError(f"{what} raised {type(error).__name__}: {error}", what)


class _Added(NamedTuple):
    function: Callable[..., Any]
    raises: bool
    """Whether its errors go on to whoever sets."""


class SetCallbacks:
    """The callbacks of one store; any thread may add and remove."""

    def __init__(self, on_failure: Callable[[str], None]) -> None:
        self._on_failure = on_failure
        self._added: dict[str, RegistrationSet[_Added]] = {
            kind: RegistrationSet() for kind in ("pre-set", "on-set", "post-set", "mirror")
        }
        self.preparing = False
        """True while mirrors check a set; another set would then be overtaken by the one that is checked."""

    def add(self, kind: str, callback: Callable[..., Any], *, raises: bool = False) -> Registration:
        """Call a function around each set until the answer is closed. Raises `TypeError` for async functions.

        Args:
            kind: ``pre-set``: may replace the list to set. ``on-set``: may refuse it, the newest is asked first. Both
                are called on the thread that sets, and other sets wait for them. ``post-set``: hears of successful
                sets and declarations, and holds up nobody else. ``mirror``: checks values once all others have agreed;
                it raises `RefusedError`, or returns the function that shows them (None when they do not concern it),
                which is called when they are stored, before anybody else hears of them.
            raises: what it raises goes on to whoever sets.
        """
        if kind != "mirror":
            require_plain(callback, f"the {kind} callback", "the list of parameters")
        return self._added[kind].add(_Added(callback, raises))

    def run_pre_set(self, parameters: list[Parameter]) -> list[Parameter]:
        """What pre-set callbacks make of the list. Raises `RefusedError`, `CallbackAnswerError`."""
        if not self._added["pre-set"]:
            return parameters
        wanted: list[Parameter] = []
        for callback, raises in self._added["pre-set"]:
            what = f"the pre-set callback {_name_of(callback)!r}"
            if raises:
                answer = copy_context().run(callback, list(parameters))
            else:
                answer = call_checked(what, callback, list(parameters))
            if not isinstance(answer, (list, tuple)) or not all(isinstance(item, Parameter) for item in answer):
                raise _wrong_answer(what, answer, "a list of Parameter objects")
            try:
                wanted += [checked_parameter(item) for item in answer]
            except (TypeError, InvalidParameterValueError) as error:
                raise CallbackAnswerError(f"{what} returned what cannot be set: {error}") from error
        if not wanted:
            raise RefusedError(EMPTY_LIST_REASON)
        return wanted

    def run_on_set(self, parameters: Sequence[Parameter]) -> tuple[SetResult, list[Commit]]:
        """Ask the on-set callbacks, the newest first, then the mirrors.

        Returns:
            The last consent, and what has to be called once the values are stored.

        Raises:
            RefusedError: one of them refused or raised. CallbackAnswerError.
        """
        result = ACCEPTED
        for callback, raises in reversed(list(self._added["on-set"])):
            try:
                result = copy_context().run(callback, list(parameters))
            except Exception as error:
                if raises:
                    raise
                raise _raised(f"the on-set callback {_name_of(callback)!r}", error) from error
            if type(result) is not SetResult or type(result.successful) is not bool or type(result.reason) is not str:
                result = _as_result(callback, result)
            if not result.successful:
                raise RefusedError(result.reason)
        return result, self._prepared(parameters) if self._added["mirror"] else []

    def _prepared(self, parameters: Sequence[Parameter]) -> list[Commit]:
        changes = {parameter.name: parameter.value for parameter in parameters}
        self.preparing = True
        try:
            found = [prepare(changes) for prepare, _ in self._added["mirror"]]
        finally:
            self.preparing = False
        return [commit for commit in found if commit is not None]

    def run_post_set(self, parameters: Sequence[Parameter]) -> None:
        """Call the post-set callbacks, the newest first; one that raises is logged and the others still hear.

        Raises:
            Exception: what the first one raised that was added with `raises`, once all have heard.
        """
        failed: Exception | None = None
        for callback, raises in reversed(list(self._added["post-set"])):
            try:
                copy_context().run(callback, list(parameters))
            except Exception as error:
                if raises and failed is None:
                    failed = error
                else:
                    self._on_failure(f"the post-set callback {_name_of(callback)!r}")
        if failed is not None:
            raise failed


def _as_result(callback: object, answer: Any) -> SetResult:
    """What looks like a SetResult is one: rcl_interfaces' SetParametersResult, which rclpy's callbacks return, too."""
    successful, reason = getattr(answer, "successful", None), getattr(answer, "reason", None)
    if successful is None or not isinstance(reason, str):
        what = f"the on-set callback {_name_of(callback)!r}"
        raise _wrong_answer(what, answer, "a SetResult with a text as its reason")
    return SetResult(bool(successful), str(reason))


def _wrong_answer(what: str, answer: object, expected: str) -> CallbackAnswerError:
    if inspect.iscoroutine(answer):
        answer.close()  # else Python warns about it, somewhere else
    return CallbackAnswerError(f"{what} returned {answer!r}, expected {expected}")


def _name_of(function: Any) -> str:
    name = getattr(function, "__name__", None)
    return name if isinstance(name, str) else type(function).__name__
