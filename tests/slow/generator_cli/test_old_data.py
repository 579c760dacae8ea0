"""Old messages with new definitions: read as before or not, compared with the result of decoding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import assume, event, given, settings
from support.changed_definitions import changed_worlds
from support.definition_strategies import World
from support.example_counts import examples
from support.interface_packages import texts
from support.reference_cdr import Reference

from rosidl_py_gen import to_dict
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.generator_cli.compare import DefinitionSet, collect, compare

if TYPE_CHECKING:
    from collections.abc import Mapping

NAME, POINT = "a_msgs/msg/Sample", "a_msgs/msg/Point"


def facts(definitions: Mapping[str, str]) -> DefinitionSet:
    return collect(texts(definitions), [RosName.parse(name) for name in definitions])


def reads_old_data(name: str, old: Mapping[str, str], new: Mapping[str, str]) -> bool:
    changes = [one for type_ in compare(facts(old), facts(new)).changed for one in type_.messages if one.name == name]
    return all(one.reads_old_data for one in changes)


@pytest.mark.parametrize(
    ("old", "new", "is_same"),
    [
        ("int32 a", "int32 B=3\nint32 a 5  # other words", True),
        ("uint8 a\nbyte b", "byte a\nchar b", True),
        ("bool a\nbool[] b", "uint8 a\nint8[] b", True),
        ("string<=3 a\nint8[<=4] b", "string<=5 a\nint8[] b", True),
        ("int32 a\nstring b", "int32 a", False),
        ("int32 a", "int32 a\nint32 b", False),
        ("int32 a", "int32 b", False),
        ("int32 a\nint32 b", "int32 b\nint32 a", False),
        ("int32 a", "uint32 a", False),
        ("int32 a", "float32 a", False),
        ("int32 a", "int64 a", False),
        ("uint8 a", "bool a", False),
        ("string a", "string<=2 a", False),
        ("string a", "wstring a", False),
        ("string a", "int32 a", False),
        ("int32 a", "Point a", False),
        ("int8[] a", "int8[<=2] a", False),
        ("int32[3] a", "int32[4] a", False),
        ("int32[3] a", "int32[] a", False),
        ("", "uint8 a", False),
    ],
)
def test_old_data_are_read_as_before_if_the_layout_is_the_same(old: str, new: str, is_same: bool) -> None:
    point = {POINT: "float64 x"}
    assert reads_old_data(NAME, {NAME: old, **point}, {NAME: new, **point}) is is_same


@pytest.mark.parametrize("field", ["Point at", "Point[] at", "Point[2] at", "int8 a\nPoint[<=3] at"])
def test_the_layout_of_nested_messages_counts(field: str) -> None:
    old, wider, more = ({NAME: field, POINT: text} for text in ("string<=3 x", "string x", "string<=3 x\nint8 y"))
    assert reads_old_data(NAME, old, wider) and not reads_old_data(NAME, wider, old)
    assert not reads_old_data(NAME, old, more) and not reads_old_data(NAME, more, old)


@settings(max_examples=examples(400))
@given(changed_worlds())
def test_old_data_that_are_read_as_before_are_decoded_as_before(
    case: tuple[World, World, Reference, dict[str, Any]],
) -> None:
    old, new, reference, value = case
    try:
        now = new.compile()
    except DefinitionError:  # two fields of one name
        assume(False)
    is_same = reads_old_data(old.top, dict(old.texts), dict(new.texts))
    event(str(is_same))
    if is_same:
        message = reference.build(old.compile(), value)
        assert same(to_dict(now.decode(message.encode())), to_dict(message))


def same(one: Any, other: Any) -> bool:
    """Compare values; NaN equals NaN, and True equals 1, as a bool may be read as a number."""
    if isinstance(one, dict):
        return [*one] == [*other] and all(same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple, np.ndarray)):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other or (one != one and other != other))
