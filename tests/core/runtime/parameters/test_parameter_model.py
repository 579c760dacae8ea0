"""Parameter store against a model: random declarations and sets, ranges, read-only, a refusing callback."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from support.example_counts import examples

from rosidl_py_gen.runtime import ParameterEvent, SetResult
from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterAlreadyDeclaredError,
    ParameterDescriptor,
    ParameterImmutableError,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterValue,
    parameter_value,
)

VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 5),
    st.sampled_from([-2.0, 0.0, 0.5, 1.5, 4.0]),
    st.text("axy", max_size=2),
    st.lists(st.booleans()),
)
NAMES = st.sampled_from(["a", "b", "g.a", "g.b"])
INT_RANGES = st.sampled_from([None, IntRange(-2, 3), IntRange(-3, 4, 2)])
FLOAT_RANGES = st.sampled_from([None, FloatRange(-1.0, 2.0), FloatRange(-2.0, 4.0, 1.0)])
ALLOWED_INTS = {None: set(range(-5, 6)), IntRange(-2, 3): {-2, -1, 0, 1, 2, 3}, IntRange(-3, 4, 2): {-3, -1, 1, 3, 4}}
ALLOWED_FLOATS = {
    None: {0.5, 1.5, *map(float, range(-5, 6))},
    FloatRange(-1.0, 2.0): {-1.0, 0.0, 0.5, 1.0, 1.5, 2.0},
    FloatRange(-2.0, 4.0, 1.0): {-2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0},
}
REFUSED_TEXT = "x"


@dataclass
class Known:
    value: ParameterValue
    kind: ParameterType
    descriptor: ParameterDescriptor


def in_range(value: ParameterValue, descriptor: ParameterDescriptor) -> bool:
    if value.type is ParameterType.INTEGER:
        return value.value in ALLOWED_INTS[descriptor.integer_range]
    if value.type is ParameterType.DOUBLE:
        return value.value in ALLOWED_FLOATS[descriptor.floating_point_range]
    return True


class StoreAgainstModel(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.model: dict[str, Known] = {}
        self.from_events: dict[str, ParameterValue] = {}
        self.post_set_values: dict[str, ParameterValue] = {}
        self.refusing = False

    @initialize(allow=st.booleans())
    def create(self, allow: bool) -> None:
        self.allow = allow
        self.store = ParameterStore(allow_undeclared=allow, on_event=self.hear)
        self.store.callbacks.add("on-set", self.on_set)
        self.store.callbacks.add("post-set", self.on_post_set)

    def on_set(self, parameters: list[Parameter]) -> SetResult:
        refused = self.refusing and any(parameter.value.value == REFUSED_TEXT for parameter in parameters)
        return SetResult(not refused, "no x" if refused else "")

    def on_post_set(self, parameters: list[Parameter]) -> None:
        self.post_set_values |= {parameter.name: parameter.value for parameter in parameters}

    def hear(self, event: ParameterEvent) -> None:
        for parameter in event.new:
            assert not self.from_events.get(parameter.name, ParameterValue()).is_set
        for parameter in event.changed:
            assert parameter.name in self.from_events
        for parameter in event.new + event.changed:
            self.from_events[parameter.name] = parameter.value
        for parameter in event.deleted:
            del self.from_events[parameter.name]

    def is_accepted(self, value: ParameterValue) -> bool:
        return not (self.refusing and value.value == REFUSED_TEXT)

    @rule(refusing=st.booleans())
    def set_refusing(self, refusing: bool) -> None:
        self.refusing = refusing

    @rule(
        name=NAMES,
        value=VALUES,
        dynamic=st.booleans(),
        read_only=st.sampled_from([False, False, True]),
        ints=INT_RANGES,
        floats=FLOAT_RANGES,
    )
    def declare(
        self,
        name: str,
        value: object,
        dynamic: bool,
        read_only: bool,
        ints: IntRange | None,
        floats: FloatRange | None,
    ) -> None:
        given = parameter_value(value)
        descriptor = ParameterDescriptor(
            dynamic_typing=dynamic, read_only=read_only, integer_range=ints, floating_point_range=floats
        )
        possible = (
            name not in self.model
            and (dynamic or given.is_set)
            and in_range(given, descriptor)
            and self.is_accepted(given)
        )
        try:
            self.store.declare(name, given, descriptor)
            assert possible
            self.model[name] = Known(given, given.type, descriptor)
        except (ParameterAlreadyDeclaredError, InvalidParameterValueError):
            assert not possible

    @rule(name=NAMES)
    def undeclare(self, name: str) -> None:
        try:
            self.store.undeclare(name)
        except ParameterNotDeclaredError:
            assert name not in self.model
        except ParameterImmutableError:
            assert self.model[name].descriptor.read_only
        else:
            assert not self.model.pop(name).descriptor.read_only
            self.from_events.pop(name, None)

    @rule(items=st.lists(st.tuples(NAMES, VALUES), min_size=1, max_size=4))
    def set_atomically(self, items: list[tuple[str, object]]) -> None:
        requested = [Parameter(name, parameter_value(value)) for name, value in items]
        wanted = [self.convert(parameter) for parameter in requested]
        possible = all(self.may_set(parameter) for parameter in wanted)
        self.post_set_values.clear()
        assert self.store.set_atomically(requested).successful == possible
        assert self.post_set_values == ({parameter.name: parameter.value for parameter in wanted} if possible else {})
        if possible:
            self.apply(wanted)

    @rule(items=st.lists(st.tuples(NAMES, VALUES), max_size=4))
    def set_each(self, items: list[tuple[str, object]]) -> None:
        requested = [Parameter(name, parameter_value(value)) for name, value in items]
        for one, result in zip(requested, self.store.set_individually(requested), strict=True):
            parameter = self.convert(one)
            assert result.successful == self.may_set(parameter)
            if result.successful:
                self.apply([parameter])

    def convert(self, parameter: Parameter) -> Parameter:
        declared = self.model.get(parameter.name)
        if declared is None or declared.descriptor.dynamic_typing or declared.kind is not ParameterType.DOUBLE:
            return parameter
        value = parameter.value.value
        return Parameter(parameter.name, parameter_value(float(value))) if type(value) is int else parameter

    def may_set(self, parameter: Parameter) -> bool:
        declared = self.model.get(parameter.name)
        if not self.is_accepted(parameter.value):
            return False
        if declared is None:
            return self.allow
        fits = declared.descriptor.dynamic_typing or parameter.value.type is declared.kind
        return fits and not declared.descriptor.read_only and in_range(parameter.value, declared.descriptor)

    def apply(self, parameters: list[Parameter]) -> None:
        for parameter in {parameter.name: parameter for parameter in parameters}.values():
            declared = self.model.get(parameter.name)
            if not parameter.value.is_set:
                self.model.pop(parameter.name, None)
                continue
            descriptor = declared.descriptor if declared else ParameterDescriptor(dynamic_typing=True)
            self.model[parameter.name] = Known(parameter.value, parameter.value.type, descriptor)

    @invariant()
    def agree(self) -> None:
        values = {name: declared.value for name, declared in self.model.items()}
        assert self.store.values() == values
        assert {name: value for name, value in values.items() if value.is_set} == self.from_events
        assert set(self.store.listing().names) == set(values)
        for name, declared in self.model.items():
            assert self.store.describe(name).read_only == declared.descriptor.read_only


TestStoreAgainstModel = StoreAgainstModel.TestCase
TestStoreAgainstModel.settings = settings(max_examples=examples(80), stateful_step_count=25, deadline=None)
