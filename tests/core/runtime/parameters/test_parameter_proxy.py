"""Parameter objects in Python: lists, computed fields, methods, deletion, comparison, copies."""

from __future__ import annotations

import copy
import dataclasses
import functools
import json
import pickle
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import pytest

from rosidl_py_gen.runtime.parameters.dataclass_parameters import bind_class, snapshot, update_parameters
from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError, Parameter, parameter_value


@dataclass
class Motor:
    pwm: int = 10
    gains: list[float] = field(default_factory=lambda: [1.0])


@dataclass(order=True)
class Drive:
    speed: float = 0.5
    mode: str = "auto"
    tags: list[str] = field(default_factory=list)
    left: Motor = field(default_factory=Motor, compare=False)

    @property
    def speed_kmh(self) -> float:
        return self.speed * 3.6

    @speed_kmh.setter
    def speed_kmh(self, value: float) -> None:
        self.speed = value / 3.6

    def stop(self) -> None:
        self.speed = 0.0

    @classmethod
    def of_speed(cls, speed: float) -> Drive:
        return cls(speed=speed)


@dataclass
class Computed:
    width: int = 2
    height: int = 3
    area: int = field(init=False)
    sides: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.area = self.width * self.height
        self.sides = [self.width, self.height]
        self.note = f"{self.width}x{self.height}"

    @functools.cached_property
    def perimeter(self) -> int:
        return 2 * (self.width + self.height)


@pytest.fixture
def store() -> ParameterStore:
    return ParameterStore()


def set_values(store: ParameterStore, **values: object) -> None:
    assert store.set_atomically([Parameter(name, parameter_value(value)) for name, value in values.items()]).successful


# ------------------------------------------------------------------------------------------------------------ lists


@pytest.mark.parametrize(
    "change",
    [
        lambda tags: tags.append("x"),
        lambda tags: tags.extend(["x"]),
        lambda tags: tags.insert(0, "x"),
        lambda tags: tags.pop(),
        lambda tags: tags.remove("a"),
        lambda tags: tags.clear(),
        lambda tags: tags.sort(),
        lambda tags: tags.sort(reverse=True),
        lambda tags: tags.reverse(),
        lambda tags: tags.__setitem__(0, "x"),
        lambda tags: tags.__delitem__(0),
        lambda tags: tags.__imul__(2),
    ],
)
def test_list_parameter_cannot_be_changed_in_place(store: ParameterStore, change: Any) -> None:
    drive = bind_class(store, Drive, initial=Drive(tags=["b", "a"]))
    for tags in (drive.tags, drive.left.gains):
        with pytest.raises(TypeError, match=r"cannot be changed in place; assign a new one"):
            change(tags)
    assert drive.tags == ["b", "a"] and store.get("tags").value == ("b", "a")


def test_list_parameter_is_a_list_and_copies_to_plain_lists(store: ParameterStore) -> None:
    drive = bind_class(store, Drive, initial=Drive(tags=["b", "a"]))
    tags = drive.tags
    assert isinstance(tags, list) and sorted(tags) == ["a", "b"] and json.dumps(tags) == '["b", "a"]'
    copies = [
        list(tags),
        tags[:],
        tags + tags[:0],
        copy.copy(tags),
        copy.deepcopy(tags),
        pickle.loads(pickle.dumps(tags)),
    ]
    for made in (*copies, snapshot(drive).tags, tags.copy()):
        assert type(made) is list and made == ["b", "a"]
        made.append("c")
    assert repr(tags) == "['b', 'a']" and drive.tags == ["b", "a"]


def test_assigning_a_list_sets_its_parameter(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    given = ["a"]
    drive.tags = given
    given.append("not seen")
    drive.tags += ["b"]
    drive.left.gains = [*drive.left.gains, 2.0]
    assert drive.tags == ["a", "b"] and store.get("tags").value == ("a", "b")
    assert drive.left.gains == [1.0, 2.0] and store.get("left.gains").value == (1.0, 2.0)


# -------------------------------------------------------------------------------------------- replacing and comparing


def test_modified_copy_of_parameter_object_can_be_assigned(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    made = dataclasses.replace(snapshot(drive), mode="manual")
    assert type(made) is Drive and type(made.left) is Motor and made == Drive(mode="manual")
    made.tags.append("x")
    made.left.pwm = 99
    assert (drive.mode, drive.tags, drive.left.pwm) == ("auto", [], 10)
    drive.left = dataclasses.replace(snapshot(drive.left), pwm=11)
    assert store.get("left.pwm").value == 11
    drive.left = bind_class(ParameterStore(), Drive, initial=Drive(left=Motor(12))).left
    assert store.get("left.pwm").value == drive.left.pwm == 12


def test_parameter_objects_compare_by_value(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    other = bind_class(ParameterStore(), Drive, initial=Drive(speed=1.0))
    assert drive == Drive() and drive != other and drive != 5 and drive.left == Motor() == other.left
    drive.speed = 1.0
    assert drive == other
    with pytest.raises(TypeError, match="unhashable"):
        hash(drive)


def test_parameter_fields_cannot_be_deleted(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    for live, name in ((drive, "mode"), (drive, "left"), (drive.left, "pwm")):
        with pytest.raises(AttributeError, match=name):
            delattr(live, name)
    assert drive == Drive()


# ---------------------------------------------------------------------------------------------- fields without init


def test_computed_fields_follow_their_parameters(store: ParameterStore) -> None:
    computed = bind_class(store, Computed, initial=Computed(4))
    assert list(store.values()) == ["width", "height"]
    assert (computed.area, computed.sides, computed.note, computed.perimeter) == (12, [4, 3], "4x3", 14)
    computed.width = 5
    assert (computed.area, computed.sides, computed.note, computed.perimeter) == (15, [5, 3], "5x3", 16)
    set_values(store, width=1, height=1)
    assert computed.area == 1 and snapshot(computed) == Computed(1, 1) and snapshot(computed).note == "1x1"
    with pytest.raises(AttributeError, match="Computed has no parameter 'area'"):
        computed.area = 7
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        computed.nothing  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(AttributeError, match="has no parameter 'area'"):
        update_parameters(computed, area=3)


def test_property_setters_set_parameters(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    drive.speed_kmh = 7.2
    assert drive.speed == 2.0 and store.get("speed").value == 2.0 and drive.speed_kmh == 7.2


def test_methods_of_parameter_class_can_set_parameters(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    drive.stop()
    assert drive.speed == store.get("speed").value == 0.0 and Drive.of_speed(2.0).speed == 2.0
    assert drive.of_speed(3.0) == Drive(speed=3.0)


# ------------------------------------------------------------------------------------------------------ wrong values


def test_nested_group_accepts_only_objects_of_its_class(store: ParameterStore) -> None:
    drive = bind_class(store, Drive)
    with pytest.raises(TypeError, match="left must be an object of Motor, got 5 of type int"):
        drive.left = 5  # type: ignore[assignment]
    with pytest.raises(TypeError, match="left must be an object of Motor, got None"):
        update_parameters(drive, speed=1.0, left=None)
    with pytest.raises(InvalidParameterValueError, match=r"parameter 'speed': <object"):
        drive.speed = object()  # type: ignore[assignment]
    with pytest.raises(
        InvalidParameterValueError, match=r"parameter 'left\.pwm': 'x' is of type STRING, expected INTEGER"
    ):
        drive.left = Motor(pwm="x")  # type: ignore[arg-type]
    assert drive == Drive() and drive.left == Motor()


# ----------------------------------------------------------------------------------------------------------- threads


@dataclass
class Triple:
    a: int = 0
    b: int = 0
    nested: Motor = field(default_factory=lambda: Motor(0))
    total: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.total = self.a + self.b + self.nested.pwm


def test_threads_never_read_partial_updates(store: ParameterStore) -> None:
    live = bind_class(store, Triple)
    torn: list[object] = []
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            # A later read never returns an older value: a is read after b, b after the nested field.
            order = live.nested.pwm, live.b, live.a
            seen = snapshot(live)
            stored = [value.value for value in store.get_all(["a", "b", "nested.pwm"])]
            if sorted(order) != list(order) or not seen.a == seen.b == seen.nested.pwm == seen.total / 3:
                torn.append((order, seen))
            if len(set(stored)) != 1:
                torn.append(stored)

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    for number in range(1, 1500):
        update_parameters(live, a=number, b=number, nested=Motor(number))
    done.set()
    for reader in readers:
        reader.join()
    assert torn == []


def test_sets_of_several_threads_are_serialized(store: ParameterStore) -> None:
    live = bind_class(store, Triple)

    def count(parameters: list[Parameter]) -> list[Parameter]:
        number = live.a + 1
        time.sleep(0.002)
        return [Parameter("a", parameter_value(number))]

    store.callbacks.add("pre-set", count)
    threads = [threading.Thread(target=setattr, args=(live, "a", 0)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert live.a == 8


def test_reads_do_not_wait_for_slow_set_callbacks(store: ParameterStore) -> None:
    live = bind_class(store, Triple)
    entered, release = threading.Event(), threading.Event()

    def slow(parameters: list[Parameter]) -> None:
        entered.set()
        assert release.wait(20)

    added = store.callbacks.add("pre-set", lambda ps: slow(ps) or ps)  # type: ignore[func-returns-value]
    setter = threading.Thread(target=lambda: setattr(live, "a", 1))
    setter.start()
    assert entered.wait(20)
    assert live.a == 0 and snapshot(live) == Triple() and store.get("a").value == 0 and store.listing().names
    release.set()
    setter.join()
    added.close()
    # After a set is stored, its post-set callbacks block no other thread.
    entered.clear()
    release.clear()
    added = store.callbacks.add("post-set", slow)
    setter = threading.Thread(target=lambda: setattr(live, "a", 2))
    setter.start()
    assert entered.wait(20)
    added.close()
    live.a = 3
    release.set()
    setter.join()
    assert live.a == 3
