"""The parameters of one node: declare, get, set, describe, list.

A plain object without I/O: events go to the `on_event` function, callbacks are called in place. Decides the order of
checks and what each failure says (protocol.md 9.3, 9.4); the rules themselves are in `parameter_rules.py`. Nothing is
stored before every check and callback has agreed, so a refused set leaves no trace.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.runtime.parameter_rules import EMPTY_LIST_REASON, Listing, descriptor_problem, list_names
from rosidl_py_gen.runtime.parameter_values import (
    InvalidParameterName,
    InvalidParameterValue,
    Parameter,
    ParameterAlreadyDeclared,
    ParameterDescriptor,
    ParameterImmutable,
    ParameterNotDeclared,
    ParameterType,
    ParameterUninitialized,
    ParameterValue,
    WrongParameterType,
    parameter_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

NOT_SET = ParameterValue()
_Callback = TypeVar("_Callback")


@dataclass(frozen=True, slots=True)
class SetResult:
    """The answer to one set request; `reason` is empty on success unless a callback gave one."""

    successful: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ParameterEvent:
    """What one set or declaration did. Changed parameters had a value before, even an equal one."""

    new: tuple[Parameter, ...] = ()
    changed: tuple[Parameter, ...] = ()
    deleted: tuple[Parameter, ...] = ()


class ParameterStore:
    """All parameters of a node.

    Args:
        overrides: values from arguments, files and the constructor; they replace defaults when declared.
        allow_undeclared: setting an unknown name declares it, reading one gives NOT_SET.
        on_event: called once per atomic set and per declaration, after the values are stored.
    """

    def __init__(
        self,
        overrides: Mapping[str, ParameterValue] | None = None,
        *,
        allow_undeclared: bool = False,
        on_event: Callable[[ParameterEvent], None] = lambda event: None,
    ) -> None:
        self.overrides = dict(overrides or {})
        self.allow_undeclared = allow_undeclared
        self._on_event = on_event
        self._values: dict[str, ParameterValue] = {}
        self._descriptors: dict[str, ParameterDescriptor] = {}
        self._pre_set: list[Callable[[list[Parameter]], list[Parameter]]] = []
        self._on_set: list[Callable[[list[Parameter]], SetResult]] = []
        self._post_set: list[Callable[[list[Parameter]], None]] = []
        self._appliers: list[Callable[[Mapping[str, ParameterValue]], None]] = []
        self._optional: set[str] = set()

    # ------------------------------------------------------------------------------------------------- callbacks

    def add_pre_set_callback(self, callback: Callable[[list[Parameter]], list[Parameter]]) -> Callable[[], None]:
        """May replace the list to set; all answers are joined. Returns the function that removes it."""
        return _added(self._pre_set, callback)

    def add_on_set_callback(self, callback: Callable[[list[Parameter]], SetResult]) -> Callable[[], None]:
        """May refuse a set, the newest is asked first. Returns the function that removes it."""
        return _added(self._on_set, callback)

    def add_post_set_callback(self, callback: Callable[[list[Parameter]], None]) -> Callable[[], None]:
        """Hears of each successful set and declaration, the newest first. Returns the function that removes it."""
        return _added(self._post_set, callback)

    def add_applier(self, apply: Callable[[Mapping[str, ParameterValue]], None]) -> Callable[[], None]:
        """Is told the new values before anybody else hears of them; for objects that mirror parameters.

        Returns the function that removes it.
        """
        return _added(self._appliers, apply)

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
        empty list in an override takes the type of the declaration.

        Raises `ParameterAlreadyDeclared`, `InvalidParameterName`, `WrongParameterType` (default or override of another
        type), `InvalidParameterValue` (a range or a callback refused it).
        """
        described = self._declaration(name, default, descriptor or ParameterDescriptor())
        value = default if ignore_override else _fitted(self.overrides.get(name, default), described)
        if value.is_set and not described.dynamic_typing and value.type is not described.type:
            raise WrongParameterType(name, described.type.name, value.type.name)
        parameter = Parameter(name, value)
        reason = descriptor_problem(parameter, described, declaring=True)
        result = SetResult(False, reason) if reason else self._ask([parameter])
        if not result.successful:
            raise InvalidParameterValue(f"parameter {name!r} cannot be declared as {value.value!r}: {result.reason}")
        self._descriptors[name] = replace(described, type=value.type) if described.dynamic_typing else described
        self._values[name] = value
        if optional:
            self._optional.add(name)
        self._on_event(ParameterEvent(new=(parameter,) if value.is_set else ()))
        self._tell([parameter])
        return value

    def _declaration(self, name: str, default: ParameterValue, descriptor: ParameterDescriptor) -> ParameterDescriptor:
        if not isinstance(name, str) or not name:
            raise InvalidParameterName(f"a parameter's name must be a text that is not empty, got {name!r}")
        if name in self._values:
            raise ParameterAlreadyDeclared(f"parameter {name!r} is already declared")
        if descriptor.dynamic_typing:
            return replace(descriptor, name=name)
        kind = default.type if descriptor.type is ParameterType.NOT_SET else descriptor.type
        if kind is ParameterType.NOT_SET:
            raise InvalidParameterValue(
                f"parameter {name!r} has no default, so its type is unknown; give a default, a type, or a descriptor "
                "with dynamic_typing"
            )
        if default.is_set and default.type is not kind:
            raise WrongParameterType(name, kind.name, default.type.name)
        return replace(descriptor, name=name, type=kind)

    def declare_overrides(self) -> None:
        """Declare every override that is not declared yet, statically typed by its value."""
        for name, value in self.overrides.items():
            if name not in self._values:
                self.declare(name, value)

    def undeclare(self, name: str) -> None:
        """Forget a parameter without an event; raises `ParameterNotDeclared`, `ParameterImmutable` when read-only."""
        if name not in self._values:
            raise ParameterNotDeclared([name])
        if self._descriptors[name].read_only:
            raise ParameterImmutable(f"parameter {name!r} is read-only and cannot be undeclared")
        self.forget(name)

    def has(self, name: str) -> bool:
        """True when declared, with or without a value."""
        return name in self._values

    # --------------------------------------------------------------------------------------------------- reading

    def get(self, name: str) -> ParameterValue:
        """The value; NOT_SET only under dynamic typing or for undeclared names when those are allowed.

        Raises `ParameterNotDeclared`, `ParameterUninitialized`.
        """
        if name not in self._values:
            if self.allow_undeclared:
                return NOT_SET
            raise ParameterNotDeclared([name])
        value = self._values[name]
        if not value.is_set and not self._descriptors[name].dynamic_typing:
            raise ParameterUninitialized(f"parameter {name!r} is declared but has no value yet")
        return value

    def get_all(self, names: Iterable[str]) -> list[ParameterValue]:
        """As the get_parameters service answers: in order, or nothing at all when one name has no value."""
        try:
            return [self.get(name) for name in names]
        except (ParameterNotDeclared, ParameterUninitialized):
            return []

    def types(self, names: Iterable[str]) -> list[ParameterType]:
        """As the get_parameter_types service answers; empty when one name is not declared."""
        asked = list(names)
        if self._missing(asked):
            return []
        return [self._values.get(name, NOT_SET).type for name in asked]

    def describe(self, name: str) -> ParameterDescriptor:
        """The descriptor; an empty one for undeclared names when those are allowed. Raises `ParameterNotDeclared`."""
        self._require([name])
        return self._descriptors.get(name) or ParameterDescriptor(name=name)

    def describe_all(self, names: Iterable[str]) -> list[ParameterDescriptor]:
        """As the describe_parameters service answers; empty when one name is not declared."""
        asked = list(names)
        return [] if self._missing(asked) else [self.describe(name) for name in asked]

    def listing(self, prefixes: Sequence[str] = (), depth: int = 0) -> Listing:
        """Names and groups; depth 0 has no limit."""
        return list_names(self._values, prefixes, depth)

    def values(self) -> dict[str, ParameterValue]:
        """A copy of all declared names and values."""
        return dict(self._values)

    # --------------------------------------------------------------------------------------------------- setting

    def set_each(self, parameters: Iterable[Parameter]) -> list[SetResult]:
        """Set one by one; a failure does not stop the next."""
        return [self.set_atomically([parameter]) for parameter in parameters]

    def set_atomically(self, parameters: Iterable[Parameter]) -> SetResult:
        """Set all or nothing, with one event for all. Never raises for a bad value; the result has the reason."""
        wanted = list(parameters)
        if self._pre_set:
            wanted = [parameter for callback in tuple(self._pre_set) for parameter in callback(list(wanted))]
            if not wanted:
                return SetResult(False, EMPTY_LIST_REASON)
        missing = self._missing(parameter.name for parameter in wanted)
        if missing:
            return SetResult(False, str(ParameterNotDeclared(missing)))
        for parameter in wanted:
            if not parameter.name:
                return SetResult(False, "a parameter's name must not be empty")
            reason = self._problem(parameter)
            if reason:
                return SetResult(False, reason)
        result = self._ask(wanted)
        if result.successful:
            self._on_event(self._apply(wanted))
            self._tell(wanted)
        return result

    def _problem(self, parameter: Parameter) -> str:
        described = self._descriptor(parameter.name)
        # An optional parameter is unset like a declaration without a value.
        unsetting = not parameter.value.is_set and parameter.name in self._optional and not described.read_only
        return descriptor_problem(parameter, described, declaring=unsetting)

    def _descriptor(self, name: str) -> ParameterDescriptor:
        return self._descriptors.get(name) or ParameterDescriptor(name=name, dynamic_typing=True)

    def _ask(self, parameters: Sequence[Parameter]) -> SetResult:
        result = SetResult(True)
        for callback in reversed(tuple(self._on_set)):
            result = callback(list(parameters))
            if not result.successful:
                return result
        return result

    def _apply(self, parameters: Sequence[Parameter]) -> ParameterEvent:
        new: list[Parameter] = []
        changed: list[Parameter] = []
        deleted: list[Parameter] = []
        # A name given twice counts once, with its last value, so that the event says what a listener must believe.
        for parameter in {parameter.name: parameter for parameter in parameters}.values():
            name, value = parameter.name, parameter.value
            had_value = self._values.get(name, NOT_SET).is_set
            if not value.is_set:
                if name in self._optional:
                    self._values[name] = value
                else:
                    # Only dynamic typing gets here; unsetting is undeclaring.
                    self.forget(name)
                if had_value:
                    deleted.append(parameter)
                continue
            described = self._descriptor(name)
            self._descriptors[name] = replace(described, type=value.type) if described.dynamic_typing else described
            self._values[name] = value
            (changed if had_value else new).append(parameter)
        values = {parameter.name: parameter.value for parameter in parameters}
        for apply in tuple(self._appliers):
            apply(values)
        return ParameterEvent(tuple(new), tuple(changed), tuple(deleted))

    def forget(self, name: str) -> None:
        """Remove a parameter without checks and without an event, as if it had never been declared."""
        self._values.pop(name, None)
        self._descriptors.pop(name, None)
        self._optional.discard(name)

    def _tell(self, parameters: Sequence[Parameter]) -> None:
        for callback in reversed(tuple(self._post_set)):
            callback(list(parameters))

    def _missing(self, names: Iterable[str]) -> list[str]:
        return [] if self.allow_undeclared else [name for name in names if name not in self._values]

    def _require(self, names: Iterable[str]) -> None:
        missing = self._missing(names)
        if missing:
            raise ParameterNotDeclared(missing)


def _fitted(value: ParameterValue, described: ParameterDescriptor) -> ParameterValue:
    """An empty list from YAML or Python says nothing about its type; let it be what was declared."""
    if described.type.is_array and value.type.is_array and not value.value:
        return parameter_value((), described.type)
    return value


def _added(callbacks: list[_Callback], callback: _Callback) -> Callable[[], None]:
    callbacks.append(callback)

    def remove() -> None:
        if callback in callbacks:
            callbacks.remove(callback)

    return remove
