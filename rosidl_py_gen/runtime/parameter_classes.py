"""Dataclasses whose attributes are parameters.

`bind_class` declares every field and returns a live object: it is an instance of the dataclass, follows sets from
outside, and setting an attribute sets the parameter. A set is checked on a complete new object before anything changes,
so neither the store nor the live object ever holds half an update.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from rosidl_py_gen.runtime.parameter_fields import FieldPlan, plan_class
from rosidl_py_gen.runtime.parameter_rules import descriptor_problem
from rosidl_py_gen.runtime.parameter_values import (
    InvalidParameterValue,
    Parameter,
    ParameterImmutable,
    ParameterValue,
    WrongParameterType,
)
from rosidl_py_gen.runtime.parameters import SetResult

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosidl_py_gen.runtime.parameters import ParameterStore

_T = TypeVar("_T")
_BINDING = "_rosidl_binding"


class _Binding:
    """Ties one live object to a store."""

    def __init__(self, store: ParameterStore, cls: type, prefix: str, validator: Callable[[Any], str | None] | None):
        self.store = store
        self.cls = cls
        self.prefix = prefix
        self.validator = validator
        self.plans = {prefix + plan.name: plan for plan in plan_class(cls)}
        self.live: Any = None

    # A set travels: check (on-set callback) -> store -> apply (before the event) -> event -> post-set callbacks.

    def check(self, parameters: Sequence[Parameter]) -> SetResult:
        changes = {p.name: p.value for p in parameters if p.name in self.plans}
        if not changes:
            return SetResult(True)
        known = self.store.values()
        values = {name: known.get(name, ParameterValue()) for name in self.plans}
        reason = self.problem({**values, **changes})
        return SetResult(not reason, reason)

    def problem(self, values: Mapping[str, ParameterValue]) -> str:
        """Why an object with these values is refused; an empty text when it is fine."""
        try:
            plain = {name: self.plans[name].from_wire(values[name]) for name in self.plans}
            for name, plan in self.plans.items():
                reason = plan.problem(plain[name])
                if reason:
                    return reason
            candidate = self.build(plain)
        except ValueError as error:
            # From choices, or from the class's own __post_init__: the text is the reason.
            return str(error) or f"{self.cls.__name__} refused the values"
        return (self.validator(candidate) or "") if self.validator is not None else ""

    def build(self, plain: Mapping[str, Any]) -> Any:
        tree: dict[str, Any] = {}
        for name, plan in self.plans.items():
            below = tree
            for part in plan.path[:-1]:
                below = below.setdefault(part, {})
            below[plan.path[-1]] = plain[name]
        return _build(self.cls, tree)

    def apply(self, values: Mapping[str, ParameterValue]) -> None:
        for name, value in values.items():
            plan = self.plans.get(name)
            if plan is None:
                continue
            target = self.live
            for part in plan.path[:-1]:
                target = getattr(target, part)
            object.__setattr__(target, plan.path[-1], plan.from_wire(value))

    def set(self, path: tuple[str, ...], value: Any) -> None:
        """What assigning to an attribute does; raises the error that says why it is refused."""
        parameters = [
            Parameter(name, plan.to_wire(_follow(value, plan.path[len(path) :])))
            for name, plan in self.plans.items()
            if plan.path[: len(path)] == path
        ]
        self.set_all(parameters)

    def set_all(self, parameters: Sequence[Parameter]) -> None:
        result = self.store.set_atomically(parameters)
        if result.successful:
            return
        if any(self.plans[p.name].descriptor.read_only for p in parameters):
            raise ParameterImmutable(result.reason)
        raise InvalidParameterValue(result.reason)


def _build(cls: Any, tree: Mapping[str, Any]) -> Any:
    hints = _hints(cls)
    return cls(**{name: _build(hints[name], part) if isinstance(part, dict) else part for name, part in tree.items()})


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


def _follow(value: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        value = getattr(value, part)
    return value


def bind_class(
    store: ParameterStore,
    cls: type[_T],
    *,
    prefix: str = "",
    initial: _T | None = None,
    validator: Callable[[_T], str | None] | None = None,
) -> _T:
    """Declare the fields of `cls` as parameters and return the live object.

    Args:
        prefix: put in front of every name, with a dot between.
        initial: where the defaults come from; None calls ``cls()``, so every field needs a default then.
        validator: gets the complete new object before each set; a text it returns is the reason to refuse.

    Raises:
        ParameterClassError: an annotation cannot be a parameter.
        ParameterError: a name is taken, an override has the wrong type or is refused. Nothing is declared then.
    """
    binding = _Binding(store, cls, f"{prefix}." if prefix else "", validator)
    source = cls() if initial is None else initial
    defaults = {name: plan.to_wire(_follow(source, plan.path)) for name, plan in binding.plans.items()}
    _refuse_bad_start(binding, {name: store.overrides.get(name, value) for name, value in defaults.items()})
    binding.live = _make_live(cls, source, binding, ())
    declared: list[str] = []
    try:
        for name, plan in binding.plans.items():
            descriptor = dataclasses.replace(plan.descriptor, name=name)
            value = store.declare(name, defaults[name], descriptor, optional=plan.optional)
            declared.append(name)
            binding.apply({name: value})
    except Exception:
        for name in declared:
            store.forget(name)
        raise
    store.add_on_set_callback(binding.check)
    store.add_applier(binding.apply)
    return binding.live  # type: ignore[no-any-return]


def _refuse_bad_start(binding: _Binding, values: dict[str, ParameterValue]) -> None:
    for name, plan in binding.plans.items():
        value = values[name]
        if value.is_set and value.type is not plan.kind:
            if value.type.is_array and plan.kind.is_array and not value.value:
                values[name] = plan.to_wire(())
                continue
            raise WrongParameterType(name, plan.kind.name, value.type.name)
    for name, plan in binding.plans.items():
        reason = descriptor_problem(Parameter(name, values[name]), plan.descriptor, declaring=True)
        if reason:
            raise InvalidParameterValue(f"parameter {name!r} cannot be declared: {reason}")
    reason = binding.problem(values)
    if reason:
        raise InvalidParameterValue(f"the parameters of {binding.cls.__name__} cannot be declared: {reason}")


def update_parameters(live: object, **changes: Any) -> None:
    """Set several fields of a live object in one atomic step; nested fields as ``left=Motor(...)``.

    Raises as assigning does, and then nothing has changed.
    """
    binding, base = _binding_of(live)
    parameters = []
    for attribute, value in changes.items():
        path = (*base, attribute)
        found = [(name, plan) for name, plan in binding.plans.items() if plan.path[: len(path)] == path]
        if not found:
            raise AttributeError(f"{binding.cls.__name__} has no parameter {'.'.join(path)!r}")
        parameters += [Parameter(name, plan.to_wire(_follow(value, plan.path[len(path) :]))) for name, plan in found]
    binding.set_all(parameters)


def snapshot(live: _T) -> _T:
    """A plain, independent copy of a live object, consistent in itself."""
    return copy.deepcopy(live)


def _binding_of(live: object) -> tuple[_Binding, tuple[str, ...]]:
    found: tuple[_Binding, tuple[str, ...]] | None = getattr(live, _BINDING, None)
    if found is None:
        raise TypeError(f"{live!r} is no live parameter object; declare_parameters returns one")
    return found


# ------------------------------------------------------------------------------------------------------ live classes

_live_classes: dict[type, type] = {}


def _make_live(cls: type, source: Any, binding: _Binding, path: tuple[str, ...]) -> Any:
    live: Any = object.__new__(_live_class(cls))
    for item in dataclasses.fields(cls):
        value = getattr(source, item.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type) and item.init:
            value = _make_live(type(value), value, binding, (*path, item.name))
        object.__setattr__(live, item.name, value)
    object.__setattr__(live, _BINDING, (binding, path))
    return live


def _live_class(cls: type) -> type:
    if cls not in _live_classes:
        members: dict[str, Any] = {
            "__doc__": cls.__doc__,
            "__module__": cls.__module__,
            "__qualname__": cls.__qualname__,
            "__eq__": _equal,
            "__hash__": None,
            "__reduce_ex__": _reduce,
            "__copy__": _plain,
            "__deepcopy__": lambda self, memo: _plain(self),
        }
        if not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            members["__setattr__"] = _set_attribute
        _live_classes[cls] = type(cls.__name__, (cls,), members)
    return _live_classes[cls]


def _base(live: Any) -> type:
    base: type = type(live).__mro__[1]
    return base


def _plain(live: Any) -> Any:
    """The same values in an object of the user's own class."""
    return _rebuild(
        _base(live), {item.name: copy.deepcopy(getattr(live, item.name)) for item in dataclasses.fields(live)}
    )


def _reduce(live: Any, protocol: Any) -> Any:
    """Pickle as the user's own class, without the store."""
    return _rebuild, (_base(live), {item.name: getattr(live, item.name) for item in dataclasses.fields(live)})


def _rebuild(cls: type, values: Mapping[str, Any]) -> Any:
    made: Any = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def _equal(live: Any, other: object) -> Any:
    left = _plain(live)
    right = _plain(other) if getattr(other, _BINDING, None) is not None else other
    return left == right


def _set_attribute(live: Any, name: str, value: Any) -> None:
    binding, path = _binding_of(live)
    full = (*path, name)
    if not any(plan.path[: len(full)] == full for plan in binding.plans.values()):
        if name in {item.name for item in dataclasses.fields(live)}:
            object.__setattr__(live, name, value)  # A field with init=False is no parameter.
            return
        raise AttributeError(f"{type(live).__name__} has no field {name!r}")
    binding.set(full, value)


__all__ = ["FieldPlan", "bind_class", "snapshot", "update_parameters"]
