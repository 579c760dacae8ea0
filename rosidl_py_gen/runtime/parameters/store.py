"""The parameters of one node: declare, get, set, describe, list.

A plain object without I/O: events go to the `on_event` function, callbacks are called in place. Decides the order of
checks and what each failure says (docs/internals/protocol.md 9.3, 9.4); the checks themselves are in `validation.py`,
calling users' functions is `callbacks.py`'s. Nothing is stored before every check and callback has agreed, so a refused
set leaves no trace.

Decides, too, that a whole number is a double where one is declared, in overrides and in sets; rclpy refuses it.

Any thread may use it. Sets and declarations exclude each other; the checks, callbacks before the values are stored, and
the event belong to that, post-set callbacks do not. Readers never wait: values that are set together are replaced
together.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.logs.loggers import report_failure
from rosidl_py_gen.runtime.parameters.callbacks import CallbackAnswerError, RefusedError, SetCallbacks
from rosidl_py_gen.runtime.parameters.declaration import coerce_empty_list, declared_descriptor, redescribed
from rosidl_py_gen.runtime.parameters.notifier import Notifier
from rosidl_py_gen.runtime.parameters.overrides import InitialSources
from rosidl_py_gen.runtime.parameters.validation import ListParametersResult, list_names, name_reason, refusal_reason
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterNameError,
    InvalidParameterValueError,
    Parameter,
    ParameterAlreadyDeclaredError,
    ParameterDescriptor,
    ParameterEvent,
    ParameterImmutableError,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterUninitializedError,
    ParameterValue,
    SetResult,
    WrongParameterTypeError,
    widened,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.runtime.parameters.callbacks import Commit

__all__ = ["CallbackAnswerError", "ParameterEvent", "ParameterStore", "SetResult"]

NOT_SET = ParameterValue()
_NESTED_REASON = "parameters cannot be set or declared by a validator"


class ParameterStore:
    """All parameters of a node.

    Args:
        overrides: values from arguments, files and the constructor; they replace defaults when declared.
        allow_undeclared: setting an unknown name declares it, reading one gives NOT_SET.
        on_event: called once per atomic set and per declaration, after the values are stored.
        on_failure: called with a description while the exception of a callback is handled; logs by default.
    """

    def __init__(
        self,
        overrides: Mapping[str, ParameterValue] | None = None,
        *,
        allow_undeclared: bool = False,
        on_event: Callable[[ParameterEvent], None] = lambda event: None,
        on_failure: Callable[[str], None] = report_failure,
    ) -> None:
        self.overrides = dict(overrides or {})
        self.sources = InitialSources()
        self.taken: set[str] = set()
        """Names of the overrides that a declaration took."""
        self.allow_undeclared = allow_undeclared
        self.lock = threading.RLock()
        """Held while something is set or declared; may be taken to do several such things as one."""
        self._on_failure = on_failure
        self.callbacks = SetCallbacks(on_failure)
        """Functions to call around each set."""
        self._notifier = Notifier(on_event, self.callbacks.run_post_set, on_failure)
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
        """Declare one parameter and return its value, which is the override's if there is one.

        The type is the descriptor's when it has one, else the default's; without either the descriptor must say
        `dynamic_typing`. An `optional` parameter keeps its type but may be unset again, and stays declared then. An
        empty list in an override takes the type of the declaration, a whole number that of a double.

        Raises:
            ParameterAlreadyDeclaredError, InvalidParameterNameError: as their names say.
            WrongParameterTypeError: default or override have another type.
            InvalidParameterValueError: a range or a callback refused it.
        """
        with self.lock, self.sources.declaring(name, ignore_override):
            if reason := name_reason(name):
                raise InvalidParameterNameError(reason)
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
                self.taken.add(name)
            self._values = {**self._values, name: value}
            for commit in commits:
                commit()
            self._notifier.event(ParameterEvent(new=(parameter,) if value.is_set else ()))
        self._notifier.after_set([parameter])
        return value

    @contextlib.contextmanager
    def declare_batch(self) -> Iterator[list[str]]:
        """Several declarations as one, whose names the caller adds to the list; nobody hears before all are made.

        When the block raises they are forgotten, and nobody ever hears of them.
        """
        declared: list[str] = []
        with self._notifier.batch(self.lock) as batch:
            try:
                yield declared
            except BaseException:
                batch.discard(declared)
                for name in declared:
                    self.forget(name)
                raise

    def _run_validation(self, parameters: Sequence[Parameter], reason: str) -> tuple[SetResult, list[Commit]]:
        """Consent, and what to call once the values are stored; raises `RefusedError`, for `reason` or theirs."""
        if reason:
            raise RefusedError(reason)
        if self.callbacks.preparing:
            raise RefusedError(_NESTED_REASON)
        return self.callbacks.run_on_set(parameters)

    def declare_overrides(self) -> None:
        """Declare every override that is not declared yet, statically typed by its value."""
        for name, value in self.overrides.items():
            if name not in self._values:
                self.declare(name, value)

    def undeclare(self, name: str) -> None:
        """Forget a parameter without an event; raises `ParameterNotDeclaredError`, `ParameterImmutableError`."""
        with self.lock:
            if name not in self._values:
                raise ParameterNotDeclaredError([name])
            if self._descriptors[name].read_only:
                raise ParameterImmutableError(f"parameter {name!r} is read-only and cannot be undeclared")
            self.forget(name)

    def has(self, name: str) -> bool:
        """True when declared, with or without a value."""
        return name in self._values

    # --------------------------------------------------------------------------------------------------- reading

    def get(self, name: str) -> ParameterValue:
        """The value; NOT_SET only under dynamic typing or for undeclared names when those are allowed.

        Raises `ParameterNotDeclaredError`, `ParameterUninitializedError`.
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
        """Several values as they are at one moment, in order; raises as `get`."""
        values = self._values
        return [self._value_in(values, name) for name in names]

    def get_all(self, names: Iterable[str]) -> list[ParameterValue]:
        """Values, as the get_parameters service answers: in order, or nothing at all when one name has no value."""
        try:
            return self.get_values(names)
        except (ParameterNotDeclaredError, ParameterUninitializedError):
            return []

    def get_or_unset(self, name: str) -> ParameterValue:
        """The value, NOT_SET for one that is unset; raises `ParameterNotDeclaredError` unless that is allowed."""
        self._require(name)
        return self._values.get(name, NOT_SET)

    def types(self, names: Iterable[str]) -> list[ParameterType]:
        """Types, as the get_parameter_types service answers; empty when one name is not declared."""
        asked = list(names)
        if self._missing(asked):
            return []
        values = self._values
        return [values.get(name, NOT_SET).type for name in asked]

    def describe(self, name: str) -> ParameterDescriptor:
        """The descriptor; `ParameterNotDeclaredError`, or an empty one for undeclared names when those are allowed."""
        self._require(name)
        return self._descriptors.get(name) or ParameterDescriptor(name=name)

    def describe_all(self, names: Iterable[str]) -> list[ParameterDescriptor]:
        """Descriptors, as the describe_parameters service answers; empty when one name is not declared."""
        asked = list(names)
        return [] if self._missing(asked) else [self.describe(name) for name in asked]

    def listing(self, prefixes: Sequence[str] = (), depth: int = 0) -> ListParametersResult:
        """Names and groups; depth 0 has no limit."""
        return list_names(self._values, prefixes, depth)

    def values(self) -> dict[str, ParameterValue]:
        """A copy of all declared names and values."""
        return dict(self._values)

    # --------------------------------------------------------------------------------------------------- setting

    def set_individually(self, parameters: Iterable[Parameter], *, require_declared: bool = False) -> list[SetResult]:
        """Set one by one; a failure does not stop the next."""
        return [self.set_atomically([one], require_declared=require_declared) for one in parameters]

    def set_atomically(self, parameters: Iterable[Parameter], *, require_declared: bool = False) -> SetResult:
        """Set all or nothing, with one event for all; the result says why a value or a callback was not fine.

        Raises:
            CallbackAnswerError: a callback or validator answered something it must not.
            Exception: whatever a callback raises that was added with `raises`.
            ParameterNotDeclaredError: with `require_declared`, where the result would say so otherwise.
        """
        try:
            with self.lock:
                wanted = [self._widened(one) for one in self.callbacks.run_pre_set(list(parameters))]
                if require_declared and (missing := self._missing([one.name for one in wanted])):
                    raise ParameterNotDeclaredError(missing)
                result, commits = self._run_validation(wanted, self._reason(wanted))
                event = self._apply(wanted)
                for commit in commits:
                    commit()
                self._notifier.event(event)
        except RefusedError as refused:
            refusal = refused
        else:
            self._notifier.after_set(wanted)
            return result
        if refusal.failed:
            self._report(refusal)
        return SetResult(False, str(refusal))

    def set_descriptor(
        self, name: str, descriptor: ParameterDescriptor, alternative: ParameterValue = NOT_SET
    ) -> ParameterValue:
        """Describe a parameter anew, and return its value: the one it has, or else the alternative, which is set then.

        Without a type the descriptor keeps that of the parameter. Nothing happens to an undeclared one where those are
        allowed.

        Raises:
            ParameterNotDeclaredError, ParameterImmutableError: the latter for one that is read-only so far.
            InvalidParameterValueError: neither value fits, a callback refuses the alternative, or a range makes no
                sense; all stays as it was. TypeError: the descriptor is none.
        """
        with self.lock:
            self._require(name)
            if name not in self._values:
                return NOT_SET
            if self._descriptors[name].read_only:
                raise ParameterImmutableError(f"parameter {name!r} is read-only and cannot be described anew")
            described, now, reason = redescribed(self._descriptors[name], self._values[name], descriptor, alternative)
            is_new = now.value != self._values[name]
            try:
                if reason:
                    raise RefusedError(reason)
                commits = self._run_validation([now], "")[1] if is_new else []
            except RefusedError as refusal:
                text = f"parameter {name!r} cannot be described so while it is {now.value.value!r}: {refusal}"
                raise InvalidParameterValueError(text) from refusal.__cause__
            self._descriptors[name] = described
            if is_new:
                event = self._apply([now])
                for commit in commits:
                    commit()
                self._notifier.event(event)
        if is_new:
            self._notifier.after_set([now])
        return now.value

    def _report(self, refusal: RefusedError) -> None:
        """Report what the function of the user raised, not what became of it."""
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

    def _reason(self, wanted: Sequence[Parameter]) -> str:
        """Why the list cannot be set, before callbacks are asked; an empty text when it can."""
        missing = self._missing([parameter.name for parameter in wanted])
        if missing:
            return str(ParameterNotDeclaredError(missing))
        for parameter in wanted:
            described = self._descriptors.get(parameter.name)
            if described is None:
                reason = name_reason(parameter.name)
            else:
                # An optional parameter is unset like a declaration without a value.
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
        # A name given twice counts once, with its last value, so that the event says what a listener must believe.
        once = parameters if len(parameters) == 1 else {parameter.name: parameter for parameter in parameters}.values()
        values = dict(self._values)  # What is set together becomes visible together.
        for parameter in once:
            name, value = parameter.name, parameter.value
            had_value = values.get(name, NOT_SET).is_set
            if value.is_set:
                (changed if had_value else new).append(parameter)
                described = self._descriptors.get(name)
                if described is None or described.dynamic_typing:
                    self._retype(name, value)
                values[name] = value
                continue
            if had_value:
                deleted.append(parameter)
            if name in self._optional:
                values[name] = value
            else:
                # Only dynamic typing gets here; unsetting is undeclaring.
                values.pop(name, None)
                self._descriptors.pop(name, None)
        self._values = values
        return ParameterEvent(tuple(new), tuple(changed), tuple(deleted))

    def _retype(self, name: str, value: ParameterValue) -> None:
        """Under dynamic typing the descriptor's type follows the value; an undeclared name becomes declared so."""
        described = self._descriptor(name)
        if described.dynamic_typing:
            self._descriptors[name] = replace(described, type=value.type)

    def forget(self, name: str) -> None:
        """Remove a parameter without checks and without an event, as if it had never been declared."""
        self._values = {known: value for known, value in self._values.items() if known != name}
        self._descriptors.pop(name, None)
        self._optional.discard(name)

    def _missing(self, names: Iterable[str]) -> list[str]:
        values = self._values
        return [] if self.allow_undeclared else [name for name in names if name not in values]

    def _require(self, name: str) -> None:
        if self._missing([name]):
            raise ParameterNotDeclaredError([name])
