"""The functions that users hand in around a set: keeping them, calling them, judging what they answer.

Decides what callbacks and validators may be and may answer, and what becomes of one that raises: the set is refused
with a reason that names the function, and the traceback is logged; a set that is stored already stays. When they are
called is `store.py`'s. All run on the thread that sets, post-set callbacks without any lock.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen.runtime.loop.callbacks import is_async
from rosidl_py_gen.runtime.parameters.rules import EMPTY_LIST_REASON
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValue,
    Parameter,
    ParameterError,
    ParameterValue,
    SetResult,
    checked_parameter,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    Commit: TypeAlias = Callable[[], None]
    Prepare: TypeAlias = Callable[[Mapping[str, ParameterValue]], Commit | None]
    PreSet: TypeAlias = Callable[[list[Parameter]], list[Parameter]]
    OnSet: TypeAlias = Callable[[list[Parameter]], SetResult]
    PostSet: TypeAlias = Callable[[list[Parameter]], None]

ACCEPTED = SetResult(True)


class CallbackAnswerError(ParameterError, TypeError):
    """The author of a parameter callback has to change it: it answered something it must not."""


class Refused(Exception):
    """Why a set is refused; `culprit` names a function that raised, whose traceback is worth a log entry."""

    def __init__(self, reason: str, culprit: str = "") -> None:
        super().__init__(reason)
        self.culprit = culprit


def require_plain(function: object, what: str) -> None:
    """Raises `TypeError` for what cannot be called, and for async functions: a set waits for nobody."""
    if not callable(function):
        raise TypeError(f"{what} must be a function, got {function!r}")
    if is_async(function):
        raise TypeError(
            f"{what} {_name_of(function)!r} is async, but a set cannot wait for it; give a plain function, which may "
            "start a task"
        )


def validate(culprit: str, validator: Callable[[Any], str | None], value: Any) -> None:
    """Raises `Refused` with the validator's text, or because it raised, and `CallbackAnswerError`."""
    answer = called(culprit, validator, value)
    if answer is None:
        return
    if not isinstance(answer, str):
        raise _wrong_answer(culprit, answer, "None or a text")
    if answer:
        raise Refused(answer)


def called(culprit: str, function: Callable[..., Any], *arguments: object) -> Any:
    """What the function answers; raises `Refused` when it raises."""
    try:
        return function(*arguments)
    except Exception as error:
        raise _raised(culprit, error) from error


def _raised(culprit: str, error: Exception) -> Refused:
    return Refused(f"{culprit} raised {type(error).__name__}: {error}", culprit)


class SetCallbacks:
    """The callbacks of one store; lists are replaced as a whole, so that any thread may add and remove."""

    def __init__(self, on_failure: Callable[[str], None]) -> None:
        self._on_failure = on_failure
        self._pre_set: tuple[PreSet, ...] = ()
        self._on_set: tuple[OnSet, ...] = ()
        self._post_set: tuple[PostSet, ...] = ()
        self._mirrors: tuple[Prepare, ...] = ()
        self.preparing = False
        """True while mirrors check a set; another set would then be overtaken by the one that is checked."""

    def add(self, kind: str, callback: Callable[..., Any]) -> Callable[[], None]:
        """Add to ``pre_set``, ``on_set``, ``post_set`` or ``mirrors``; returns the function that removes it."""
        if kind != "mirrors":
            require_plain(callback, f"the {kind.replace('_', '-')} callback")
        attribute = f"_{kind}"
        setattr(self, attribute, (*getattr(self, attribute), callback))

        def remove() -> None:
            left = list(getattr(self, attribute))
            if callback in left:
                left.remove(callback)
                setattr(self, attribute, tuple(left))

        return remove

    def before(self, parameters: list[Parameter]) -> list[Parameter]:
        """What pre-set callbacks make of the list. Raises `Refused`, `CallbackAnswerError`."""
        if not self._pre_set:
            return parameters
        wanted: list[Parameter] = []
        for callback in self._pre_set:
            culprit = f"the pre-set callback {_name_of(callback)!r}"
            answer = called(culprit, callback, list(parameters))
            if not isinstance(answer, (list, tuple)) or not all(isinstance(item, Parameter) for item in answer):
                raise _wrong_answer(culprit, answer, "a list of Parameter objects")
            try:
                wanted += [checked_parameter(item) for item in answer]
            except (TypeError, InvalidParameterValue) as error:
                raise CallbackAnswerError(f"{culprit} returned what cannot be set: {error}") from error
        if not wanted:
            raise Refused(EMPTY_LIST_REASON)
        return wanted

    def ask(self, parameters: Sequence[Parameter]) -> tuple[SetResult, list[Commit]]:
        """Ask the on-set callbacks, the newest first, then the mirrors.

        Returns:
            The first refusal or the last consent, and what has to be called once the values are stored.

        Raises:
            Refused: one of them raised, or a mirror refused. CallbackAnswerError.
        """
        result = ACCEPTED
        for callback in reversed(self._on_set):
            try:
                result = callback(list(parameters))
            except Exception as error:
                raise _raised(f"the on-set callback {_name_of(callback)!r}", error) from error
            if type(result) is not SetResult or type(result.successful) is not bool or type(result.reason) is not str:
                result = _as_result(callback, result)
            if not result.successful:
                return result, []
        return result, self._prepared(parameters) if self._mirrors else []

    def _prepared(self, parameters: Sequence[Parameter]) -> list[Commit]:
        changes = {parameter.name: parameter.value for parameter in parameters}
        self.preparing = True
        try:
            found = [prepare(changes) for prepare in self._mirrors]
        finally:
            self.preparing = False
        return [commit for commit in found if commit is not None]

    def tell(self, parameters: Sequence[Parameter]) -> None:
        """Call the post-set callbacks, the newest first; one that raises is logged and the others still hear."""
        for callback in reversed(self._post_set):
            try:
                callback(list(parameters))
            except Exception:
                self._on_failure(f"the post-set callback {_name_of(callback)!r}")


def _as_result(callback: OnSet, answer: Any) -> SetResult:
    """What looks like a SetResult is one: rcl_interfaces' SetParametersResult, which rclpy's callbacks return, too."""
    successful, reason = getattr(answer, "successful", None), getattr(answer, "reason", None)
    if successful is None or not isinstance(reason, str):
        culprit = f"the on-set callback {_name_of(callback)!r}"
        raise _wrong_answer(culprit, answer, "a SetResult with a text as its reason")
    return SetResult(bool(successful), str(reason))


def _wrong_answer(culprit: str, answer: object, expected: str) -> CallbackAnswerError:
    if inspect.iscoroutine(answer):
        answer.close()  # else Python warns about it, somewhere else
    return CallbackAnswerError(f"{culprit} returned {answer!r}, expected {expected}")


def _name_of(function: Any) -> str:
    name = getattr(function, "__name__", None)
    return name if isinstance(name, str) else type(function).__name__
