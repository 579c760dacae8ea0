"""Dataclasses as parameters: annotations, and atomic updates."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any, Literal

import pytest
from support.parameter_store import StoreWorld, p

from rosidl_py_gen.runtime import SetResult
from rosidl_py_gen.runtime.parameters.dataclass_parameters import (
    Int8,
    ParameterClassError,
    Range,
    ReadOnly,
    UInt16,
    UInt64,
    bind_class,
    parameter_fields_of,
    snapshot,
    update_parameters,
)
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    ParameterAlreadyDeclaredError,
    ParameterDescriptor,
    ParameterImmutableError,
    ParameterType,
    WrongParameterTypeError,
)

T = ParameterType


class Gear(Enum):
    LOW = 1
    HIGH = 2


class Mixed(Enum):
    A = 1
    B = "b"


def even(value: int) -> str | None:
    return None if value % 2 == 0 else f"{value} is odd"


async def later(value: int) -> str | None:
    return None


@dataclass
class Motor:
    pwm: Annotated[int, Range(0, 255)] = 10
    inverted: bool = False


@dataclass
class Drive:
    max_speed: Annotated[float, Range(0.0, 2.5), "maximum speed in m/s"] = 0.8
    mode: Literal["auto", "manual"] = "auto"
    left: Motor = field(default_factory=Motor)
    tags: list[str] = field(default_factory=list)
    frame: Annotated[str, ReadOnly] = "base_link"
    limit: float | None = None
    gear: Gear = Gear.LOW
    teeth: Annotated[int, even] = 4
    blob: bytes = b""
    small: Int8 = 0


def test_parameter_class_declares_every_field_with_type_and_descriptor() -> None:
    world = StoreWorld()
    bind_class(world.store, Drive)
    assert {name: value.type for name, value in world.store.values().items()} == {
        "max_speed": T.DOUBLE,
        "mode": T.STRING,
        "left.pwm": T.INTEGER,
        "left.inverted": T.BOOL,
        "tags": T.STRING_ARRAY,
        "frame": T.STRING,
        "limit": T.NOT_SET,
        "gear": T.INTEGER,
        "teeth": T.INTEGER,
        "blob": T.BYTE_ARRAY,
        "small": T.INTEGER,
    }
    describe = world.store.describe
    assert describe("max_speed") == ParameterDescriptor(
        "max_speed", T.DOUBLE, "maximum speed in m/s", floating_point_range=FloatRange(0.0, 2.5)
    )
    assert describe("left.pwm").integer_range == IntRange(0, 255)
    assert describe("frame").read_only and not describe("mode").read_only
    assert describe("mode").additional_constraints == "one of: auto, manual"
    assert describe("limit").type is T.DOUBLE
    assert describe("small").integer_range == IntRange(-128, 127)
    assert len(world.events) == 11


def test_parameter_object_has_initial_values_and_equals_a_plain_instance() -> None:
    world = StoreWorld(max_speed=1.5, left__pwm=77, mode="manual", limit=3.0, gear=2)
    drive = bind_class(world.store, Drive)
    assert (drive.max_speed, drive.left.pwm, drive.mode, drive.limit, drive.gear) == (1.5, 77, "manual", 3.0, Gear.HIGH)
    expected = Drive(max_speed=1.5, left=Motor(77), mode="manual", limit=3.0, gear=Gear.HIGH)
    assert drive == expected and expected == drive and expected == snapshot(drive)
    assert dataclasses.asdict(snapshot(drive)) == dataclasses.asdict(expected)
    assert repr(drive) == repr(expected) and "max_speed" in dir(drive)


def test_parameter_object_follows_external_sets() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    left = drive.left
    assert world.set(left__pwm=42, tags=["a", "b"], gear=2, limit=1.5, blob=b"\x01").successful
    assert (drive.left.pwm, left.pwm, drive.tags, drive.gear, drive.limit) == (42, 42, ["a", "b"], Gear.HIGH, 1.5)
    assert drive.blob == b"\x01"
    assert world.set(limit=None).successful and drive.limit is None


def test_assigning_attributes_sets_parameters_and_publishes_events() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    drive.max_speed = 2
    drive.left.pwm = 9
    drive.gear = Gear.HIGH
    drive.limit = 1.0
    drive.limit = None
    changed = [
        tuple((item.name, item.value.value) for item in e.changed + e.new + e.deleted) for e in world.events[11:]
    ]
    assert changed == [
        (("max_speed", 2.0),),
        (("left.pwm", 9),),
        (("gear", 2),),
        (("limit", 1.0),),
        (("limit", None),),
    ]
    drive.left = Motor(pwm=3, inverted=True)
    assert world.events[-1].changed == (
        p("left.pwm", 3),
        p("left.inverted", True),
    )
    assert drive.left.pwm == 3
    drive.left.pwm = 4
    assert world.get("left.pwm") == 4


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"max_speed": 3.0}, "Parameter max_speed out of range Min: 0.0, Max: 2.5, value: 3.0"),
        ({"max_speed": 3}, "Parameter max_speed out of range Min: 0.0, Max: 2.5, value: 3.0"),
        ({"max_speed": "3"}, "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'"),
        ({"left__pwm": 256}, "Parameter left.pwm out of range. Min: 0, Max: 255, value: 256"),
        ({"mode": "fast"}, "Parameter mode must be one of 'auto', 'manual', got 'fast'"),
        ({"gear": 3}, "Parameter gear must be one of 1, 2, got 3"),
        ({"frame": "x"}, "Trying to set a read-only parameter: frame."),
        ({"teeth": 5}, "5 is odd"),
        ({"small": 128}, "Parameter small out of range. Min: -128, Max: 127, value: 128"),
        ({"mode": None}, "Static parameter cannot be undeclared"),
        ({"max_speed": 1.0, "teeth": 7}, "7 is odd"),
    ],
)
def test_refused_set_returns_reason_and_changes_no_value(values: dict[str, object], reason: str) -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    before, events = snapshot(drive), len(world.events)
    assert world.set(**values) == SetResult(False, reason)
    assert drive == before and len(world.events) == events


def test_assigning_a_refused_value_raises_and_changes_no_value() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    with pytest.raises(InvalidParameterValueError, match="out of range"):
        drive.max_speed = 9.0
    with pytest.raises(InvalidParameterValueError, match=r"'mode'.*INTEGER, expected STRING"):
        drive.mode = 5  # type: ignore[assignment]
    with pytest.raises(ParameterImmutableError, match="read-only parameter: frame"):
        drive.frame = "x"
    with pytest.raises(AttributeError, match="has no parameter 'typo'"):
        drive.typo = 1  # type: ignore[attr-defined]
    assert drive == Drive()


def test_post_set_callback_sees_all_new_values_of_the_object() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    seen: list[tuple[float, int]] = []
    world.store.callbacks.add("post-set", lambda ps: seen.append((drive.max_speed, drive.left.pwm)))
    world.events.clear()
    assert world.set(max_speed=1.0, left__pwm=1).successful
    assert seen == [(1.0, 1)]


def test_class_validator_receives_the_complete_new_object() -> None:
    world = StoreWorld()

    def check(new: Drive) -> str | None:
        return "too fast for manual" if new.mode == "manual" and new.max_speed > 1 else None

    drive = bind_class(world.store, Drive, validator=check)
    assert world.set(mode="manual").successful
    assert world.set(max_speed=2.0) == SetResult(False, "too fast for manual")
    assert world.set(max_speed=2.0, mode="auto").successful
    assert (drive.mode, drive.max_speed) == ("auto", 2.0)


def test_post_init_can_refuse_a_set() -> None:
    @dataclass
    class Pair:
        low: int = 0
        high: int = 10

        def __post_init__(self) -> None:
            if self.low > self.high:
                raise ValueError("low must not exceed high")

    world = StoreWorld()
    pair = bind_class(world.store, Pair)
    assert world.set(low=11) == SetResult(False, "low must not exceed high")
    update_parameters(pair, low=11, high=12)
    assert (pair.low, pair.high, len(world.events)) == (11, 12, 3)
    with pytest.raises(AttributeError, match="no parameter 'nope'"):
        update_parameters(pair, nope=1)
    with pytest.raises(TypeError, match="expected a parameter object"):
        update_parameters(Pair(), low=1)


@pytest.mark.parametrize(
    ("overrides", "error"),
    [
        ({"max_speed": "1"}, WrongParameterTypeError),
        ({"max_speed": 9.0}, InvalidParameterValueError),
        ({"mode": "x"}, InvalidParameterValueError),
        ({"teeth": 3}, InvalidParameterValueError),
    ],
)
def test_invalid_override_declares_no_parameter(overrides: dict[str, object], error: type[Exception]) -> None:
    world = StoreWorld(**overrides)
    with pytest.raises(error):
        bind_class(world.store, Drive)
    assert world.store.values() == {} and world.events == []


def test_already_declared_name_prevents_declaration_of_the_class() -> None:
    world = StoreWorld()
    world.declare("left.pwm", 1)
    with pytest.raises(ParameterAlreadyDeclaredError):
        bind_class(world.store, Drive)
    assert list(world.store.values()) == ["left.pwm"]
    assert world.set(left__pwm=999).successful


def test_prefix_and_initial_object_apply_to_bound_class() -> None:
    world = StoreWorld(a__left__pwm=5)
    first = bind_class(world.store, Drive, prefix="a", initial=Drive(max_speed=2.0))
    second = bind_class(world.store, Drive, prefix="b")
    assert (first.max_speed, first.left.pwm, second.max_speed, second.left.pwm) == (2.0, 5, 0.8, 10)
    first.max_speed = 1.0
    assert second.max_speed == 0.8 and world.get("a.max_speed") == 1.0
    assert world.set(b__mode="no").reason == "Parameter b.mode must be one of 'auto', 'manual', got 'no'"
    assert world.set(b__left__pwm=-1).reason == "Parameter b.left.pwm out of range. Min: 0, Max: 255, value: -1"
    with pytest.raises(InvalidParameterValueError, match=r"parameter 'b\.mode'"):
        second.mode = 5  # type: ignore[assignment]


def test_arrays_of_every_type_and_ranges_for_their_items() -> None:
    @dataclass
    class Arrays:
        flags: list[bool] = field(default_factory=lambda: [True])
        numbers: Annotated[list[int], Range(0, 9)] = field(default_factory=list)
        bytes8: list[Int8] = field(default_factory=list)
        reals: tuple[float, ...] = (1, 2)
        names: list[str] | None = None

    world = StoreWorld(p__flags=[], p__numbers=[1, 2])
    arrays = bind_class(world.store, Arrays, prefix="p")
    assert arrays == Arrays([], [1, 2], [], (1.0, 2.0), None)
    assert world.store.types(["p.flags", "p.numbers", "p.reals", "p.names"]) == [
        T.BOOL_ARRAY,
        T.INTEGER_ARRAY,
        T.DOUBLE_ARRAY,
        T.NOT_SET,
    ]
    assert world.set(p__numbers=[1, 10]).reason == "Parameter p.numbers[1] out of range. Min: 0, Max: 9, value: 10"
    assert world.set(p__bytes8=[-129]).reason == "Parameter p.bytes8[0] out of range. Min: -128, Max: 127, value: -129"
    assert world.set(p__numbers=[9], p__names=["a"]).successful
    assert (arrays.numbers, arrays.names) == ([9], ["a"])


def test_integer_width_annotations_define_ranges() -> None:
    @dataclass
    class Widths:
        a: UInt16 = 0
        b: UInt64 = 0
        c: Annotated[UInt16, Range(5, 10)] = 5

    plans = {plan.name: plan.descriptor.integer_range for plan in parameter_fields_of(Widths)}
    assert plans == {"a": IntRange(0, 65535), "b": IntRange(0, 2**63 - 1), "c": IntRange(5, 10)}


def test_enum_with_mixed_value_types_is_stored_by_name() -> None:
    @dataclass
    class Choice:
        mixed: Mixed = Mixed.A

    world = StoreWorld(mixed="B")
    choice = bind_class(world.store, Choice)
    assert choice == Choice(Mixed.B) and world.set(mixed="A").successful and choice == Choice(Mixed.A)


def test_frozen_slotted_dataclass_can_be_bound() -> None:
    @dataclass(frozen=True, slots=True)
    class Frozen:
        a: int = 1

    world = StoreWorld()
    frozen = bind_class(world.store, Frozen)
    assert world.set(a=2).successful and frozen.a == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        frozen.a = 3  # type: ignore[misc]


def test_copies_of_parameter_object_are_plain_and_independent() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    for made in (copy.copy(drive), copy.deepcopy(drive), snapshot(drive), pickle.loads(pickle.dumps(drive))):
        assert type(made) is Drive and type(made.left) is Motor
        made.max_speed = 99.0
        made.left.pwm = 1000
    assert drive == Drive() and world.get("max_speed") == 0.8


def test_field_without_default_needs_an_initial_object() -> None:
    @dataclass
    class Bare:
        a: int

    with pytest.raises(ParameterClassError, match=r"Bare\.a has no default"):
        bind_class(StoreWorld().store, Bare)
    assert bind_class(StoreWorld().store, Bare, initial=Bare(3)).a == 3


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"initial": 5}, "initial must be an object of Drive, got 5 of type int"),
        ({"initial": Drive(left=5)}, r"initial\.left must be an object of Motor, got 5 of type int"),  # type: ignore[arg-type]
        ({"prefix": 5}, "the prefix must be a str, got 5"),
        ({"validator": "x"}, "the validator must be a function"),
        ({"validator": later}, "the validator 'later' is async"),
    ],
)
def test_bind_class_refuses_arguments_of_wrong_type(arguments: dict[str, Any], reason: str) -> None:
    world = StoreWorld()
    with pytest.raises(TypeError, match=reason):
        bind_class(world.store, Drive, **arguments)
    assert world.store.values() == {}


# ------------------------------------------------------------------------------------- unsupported annotations


@pytest.mark.parametrize(
    ("annotation", "reason"),
    [
        (dict[str, int], "cannot be a parameter"),
        (list[list[int]], "cannot be a parameter"),
        (int | str, "cannot be a parameter"),
        (list[bytes], "cannot be a parameter"),
        (Literal["a", 1], "choices must be all str, all int or all bool"),
        (Annotated[str, Range(0, 1)], "a range is for numbers only"),
        (Annotated[int, Range(0, 1.5)], "must have integer ends"),
        (Annotated[Int8, Range(0, 200)], r"does not fit IntRange\(from_value=-128"),
        (Annotated[int, Range(float("-inf"), 10)], "must have integer ends"),
        (Annotated[int, Range(float("nan"), 10)], "must have integer ends"),
        (Annotated[int, Range(0, 10, -1)], "a step >= 0"),
        (Annotated[int, Range(0, 2**64)], "must have 64-bit integers"),
        (Annotated[float, Range(float("-inf"), 10, 0.5)], "its step and lower end must be finite"),
        (Annotated[float, Range(0, 1, float("inf"))], "lower end must be finite"),
        (Annotated[float, Range(float("nan"), 1)], "must have numbers as its ends"),
        (Annotated[float, Range("a", 1)], "must have numbers as its ends"),  # type: ignore[arg-type]
        (Annotated[float, Range(0, 10**400)], "must have numbers as its ends"),
        (Annotated[int, later], "the validator 'later' is async"),
    ],
)
def test_unsupported_annotation_error_names_class_and_field(annotation: object, reason: str) -> None:
    made = dataclasses.make_dataclass("Bad", [("x", annotation, None)])
    with pytest.raises(ParameterClassError, match=f"Bad.x: .*{reason}"):
        parameter_fields_of(made)


def test_unresolvable_annotation_is_reported() -> None:
    @dataclass
    class Local:
        pwm: int = 0

    @dataclass
    class Holder:
        motor: Local = field(default_factory=Local)

    with pytest.raises(ParameterClassError, match="Holder: name 'Local' is not defined"):
        parameter_fields_of(Holder)


def test_parameter_class_must_be_a_dataclass() -> None:
    with pytest.raises(ParameterClassError, match="is an object; pass its class"):
        parameter_fields_of(Motor())  # type: ignore[arg-type]
    with pytest.raises(ParameterClassError, match="is not a dataclass"):
        parameter_fields_of(int)
