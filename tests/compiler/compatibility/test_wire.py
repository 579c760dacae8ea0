"""Verdicts about old messages with new definitions, compared with the result of decoding."""

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

from rosidl_py_gen import DecodeError, to_dict
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.compatibility.definition_set import DefinitionSet, collect
from rosidl_py_gen.compiler.compatibility.wire_compatibility import ReadResult, ReadVerdict, WireCompatibility
from rosidl_py_gen.errors import DefinitionError

if TYPE_CHECKING:
    from collections.abc import Mapping

NAME = "a_msgs/msg/Sample"
POINT = f"\n{'=' * 80}\nMSG: a_msgs/Point\n"


def facts(definitions: Mapping[str, str]) -> DefinitionSet:
    return collect(texts(definitions), [split_ros_name(name) for name in definitions])


def verdict(old: str, new: str, points: tuple[str, str] = ("float64 x", "float64 x")) -> ReadVerdict:
    sides = [
        facts({NAME: text, "a_msgs/msg/Point": point}).messages for text, point in zip((old, new), points, strict=True)
    ]
    return WireCompatibility(*sides).verdict(NAME, NAME)


CASES = [
    # old, new, verdict, reason
    ("int32 a", "int32 a", "same", ""),
    ("int32 a", "int32 B=3\nint32 a 5  # other words", "same", ""),
    ("uint8 a\nbyte b", "byte a\nchar b", "same", ""),
    ("bool a\nbool[] b", "uint8 a\nint8[] b", "same", ""),
    ("string<=3 a\nint8[<=4] b", "string<=5 a\nint8[] b", "same", ""),
    ("int32 a\nstring b", "int32 a", "without", "b: not read"),
    ("int32 a\nstring b", "", "without", "a, b: not read"),
    ("int32 a", "int32 b", "renamed", "b: is what a was"),
    ("int32 a\nint32 b", "int32 b\nint32 a", "other", "b: is read from the place of a"),
    ("int32 a", "uint32 a", "sometimes", "a: int32 is read as uint32, the same from 0 to 2147483647"),
    ("uint8 a", "bool a", "sometimes", "a: uint8 is read as bool, of which only 0 and 1 are values"),
    ("string a", "string<=2 a", "sometimes", "a: texts of more than 2 characters are too long"),
    ("int8[] a", "int8[<=2] a", "sometimes", "a: more than 2 elements cannot be read"),
    ("int32 a", "int32 a\nint32 b", "fails", "b: messages end before it"),
    ("int32 a", "float32 a", "other", "a: int32 is read as float32"),
    ("int32 a", "int64 a", "other", "a: int32 is read as int64"),
    ("string a", "wstring a", "other", "a: string is read as wstring"),
    ("int32[3] a", "int32[4] a", "other", "a: int32[3] is read as int32[4]"),
    ("int32[3] a", "int32[] a", "other", "a: int32[3] is read as int32[]"),
    ("int32 a\nint32 b", "int32 c\nint32 a\nint32 b", "other", "c: is read from the place of a"),
    ("", "uint8 a", "other", "a: a message without fields is one byte that belongs to no field"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "reading", "reason"), CASES)
def test_verdict_of_a_changed_definition_depends_on_its_layout(old: str, new: str, reading: str, reason: str) -> None:
    found = verdict(old, new)
    assert (found.reading.value, "; ".join(found.reasons)) == (reading, reason)


@pytest.mark.parametrize(
    ("text", "reading", "reason"),
    [
        ("int8 a\nPoint at", "fails", "at.y: messages end before it"),
        ("Point at\nint8 a", "other", "at.y: is read from the data after the message"),
        ("Point[] at", "other", "at[].y: is read from the data after the message"),
        ("Point[2] at", "other", "at[].y: is read from the data after the message"),
    ],
)
def test_extra_field_in_a_nested_message_shifts_the_data_after_it(text: str, reading: str, reason: str) -> None:
    found = verdict(text, text, ("float64 x", "float64 x\nfloat64 y"))
    assert (found.reading.value, found.reasons) == (reading, (reason,))
    found = verdict(text, text, ("float64 x\nfloat64 y", "float64 x"))
    assert found.reading.value == ("without" if reading == "fails" else "other")


def test_verdict_has_at_most_ten_reasons() -> None:
    old = "\n".join(f"int32 a{number}" for number in range(50))
    assert len(verdict(old, old.replace("int32", "uint32")).reasons) == 10


# --- decoded ----------------------------------------------------------------------------------------------------------


def leaves(value: Any) -> list[Any]:
    """Return the values of a message in the order of its fields, without their names."""
    if isinstance(value, dict):
        return [leaf for one in value.values() for leaf in leaves(one)]
    if isinstance(value, (list, tuple, np.ndarray)):
        return [len(value), *(leaf for one in value for leaf in leaves(one))]
    return [value]


def same(one: Any, other: Any) -> bool:
    """Return True if the values are equal; NaN equals NaN, and True equals 1."""
    return len(one) == len(other) and all(a == b or (a != a and b != b) for a, b in zip(one, other, strict=True))


@settings(max_examples=examples(400))
@given(changed_worlds())
def test_verdicts_match_the_results_of_decoding(case: tuple[World, World, Reference, dict[str, Any]]) -> None:
    old, new, reference, value = case
    try:
        new_class = new.compile()
    except DefinitionError:  # two fields of one name
        assume(False)
    sides = [facts(dict(world.texts)).messages for world in (old, new)]
    found = WireCompatibility(*sides).verdict(old.top, old.top)
    event(found.reading.value)
    message = reference.build(old.compile(), value)
    old_values = to_dict(message)
    if found.reading is ReadResult.FAILS:
        with pytest.raises(DecodeError):
            new_class.decode(message.encode())
        return
    if found.reading in (ReadResult.DEPENDS_ON_VALUES, ReadResult.MISREAD):  # these verdicts make no claim
        return
    read = to_dict(new_class.decode(message.encode()))
    if found.reading is ReadResult.SAME:
        assert same(leaves(read), leaves(old_values)) and names(read) == names(old_values)
    else:  # under new names, or without the last ones
        assert same(leaves(read), leaves(old_values)[: len(leaves(read))])


def names(value: Any, path: str = "") -> list[str]:
    if not isinstance(value, dict):
        return [path]
    return [name for key, one in value.items() for name in names(one, f"{path}.{key}")]
