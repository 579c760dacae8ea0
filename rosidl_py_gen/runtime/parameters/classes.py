"""Dataclasses whose attributes are parameters.

`bind_class` declares every field and returns a live object: it is an instance of the dataclass, follows sets from
outside, and setting an attribute sets the parameter. A set is checked on a complete new object before anything changes,
and that object then replaces the one that is shown, so neither the store nor the live object ever holds half an update.
What a live object does is in `live.py`.
"""

from __future__ import annotations

import contextlib
import dataclasses
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.runtime.parameters.callbacks import Refused, called, require_plain, validate
from rosidl_py_gen.runtime.parameters.fields import FieldPlan, ParameterClassError, plan_class
from rosidl_py_gen.runtime.parameters.live import FixedList, hints_of, make_live, place_of, plain
from rosidl_py_gen.runtime.parameters.rules import descriptor_problem
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValue,
    Parameter,
    ParameterImmutable,
    ParameterValue,
    WrongParameterType,
    require_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rosidl_py_gen.runtime.parameters.callbacks import Commit
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

_T = TypeVar("_T")


class _Binding:
    """Ties one live object to a store."""

    def __init__(self, store: ParameterStore, cls: type, prefix: str, validator: Callable[[Any], str | None] | None):
        self.store = store
        self.cls = cls
        self.validator = validator
        self.plans = {plan.name: plan for plan in (plan.with_prefix(prefix) for plan in plan_class(cls))}
        self.values: dict[str, ParameterValue] = {}
        self.current: Any = None

    # A set travels: on-set callbacks -> prepare -> store -> commit (before the event) -> event -> post-set callbacks.

    def prepare(self, changes: Mapping[str, ParameterValue]) -> Commit | None:
        """Check a change and make the object that shows it. Raises `Refused`, `CallbackAnswerError`."""
        mine = {name: value for name, value in changes.items() if name in self.plans}
        if not mine:
            return None
        self._refuse_other_types(mine)
        values = {**self.values, **mine}
        shown = self.complete(values, mine)

        def commit() -> None:
            self.values, self.current = values, shown

        return commit

    def _refuse_other_types(self, values: Mapping[str, ParameterValue]) -> None:
        """What was undeclared and is declared again still belongs to the class, which goes by its annotations."""
        for name, value in values.items():
            plan = self.plans[name]
            if value.type is not plan.kind and (value.is_set or not plan.optional):
                field = f"{self.cls.__name__}.{'.'.join(plan.path)}"
                raise Refused(f"it shows as {field}, which is of type {plan.kind.name}, not {value.type.name}")

    def follow_store(self) -> None:
        """Take over what callbacks have set while the fields were declared. Raises `Refused`, `CallbackAnswerError`."""
        found = self.store.values()
        changed = {name: found[name] for name in self.plans if name in found and found[name] != self.values[name]}
        commit = self.prepare(changed)
        if commit is not None:
            commit()

    def complete(self, values: Mapping[str, ParameterValue], changed: Mapping[str, ParameterValue]) -> Any:
        """A complete object with these values; validators of the `changed` fields and that of the class agree."""
        try:
            fields = {name: plan.from_wire(values[name]) for name, plan in self.plans.items()}
        except InvalidParameterValue as error:
            raise Refused(str(error)) from None
        for name in changed:
            self.plans[name].check(fields[name])
        made = self.build(fields)
        if self.validator is not None:
            validate(f"the validator of {self.cls.__name__}", self.validator, made)
        for name, plan in self.plans.items():
            # Whatever the class or the validator did to its fields: they show the parameters.
            value = plan.from_wire(values[name])
            fixed = FixedList.of(value) if isinstance(value, list) else value
            object.__setattr__(_follow(made, plan.path[:-1]), plan.path[-1], fixed)
        return made

    def build(self, fields: Mapping[str, Any]) -> Any:
        tree: dict[str, Any] = {}
        for name, plan in self.plans.items():
            below = tree
            for part in plan.path[:-1]:
                below = below.setdefault(part, {})
            below[plan.path[-1]] = fields[name]
        return _build(self.cls, tree)

    # ------------------------------------------------------------------------------------------------------- writing

    def set(self, path: tuple[str, ...], value: Any) -> None:
        """What assigning to an attribute does; raises the error that says why it is refused."""
        self.set_all(self.parameters(path, value))

    def parameters(self, path: tuple[str, ...], value: Any) -> list[Parameter]:
        """The parameters at or below `path`, with the values that `value` gives them; nothing when there are none."""
        found = [plan for plan in self.plans.values() if plan.path[: len(path)] == path]
        if found and found[0].path != path:
            expected = self.cls
            for part in path:
                expected = hints_of(expected)[part]
            _require_instance(".".join(path), value, expected)
        return [Parameter(plan.name, plan.to_wire(_follow(value, plan.path[len(path) :]))) for plan in found]

    def set_all(self, parameters: Sequence[Parameter]) -> None:
        result = self.store.set_atomically(parameters)
        if result.successful:
            return
        if result.reason.startswith("Trying to set a read-only parameter"):
            raise ParameterImmutable(result.reason)
        raise InvalidParameterValue(result.reason)


def _build(cls: Any, tree: Mapping[str, Any]) -> Any:
    hints = hints_of(cls)
    fields = {name: _build(hints[name], part) if isinstance(part, dict) else part for name, part in tree.items()}
    try:
        return called(f"{cls.__name__}(...)", lambda: cls(**fields))
    except Refused as refusal:
        if isinstance(refusal.__cause__, ValueError):
            # From the class's own __post_init__: the text is the reason.
            raise Refused(str(refusal.__cause__) or f"{cls.__name__} refused the values") from None
        raise


def _follow(value: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        value = getattr(value, part)
    return value


def _require_instance(what: str, value: object, expected: type) -> None:
    if not isinstance(value, expected):
        found = f"{value!r} of type {type(value).__name__}"
        raise TypeError(f"{what} must be an object of {expected.__name__}, got {found}")


def bind_class(
    store: ParameterStore,
    cls: type[_T],
    *,
    prefix: str = "",
    initial: _T | None = None,
    validator: Callable[[_T], str | None] | None = None,
) -> _T:
    """Declare the fields of `cls` as parameters and return the live object.

    Events are published and post-set callbacks called once all fields are declared, and the live object follows what
    these set. A field that is undeclared shows its last value; it follows again when it is declared again, which is
    refused with another type.

    Args:
        prefix: put in front of every name, with a dot between.
        initial: where the defaults come from; None calls ``cls()``, so every field needs a default then.
        validator: gets the complete new object before each set; a text it returns is the reason to refuse.

    Raises:
        ParameterClassError: an annotation cannot be a parameter, or a field has no default and `initial` is not given.
        ParameterError: a name is taken, an override has the wrong type or is refused. Nothing is declared then.
        TypeError: an argument has the wrong type; the validator is async.
    """
    require_name(prefix, "the prefix")
    binding = _Binding(store, cls, f"{prefix}." if prefix else "", validator)
    if validator is not None:
        require_plain(validator, "the validator")
    source = _start(cls, initial)
    with store.together() as declared:
        start = {name: plan.to_wire(_follow(source, plan.path)) for name, plan in binding.plans.items()}
        binding.values = {name: store.overrides.get(name, value) for name, value in start.items()}
        _refuse_bad_start(binding, binding.values)
        live: _T = make_live(cls, source, binding)
        for name, plan in binding.plans.items():
            store.declare(name, start[name], plan.descriptor, optional=plan.optional)
            declared.append(name)
        with _explained(cls):
            binding.follow_store()
        store.add_mirror(binding.prepare)
    return live


def _start(cls: type[_T], initial: _T | None) -> _T:
    """The object the defaults come from."""
    if initial is None:
        for item in dataclasses.fields(cls):  # type: ignore[arg-type]  # plan_class made sure
            if item.init and item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
                raise ParameterClassError(f"{cls.__name__}.{item.name} has no default; give it one, or pass initial=")
        return cls()
    _require_instance("initial", initial, cls)
    _require_nested("initial", initial, cls)
    return initial


def _require_nested(what: str, value: object, cls: type) -> None:
    for name, hint in hints_of(cls).items():
        if isinstance(hint, type) and dataclasses.is_dataclass(hint) and hasattr(value, name):
            _require_instance(f"{what}.{name}", getattr(value, name), hint)
            _require_nested(f"{what}.{name}", getattr(value, name), hint)


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
    with _explained(binding.cls):
        binding.current = binding.complete(values, values)


@contextlib.contextmanager
def _explained(cls: type) -> Iterator[None]:
    try:
        yield
    except Refused as refusal:
        reason = f"the parameters of {cls.__name__} cannot be declared: {refusal}"
        raise InvalidParameterValue(reason) from refusal.__cause__


def update_parameters(live: object, **changes: Any) -> None:
    """Set several fields of a live object in one atomic step; nested fields as ``left=Motor(...)``.

    Raises as assigning does, and then nothing has changed.
    """
    binding, base = place_of(live)
    parameters: list[Parameter] = []
    for attribute, value in changes.items():
        found = binding.parameters((*base, attribute), value)
        if not found:
            raise AttributeError(f"{binding.cls.__name__} has no parameter {'.'.join((*base, attribute))!r}")
        parameters += found
    binding.set_all(parameters)


def snapshot(live: _T) -> _T:
    """A plain, independent copy of a live object: all values as they were at one moment, in any thread.

    Reading several attributes one after the other may see a set that comes in between; a snapshot cannot.
    """
    place_of(live)
    return plain(live)  # type: ignore[no-any-return]


__all__ = ["FieldPlan", "bind_class", "snapshot", "update_parameters"]
