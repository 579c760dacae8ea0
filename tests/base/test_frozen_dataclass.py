"""`frozen_dataclass` makes what `dataclass(frozen=True, slots=True)` makes."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, astuple, dataclass, field, fields, is_dataclass, replace
from typing import Any

import pytest

from rosidl_py_gen.base.frozen_dataclass import frozen_dataclass


def _made(decorate: Callable[[Any], Any]) -> Any:
    class Point:
        """A point."""

        x: int
        y: float = 0.5
        tags: list[str] = field(default_factory=list)

        def __post_init__(self) -> None:
            if self.x < 0:
                raise ValueError("x")

        @property
        def sum(self) -> float:
            return self.x + self.y

    return decorate(Point)


@frozen_dataclass
class One:
    """Class of this module, for pickle."""

    name: str


@frozen_dataclass
class Own:
    """Class with methods of its own."""

    name: str

    def __eq__(self, other: object) -> bool:
        return True

    def __hash__(self) -> int:
        return 5

    def __repr__(self) -> str:
        return "own"


ORIGINAL, OURS = _made(dataclass(frozen=True, slots=True)), _made(frozen_dataclass)


@pytest.mark.parametrize("cls", [ORIGINAL, OURS])
def test_objects_behave_alike(cls: Any) -> None:
    point, same = cls(1), cls(x=1, y=0.5, tags=[])
    assert point == same and point != cls(2) and point != (1, 0.5, [])
    assert repr(point).endswith("Point(x=1, y=0.5, tags=[])") and point.sum == 1.5
    assert replace(point, x=3) == cls(3) and astuple(point) == (1, 0.5, []) and asdict(point)["x"] == 1
    assert is_dataclass(cls) and [one.name for one in fields(cls)] == ["x", "y", "tags"]
    assert cls.__match_args__ == ("x", "y", "tags") and not hasattr(point, "__dict__") and cls.__doc__ == "A point."
    assert point.tags is not cls(1).tags and copy.copy(point) == point and copy.deepcopy(point) == point
    for change in (lambda: setattr(point, "x", 2), lambda: delattr(point, "x"), lambda: setattr(point, "z", 2)):
        with pytest.raises((FrozenInstanceError, TypeError)):
            change()
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
        point.x = 2
    for wrong in ({}, {"x": 1, "z": 2}):
        with pytest.raises(TypeError, match="__init__"):
            cls(**wrong)
    with pytest.raises(ValueError, match="x"):
        cls(-1)
    with pytest.raises(TypeError, match="unhashable"):
        hash(point)


def test_own_methods_stay_and_one_field_is_enough() -> None:
    assert One("a") == One("a") != One("b") and hash(One("a")) == hash(One("a"))
    assert pickle.loads(pickle.dumps(One("a"))) == One("a")
    assert Own("a") == 3 and hash(Own("a")) == 5 and repr(Own("a")) == "own"

    @dataclass(frozen=True, slots=True)
    class Derived(One):
        more: int = 1

    assert Derived("a") == Derived("a", 1) and repr(Derived("a")).endswith("Derived(name='a', more=1)")


def test_a_nan_equals_itself_as_with_dataclass() -> None:
    nan = float("nan")
    for cls in (ORIGINAL, OURS):
        assert cls(1, nan) == cls(1, nan)
