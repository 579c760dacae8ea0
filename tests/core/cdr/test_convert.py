"""Messages as dicts and JSON: partial input, hints, numbers that JSON does not have."""

from __future__ import annotations

import json
import math
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from rosidl_py_gen import EncodeError, compile_definition, encode, from_dict, from_json, to_dict, to_json

LINE = "=" * 80
Sample: Any = compile_definition(
    "convert/msg/Sample",
    f"""float64 f64 1.5
float32 f32
float64[] many
float32[2] pair
bool[] flags
uint8[] data
string text "default"
string[] words ["a"]
uint8 class 7
Inner inner
Inner[] list
int64 big
uint64 huge
wstring wide
{LINE}
MSG: convert/Inner
float64 x -1
float32 from
""",
)
NAME = "convert/msg/Sample"


def test_dicts_have_ros_names_and_plain_values() -> None:
    found = to_dict(Sample())
    first = ["f64", "f32", "many", "pair", "flags", "data", "text", "words"]
    assert list(found) == [*first, "class", "inner", "list", "big", "huge", "wide"]
    assert found["class"] == 7
    assert found["inner"] == {"x": -1.0, "from": 0.0}
    assert type(found["pair"]) is list
    assert json.loads(to_json(Sample())) == found


def test_dicts_share_nothing_with_the_message() -> None:
    message = Sample(words=["w"])
    to_dict(message)["words"].append("more")
    given = ["v"]
    built = from_dict(Sample, {"words": given, "data": (source := np.array([1, 2], np.uint8))})
    source[0] = 9
    assert message.words == ["w"]
    assert built.data.tolist() == [1, 2]


def test_fields_missing_from_a_dict_keep_their_defaults() -> None:
    assert from_dict(Sample, {}) == Sample() == from_json(Sample, "{}")
    found = from_dict(Sample, {"inner": {"from": 2}, "list": [{}, {"x": 3}], "class": 1})
    assert (found.inner.x, found.inner.from_, found.class_, found.text) == (-1.0, 2.0, 1, "default")
    assert [one.x for one in found.list] == [-1.0, 3.0]
    assert from_dict(Sample, MappingProxyType({"text": "x"})).text == "x"


@pytest.mark.parametrize(
    ("values", "path", "text"),
    [
        ({"txt": "x"}, NAME, 'unknown field "txt"; did you mean "text"?'),
        ({"class_": 1}, NAME, 'unknown field "class_"; did you mean "class"?'),
        ({"list": [{}, {"form": 1}]}, f"{NAME}.list[1]", 'unknown field "form"; did you mean "from"?'),
        ({5: 1}, NAME, 'unknown field "5"'),
        ({"x" * 10_000: 1}, NAME, "unknown field"),
        ({"inner": 5}, f"{NAME}.inner", "expected a mapping of fields, found 5"),
        ({"list": {}}, f"{NAME}.list", "expected a list of convert/msg/Inner, found {}"),
        ({"words": "abc"}, f"{NAME}.words", "expected a list of string, found 'abc'"),
        ({"words": ["a", None]}, f"{NAME}.words[1]", "expected str, found None"),
        ({"data": [1, 256]}, f"{NAME}.data[1]", "expected uint8 in 0..255, found 256"),
        ({"data": "abc"}, f"{NAME}.data", "expected a sequence of uint8, found 'abc'"),
        ({"pair": [1.0]}, f"{NAME}.pair", "expected exactly 2 elements, found 1"),
        ({"f64": "nan"}, f"{NAME}.f64", "expected float, found 'nan'"),
        ({"many": [1, "Inf"]}, f"{NAME}.many[1]", "expected float, found 'Inf'"),
        ({"many": "NaN"}, f"{NAME}.many", "expected a sequence of float64, found 'NaN'"),
        ({"f32": 1e300}, f"{NAME}.f32", "expected float that fits float32, found 1e+300"),
        ({"f64": 10**400}, f"{NAME}.f64", "expected float that fits float64, found 1"),
        ([], NAME, "expected a mapping of fields, found []"),
        ("text", NAME, "expected a mapping of fields, found 'text'"),
    ],
)
def test_wrong_dict_or_json_values_are_reported_with_path(values: Any, path: str, text: str) -> None:
    with pytest.raises(EncodeError) as caught:
        from_dict(Sample, values)
    assert caught.value.path == path
    assert caught.value.reason.startswith(text)
    assert len(str(caught.value)) < 400
    if not isinstance(values, dict) or all(isinstance(key, str) for key in values):
        with pytest.raises(EncodeError) as again:
            from_json(Sample, json.dumps(values))
        assert (again.value.path, again.value.reason) == (path, caught.value.reason)


def test_converting_a_message_with_a_wrong_value_reports_its_path() -> None:
    for convert, values, reason in (
        (to_dict, {"inner": 5}, "inner: expected "),
        (to_json, {"text": b"x"}, "text: expected str"),
    ):
        with pytest.raises(EncodeError, match=reason):
            convert(Sample(**values))


def test_json_contains_nan_and_infinity_as_text() -> None:
    message = Sample(
        f64=math.nan, f32=math.inf, many=[1.0, -math.inf, math.nan], pair=[math.inf, 0.0], list=[Sample().inner]
    )
    message.list[0].x = -math.inf
    text = to_json(message)
    found = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert (found["f64"], found["f32"], found["many"]) == ("NaN", "Infinity", [1.0, "-Infinity", "NaN"])
    assert found["list"][0]["x"] == "-Infinity"
    assert encode(from_json(Sample, text)) == encode(message)
    assert encode(from_json(Sample, text.encode())) == encode(message)
    assert encode(from_dict(Sample, found)) == encode(message)
    assert encode(from_dict(Sample, to_dict(message))) == encode(message)


def test_strings_that_look_like_numbers_stay_strings() -> None:
    message = Sample(text="NaN", words=["Infinity", "-Infinity"], wide="NaN")
    assert from_json(Sample, to_json(message)) == message


def test_integers_keep_every_digit_and_floats_their_sign() -> None:
    message = Sample(big=-(2**63), huge=2**64 - 1, f64=-0.0, many=[5e-324, 1.7976931348623157e308, 0.1])
    again = from_json(Sample, to_json(message))
    assert again == message
    assert math.copysign(1, again.f64) == -1
    assert encode(from_json(Sample, '{"f64": 1, "many": [1, 2], "f32": 3}')) == encode(
        Sample(f64=1.0, many=[1, 2], f32=3)
    )
    assert type(from_dict(Sample, {"f64": 1}).f64) is float


def test_json_is_indented_on_request_and_keeps_unicode_text() -> None:
    message = Sample(text="é😀\n\"'\\", wide="ü")
    assert "é😀" in to_json(message)
    assert to_json(message, indent=2).count("\n") > 10
    assert from_json(Sample, to_json(message, indent=2)) == message


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "5", "null", '"x"', "{'a': 1}", b"\xff\xfe\xfd", "[" * 100_000, "9" * 10_000]
)
def test_from_json_refuses_text_that_is_not_a_json_object(text: Any) -> None:
    with pytest.raises(EncodeError) as caught:
        from_json(Sample, text)
    assert caught.value.path == NAME


def test_values_of_other_types_are_converted_to_the_field_type() -> None:
    message = from_dict(
        Sample, {"data": b"abc", "many": np.array([1, 2]), "words": ("x",), "flags": [1, 0], "pair": (1, 2)}
    )
    assert message.data.dtype == np.uint8
    assert message.many.dtype == np.float64
    assert (message.words, message.flags.dtype) == (["x"], np.bool_)
    assert message.data.flags.writeable
    odd = Sample(data=b"ab", many=(1, 2.5), class_=np.uint8(5), flags=[np.True_], f64=np.float32(0.5))
    found = to_dict(odd)
    assert (found["data"], found["many"], found["class"]) == ([97, 98], [1, 2.5], 5)
    assert (found["flags"], found["f64"]) == ([True], 0.5)
    assert from_json(Sample, to_json(odd)) == odd
