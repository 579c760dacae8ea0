"""Values from the command line: numbers in every form that JSON and YAML have, converted by the type of their field."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen import compile_definition, to_dict, to_json
from rosidl_py_gen.base.terminal_text import printable_lines
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.message_text import message_from, to_plain, to_yaml
from rosidl_py_gen.ros_cli.param import fit_parameter
from rosidl_py_gen.ros_cli.values import MAX_TEXT
from rosidl_py_gen.runtime import ParameterDescriptor, ParameterType

if TYPE_CHECKING:
    from conftest import Tool
    from support.node_fixtures import World

_TEXT = """int64 i
uint8 u
float64 d
float64[] f
int32[] n
uint8[] bytes
bool b
string s
wstring w
string[] t
Inner[] inner
===
MSG: test_msgs/Inner
float64 x
int8 k
"""
_CLASS: Any = compile_definition("test_msgs/msg/Every", _TEXT.replace("===", "=" * 80))

TAKEN: list[tuple[str, Any]] = [
    *((f"{{d: {text}}}", {"d": value}) for text, value in [("1e-3", 0.001), ("1E5", 1e5), ("2.5e-07", 2.5e-07)]),
    *((f'{{"d": {text}}}', {"d": value}) for text, value in [("1e-3", 0.001), ("-0.0", -0.0), ("5", 5.0)]),
    *((f"{{d: {text}}}", {"d": -math.inf}) for text in ("-.inf", "-Infinity", "-inf", "'-Infinity'")),
    *((f"{{d: {text}}}", {"d": 255.0}) for text in ("255", "0xff", "+255.", "2.55e2")),
    *((f"{{i: {text}}}", {"i": 300}) for text in ("300", "300.0", "3e2", "3E+2", "0x12c", "0b100101100")),
    *((f'{{"i": {text}}}', {"i": 2**53 + 1}) for text in ("9007199254740993", "9007199254740993.0")),
    ("{n: [1.0, 2, 3e0], u: 7.0, inner: [{k: 1e1, x: 1e-1}]}", {"n": [1, 2, 3], "u": 7}),
    ('{"f": [0.5, 1e-07, "Infinity", -Infinity], "bytes": [1.0, 2]}', {"f": [0.5, 1e-07, math.inf, -math.inf]}),
    *((f"{{b: {text}}}", {"b": True}) for text in ("true", "yes", "On", "1")),
    *((f"{{s: {text}, w: {text}}}", {"s": text, "w": text}) for text in ("5", "1.10", "1e3", "007", "12:30", "1_0")),
    *((f"{{s: {text}}}", {"s": text}) for text in ("2024-01-01", "0x10", "nan", ".5")),
    ('{"s": 2.5, "t": [1, 1e22, "x"]}', {"s": "2.5", "t": ["1", "1e22", "x"]}),
    ("{bytes: !!binary AQID}", {"bytes": [1, 2, 3]}),
    *((text, {}) for text in ("", "~", "null", "{}", "# nothing")),
]
REFUSED: list[tuple[str, str]] = [
    ("{i: 3.7}", "expected int, found 3.7"),
    *(
        (f"{{i: {text}}}", "expected int")
        for text in ("010", "1_000", "12:30", "1e400", f"1e{'9' * 30}", "nan", "yes no")
    ),
    ("{u: 256.0}", "0..255"),
    ("{n: [1, 2.5]}", "expected int, found 2.5"),
    ("{i: " + "9" * 5000 + "}", "expected int"),
    *((f"{{d: {text}}}", "expected float") for text in ("1e400", "010", "'1.5'", f"0x{'f' * 300}")),
    ("{s: true}", "found True"),
    ("{s: null}", "found None"),
    ("{b: 2}", "expected bool, found 2"),
    ("{b: 'true'}", "expected bool"),
    ("{inner: 5}", "found 5"),
    ("!!bool perhaps", "not YAML"),
    ("!!timestamp perhaps", "not YAML"),
    ("x" * (MAX_TEXT + 1), f"expected at most {MAX_TEXT} of YAML"),
]


def test_numbers_are_taken_in_every_form_and_converted_by_the_type_of_their_field() -> None:
    for text, expected in TAKEN:
        found = to_dict(message_from(_CLASS, text))
        assert {name: found[name] for name in expected} == expected, text
    bools = to_json(message_from(_CLASS, "{i: true, d: true, f: [on, 2], n: [false, true], inner: [{k: yes, x: on}]}"))
    for part in ('"i":1,', '"d":1.0,', '"f":[1.0,2.0],', '"n":[0,1],', '"inner":[{"x":1.0,"k":1}]'):
        assert part in bools.replace(" ", ""), bools
    assert math.isnan(message_from(_CLASS, '{"d": NaN}').d)
    assert math.isnan(message_from(_CLASS, "{d: .nan}").d)


def test_what_does_not_fit_is_refused() -> None:
    for text, reason in REFUSED:
        with pytest.raises(CommandError) as error:
            message_from(_CLASS, text)
        assert reason in str(error.value), text[:100]


def test_what_echo_prints_as_yaml_is_taken_again() -> None:
    strings = ["é\u202e\u200b\u2028", "a\r\nb\x1b", "\x85\x7f\ufeff", "x...", "...", "a\n...", " ", "~"]
    for text in strings:
        message = _CLASS(s=text, t=[text], d=-math.inf)
        printed = printable_lines(to_yaml(to_plain(message)))
        assert message_from(_CLASS, printed).encode() == message.encode(), printed
        assert printable_lines(to_yaml({"s": text})).endswith("\n")
    assert to_yaml({"s": "x..."}) == "s: x...\n"
    assert to_yaml({"s": "é"}) == "s: é\n"
    assert to_yaml("x") == "x\n"


def test_what_echo_prints_as_json_is_taken_again() -> None:
    message = _CLASS(d=math.nan, f=[1e-07, math.inf, -math.inf], i=-(2**63), s='\u202e"\n\x1b', t=["NaN", "1.0"])
    again = message_from(_CLASS, to_json(message))
    assert again.encode() == message.encode()
    big: Message = _CLASS(bytes=bytes(range(256)) * 4096)  # 2**20 values: more than YAML may have
    assert message_from(_CLASS, json.dumps(to_plain(big, truncate=None))).encode() == big.encode()


async def test_a_parameter_gets_a_number_of_its_type(memory: World, tool: Tool) -> None:
    node = memory.node("drive")
    for name, value in {"d": 1.5, "i": 1, "s": "x", "ds": [1.5], "is": [1], "ss": ["x"], "b": False}.items():
        node.declare_parameter(name, value)
    node.declare_parameter("any", 1.5, ParameterDescriptor(dynamic_typing=True))
    for name, text, expected in [
        *(("d", "1e-3", 0.001), ("d", "2", 2.0), ("d", '"-Infinity"', -math.inf), ("i", "3.0", 3), ("i", "1e3", 1000)),
        *(("s", "5", "5"), ("s", "1.10", "1.10"), ("ds", '[1, 2.5, "Infinity"]', (1.0, 2.5, math.inf))),
        *(("is", "[1.0, 2]", (1, 2)), ("ss", "[1, x]", ("1", "x")), ("any", "3", 3), ("b", "yes", True)),
    ]:
        ended = await tool("param", "set", "/drive", name, text)
        assert (ended.code, node.get_parameter(name)) == (0, expected), ended.err
    for name, text in [("i", "3.7"), ("b", "3"), ("is", "3"), ("ss", "[true]"), ("nope", "1"), ("i", "[1, a]")]:
        assert (await tool("param", "set", "/drive", name, text)).code == 1, text
    assert fit_parameter("[1]", ParameterType.BYTE_ARRAY) is None
