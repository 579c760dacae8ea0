"""Errors of invalid values: the path, from `encode` as from `validate`."""

from __future__ import annotations

import copy
import pickle
from collections import UserList, deque
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.definition_strategies import values, worlds
from support.example_counts import examples
from support.inner_state import type_fields

from rosidl_py_gen import EncodeError, compile_definition, decode, encode, get_message, to_dict, validate
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr.layout import Count

Everything = compile_definition(
    "wrong/msg/Everything",
    """bool flag
byte octet
char letter
int8 i8
uint8 u8
int16 i16
uint16 u16
int32 i32
uint32 u32
int64 i64
uint64 u64
float32 f32
float64 f64
string text
wstring wide
string<=3 short_text
wstring<=3 short_wide
string[] texts
string<=3[<=2] few_texts
string[2] two_texts
wstring[] wides
Part part
Part[] parts
Part[<=2] few_parts
Part[2] two_parts
Fixed[] fixed
Fixed[2] two_fixed
================================================================================
MSG: wrong/Part
string name
uint8 class
Fixed inner
================================================================================
MSG: wrong/Fixed
float64 x
int16[2] pair
""",
)
Part = type_fields(Everything)[21].cls
assert Part is not None
Fixed = type_fields(Part)[2].cls
assert Fixed is not None
TOP = "wrong/msg/Everything"


part: Any = Part
fixed: Any = Fixed
WRONG: list[tuple[str, Any, str, str]] = [
    # field, value, path after the field, error text
    ("flag", 2, "", "expected bool, found 2"),
    ("flag", "yes", "", "expected bool, found 'yes'"),
    ("flag", [], "", "expected bool, found []"),
    ("octet", b"\1", "", "expected int, found b'\\x01'"),
    ("letter", "a", "", "expected int, found 'a'"),
    *((name, None, "", "expected int, found None") for name in ("i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64")),
    *((name, 1.0, "", "expected int, found 1.0") for name in ("i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64")),
    ("i8", 128, "", "expected int8 in -128..127, found 128"),
    ("u8", -1, "", "expected uint8 in 0..255, found -1"),
    ("octet", 256, "", "expected uint8 in 0..255, found 256"),
    ("i32", -(2**31) - 1, "", "expected int32 in -2147483648..2147483647, found -2147483649"),
    ("i64", 2**63, "", "expected int64 in -9223372036854775808..9223372036854775807, found 9223372036854775808"),
    ("u64", 2**64, "", "expected uint64 in 0..18446744073709551615, found 18446744073709551616"),
    ("f32", 1e300, "", "expected float that fits float32, found 1e+300"),
    ("f32", "1", "", "expected float, found '1'"),
    ("f64", 10**400, "", "expected float that fits float64, found 1000"),
    ("f64", 1j, "", "expected float, found 1j"),
    ("text", 5, "", "expected str, found 5"),
    ("text", b"x", "", "expected str, found b'x'"),
    ("text", "a\ud800", "", "expected text without lone surrogates, found one at character 1"),
    ("wide", "\udc00", "", "expected text without lone surrogates, found one at character 0"),
    ("short_text", "abcd", "", "expected at most 3 characters, found 4"),
    ("short_text", 5, "", "expected str, found 5"),
    ("short_wide", "abcd", "", "expected at most 3 characters, found 4"),
    ("texts", "abc", "", "expected a list of string, found 'abc'"),
    ("texts", ["a", 5], "[1]", "expected str, found 5"),
    ("texts", [None], "[0]", "expected str, found None"),
    ("texts", {}, "", "expected a list of string, found {}"),
    ("few_texts", ["a", "abcd"], "[1]", "expected at most 3 characters, found 4"),
    ("few_texts", ["a", "b", "c"], "", "expected at most 2 elements, found 3"),
    ("two_texts", ["a"], "", "expected exactly 2 elements, found 1"),
    ("wides", ["a", b"b"], "[1]", "expected str, found b'b'"),
    ("part", None, "", "expected wrong/msg/Part, found None"),
    ("part", fixed(), "", "expected wrong/msg/Part, found Fixed("),
    ("part", {"name": "x"}, "", "expected wrong/msg/Part, found {'name': 'x'}"),
    ("part", part(class_=300), ".class", "expected uint8 in 0..255, found 300"),
    ("part", part(inner=fixed(x="a")), ".inner.x", "expected float, found 'a'"),
    ("part", part(inner=fixed(pair=[1])), ".inner.pair", "expected exactly 2 elements, found 1"),
    ("part", part(inner=fixed(pair=[1, 2**15])), ".inner.pair[1]", "expected int16 in -32768..32767, found 32768"),
    ("parts", {}, "", "expected a list of wrong/msg/Part, found {}"),
    ("parts", np.zeros(0), "", "expected a list of wrong/msg/Part, found array([]"),
    ("parts", part(), "", "expected a list of wrong/msg/Part, found Part("),
    ("parts", [part(), None], "[1]", "expected wrong/msg/Part, found None"),
    ("parts", [part(), part(), part(), part(inner=fixed(x=""))], "[3].inner.x", "expected float, found ''"),
    ("few_parts", [part()] * 3, "", "expected at most 2 elements, found 3"),
    ("two_parts", (part(), 7), "[1]", "expected wrong/msg/Part, found 7"),
    ("fixed", [fixed(), part()], "[1]", "expected wrong/msg/Fixed, found Part("),
    ("fixed", {}, "", "expected a list of wrong/msg/Fixed, found {}"),
    ("fixed", deque(), "", "expected a list of wrong/msg/Fixed, found deque([])"),
    ("two_fixed", [], "", "expected exactly 2 elements, found 0"),
    ("two_fixed", UserList([fixed(), fixed()]), "", "expected a list of wrong/msg/Fixed, found ["),
]


@pytest.mark.parametrize(("field", "value", "where", "text"), WRONG)
def test_wrong_value_is_reported_with_its_path(field: str, value: Any, where: str, text: str) -> None:
    message = Everything()
    assert encode(message)
    setattr(message, field, value)
    for check in (encode, validate, type(message).encode):
        with pytest.raises(EncodeError) as caught:
            check(message)
        assert caught.value.path == f"{TOP}.{field}{where}"
        assert caught.value.reason.startswith(text)
        assert str(caught.value) == f"{caught.value.path}: {caught.value.reason}"
        assert len(str(caught.value)) < 300
        again = pickle.loads(pickle.dumps(caught.value))
        assert (type(again), again.path, again.reason) == (EncodeError, caught.value.path, caught.value.reason)
    assert getattr(message, field) is value


def test_message_of_another_class_with_equal_fields_is_refused() -> None:
    header = get_message("std_msgs/msg/Header")
    duration = get_message("builtin_interfaces/msg/Duration")
    for message in (
        header(stamp=duration()),
        get_message("geometry_msgs/msg/PoseStamped")(header=header(stamp=duration())),
    ):
        for check in (encode, validate):
            with pytest.raises(EncodeError, match=r"\.stamp: expected builtin_interfaces/msg/Time, found Duration\("):
                check(message)


def test_deleted_field_is_reported_as_not_set() -> None:
    message = Everything()
    del message.part.inner.x
    for check in (encode, validate):
        with pytest.raises(EncodeError) as caught:
            check(message)
        assert (caught.value.path, caught.value.reason) == (f"{TOP}.part.inner.x", "the field is not set")


def test_sequence_longer_than_its_count_can_express_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Count, "MAX", 3)  # of 2^32 - 1, which would need as many bytes
    message = get_message("std_msgs/msg/UInt8MultiArray")(data=[1] * 4)
    with pytest.raises(EncodeError, match=r"Array\.data: expected at most 3 elements, found 4"):
        validate(message)


def test_values_whose_methods_raise_are_reported_with_path() -> None:
    class Hostile:
        def __repr__(self) -> str:
            raise RuntimeError("no")

        def __index__(self) -> int:
            raise KeyError("no")

    for field in ("u8", "f64", "text", "texts", "part", "parts", "flag"):
        message = Everything()
        setattr(message, field, Hostile())
        for check in (encode, validate):
            with pytest.raises(EncodeError) as caught:
                check(message)
            assert caught.value.path == f"{TOP}.{field}"


class Index:
    def __index__(self) -> int:
        return 5


class LoudText(str):
    """Subclass of str, as a caller may define it."""


ACCEPTED: list[tuple[str, Any, Any]] = [
    ("flag", np.True_, True),
    ("flag", 1, True),
    ("i32", True, 1),
    ("i32", np.int64(-7), -7),
    ("u8", Index(), 5),
    ("f64", 3, 3.0),
    ("f64", np.float32(0.5), 0.5),
    ("f32", np.float64(0.5), 0.5),
    ("text", LoudText("a"), "a"),
    ("text", np.str_("b"), "b"),
    ("short_wide", "😀😀😀", "😀😀😀"),
    ("texts", ("a", LoudText("b")), ["a", "b"]),
    ("two_texts", ("a", ""), ["a", ""]),
    ("parts", (), []),
]


@pytest.mark.parametrize(("field", "value", "wanted"), ACCEPTED)
def test_equivalent_values_of_other_types_are_encoded(field: str, value: Any, wanted: Any) -> None:
    message = Everything()
    setattr(message, field, value)
    validate(message)
    assert to_dict(decode(Everything, encode(message)))[field] == wanted


def test_instances_of_subclasses_are_encoded_like_their_base_class() -> None:
    @dataclass(slots=True, eq=False, repr=False)
    class MyFixed(Fixed):  # type: ignore[misc, valid-type]
        note: str = "mine"

        def double(self) -> float:
            return float(2 * self.x)

    class MyPart(Part):  # type: ignore[misc, valid-type]
        pass

    inner = MyFixed(x=1.5)
    assert inner.double() == 3.0
    mine = Everything(part=MyPart("n", 2, inner), parts=[MyPart()], fixed=[inner, Fixed()], two_fixed=(inner, inner))
    plain = Everything(
        part=Part("n", 2, Fixed(x=1.5)), parts=[Part()], fixed=[Fixed(x=1.5), Fixed()], two_fixed=[Fixed(x=1.5)] * 2
    )
    validate(mine)
    assert encode(mine) == encode(plain)
    assert encode(inner) == encode(Fixed(x=1.5))
    assert type(decode(MyPart, encode(Part("q")))) is MyPart


@pytest.mark.slow
@settings(max_examples=examples(400))
@given(worlds(), st.data())
def test_validate_and_encode_refuse_the_same_messages_for_the_same_reason(world: Any, data: st.DataObject) -> None:
    reference = world.reference()
    message = reference.build(world.compile(), data.draw(values(reference, world.top)))
    target: Any = message
    while True:  # descend to a nested message and set one of its fields to a value that may be wrong
        fields = type_fields(target)
        inside = [getattr(target, field.py_name) for field in fields if field.cls is not None]
        inside = [one for value in inside for one in (value if isinstance(value, list) else [value])]
        if not inside or not data.draw(st.booleans()):
            break
        target = data.draw(st.sampled_from(inside))
    if type_fields(target):
        field = data.draw(st.sampled_from(type_fields(target)))
        setattr(target, py_name(field.ros_name), copy.deepcopy(data.draw(st.sampled_from(STRANGE))))
    outcomes: list[Any] = []
    for check in (validate, encode):
        try:
            check(message)
            outcomes.append(None)
        except EncodeError as error:
            assert "cannot be encoded" not in str(error)
            outcomes.append((error.path, error.reason))
    assert outcomes[0] == outcomes[1]


STRANGE: list[Any] = [
    *(None, True, 0, 1, -1, 255, 256, 2**31, 2**64, 10**400, 0.5, 1e300, float("nan"), 1j, "", "a", "abcdef", "\ud800"),
    *(b"", b"abc", bytearray(b"abc"), [], [1], [1, 2, 3], [None], ["a"], ["\udc80"], ["abcdefgh"], [0.5] * 3),
    *((), ("a",)),
    *({}, {"a": 1}, set(), deque(), deque([1]), range(3), [[]], [b"a"], UserList(["a"]), np.True_, np.int8(3)),
    *(np.zeros(0), np.zeros(3), np.zeros(3, bool), np.zeros(3, "i1"), np.zeros((3, 1)), np.float64(1), np.array(1)),
    *(np.zeros(0, object), np.array(["a"]), np.array(["a"], object), np.array([True, None]), np.zeros(3, ">u8")),
    *(np.zeros(6)[::2], np.zeros(6, "u1")[::2], np.zeros(6, bool)[::2], fixed(), part(), [fixed()], [part()] * 3),
]
