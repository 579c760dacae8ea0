"""Expressions over messages: what they can say, what they refuse, and that nothing they say can do harm."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import compile_text
from rosidl_py_gen.tools.filters import FUNCTIONS, FilterError, compile_filter, compile_path

Point = compile_text("filter_msgs/msg/Point", "float64 x\nfloat64 y")
Scan = compile_text(
    "filter_msgs/msg/Scan",
    "int32 level\nstring name\nbool ok\nfloat32[] ranges\nuint8[] data\nPoint at\nPoint[] points\nstring[] names\n"
    "int32 from\n" + "=" * 80 + "\nMSG: filter_msgs/Point\nfloat64 x\nfloat64 y",
)
SCAN = Scan(
    level=30,
    name="front left",
    ok=True,
    ranges=np.array([0.5, 2.0, 4.0], "f4"),
    data=np.array([1, 2, 255], "u1"),
    at=Point(x=1.5, y=-2.0),
    points=[Point(x=1.0), Point(x=9.0)],
    names=["a", "b"],
    from_=7,
)


@pytest.mark.parametrize(
    "text",
    [
        "m.level >= 30 and not m.level > 40",
        "m.level in (20, 30)",
        "10 < m.level <= 30",
        "m.name == 'front left' and 'left' in m.name",
        "m.level & 2 and m.level % 7 == 2 and m.level // 4 == 7 and -m.level == ~29",
        "abs(m.at.y) == 2 and sqrt(m.at.y ** 2) == 2",
        "min(m.ranges) == 0.5 and max(m.data) == 255 and sum(m.data) == 258 and len(m.ranges) == 3",
        "any(r < 1 for r in m.ranges) and all(p.x > 0 for p in m.points if p.x < 5)",
        "max(p.x for p in m.points) == 9 and max(m.level, 4) == 30",
        "m.points[-1].x == 9 and m.ranges[0] == 0.5 and m.ranges[1:] == [2, 4]",
        "len(m.points[:1]) == 1 and m.name[0:5] == 'front'",
        "'b' in m.names and 255 in m.data and m.from_ == 7",
        "round(m.at.x) == 2 and int(m.at.x) == 1 and not isnan(m.at.x)",
        "1 if m.ok else 0",
        "m.ranges",
        "m.data[2] + 1 == 256 and sum(m.data) - 258 == 0 and max(x + 1 for x in m.data) == 256",
        "m.at == m.at and len(m.data) == 3 and any(len(m.data) > x for x in m.data)",
        "any(m.ranges[0] < r for r in m.ranges) and any(p.x > m.at.x for p in m.points)",
        "2 ** 10 == 1024 and 1 << 3 == 8 and m.data == [1, 2, 255]",
    ],
)
def test_conditions_that_hold(text: str) -> None:
    assert compile_filter(text, Scan)(SCAN)
    assert not compile_filter(f"not ({text})", Scan)(SCAN)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("m.levle == 3", 'column 1: m is filter_msgs/msg/Scan, which has no field "levle"; did you mean "level"'),
        ("m.at.z", 'm.at is filter_msgs/msg/Point, which has no field "z"; it has x, y'),
        ("m.points.x > 1", "m.points is filter_msgs/msg/Point\\[\\], which has no fields"),
        ("level == 3", 'there is no "level"; the message is m'),
        ("m.level ==", "is not an expression: column 11: invalid syntax"),
        ("m.name.startswith('x')", "m.name.startswith\\(...\\) is not allowed; there are abs, all"),
        ("m.__class__", "no field"),
        ("m.at.__class__.__mro__", "no field"),
        ("m._TYPE", "no field"),
        ("__import__('os').system('true')", "is not allowed"),
        ("open('/etc/passwd')", "is not allowed"),
        ("(lambda: m)()", "is not allowed"),
        ("[x for x in m.data]", "is not allowed"),
        ("any(any(y for y in m.data) for x in m.data)", "only one `for name in ...` is allowed"),
        ("any(x for x in m.data for y in m.data)", "only one"),
        ("(x := 3)", "is not allowed"),
        ("f'{m}'", "is not allowed"),
        ("b'x' == m.data", "is not allowed"),
        ("round(1.5, ndigits=3)", "takes 1 to 2 values"),
        ("abs(*m.data)", "takes one value"),
        ("max()", "takes 1 to 100 values"),
        ("m" * 1001, "at most 1000 are taken"),
        ("-" * 900 + "1", "nested too deeply"),
        ("lambda: " + "-" * 900 + "1", "nested too deeply"),
        ("(" * 300 + "1" + ")" * 300, "is not an expression"),
        ("m.data[::2]", "step"),
        ("9 ** 9 ** 9 > 1", "column 6: what stands right of \\*\\* and << has to be a number up to 64"),
        ("2 ** m.level > 1", "has to be a number up to 64"),
        ("1 << 100000000000 > 1", "has to be a number up to 64"),
        ("(2 ** 64) ** 64 > 1", "of what has one of them already"),
        ("-(1 << 64) ** 64 > 1", "of what has one of them already"),
        ("round(5, -100000000000) > 1", "the digits of round has to be a number up to 20"),
        ("round(5, m.level) > 1", "the digits of round has to be a number up to 20"),
        ("any(max(m.data) > x for x in m.data)", "all of m.data for each element of another array takes too long"),
        ("any(x in m.ranges[1:] for x in m.data)", "all of m.ranges for each element of another array"),
        ("any(m.points[0:] for x in m.data)", "all of m.points for each element of another array"),
        ("m @ m", "is not allowed"),
        ("_number(m)", "_number\\(...\\) is not allowed"),
        ("m.data.tofile", "which has no fields"),
        ("[m][0].level", "has no fields"),
        ("m.level.real", "which has no fields"),
        ("yield", "is not an expression"),
        ("(await m)", "is not allowed"),
        ("{**m}", "is not allowed"),
        ("{x: 1 for x in m.data}", "is not allowed"),
        ("max(*m.data)", "takes 1 to 100 values"),
        ("...", "is not allowed"),
        ("1j", "is not allowed"),
    ],
)
def test_what_is_wrong_is_said_before_the_first_message(text: str, reason: str) -> None:
    with pytest.raises(FilterError, match=reason):
        compile_filter(text, Scan)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("m.points[5].x > 1", "there is no such element"),
        ("m.level / 0 > 1", "division by zero"),
        ("m.name > 3", "not supported"),
        ("m.name * 1000000000 == ''", "expected a number, found str"),
        ("'%1000000000d' % 1 == ''", "expected a number, found str"),
        ("[0] * 1000000000 == []", "expected a number, found list"),
        ("(0 - 1) ** 0.5 > 1", "not supported between instances of 'complex'"),
        ("max(m.points)", "not supported between instances of 'Point'"),
        ("int(m.name) > 1", "invalid literal for int"),
        ("min(m.ranges[0:0]) > 1", "empty"),
        ("int(1e999) > 1", "infinity"),
    ],
)
def test_what_has_no_value_for_a_message_is_an_error_of_ours(text: str, reason: str) -> None:
    condition = compile_filter(text, Scan)
    with pytest.raises(FilterError, match=reason):
        condition(SCAN)


def test_what_is_allowed_takes_no_longer_than_the_message_and_the_text() -> None:
    scan = Scan(data=np.zeros(1_000_000, "u1"), ranges=np.zeros(100_000, "f4"))
    began = time.monotonic()
    for text in (
        " and ".join(["max(m.data) == 0"] * 40),
        "not any(x > 1 for x in m.data) and 1 not in m.data",
        " * ".join(["9" * 20] * 30) + " > 0",
        f"({'9' * 900}) ** 64 > 0",
    ):
        assert compile_filter(text, Scan)(scan)
    assert time.monotonic() - began < 15


_TEXTS = """
m ( ) [ ] { } . , : ** << % * - x 999 'a' 1.5 .x [0] m.data m.points lambda __class__ for|x|in |if| |else| |and| not|
"""
_PIECES = st.sampled_from([*FUNCTIONS, *(text.replace("|", " ") for text in _TEXTS.split())])


@given(st.lists(_PIECES, max_size=12).map("".join))
def test_any_text_is_a_condition_or_a_filter_error(text: str) -> None:
    with suppress(FilterError):
        assert compile_filter(text, Scan)(SCAN) in (True, False)


def test_paths_lead_to_fields_and_elements() -> None:
    assert compile_path("at.x", Scan)(SCAN) == 1.5
    assert compile_path("points[1]", Scan)(SCAN) == Point(x=9.0)
    assert compile_path(".points[0].x", Scan)(SCAN) == 1.0
    assert compile_path("ranges[1:]", Scan)(SCAN).tolist() == [2.0, 4.0]
    assert compile_path("from", Scan)(SCAN) == 7


@pytest.mark.parametrize("text", ["at.z", "at..x", "", "level + 1", "len(m)", "points[0", "points['x']", "ranges[m]"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(FilterError):
        compile_path(text, Scan)(SCAN)
