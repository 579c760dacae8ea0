"""Parameters of one node, without I/O: declare, get, set, describe, list; and the callbacks and validators of a set.

Nothing is stored before all checks and callbacks have agreed. An integer is converted if a double is declared, in
overrides and in sets; rclpy refuses the integer. Source: docs/internals/protocol.md 9.3, 9.4.

Thread: any. Sets and declarations exclude each other, including their checks, callbacks and event, but not the post-set
callbacks. Readers never wait: each set replaces the dict of values.

If a callback raises, the parameters are not set: the change is refused with a reason that names the function, and the
traceback is logged. Exceptions of callbacks that were added with `raises` are raised to the caller instead. Exceptions
of callbacks after the change do not undo it. All callbacks run on the thread that sets, each in a copy of the thread's
`contextvars` context.
"""

from __future__ import annotations

import contextlib
import inspect
import threading
from contextvars import copy_context
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.runtime.logs import report_failure
from rosidl_py_gen.runtime.loop.callbacks import is_async
from rosidl_py_gen.runtime.parameters.values import (
    EMPTY_LIST_REASON,
    InvalidParameterNameError,
    InvalidParameterValueError,
    ListParametersResult,
    Parameter,
    ParameterAlreadyDeclaredError,
    ParameterDescriptor,
    ParameterError,
    ParameterEvent,
    ParameterImmutableError,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterUninitializedError,
    ParameterValue,
    SetResult,
    WrongParameterTypeError,
    apply_descriptor,
    checked_parameter,
    coerce_empty_list,
    declared_descriptor,
    list_names,
    name_reason,
    refusal_reason,
    widened,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.base.callbacks import Registration

NOT_SET = ParameterValue()
_NESTED_REASON = "parameters cannot be set or declared by a validator"


class ParameterStore:
    """All parameters of a node.

    Args:
        overrides: values from arguments, files and the constructor, which replace the defaults of declarations.
        sources: file or argument that sets an override, by name; error texts name it if the value is refused.
        allow_undeclared: setting an unknown name declares it, reading an unknown name returns NOT_SET.
        on_event: called for each atomic set and each declaration, after the values are stored.
        on_failure: called with a description while the exception of a callback is handled; logs by default.

    Attributes:
        used_overrides: names of the overrides that a declaration has used.
        was_refused: an override was refused, which ends most programs before they declare other parameters.
        lock: locked during sets and declarations; lock it to combine several of them.
    """

    def __init__(
        self,
        overrides: Mapping[str, ParameterValue] | None = None,
        *,
        sources: Mapping[str, str] | None = None,
        allow_undeclared: bool = False,
        on_event: Callable[[ParameterEvent], None] = lambda event: None,
        on_failure: Callable[[str], None] = report_failure,
    ) -> None:
        self.overrides = dict(overrides or {})
        self._sources = sources or {}
        self.used_overrides: set[str] = set()
        self.was_refused = False
        self.allow_undeclared = allow_undeclared
        self.lock = threading.RLock()
        self._on_event = on_event
        self._on_failure = on_failure
        self.callbacks = SetCallbacks(on_failure)
        self._batch: list[tuple[ParameterEvent, Sequence[Parameter]]] | None = None
        """Changes made in a block of `declare_batch`; their events and post-set callbacks follow when the block ends.
        Lock: lock."""
        self._values: dict[str, ParameterValue] = {}
        self._descriptors: dict[str, ParameterDescriptor] = {}
        self._optional: set[str] = set()

    # ------------------------------------------------------------------------------------------------- declaring

    def declare(
        self,
        name: str,
        default: ParameterValue = NOT_SET,
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
        optional: bool = False,
    ) -> ParameterValue:
        """Declare one parameter and return its value: the override, or else the default.

        The type of the parameter is the type in the descriptor, or else the type of the default; without either, the
        descriptor must have `dynamic_typing`.

        Args:
            name: name of the parameter.
            default: value if there is no override.
            descriptor: descriptor; None: an empty one.
            ignore_override: use the default even if there is an override.
            optional: the parameter keeps its type when it has no value; unsetting it does not undeclare it.

        Raises:
            ParameterError, TypeError: as in `Node.declare_parameter`.
        """
        if reason := name_reason(name):
            raise InvalidParameterNameError(reason)
        with self.lock, self._naming_source("" if ignore_override else self._sources.get(name, "")):
            if name in self._values:
                raise ParameterAlreadyDeclaredError(f"parameter {name!r} is already declared")
            described = declared_descriptor(name, default, descriptor)
            is_overridden = name in self.overrides and not ignore_override
            value = coerce_empty_list(self.overrides[name] if is_overridden else default, described)
            if is_overridden and not described.dynamic_typing:
                value = widened(value, described.type)
            if value.is_set and not described.dynamic_typing and value.type is not described.type:
                raise WrongParameterTypeError(name, described.type.name, value.type.name)
            parameter = Parameter(name, value)
            try:
                _, commits = self._run_validation([parameter], refusal_reason(parameter, described, declaring=True))
            except RefusedError as refusal:
                reason = f"parameter {name!r} cannot be declared as {value.value!r}: {refusal}"
                raise InvalidParameterValueError(reason) from refusal.__cause__
            self._descriptors[name] = replace(described, type=value.type) if described.dynamic_typing else described
            if optional:
                self._optional.add(name)
            if is_overridden:
                self.used_overrides.add(name)
            self._values = {**self._values, name: value}
            event = ParameterEvent(new=(parameter,) if value.is_set else ())
            is_published = self._publish(event, [parameter], commits)
        if is_published:
            self.callbacks.run_post_set([parameter])
        return value

    @contextlib.contextmanager
    def _naming_source(self, source: str) -> Iterator[None]:
        """Run a block, and add the file or argument that sets a refused initial value, if it is known, to the error of
        the block.
        """
        try:
            yield
        except (InvalidParameterValueError, WrongParameterTypeError) as error:
            if source:
                self.was_refused, error.source = True, source
                error.args = (f"{error}; the value is from {source}",)
            raise

    @contextlib.contextmanager
    def declare_batch(self) -> Iterator[list[str]]:
        """Combine the declarations in a ``with`` block.

        The block gets a list, to which the caller appends the declared names. Events and post-set callbacks follow at
        the end of the block. If the block raises, the declarations are undone, without events and callbacks.
        """
        declared: list[str] = []
        batch: list[tuple[ParameterEvent, Sequence[Parameter]]] = []
        try:
            with self.lock:
                outer, self._batch = self._batch, batch
                try:
                    yield declared
                except BaseException:
                    kept = [(event, [one for one in items if one.name not in declared]) for event, items in batch]
                    batch[:] = [(event.without(declared), items) for event, items in kept if items]
                    for name in declared:
                        self.forget(name)
                    raise
                finally:
                    self._batch = outer
                    batch = [change for change in batch if self._publish(*change)]
        finally:
            with contextlib.ExitStack() as calls:  # makes all calls even if one raises
                for _, parameters in reversed(batch):
                    calls.callback(self.callbacks.run_post_set, parameters)

    def _run_validation(self, parameters: Sequence[Parameter], reason: str) -> tuple[SetResult, list[Commit]]:
        """Call the on-set callbacks and the objects of `declare_parameters`.

        Returns the last result, and functions to call after storing.

        Raises:
            RefusedError: `reason` is not empty, a callback refuses the parameters, or a validator tries to set
                parameters.
        """
        if reason:
            raise RefusedError(reason)
        if self.callbacks.preparing:
            raise RefusedError(_NESTED_REASON)
        return self.callbacks.run_on_set(parameters)

    def _publish(self, event: ParameterEvent, parameters: Sequence[Parameter], commits: Iterable[Commit] = ()) -> bool:
        """Publish the event of a change, or add the change to the batch of declarations. Lock: lock must be held.

        Returns:
            True if the caller must call the post-set callbacks, without the lock.
        """
        for commit in commits:
            commit()
        if self._batch is not None:
            self._batch.append((event, parameters))
            return False
        try:
            self._on_event(event)
        except Exception:
            self._on_failure("publishing a parameter event")
        return True

    def declare_overrides(self) -> None:
        """Declare every override that is not declared yet, with the type of its value, else with dynamic typing."""
        for name, value in self.overrides.items():
            if name not in self._values:
                self.declare(name, value, None if value.is_set else ParameterDescriptor(dynamic_typing=True))

    def undeclare(self, name: str) -> None:
        """Remove a parameter without an event.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            ParameterImmutableError: the parameter is read-only.
        """
        with self.lock:
            if name not in self._values:
                raise ParameterNotDeclaredError([name])
            if self._descriptors[name].read_only:
                raise ParameterImmutableError(f"parameter {name!r} is read-only and cannot be undeclared")
            self.forget(name)

    def has(self, name: str) -> bool:
        """Return True if the parameter is declared, with or without a value."""
        return name in self._values

    # --------------------------------------------------------------------------------------------------- reading

    def get(self, name: str) -> ParameterValue:
        """Return the value of a parameter; NOT_SET if it has dynamic typing and no value.

        The value is also NOT_SET for an undeclared name if the node allows undeclared parameters.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            ParameterUninitializedError: the parameter has no value.
        """
        return self._value_in(self._values, name)

    def _value_in(self, values: Mapping[str, ParameterValue], name: str) -> ParameterValue:
        value = values.get(name)
        if value is None:
            if self.allow_undeclared:
                return NOT_SET
            raise ParameterNotDeclaredError([name])
        if not value.is_set and not self._descriptor(name).dynamic_typing:
            raise ParameterUninitializedError(f"parameter {name!r} is declared but has no value yet")
        return value

    def get_values(self, names: Iterable[str]) -> list[ParameterValue]:
        """Return the values of several parameters, read at one moment, in the order of the names.

        Raises:
            ParameterNotDeclaredError: a parameter is not declared.
            ParameterUninitializedError: a parameter has no value.
        """
        values = self._values
        return [self._value_in(values, name) for name in names]

    def get_all(self, names: Iterable[str]) -> list[ParameterValue]:
        """Return the values for a get_parameters response: an empty list if one of the names has no value."""
        try:
            return self.get_values(names)
        except (ParameterNotDeclaredError, ParameterUninitializedError):
            return []

    def get_or_unset(self, name: str) -> ParameterValue:
        """Return the value of a parameter, or NOT_SET if it has none.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared, and the node does not allow undeclared parameters.
        """
        self._require(name)
        return self._values.get(name, NOT_SET)

    def types(self, names: Iterable[str]) -> list[ParameterType]:
        """Return the types for a get_parameter_types response: an empty list if one of the names is not declared."""
        names, values = list(names), self._values
        return [] if self._missing(names) else [values.get(name, NOT_SET).type for name in names]

    def describe(self, name: str) -> ParameterDescriptor:
        """Return the descriptor of a parameter; an empty one for an undeclared name if the node allows undeclared ones.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
        """
        self._require(name)
        return self._descriptors.get(name) or ParameterDescriptor(name=name)

    def describe_all(self, names: Iterable[str]) -> list[ParameterDescriptor]:
        """Return the descriptors for a describe_parameters response: an empty list if one name is not declared."""
        names = list(names)
        return [] if self._missing(names) else [self.describe(name) for name in names]

    def listing(self, prefixes: Sequence[str] = (), depth: int = 0) -> ListParametersResult:
        """Return the names and groups of parameters below prefixes (empty: all); depth 0 is unlimited."""
        return list_names(self._values, prefixes, depth)

    def values(self) -> dict[str, ParameterValue]:
        """Return the values of all declared parameters by name.

        The value is NOT_SET for a parameter without a value.
        """
        return dict(self._values)

    # --------------------------------------------------------------------------------------------------- setting

    def set_individually(self, parameters: Iterable[Parameter], *, require_declared: bool = False) -> list[SetResult]:
        """Set each parameter separately, and return a result for each; a refused one does not affect the others."""
        return [self.set_atomically([parameter], require_declared=require_declared) for parameter in parameters]

    def set_atomically(self, parameters: Iterable[Parameter], *, require_declared: bool = False) -> SetResult:
        """Set all parameters or none, with one event; the result contains the reason of a refusal.

        Raises:
            ParameterNotDeclaredError: `require_declared`, and a parameter is not declared.
            CallbackAnswerError: a callback returned an invalid result.
            Exception: raised by a callback that was added with `raises`.
        """
        try:
            with self.lock:
                requested = [self._widened(item) for item in self.callbacks.run_pre_set(list(parameters))]
                if require_declared and (missing := self._missing([item.name for item in requested])):
                    raise ParameterNotDeclaredError(missing)
                result, commits = self._run_validation(requested, self._reason(requested))
                is_published = self._publish(self._apply(requested), requested, commits)
        except RefusedError as refused:
            refusal = refused
        else:
            if is_published:
                self.callbacks.run_post_set(requested)
            return result
        if refusal.failed:
            self._report(refusal)
        return SetResult(False, str(refusal))

    def set_descriptor(
        self, name: str, descriptor: ParameterDescriptor, alternative: ParameterValue = NOT_SET
    ) -> ParameterValue:
        """Replace the descriptor of a parameter, and return its value (see `Node.set_descriptor`)."""
        with self.lock:
            self._require(name)
            if name not in self._values:
                return NOT_SET
            if self._descriptors[name].read_only:
                raise ParameterImmutableError(f"parameter {name!r} is read-only; its descriptor cannot be changed")
            described, parameter, reason = apply_descriptor(
                self._descriptors[name], self._values[name], descriptor, alternative
            )
            is_changed, is_published = parameter.value != self._values[name], False
            try:
                if reason:
                    raise RefusedError(reason)
                commits = self._run_validation([parameter], "")[1] if is_changed else []
            except RefusedError as refusal:
                value = parameter.value.value
                text = f"parameter {name!r} cannot have this descriptor with the value {value!r}: {refusal}"
                raise InvalidParameterValueError(text) from refusal.__cause__
            self._descriptors[name] = described
            if is_changed:
                is_published = self._publish(self._apply([parameter]), [parameter], commits)
        if is_published:
            self.callbacks.run_post_set([parameter])
        return parameter.value

    def _report(self, refusal: RefusedError) -> None:
        """Report the exception of a callback that caused a refusal, not the `RefusedError` that was raised because of
        it.
        """
        try:
            raise refusal.__cause__ or refusal
        except Exception:
            self._on_failure(refusal.failed)

    def _widened(self, parameter: Parameter) -> Parameter:
        name, value = parameter
        described = self._descriptors.get(name)
        if described is None or described.type is value.type or described.dynamic_typing:
            return parameter
        return Parameter(name, widened(value, described.type))

    def _reason(self, parameters: Sequence[Parameter]) -> str:
        """Return the reason why the parameters cannot be set; "" if they can be set."""
        missing = self._missing([parameter.name for parameter in parameters])
        if missing:
            return str(ParameterNotDeclaredError(missing))
        for parameter in parameters:
            described = self._descriptors.get(parameter.name)
            if described is None:
                reason = name_reason(parameter.name)
            else:
                # Unsetting an optional parameter is like declaring it without a value.
                unsetting = not parameter.value.is_set and parameter.name in self._optional and not described.read_only
                reason = refusal_reason(parameter, described, declaring=unsetting)
            if reason:
                return reason
        return ""

    def _descriptor(self, name: str) -> ParameterDescriptor:
        return self._descriptors.get(name) or ParameterDescriptor(name=name, dynamic_typing=True)

    def _apply(self, parameters: Sequence[Parameter]) -> ParameterEvent:
        new: list[Parameter] = []
        changed: list[Parameter] = []
        deleted: list[Parameter] = []
        # The last value of a name counts, so that the event agrees with the stored values.
        unique = {parameter.name: parameter for parameter in parameters}.values()
        values = dict(self._values)  # a copy, so that readers see all changes at once
        for parameter in unique:
            name, value = parameter.name, parameter.value
            had_value = values.get(name, NOT_SET).is_set
            if value.is_set:
                (changed if had_value else new).append(parameter)
                described = self._descriptors.get(name)
                if described is None or described.dynamic_typing:
                    self._descriptors[name] = replace(self._descriptor(name), type=value.type)
                values[name] = value
                continue
            if had_value:
                deleted.append(parameter)
            if name in self._optional:
                values[name] = value
            else:
                # Unsetting a parameter with dynamic typing undeclares it.
                values.pop(name, None)
                self._descriptors.pop(name, None)
        self._values = values
        return ParameterEvent(tuple(new), tuple(changed), tuple(deleted))

    def forget(self, name: str) -> None:
        """Remove a parameter without checks and without an event."""
        self._values = {key: value for key, value in self._values.items() if key != name}
        self._descriptors.pop(name, None)
        self._optional.discard(name)

    def _missing(self, names: Iterable[str]) -> list[str]:
        values = self._values
        return [] if self.allow_undeclared else [name for name in names if name not in values]

    def _require(self, name: str) -> None:
        if self._missing([name]):
            raise ParameterNotDeclaredError([name])


# ------------------------------------------------------------------------------------------------------------ callbacks

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
