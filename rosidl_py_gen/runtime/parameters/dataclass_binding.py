"""Dataclasses whose fields are parameters.

`bind_class` declares every field and returns a parameter object (`live.py`), which follows sets from outside;
setting an attribute sets the parameter. A set is checked on a complete new instance before anything changes, and that
instance then replaces the one that is shown, so neither the store nor the object ever holds half an update.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rosidl_py_gen.runtime.parameters.callbacks import RefusedError, call_checked, require_plain, validate
from rosidl_py_gen.runtime.parameters.dataclass_fields import ParameterClassError, nested_class, plan_class
from rosidl_py_gen.runtime.parameters.proxy import FixedList, ParameterProxy, current
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValueError,
    Parameter,
    ParameterImmutableError,
    ParameterValue,
    require_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.parameters.callbacks import Commit
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

_T = TypeVar("_T")


class _ParameterBinding:
    """Ties one parameter object to a store."""

    def __init__(self, store: ParameterStore, cls: type, prefix: str, validator: Callable[[Any], str | None] | None):
        self.store = store
        self.cls = cls
        self.validator = validator
        self.plans = {plan.name: plan for plan in (plan.with_prefix(prefix) for plan in plan_class(cls))}
        self.groups = frozenset(plan.path[:end] for plan in self.plans.values() for end in range(1, len(plan.path)))
        self.values: dict[str, ParameterValue] = {}
        self.current: Any = None

    # A set travels: on-set callbacks -> prepare -> store -> commit (before the event) -> event -> post-set callbacks.

    def prepare(self, changes: Mapping[str, ParameterValue]) -> Commit | None:
        """Check a change and make the instance that shows it. Raises `RefusedError`, `CallbackAnswerError`."""
        mine = {name: value for name, value in changes.items() if name in self.plans}
        if not mine and self.current is not None:
            return None
        self._refuse_other_types(mine)
        values = {**self.values, **mine}
        complete = self._complete(values, mine)

        def commit() -> None:
            self.values, self.current = values, complete

        return commit

    def _refuse_other_types(self, values: Mapping[str, ParameterValue]) -> None:
        """What was undeclared and is declared again still belongs to the class, which goes by its annotations."""
        for name, value in values.items():
            plan = self.plans[name]
            if value.type is not plan.kind and (value.is_set or not plan.optional):
                field = f"{self.cls.__name__}.{'.'.join(plan.path)}"
                raise RefusedError(f"it shows as {field}, which is of type {plan.kind.name}, not {value.type.name}")

    def _complete(self, values: Mapping[str, ParameterValue], changed: Mapping[str, ParameterValue]) -> Any:
        """A complete instance with these values; validators of the `changed` fields and that of the class agree."""
        try:
            fields = {name: plan.from_parameter(values[name]) for name, plan in self.plans.items()}
        except InvalidParameterValueError as error:
            raise RefusedError(str(error)) from None
        for name in changed:
            self.plans[name].check(fields[name])
        made = _build(self.cls, {plan.path: fields[name] for name, plan in self.plans.items()})
        if self.validator is not None:
            validate(f"the validator of {self.cls.__name__}", self.validator, made)
        for name, plan in self.plans.items():
            # Whatever the class or the validator did to its fields: they show the parameters.
            value = plan.from_parameter(values[name])
            fixed = FixedList(value) if isinstance(value, list) else value
            object.__setattr__(_follow(made, plan.path[:-1]), plan.path[-1], fixed)
        return made

    def set(self, changes: Mapping[tuple[str, ...], Any]) -> None:
        """What assigning to attributes does; raises the error that says why it is refused."""
        wanted = [parameter for path, value in changes.items() for parameter in self._parameters(path, current(value))]
        result = self.store.set_atomically(wanted)
        if result.successful:
            return
        if any(described.read_only for described in self.store.describe_all([one.name for one in wanted])):
            raise ParameterImmutableError(result.reason)
        raise InvalidParameterValueError(result.reason)

    def _parameters(self, path: tuple[str, ...], value: Any) -> list[Parameter]:
        """The parameters at or below `path`, with the values that `value` gives them."""
        if path in self.groups:
            _require_instance(".".join(path), value, type(_follow(self.current, path)))
        found = [plan for plan in self.plans.values() if plan.path[: len(path)] == path]
        if not found:
            raise AttributeError(f"{self.cls.__name__} has no parameter {'.'.join(path)!r}")
        return [Parameter(plan.name, plan.to_parameter(_follow(value, plan.path[len(path) :]))) for plan in found]


def _build(cls: Any, fields: Mapping[tuple[str, ...], Any]) -> Any:
    """An instance of `cls` and those nested in it, from the values at the paths of their leaves."""
    made = {path[0]: value for path, value in fields.items() if len(path) == 1}
    for name in dict.fromkeys(path[0] for path in fields if len(path) > 1):
        below = {path[1:]: value for path, value in fields.items() if path[0] == name}
        made[name] = _build(nested_class(cls, name), below)
    try:
        return call_checked(f"{cls.__name__}(...)", lambda: cls(**made))
    except RefusedError as refusal:
        if isinstance(refusal.__cause__, ValueError):
            # From the class's own __post_init__: the text is the reason.
            raise RefusedError(str(refusal.__cause__) or f"{cls.__name__} refused the values") from None
        raise


def _follow(value: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        value = getattr(value, part)
    return value


def _require_instance(what: str, value: object, expected: type) -> None:
    """Also of what is nested in it."""
    if not isinstance(value, expected):
        found = f"{value!r} of type {type(value).__name__}"
        raise TypeError(f"{what} must be an object of {expected.__name__}, got {found}")
    for item in dataclasses.fields(expected):
        nested = nested_class(expected, item.name)
        if nested is not None and item.init:
            _require_instance(f"{what}.{item.name}", getattr(value, item.name), nested)


def bind_class(
    store: ParameterStore,
    cls: type[_T],
    *,
    prefix: str = "",
    initial: _T | None = None,
    validator: Callable[[_T], str | None] | None = None,
) -> _T:
    """Declare the fields of `cls` as parameters and return the parameter object.

    Events are published and post-set callbacks called once all fields are declared, and the object follows what these
    set. A field that is undeclared shows its last value; it follows again when it is declared again, which is refused
    with another type.

    Args:
        prefix: put in front of every name, with a dot between.
        initial: where the defaults come from; None calls ``cls()``, so every field needs a default then.
        validator: gets the complete new instance before each set; a text it returns is the reason to refuse.

    Raises:
        ParameterClassError: an annotation cannot be a parameter, or a field has no default and `initial` is not given.
        ParameterError: a name is taken, an override has the wrong type or is refused. Nothing is declared then.
        TypeError: an argument has the wrong type; the validator is async.
    """
    require_name(prefix, "the prefix")
    binding = _ParameterBinding(store, cls, f"{prefix}." if prefix else "", validator)
    if validator is not None:
        require_plain(validator, "the validator", "the new instance")
    source = _start(cls, initial)
    with store.declare_batch() as declared:
        values = {}
        for name, plan in binding.plans.items():
            default = plan.to_parameter(_follow(source, plan.path))
            values[name] = store.declare(name, default, plan.descriptor, optional=plan.optional)
            declared.append(name)
        values |= {name: value for name, value in store.values().items() if name in values}  # callbacks may set, too
        try:
            commit = binding.prepare(values)
        except RefusedError as refusal:
            reason = f"the parameters of {cls.__name__} cannot be declared: {refusal}"
            raise InvalidParameterValueError(reason) from refusal.__cause__
        assert commit is not None
        commit()
        store.callbacks.add("mirror", binding.prepare)
    return cast("_T", ParameterProxy(binding))


def _start(cls: type[_T], initial: _T | None) -> _T:
    """The object the defaults come from."""
    if initial is None:
        for item in dataclasses.fields(cls):  # type: ignore[arg-type]  # plan_class made sure
            if item.init and item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
                raise ParameterClassError(f"{cls.__name__}.{item.name} has no default; give it one, or pass initial=")
        return cls()
    source: _T = current(initial)
    _require_instance("initial", source, cls)
    return source
