"""Generated messages as dataclasses: construction, comparison, copies, pickle, repr."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest
from support.inner_state import type_fields

from rosidl_py_gen import Message, compile_definition, decode, encode, get_message, get_service

TEXT = """# How warm it is. [degC]
float64[] values [1.5, 2.5]   # [degC]
string name "it's"
uint8 class 7
Inner inner
Inner[] many
Inner[2] two
bool[3] flags [true, false, true]
string[] words ["a", "b"]
uint8 LIMIT=200
string GREETING="hi # there"
float32 RATIO=0.5
================================================================================
MSG: plain/Inner
int32 x -3
float32[4] quad
"""
Sample: Any = compile_definition("plain/msg/Sample", TEXT)
Inner: Any = type_fields(Sample)[3].cls


def test_fields_have_the_order_and_names_of_the_definition() -> None:
    names = [field.name for field in dataclasses.fields(Sample)]
    assert names == ["values", "name", "class_", "inner", "many", "two", "flags", "words"]
    assert Sample.__slots__ == tuple(names)
    with pytest.raises(AttributeError):
        Sample().typo = 1


def test_construction_is_positional_and_by_keyword() -> None:
    by_position = Sample([1.0], "n", 3, Inner(5), [Inner(6)], [Inner(7), Inner(8)], [True] * 3, ["w"])
    by_name = Sample(
        values=[1.0], name="n", class_=3, inner=Inner(x=5), many=[Inner(x=6)], two=[Inner(x=7), Inner(x=8)],
        flags=[True] * 3, words=["w"],
    )  # fmt: skip
    assert by_position == by_name
    with pytest.raises(TypeError):
        Sample(nome="x")


def test_default_values_match_the_definition_and_are_never_shared() -> None:
    first, second = Sample(), Sample()
    assert first.values.tolist() == [1.5, 2.5]
    assert (first.name, first.class_, first.words) == ("it's", 7, ["a", "b"])
    assert first.flags.tolist() == [True, False, True]
    assert first.inner.x == -3
    assert [one.x for one in first.two] == [-3, -3]
    assert first.two[0] is not first.two[1]
    first.words.append("c")
    first.values[0] = 9
    first.inner.x = first.two[0].x = 9
    first.many.append(Inner())
    assert second == Sample()
    assert second.words == ["a", "b"]


def test_constants_are_class_attributes() -> None:
    assert (Sample.LIMIT, Sample.GREETING, Sample.RATIO) == (200, '"hi', 0.5)
    assert "LIMIT" not in [field.name for field in dataclasses.fields(Sample)]
    with pytest.raises(AttributeError):
        Sample().LIMIT = 5


def test_class_docstring_contains_comment_and_unit() -> None:
    assert Sample.__doc__ is not None
    assert "How warm it is" in Sample.__doc__
    assert "degC" in Sample.__doc__


def test_messages_are_equal_if_their_values_are_equal() -> None:
    one = decode(Sample, encode(Sample()))
    assert one == Sample()
    assert (one != Sample()) is False
    for other in (Sample(values=[1.5, 2.5]), Sample(values=(1.5, 2.5)), Sample(values=np.array([1.5, 2.5], "f4"))):
        assert one == other
        assert other == one
    for changed in (
        Sample(values=[1.5, 2.6]), Sample(values=[1.5]), Sample(values=[]), Sample(name="x"), Sample(class_=1),
        Sample(inner=Inner(9)), Sample(many=[Inner()]), Sample(two=[Inner(), Inner(1)]), Sample(words=["a"]),
        Sample(values=[[1.5], [2.5]]), Sample(values=[[1], 2]), Sample(values=None), Sample(words=None),
        Sample(many=None), Sample(values="ab"),
    ):  # fmt: skip
        assert changed != one
        assert (changed == one) is False
    assert Inner() != Sample()
    assert Inner() != {"x": -3}
    assert (Inner() == object()) is False
    assert Sample(values=[float("nan")]) != Sample(values=[float("nan")])


def test_bytes_in_a_uint8_sequence_equal_the_decoded_array() -> None:
    cls = compile_definition("plain/msg/Bytes", "uint8[] data\n")
    for value in (b"abc", bytearray(b"abc"), memoryview(b"abc"), [97, 98, 99], np.frombuffer(b"abc", np.uint8)):
        assert cls(value) == decode(cls, encode(cls(value))) == cls(b"abc")
    assert cls(b"abc") != cls(b"abd")
    assert cls(b"") == cls()


def test_messages_are_not_hashable() -> None:
    with pytest.raises(TypeError):
        hash(Sample())


def test_deep_copies_of_messages_are_independent_and_shallow_copies_are_not() -> None:
    first = Sample(many=[Inner(1)])
    shallow, deep = copy.copy(first), copy.deepcopy(first)
    assert first == shallow == deep
    assert shallow.many is first.many
    assert deep.many[0] is not first.many[0]
    deep.many[0].x = 2
    deep.values[0] = 0
    assert first.many[0].x == 1
    assert first.values[0] == 1.5


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_pickle_preserves_class_and_values(protocol: int) -> None:
    header = get_message("std_msgs/msg/Header")
    request = get_service("std_srvs/srv/SetBool").Request
    for message in (
        Sample(many=[Inner(1)]),
        decode(Sample, encode(Sample())),
        header(frame_id="map"),
        request(data=True),
    ):
        again = pickle.loads(pickle.dumps(message, protocol))
        assert type(again) is type(message)
        assert again == message
        assert encode(again) == encode(message)


def test_asdict_and_match_patterns_work_with_messages() -> None:
    assert dataclasses.asdict(Inner(4))["x"] == 4
    match Inner(4, [0.0] * 4):
        case Inner(x, quad):  # type: ignore[misc]
            assert (x, quad) == (4, [0.0] * 4)


def test_repr_contains_every_field_and_abbreviates_long_arrays() -> None:
    assert repr(Inner(1, [0.0, 0.5, 1.0, 1.5])) == "Inner(x=1, quad=[0.0, 0.5, 1.0, 1.5])"
    assert repr(Sample()) == (
        'Sample(values=[1.5, 2.5], name="it\'s", class_=7, inner=Inner(x=-3, quad=[0.0, 0.0, 0.0, 0.0]), many=[], '
        "two=[Inner(x=-3, quad=[0.0, 0.0, 0.0, 0.0]), Inner(x=-3, quad=[0.0, 0.0, 0.0, 0.0])], "
        "flags=[True, False, True], words=['a', 'b'])"
    )
    image = get_message("sensor_msgs/msg/Image")(data=np.zeros(6_000_000, np.uint8))
    assert "data=[0, 0, 0, 0, 0, 0, 0, 0, ... 6000000 elements]" in repr(image)
    assert len(repr(image)) < 400
    assert len(repr(Sample(name="x" * 10**6))) < 1000
    assert len(repr(Sample(values=list(range(10**5)), many=[Inner()] * 1000, words=["w"] * 1000))) < 2000
    for odd in (None, "text", 5, np.zeros((2, 2)), b"abc", {}):
        assert "values=" in repr(Sample(values=odd))
    unset = Sample()
    del unset.name
    assert "name=" in repr(unset)


def test_fields_named_like_methods_replace_the_methods() -> None:
    cls = compile_definition("plain/msg/GivesWay", "string encode 'e'\nuint8[] decode\n")
    message = cls(decode=[1, 2])
    assert (message.encode, message.decode) == ("e", [1, 2])
    again = decode(cls, encode(message))
    assert (again.encode, again.decode.tolist()) == ("e", [1, 2])
    outer = compile_definition(
        "plain/msg/Around",
        "GivesWay inner\nGivesWay[] more\n" + "=" * 80 + "\nMSG: plain/GivesWay\nstring encode 'e'\nuint8[] decode\n",
    )
    around = outer(message, [message, message])
    assert outer.decode(around.encode()) == around


def test_base_class_message_cannot_be_encoded_or_decoded() -> None:
    for attempt in (lambda: encode(Message()), lambda: decode(Message, b"\0\1\0\0\0"), Message().encode):
        with pytest.raises(TypeError, match="is not a generated message class"):
            attempt()
