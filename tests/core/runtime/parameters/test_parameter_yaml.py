"""Parameter files as rcl reads them, and round trips (docs/internals/protocol.md 10.5)."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_counts import examples

from rosidl_py_gen.runtime.parameters.files import (
    ParameterTable,
    dump_parameters,
    parse_parameter_file,
    parse_parameter_value,
    plain_scalar,
)
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides, overrides_for
from rosidl_py_gen.runtime.parameters.values import ParameterType, ParameterValue, parameter_value

T = ParameterType


@pytest.mark.parametrize("text", ["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
def test_yaml_true_words_are_bools(text: str) -> None:
    assert plain_scalar(text) == ParameterValue(T.BOOL, True)


@pytest.mark.parametrize("text", ["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
def test_yaml_false_words_are_bools(text: str) -> None:
    assert plain_scalar(text) == ParameterValue(T.BOOL, False)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0", 0),
        ("-0", 0),
        ("42", 42),
        ("+5", 5),
        ("-7", -7),
        ("0x1f", 31),
        ("-0X1F", -31),
        ("010", 8),
        ("-010", -8),
        ("00", 0),
        ("9223372036854775807", 2**63 - 1),
        ("-9223372036854775808", -(2**63)),
    ],
)
def test_yaml_integers_are_read_like_strtoll(text: str, number: int) -> None:
    assert plain_scalar(text) == ParameterValue(T.INTEGER, number)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1.0", 1.0),
        (".5", 0.5),
        ("1.", 1.0),
        ("1e3", 1000.0),
        ("-1.5E-2", -0.015),
        ("08", 8.0),
        ("0x1p3", 8.0),
        ("0x.8", 0.5),
        ("9223372036854775808", 2.0**63),
        (".inf", math.inf),
        ("+.Inf", math.inf),
        ("-.INF", -math.inf),
        ("0e-400", 0.0),
        ("-.00e-9999999", -0.0),
        ("0x0p-9999", 0.0),
        ("0x1p-1074", 5e-324),
        ("-0x0.0000000000001P-1022", -5e-324),
        ("2.2250738585072014e-308", 2.2250738585072014e-308),
        ("2.22507385850720138e-308", 2.2250738585072014e-308),
        ("0." + "0" * 5000 + "1e5000", 0.1),
        ("inf", math.inf),
        ("-Infinity", -math.inf),
    ],
)
def test_yaml_floats_are_read_like_strtod(text: str, number: float) -> None:
    assert plain_scalar(text) == ParameterValue(T.DOUBLE, number)


@pytest.mark.parametrize("text", [".nan", ".NaN", ".NAN", "nan", "-NaN"])
def test_nan_words_are_doubles(text: str) -> None:
    got = plain_scalar(text)
    assert got.type is T.DOUBLE and isinstance(got.value, float) and math.isnan(got.value)


LIKE_OTHER_TYPES = "null ~ None yEs tRue 1_000 0x 0xg 1e 1.2.3 12:30 2001-01-01 . 0b11 0o17 --1 + e5 nanx infinite ٣"
OUT_OF_RANGE = "1e400 1e-400 -1e-400 1e-310 5e-324 2.2250738585072011e-308 0x1p-1075"
"""glibc's strtod reports ERANGE for these (run), and rcl then sees a text."""


@pytest.mark.parametrize(
    "text", [*LIKE_OTHER_TYPES.split(), *OUT_OF_RANGE.split(), "1" + "0" * 5000 + "e-5320", "9" * 5000]
)
def test_other_yaml_scalars_are_strings(text: str) -> None:
    assert plain_scalar(text) == ParameterValue(T.STRING, text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5", 5),
        ("'5'", "5"),
        ('"yes"', "yes"),
        ("!!str 5", "5"),
        ("!!str yes", "yes"),
        ("''", ""),
        ("[1, 2]", [1, 2]),
        ("[1.0, 2.5]", [1.0, 2.5]),
        ("[a, 'b', \"5\"]", ["a", "b", "5"]),
        ("[yes, off]", [True, False]),
        ("[0x10, 010]", [16, 8]),
        ("a b", "a b"),
        ("!!binary AQI=", b"\x01\x02"),
        ('!!binary "AQI="', b"\x01\x02"),
        ("!!binary ???", "???"),
        ("!!binary 5", 5),
        ("[!!binary AQI=, b]", ["AQI=", "b"]),
        ("&x 1", 1),
        ("&x [1, &y 2]", [1, 2]),
        ("|\n  two\n  lines\n", "two\nlines\n"),
        # Tags but !!str are ignored, quoted is always text, block scalars are plain: rcl_yaml_param_parser, get_value.
        ("!!int 5", 5),
        ("!!float 1.5", 1.5),
        ("!!float 1", 1),
        ("!!bool yes", True),
        ("!!null x", "x"),
        ("!mine 5", 5),
        ("! 5", 5),
        ("!!int '5'", "5"),
        ('!!bool "yes"', "yes"),
        ("[!!int 1, 2]", [1, 2]),
        ("!!str |-\n  5\n", "5"),
        ("|-\n  5\n", 5),
        (">-\n  yes\n", True),
        ("|\n  5\n", "5\n"),
    ],
)
def test_parameter_argument_values_are_parsed_like_rcl(text: str, value: object) -> None:
    assert parse_parameter_value(text) == parameter_value(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("!!float 1", 1.0),
        ("!!float 0x10", 16.0),
        ("!!float .inf", math.inf),
        ("!!int '5'", 5),
        ('!!bool "yes"', True),
        ("!!str 5", "5"),
        ("[!!float 1, 2.5]", [1.0, 2.5]),
        ("!!null x", "x"),
        ("!!binary AQI=", b"\x01\x02"),
        ("5", 5),
    ],
)
def test_yaml_tags_determine_the_type_since_lyrical(text: str, value: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "lyrical")
    assert parse_parameter_value(text) == parameter_value(value)


@pytest.mark.parametrize(("text", "wanted"), [("!!int yes", "INTEGER"), ("!!bool 1", "BOOL"), ("!!float x", "DOUBLE")])
def test_yaml_value_that_contradicts_its_tag_is_refused(
    text: str, wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DISTRO", "lyrical")
    with pytest.raises(ParameterFileError, match=f"<value>:1:1: the tag requires a value of type {wanted}, found '"):
        parse_parameter_value(text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty value"),
        ("[1, 2.0]", "all items of an array must have one type, got DOUBLE, INTEGER"),
        ("[1, yes]", "BOOL, INTEGER"),
        ("[[1]]", "scalars only"),
        ("[{a: 1}]", "scalars only"),
        ("{a: 1}", "expected a value or a list, found a map"),
        ("[&x 1, *x]", "anchors and aliases are not supported"),
        ("[1", "2:1: did not find"),
        ("!!int", "empty value"),
        ("[" * 5000, "(exceeded maximum nesting depth|more than 500 levels)"),
        ("\x00", "control characters"),
    ],
)
def test_invalid_parameter_argument_values_are_refused(text: str, reason: str) -> None:
    with pytest.raises(ParameterFileError, match=reason):
        parse_parameter_value(text)


FILE = """
talker:
  ros__parameters:
    rate: 5
    group: {sub: 1, deeper: {x: [a, b]}}
/ns/listener:
  ros__parameters: {rate: 7}
deep:
  er:
    node:
      ros__parameters:
        a.b: yes
/**:
  ros__parameters_of_all:
    rate: 9
"""


def test_parameter_file_yields_node_patterns_and_dotted_names_in_order() -> None:
    entries = parse_parameter_file(FILE)
    assert [(entry.pattern, {n: v.value for n, v in entry.values.items()}) for entry in entries] == [
        ("/talker", {"rate": 5, "group.sub": 1, "group.deeper.x": ("a", "b")}),
        ("/ns/listener", {"rate": 7}),
        ("/deep/er/node", {"a.b": True}),
        ("/**", {"rate": 9}),
    ]


def test_last_matching_entry_of_a_parameter_file_wins() -> None:
    entries = parse_parameter_file(FILE)
    assert overrides_for(entries, "/talker")["rate"].value == 9
    assert overrides_for(entries, "/other") == {"rate": parameter_value(9)}


@pytest.mark.parametrize(
    ("pattern", "matching", "others"),
    [
        ("/**", ["/a", "/a/b", "/a/b/c"], []),
        ("/*", ["/a"], ["/a/b"]),
        ("/*/n", ["/a/n"], ["/n", "/a/b/n"]),
        ("/ns/**", ["/ns", "/ns/a", "/ns/a/b"], ["/a/ns", "/nsx/a"]),
        ("/**/n", ["/n", "/a/n", "/a/b/n"], ["/a/nn", "/xn"]),
        ("/a.b", ["/a.b"], ["/axb"]),
        ("/*/**/*", ["/a/b", "/a/b/c"], ["/a"]),
        ("/**/a/**/b/**", ["/a/b", "/x/a/y/b/z"], ["/b/a", "/a", "/ab"]),
        ("/**" * 400 + "/x", ["/x", "/a/b/c/d/x"], ["/a/b/c/d/e"]),
    ],
)
def test_node_patterns_match_names_with_wildcards(pattern: str, matching: list[str], others: list[str]) -> None:
    entry = ParameterOverrides(pattern, {})
    assert [name for name in matching + others if entry.matches(name)] == matching


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- 5", "f.yaml:1:1: expected node names, found a list"),
        ("a: 5", "f.yaml:1:4: expected ros__parameters below 'a', found a value"),
        ("a:\n  ros__parameters: 5", "f.yaml:2:20: expected parameter names"),
        ("ros__parameters: {a: 1}", "must be below the name of a node"),
        ("a:\n  ros__parameters:\n    x:\n", "f.yaml:3:7: empty value"),
        ("a:\n  ros__parameters:\n    x: [1, a]\n", "f.yaml:3:8: all items"),
        ("a:\n  ros__parameters:\n    x: &q 1\n    y: *q\n", "f.yaml:4:8: anchors and aliases"),
        ("a: *b", "anchors and aliases"),
        ("a: {[1]: 2}", "a key must be a string"),
        ("a: {", "f.yaml:2:1: did not find"),
        ("a: {b: c: d}", "f.yaml:1:8"),
        ("--- 1\n--- 2", "f.yaml:2:5: expected node names with parameters below them"),
        ("--- x\n--- {a: {}}", "f.yaml:2:5: expected no text before the node names"),
        ("a-b:\n  ros__parameters: {x: 1}", "f.yaml:2:3: the node key 'a-b' is invalid: character '-' is not allowed"),
        ("/:\n  /show:\n    ros__parameters: {x: 1}", "f.yaml:3:5: the node key '//show' is invalid"),
        ("a:\n  ros__parameters: {x: {}, y: 1}", "f.yaml:2:24: an empty map must be the last entry"),
        ("a:\n  ros__parameters: {x: {y: {}, z: 1}}", "f.yaml:2:28: an empty map must be the last entry"),
        ("a:\n  ros__parameters: {x: [[1]]}", "f.yaml:2:25: a list must contain scalars only"),
        ("a:\n  ros__parameters: {'': 1}", "f.yaml:2:21: a key must not be empty"),
        ("a:\n  ros__parameters: [1]", "f.yaml:2:20: expected parameter names"),
    ],
)
def test_invalid_parameter_file_error_has_line_and_column(text: str, reason: str) -> None:
    with pytest.raises(ParameterFileError, match=reason):
        parse_parameter_file(text, "f.yaml")


def test_value_ignored_because_of_an_earlier_type_is_reported() -> None:
    table = ParameterTable()
    table.read_file("/**: {ros__parameters: {x: 1, y: 1, z: [1]}}", "f.yaml")
    table.read_argument("/**", "x", "2.5", "-p x:=2.5")
    table.read_argument("/**", "y", "2", "-p y:=2")
    table.read_argument("/**", "z", "[]", "-p z:=[]")
    assert [(entry.source, {n: v.value for n, v in entry.values.items()}) for entry in table.overrides()] == [
        ("f.yaml", {"x": 1, "z": (1,)}),
        ("-p x:=2.5", {}),
        ("-p y:=2", {"y": 2}),
        ("-p z:=[]", {}),
    ]
    assert table.warnings() == [
        "-p x:=2.5 sets the parameter x = 2.5 of /**, which is ignored as in rcl: f.yaml has 1 of another type; give "
        "all values of a parameter the same type"
    ]


@pytest.mark.slow
def test_many_repeated_names_are_read_in_linear_time() -> None:
    count = 20_000
    text = "a:\n  ros__parameters:\n" + "    g: {h: 1}\n" * count + "    g.h: {i: 1}\n" * count
    start = time.process_time()
    assert set(parse_parameter_file(text)[0].values) == {"g.h.i"}
    assert time.process_time() - start < 20


@pytest.mark.parametrize(
    "keys",
    [
        ["a:", *("b" * 200 + ":" for _ in range(400)), *[f"n{i}: {{ros__parameters: {{}}}}" for i in range(2000)]],
        ["a:", "ros__parameters:", *("b" * 900 + ":" for _ in range(300)), *[f"x{i}: 1" for i in range(2000)]],
    ],
    ids=["nodes", "parameters"],
)
def test_excessively_long_nested_parameter_names_are_refused(keys: list[str]) -> None:
    groups = [key for key in keys if key.endswith(":")]
    lines = [f"{'  ' * level}{key}" for level, key in enumerate(groups)]
    text = "\n".join([*lines, *("  " * len(groups) + key for key in keys[len(groups) :])])
    with pytest.raises(ParameterFileError, match="all names together have more than"):
        parse_parameter_file(text)


def test_an_empty_file_has_no_parameters() -> None:
    assert parse_parameter_file("") == parse_parameter_file("# nothing\n") == []


def test_dump_parameters_equals_ros2_param_dump() -> None:
    values = {
        "use_sim_time": parameter_value(False),
        "group.sub": parameter_value(1),
        "group.name": parameter_value("plain text"),
        "number_text": parameter_value("08"),
        "list": parameter_value([1.0, 2.5]),
        "unset": ParameterValue(),
    }
    assert dump_parameters("/ns/node", values) == (
        "/ns/node:\n"
        "  ros__parameters:\n"
        "    use_sim_time: false\n"
        "    group:\n"
        "      sub: 1\n"
        "      name: plain text\n"
        '    number_text: "08"\n'
        "    list: [1.0, 2.5]\n"
    )


def test_deep_names_and_large_texts_round_trip_through_a_dump() -> None:
    deep = ".".join("abc"[index % 3] for index in range(5000))
    values = {
        name: parameter_value(name[:5])
        for name in (
            deep,
            f"{deep}.x",
            "k" * 1100,
            f"{'g' * 1100}.k",
            "a.b",
            "a",
            ".".join("p" * 40),
            "..",
            "l\nb.\x85",
        )
    }
    values["map"] = parameter_value("x: 1\n\u202e\U000e0001\u4e2d" * 100_000)
    values["codes"] = parameter_value("".join(map(chr, (*range(1, 0x300), *range(0x2000, 0x2100)))))
    text = dump_parameters("/ns/node", values)
    assert all(line.isprintable() for line in text.split("\n"))
    assert overrides_for(parse_parameter_file(text), "/ns/node") == values


TEXT = st.text(st.characters(codec="utf-8"), max_size=20)
SCALAR = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    TEXT,
    st.sampled_from(["yes", "08", "1.0", "~", "", " x", "a: b", "#c", "- d", "!!str", "&a", "*b", ".inf", "null"]),
)
LIST = st.one_of(
    *(
        st.lists(item, min_size=1, max_size=4)
        for item in (st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXT)
    )
)
NAME = st.text("abc_.1", min_size=1, max_size=6)


@settings(max_examples=examples(400))
@given(st.dictionaries(NAME, st.one_of(SCALAR, LIST, st.binary(max_size=8)), min_size=1, max_size=6))
def test_dumped_parameters_round_trip(raw: dict[str, object]) -> None:
    values = {name: parameter_value(value) for name, value in raw.items()}
    entries = parse_parameter_file(dump_parameters("/ns/node", values))
    assert overrides_for(entries, "/ns/node") == values


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused_with_our_error(text: str) -> None:
    for read in (
        parse_parameter_file,
        parse_parameter_value,
        lambda t: parse_parameter_file("a: {ros__parameters: " + t),
    ):
        try:
            read(text)
        except ParameterFileError:
            continue


@pytest.mark.parametrize("value", [5e-324, -5e-324, 1e-310, 2.225073858507201e-308, 2.2250738585072014e-308, -0.0])
def test_subnormal_numbers_round_trip_through_a_dump(value: float) -> None:
    text = dump_parameters("/n", {"a": parameter_value(value), "b": parameter_value([value])})
    (entry,) = parse_parameter_file(text)
    assert entry.values == {"a": parameter_value(value), "b": parameter_value([value])}
