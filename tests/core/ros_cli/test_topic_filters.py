"""Filter expressions over messages: supported syntax, refused syntax, and limits that keep them harmless."""

from __future__ import annotations

import threading
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import compile_definition
from rosidl_py_gen.ros_cli import message_expressions
from rosidl_py_gen.ros_cli.message_expressions import FUNCTIONS, FilterError, compile_filter, compile_path

Point = compile_definition("filter_msgs/msg/Point", "float64 x\nfloat64 y")
Scan = compile_definition(
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
        *("m.level >= 30 and not m.level > 40", "m.level in (20, 30)", "10 < m.level <= 30"),
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
        *("1 if m.ok else 0", "m.ranges"),
        "m.ranges[1:] == (2, 4) and m.ranges[2] == 4 and m.ranges > [0.5, 1.9]",
        "m.level in {30, 'x'} and len([m.at, m.name]) == 2",
        "m.ranges[0] + 0.1 == 0.6 and m.data[2] + 1 == 256 and sum(m.ranges) == 6.5",
        "(m.at if m.ok else m.points[0]).x == 1.5 and any(p.y < 0 for p in (m.at, m.points[0]))",
        "len(p for p in m.points if p.x > 5) == 1 and max(p.x for p in m.points) * 2 == 18",
        "any(True for _ in m.names) and sum(x == max(m.data) for x in m.data) == 1",
        "(m.at.x ** 2 + m.at.y ** 2) ** 0.5 == 2.5 and m.at.x ** -1 > 0 and 1 << 4 == 16 and m.level >> m.from_ == 0",
        "len(m.data" + "[:]" * 34 + ") == 3",
        "(m.name or 'x') == 'front left' and not (m.ok and 0)",
    ],
)
def test_true_conditions_evaluate_to_true_and_negations_to_false(text: str) -> None:
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
        ("m._TYPE", "no field"),
        ("__import__('os').system('true')", "is not allowed"),
        ("(lambda: m)()", "is not allowed"),
        ("[x for x in m.data]", "is not allowed"),
        ("any(any(y for y in m.data) for x in m.data)", "only one `for name in ...` is allowed"),
        ("any(x for x in m.data for y in m.data)", "only one"),
        ("(x := 3)", "is not allowed"),
        ("f'{m}'", "is not allowed"),
        ("b'x' == m.data", "is not allowed"),
        ("round(1.5, ndigits=3)", "`ndigits=3` is not allowed"),
        ("abs(*m.data)", "`\\*m.data` is not allowed"),
        ("abs(1, 2)", "takes one value"),
        ("max()", "takes 1 to 100 values"),
        ("1" * 300, "more than 256 bits"),
        ("m" * 1001, "at most 1000 are allowed"),
        ("-" * 900 + "1", "nested too deeply"),
        ("lambda: " + "-" * 900 + "1", "column 1: `lambda: -{72}` is not allowed|nested too deeply"),
        ("m.at" + ".x" * 40, "nested too deeply"),
        ("+".join(["1"] * 60), "nested too deeply"),
        ("(" * 300 + "1" + ")" * 300, "is not an expression"),
        ("m.data[::2]", "step"),
        ("m.level == 'ä' or m.levle", 'column 19: m is .* no field "levle"'),
        ("m.level @ 2", "`m.level @ 2` is not allowed"),
        ("m.level.real", "m.level is int32, which has no fields"),
        ("m.data.tofile", "m.data is uint8\\[\\], which has no fields"),
        ("m.data[0].real", "m.data\\[0\\] is uint8, which has no fields"),
        ("m.data[:2].base", "m.data\\[:2\\] is uint8\\[\\], which has no fields"),
        ("m.name.join", "m.name is string, which has no fields"),
        ("m.encode", 'no field "encode"'),
        ("any(p.z for p in m.points)", 'p is filter_msgs/msg/Point, which has no field "z"'),
        ("any(x.real for x in m.data)", "x is uint8, which has no fields"),
        ("[1][0].__class__", "no fields"),
        ("len.__self__", "no fields"),
        ("m.at[0]", "m.at is filter_msgs/msg/Point, which has no elements"),
        ("any(x for x in m.at)", "m.at is filter_msgs/msg/Point, which has no elements"),
        ("m.at == m.at", "compare their fields"),
        ("m.at in m.points", "compare their fields"),
        ("9 ** 9 ** 9 > 1", "column 6: expected a constant up to 64"),
        ("2 ** m.level", "column 6: expected a constant up to 64"),
        ("2 ** -65", "column 6: expected a constant up to 64"),
        ("1 << 100000000000 > 1", "column 6: expected a constant up to 64"),
        ("round(5, -100000000000) > 1", "column 10: expected a constant up to 64"),
        ("round(5, m.level)", "column 10: expected a constant up to 64"),
        ("{1: 2}", "is not allowed"),
        ("[*m.data]", "is not allowed"),
        ("(yield)", "is not allowed"),
        ("1j", "is not allowed"),
        ("...", "is not allowed"),
        ("_number(1)", "is not allowed"),
        ("__builtins__", 'there is no "__builtins__"'),
        ("_end", 'there is no "_end"'),
        ("any(_end for _end in m.data)", "the name means something already"),
        ("any(1 for __debug__ in m.data)", "the name means something already"),
        ("any(m for m in m.data)", "the name means something already"),
        ("any(1 for abs in m.data)", "the name means something already"),
        ("any(1 for m.level in m.data)", "only one"),
        ("any(x async for x in m.data)", "only one"),
        ("m.level\0", "is not an expression"),
        ("m.name == '\ud800'", "is not an expression"),
        ("m.level; m.level", "is not an expression"),
        ("", "is not an expression"),
    ],
)
def test_invalid_filters_are_refused_at_compilation(text: str, reason: str) -> None:
    with pytest.raises(FilterError, match=reason):
        compile_filter(text, Scan)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("m.points[5].x > 1", "no element 5 among 2"),
        ("m.level / 0 > 1", "division by zero"),
        ("m.name > 3", "not supported"),
        ("m.name * 1000000000 == ''", "expected a number, found str"),
        ("'%1000000000d' % 1 == ''", "expected a number, found str"),
        ("[0] * 1000000000 == []", "expected a number, found list"),
        ("(2 ** 64) ** 64 > 1", "more than 256 bits"),
        ("(0 - 1) ** 0.5 > 1", "root of a negative number"),
        ("max(m.points)", "not supported between instances of 'Point'"),
        ("int(m.name) > 1", "expected a number, found str"),
        ("min(m.ranges[0:0]) > 1", "zero-size"),
        ("int(1e999) > 1", "infinity"),
        ("((m.level ** 40) ** 60) ** 60 > 1", "more than 256 bits"),
        ("(m.level << 64 << 64 << 64 << 64) > 1", "more than 256 bits"),
        ("m.name % 1", "expected a number, found str"),
        ("m.name + m.name", "expected a number, found str"),
        ("m.names * 1000000000", "expected a number, found list"),
        ("m.ranges * 2", "expected a number, found list"),
        ("max(m.names) * 1000000000", "expected a number, found str"),
        ("(m.name if m.ok else 1) * 1000000000", "expected a number, found str"),
        ("sum(m.names) > 1", "unsupported operand"),
        ("float('9' * 2)", "expected a number, found str"),
        ("-m.name", "bad operand type"),
        ("abs(m.ranges)", "expected a number, found list"),
        ("[1][0].real", 'int has no field "real"'),
        ("(x for x in m.data).gi_frame.f_back", 'generator has no field "gi_frame"'),
        ("[m.names][0].sort", 'list has no field "sort"'),
        ("m.ranges['x']", "there is no element 'x' among 3"),
        ("m.ranges[m.level]", "there is no element 30 among 3"),
        ("m.ranges[1.5:]", "slice indices"),
        ("int(m.at.x * 1e999 * 0)", "NaN"),
    ],
)
def test_failing_evaluation_raises_filter_error(text: str, reason: str) -> None:
    condition = compile_filter(text, Scan)
    with pytest.raises(FilterError, match=reason):
        condition(SCAN)


@pytest.mark.parametrize(
    "text",
    [
        "any(max(m.data) > x + 1 for x in m.data)",
        "any(x in m.ranges[1:] and x > 1 for x in m.data)",
        "sum(x in m.data and x ** 64 > 9 for x in m.ranges) > 1",
        "any(m.name in m.name and x for x in (y for y in m.data))",
    ],
)
def test_evaluation_time_for_one_message_is_limited(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scan = Scan(data=np.zeros(1_000_000, "u1"), ranges=np.zeros(100_000, "f4"), name="a" * 1_000_000)
    condition = compile_filter(text, Scan)
    monkeypatch.setattr(message_expressions, "MAX_CPU_S", 0.05)
    with pytest.raises(FilterError, match=r"takes more than 0\.05 s of CPU time for one message"):
        condition(scan)


def test_evaluation_time_limit_ignores_time_without_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(message_expressions, "MAX_CPU_S", 0.05)

    def interrupted(value: float) -> bool:
        """Return True after a time in which the thread does not run, as on a busy machine."""
        return not threading.Event().wait(0.004)

    monkeypatch.setitem(message_expressions.FUNCTIONS, "bool", interrupted)
    assert compile_filter("all(bool(x) for x in m.ranges)", Scan)(Scan(ranges=[1.0] * 40))


def test_filters_accept_messages_with_a_million_elements() -> None:
    scan = Scan(data=np.arange(1_000_000).astype("u1"))
    whole = "max(m.data) == 255", "len(m.data) == 10 ** 6", "255 in m.data"
    for text in (*whole, "len(x for x in m.data if x > 9) > 9"):
        assert compile_filter(text, Scan)(scan), text


@pytest.mark.filterwarnings("error")
def test_filters_on_extreme_values_cause_no_warnings() -> None:
    scan = Scan(ranges=np.array([np.inf, -np.inf, np.nan, 3.4e38], "f4"), level=-(2**31))
    for text in ("isnan(sum(m.ranges))", "not max(m.ranges) > 1", "m.level * m.level > 0", "m.level is not 3"):
        assert compile_filter(text, Scan)(scan), text


_TEXTS = """
m ( ) [ ] { } . , : ** << % * - x 999 'a' 1.5 .x [0] m.data m.points lambda __class__ for|x|in |if| |else| |and| not|
"""
_PIECES = st.sampled_from([*FUNCTIONS, *(text.replace("|", " ") for text in _TEXTS.split())])


@given(st.lists(_PIECES, max_size=12).map("".join))
def test_arbitrary_text_compiles_or_raises_filter_error(text: str) -> None:
    with suppress(FilterError):
        assert compile_filter(text, Scan)(SCAN) in (True, False)


def test_paths_select_fields_and_elements() -> None:
    assert compile_path("at.x", Scan)[0](SCAN) == 1.5
    assert compile_path("points[1]", Scan)[0](SCAN) == Point(x=9.0)
    assert compile_path(".points[0].x", Scan)[0](SCAN) == 1.0
    assert compile_path("ranges[1:]", Scan)[0](SCAN).tolist() == [2.0, 4.0]
    assert compile_path("from", Scan)[0](SCAN) == 7


@pytest.mark.parametrize("text", ["at.z", "at..x", "", "level + 1", "len(m)", "points[0", "points['x']", "ranges[m]"])
def test_invalid_paths_are_refused(text: str) -> None:
    with pytest.raises(FilterError):
        compile_path(text, Scan)[0](SCAN)
