"""Callbacks and validators that are called when parameters are set: registration, calls, and checks of their return
values.

If a callback raises, the parameters are not set: the change is refused with a reason that names the function, and the
traceback is logged. Exceptions of callbacks that were added with `raises` are raised to the caller instead. Exceptions
of callbacks after the change do not undo it. All callbacks run on the thread that sets, each in a copy of the thread's
`contextvars` context.
"""

from __future__ import annotations

import inspect
from contextvars import copy_context
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.runtime.loop.user_callback import is_async
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

    from rosidl_py_gen.base.callbacks import Registration

Commit: TypeAlias = "Callable[[], None]"
ACCEPTED = SetResult(True)


class CallbackAnswerError(ParameterError, TypeError):
    """Raised if a parameter callback or validator returns a value of a wrong type."""


class RefusedError(ParameterError):
    """Raised internally with the reason why setting parameters is refused.

    Attributes:
        failed: description of the callback that raised an exception, such as its name; "" if none did.
    """

    def __init__(self, reason: str, failed: str = "") -> None:
        super().__init__(reason)
        self.failed = failed


def require_plain(function: object, subject: str, argument: str) -> None:
    """Raise `TypeError` unless `function` is a plain (not async) function that can be called with one argument.

    Args:
        function: callback of the user.
        subject: kind of the callback for the error text.
        argument: description of the argument for the error text.
    """
    if not callable(function):
        raise TypeError(f"{subject} must be a function, got {function!r}")
    if is_async(function):
        raise TypeError(
            f"{subject} {_name_of(function)!r} is async, but a set cannot wait for it; pass a plain function, which "
            "may start a task"
        )
    require_signature(function, f"{subject} {_name_of(function)!r}", argument)


def validate(subject: str, validator: Callable[[Any], str | None], value: Any) -> None:
    """Call a validator (user's function that returns None, or the reason to refuse a value).

    Raises:
        RefusedError: the validator returned a reason, or raised.
        CallbackAnswerError: the validator returned something else.
    """
    reason = call_checked(subject, validator, value)
    if not isinstance(reason, str | None):
        raise _wrong_return(subject, reason, "None or a str")
    if reason:
        raise RefusedError(reason)


def call_checked(subject: str, function: Callable[..., Any], *arguments: object) -> Any:
    """Call a function in a copy of the `contextvars` context, and return its result.

    Raises:
        RefusedError: the function raised; the text contains `subject` and the exception.
    """
    try:
        return copy_context().run(function, *arguments)
    except Exception as error:
        raise RefusedError(f"{subject} raised {type(error).__name__}: {error}", subject) from error


class _Callback(NamedTuple):
    function: Callable[..., Any]
    raises: bool

    def call(self, subject: str, parameters: Sequence[Parameter]) -> Any:
        """Call the callback of the user with a list of parameters, and return its result.

        Raises:
            RefusedError: the callback raised, and was not added with `raises`; else its exception is raised.
        """
        if self.raises:
            return copy_context().run(self.function, list(parameters))
        return call_checked(subject, self.function, list(parameters))


class SetCallbacks:
    """Callbacks that are called when parameters of one node are set. Thread: any."""

    def __init__(self, on_failure: Callable[[str], None]) -> None:
        self._on_failure = on_failure
        self._callbacks: dict[str, RegistrationSet[_Callback]] = {
            kind: RegistrationSet() for kind in ("pre-set", "on-set", "post-set", "bound-object")
        }
        self.preparing = False
        """True while the objects that `declare_parameters` returns check new values; their validators must not set
        parameters then."""

    def add(self, kind: str, callback: Callable[..., Any], *, raises: bool = False) -> Registration:
        """Register a function to be called around each set of parameters, until the returned registration is closed.

        Args:
            kind: ``pre-set``: may replace the list of parameters. ``on-set``: may refuse the list; the newest callback
                is called first. Other sets wait for both. ``post-set``: called after successful sets and declarations,
                without a lock. ``bound-object``: checks values after all other callbacks agreed; it raises
                `RefusedError`, or returns a function that is called when the values are stored, before the event, or
                None.
            callback: plain function that gets the list of parameters (``bound-object``: a dict of names and values).
            raises: pass exceptions of the callback to the caller of the set.

        Raises:
            TypeError: the callback is async.
        """
        if kind != "bound-object":
            require_plain(callback, f"the {kind} callback", "the list of parameters")
        return self._callbacks[kind].add(_Callback(callback, raises))

    def run_pre_set(self, parameters: list[Parameter]) -> list[Parameter]:
        """Call the pre-set callbacks, which may replace the parameters to set, and return the joined lists of
        parameters that they return.

        Raises:
            RefusedError: the result is empty, or a callback raised.
            CallbackAnswerError: a callback returned something else than a list of valid parameters.
        """
        if not self._callbacks["pre-set"]:
            return parameters
        result: list[Parameter] = []
        for callback in self._callbacks["pre-set"]:
            subject = f"the pre-set callback {_name_of(callback.function)!r}"
            replaced = callback.call(subject, parameters)
            if not isinstance(replaced, (list, tuple)) or not all(isinstance(item, Parameter) for item in replaced):
                raise _wrong_return(subject, replaced, "a list of Parameter objects")
            try:
                result += [checked_parameter(item) for item in replaced]
            except (TypeError, InvalidParameterValueError) as error:
                raise CallbackAnswerError(f"{subject} returned a parameter that cannot be set: {error}") from error
        if not result:
            raise RefusedError(EMPTY_LIST_REASON)
        return result

    def run_on_set(self, parameters: Sequence[Parameter]) -> tuple[SetResult, list[Commit]]:
        """Call the on-set callbacks, newest first, then the objects that `declare_parameters` has returned.

        All may refuse the parameters.

        Returns:
            The last result, and functions to call once the values are stored.

        Raises:
            RefusedError: a callback refused the parameters, or raised.
            CallbackAnswerError: a callback returned something else than a `SetResult`.
        """
        result = ACCEPTED
        for callback in reversed(list(self._callbacks["on-set"])):
            subject = f"the on-set callback {_name_of(callback.function)!r}"
            result = callback.call(subject, parameters)
            if type(result) is not SetResult or type(result.successful) is not bool or type(result.reason) is not str:
                result = _as_result(subject, result)
            if not result.successful:
                raise RefusedError(result.reason)
        return result, self._prepare_bound_objects(parameters) if self._callbacks["bound-object"] else []

    def _prepare_bound_objects(self, parameters: Sequence[Parameter]) -> list[Commit]:
        changes = {parameter.name: parameter.value for parameter in parameters}
        self.preparing = True
        try:
            commits = [prepare(changes) for prepare, _ in self._callbacks["bound-object"]]
        finally:
            self.preparing = False
        return [commit for commit in commits if commit is not None]

    def run_post_set(self, parameters: Sequence[Parameter]) -> None:
        """Call the post-set callbacks, newest first, after parameters were set or declared.

        Exceptions of callbacks are logged, except for the first exception of a callback that was added with `raises`,
        which is raised after all calls.
        """
        failure: Exception | None = None
        for callback, raises in reversed(list(self._callbacks["post-set"])):
            try:
                copy_context().run(callback, list(parameters))
            except Exception as error:
                if raises and failure is None:
                    failure = error
                else:
                    self._on_failure(f"the post-set callback {_name_of(callback)!r}")
        if failure is not None:
            raise failure


def _as_result(subject: str, value: Any) -> SetResult:
    """Return the `SetResult` for an object with its fields, such as rcl_interfaces' SetParametersResult.

    Raises:
        CallbackAnswerError: the object does not have the fields.
    """
    successful, reason = getattr(value, "successful", None), getattr(value, "reason", None)
    if successful is None or not isinstance(reason, str):
        raise _wrong_return(subject, value, "a SetResult with a str as its reason")
    return SetResult(bool(successful), str(reason))


def _wrong_return(subject: str, value: object, expected: str) -> CallbackAnswerError:
    if inspect.iscoroutine(value):
        value.close()  # else Python warns later that it was not awaited
    return CallbackAnswerError(f"{subject} returned {value!r}, expected {expected}")


def _name_of(function: Any) -> str:
    name = getattr(function, "__name__", None)
    return name if isinstance(name, str) else type(function).__name__
