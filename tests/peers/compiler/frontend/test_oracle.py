"""The real rosidl tool chain accepts and refuses the same texts, with the same fields, values and type hashes.

Differences made on purpose are data in tests/support/rosidl_deviations.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from each_case import each_case
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.example_counts import examples
from support.rosidl_deviations import compare_or_explain
from support.rosidl_oracle import compare

if TYPE_CHECKING:
    from support.rosidl_oracle import Rosidl

# --- picked by hand ---------------------------------------------------------------------------------------------------

SAME = [
    *("", "\n\n", "# only a comment", "uint8 A=1", "uint8 x", "uint8\tx", " uint8 x", "uint8  x", "uint8 x "),
    *("uint8", "uint8 x#comment", "uint8 x # comment\n   # more", "uint8 x 7", "uint8 x  7 ", "uint8 x=7"),
    *("uint8 X=7", "uint8 X = 7", "uint8 X= 7 # why", "uint8 X=", "string X=", "string X=a=b", "string x a=b"),
    *('string X="a # b"', "string X='it\\'s'", "string X='it's'", 'string X="a\\"b"', 'string X="a"b"'),
    *('string X="a\'b"', "string X='", 'string X="', 'string X=""', "string X='\"'", 'string X="\\\\"'),
    *('string X="\\\\\\\\"', 'string X="a\\tb"', 'string X="a\\nb"', 'string X="a\\\\nb"', 'string X="\\x41\\101"'),
    *('string X="\\xe9"', 'string X="\\u00fc"', 'wstring X="\\u00fc"', 'string X="\\q"', 'string X="\\"'),
    *("string X=ünïcödé ハ 😀", 'string x "ünïcödé ハ 😀"', "string X=trailing\\", "string<=3 X=abc"),
    *("string<=3 x abc", "string<=3 x abcd", "string<=3 x 'ab'", "wstring<=3 x öäü", "wstring<=3 x öäüß"),
    *("string<=0 x", "string<=-1 x", "string<=a x", "string<=+3 x", "string<=03 x", "string<=1_0 x", "string<= x"),
    *("string<3 x", "uint8<=3 x", "uint8[3] x", "uint8[+3] x", "uint8[03] x", "uint8[0x3] x", "uint8[1_0] x"),
    *("uint8[0] x", "uint8[-1] x", "uint8[] x", "uint8[<=3] x", "uint8[<=0] x", "uint8[<=] x", "uint8[<3] x"),
    *("uint8[ 3] x", "uint8[3 ] x", "uint8 [3] x", "uint8[3][3] x", "uint8[][] x", "uint8] x", "uint8[ x", "[] x"),
    *("[3] x", "string<=3[] x", "string<=3[4] x", "string<=3[<=4] x", "wstring<=3[] x", "wstring<=3[4] x"),
    *("wstring<=3[<=4] x", "Other x", "Other[] x"),
    "Other[3] x\nOther[3] y\nOther[4] z",
    *("b_msgs/Other x", "b_msgs/Other[3] x", "b_msgs/Other[<=3] x", "b_msgs/msg/Other x", "b_msgs::Other x"),
    *("/Other x", "b_msgs/ x", "b_msgs/other x", "B_msgs/Other x", "b__msgs/Other x", "b_msgs_/Other x"),
    *("Other_Request x", "Sample_Other x", "Other_Event x", "Other_Request_Response x", "other x", "int x"),
    *("uint128 x", "float x", "float128 x", "Uint8 x", "Other x 3", "Other X=3", "uint8[] X=3", "uint8 x\nuint8 x"),
    *("uint8 X=1\nuint8 X=1", "uint8 X=1\nuint8 x 1", "uint8 aB", "uint8 _a", "uint8 a_", "uint8 a__b", "uint8 9a"),
    *("uint8 a9", "uint8 a-b", "uint8 ä", "uint8 A9_B=1", "uint8 A_=1", "uint8 A__B=1", "uint8 _A=1", "uint8 a=1"),
    *("uint8 9=1", "uint8 =1", "uint8 A B=1"),
    *[
        f"uint8 {word}"
        for word in ("module", "struct", "from", "in", "true", "uint8", "self", "string", "long", "const")
    ],
    *[f"bool x {value}" for value in ("true", "FALSE", "True", "1", "0", "2", "yes", "'true'", "01")],
    *[f"byte x {value}" for value in ("0", "255", "256", "-1", "0x41", "a", "'a'", "1.0")],
    *[f"char x {value}" for value in ("0", "255", "256", "-1", "0x41", "a", "'a'")],
    *[
        f"int8 x {value}"
        for value in ("-128", "127", "128", "-129", "+5", "0b1", "0o17", "017", "1_000", "1_0", "- 1", "1e1")
    ],
    *[f"uint64 x {value}" for value in ("18446744073709551615", "18446744073709551616", "-0", "0xffffffffffffffff")],
    *[f"int64 x {value}" for value in ("9223372036854775807", "-9223372036854775808", "-9223372036854775809", "٣")],
    *[
        f"float64 x {value}"
        for value in ("1", "-1", "1.", ".5", "1e3", "1e-300", "1e300", "-0.0", "1_0.0", "0x1", "a", "1,5")
    ],
    *[f"float32 x {value}" for value in ("inf", "nan", "1e39", "16777217", "0.1", "infinity", "NaN")],
    *[
        f"uint8[3] x {value}"
        for value in ("[1,2,3]", "[1, 2, 3]", "[1,2]", "[1,2,3,4]", "[1,2,]", "[1,,2]", "[ 1 ,2,3 ]")
    ],
    *[
        f"uint8[] x {value}"
        for value in ("[]", "[ ]", "[1]", "[", "]", "1", "[256]", "[1.0]", "[0x1,0b1]", "(1)", "[[1]]")
    ],
    *[f"uint8[<=2] x {value}" for value in ("[]", "[1,2]", "[1,2,3]")],
    *[f"bool[2] x {value}" for value in ("[true,false]", "[True, 0]", "[1,2]", "[true]")],
    *[f"float64[] x {value}" for value in ("[1,2.5]", "[]", "[1e3, -.5]", "[a]")],
    *[
        f"string[] x {value}"
        for value in (
            *("[]", "[a]", "[a,b]", "['a','b']", '["a","b"]', "['a,b', c]", "[a b, c d]", "['it\\'s']"),
            *('["a\\"b"]', "['']", "['',]", "[,]", "[a,,b]", "['a' 'b']", "['a'b]", "['a]", "[a']", "[ 'a' ]"),
            *("[ ]", "[a ]", "['a\"b']", '["a\'b"]'),
        )
    ],
    *("string<=2[] x [ab, c]", "string<=2[] x [abc]", "string[2] x ['a','b']", "string[2] x ['a']"),
    *("string[<=1] x ['a', 'b']", "wstring[] x ['a', 'b']", "@key uint8 x", "uint8 x;", "uint8 x 1;", "---"),
    *("uint8 x\r\nuint8 y\r\n", "uint8 x\ruint8 y", "uint8 x\x0cuint8 y", "uint8 x\x85uint8 y"),
    *("uint8 x\u2028uint8 y", "\ufeffuint8 x", "uint8 x\u00a0", "uint8\u00a0x", "\u00a0uint8 x", "uint8 x # [m]"),
    *("uint8 x # [m] [s]", "uint8 x # in [0, 1]"),
    "uint8 x # \"quoted\" and 'single'",
    "uint8 x # ünïcödé ハ",
    "# file\n#\n# comment\n\n# element\nuint8 x",
    "uint8 x\n# dangling",
    "   # indented first",
    "uint8 x\n\n   # indented\n\n   # twice",
]


@each_case("text", SAME)
def test_rosidl_agrees_about_handpicked_messages(rosidl: Rosidl, text: str) -> None:
    compare(rosidl, text)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a_msgs/srv/Ask", "---"),
        ("a_msgs/srv/Ask", "uint8 x\n---\nuint8 y"),
        ("a_msgs/srv/Ask", "uint8 x\n--- \nuint8 y"),
        ("a_msgs/srv/Ask", "uint8 x\n ---\nuint8 y"),
        ("a_msgs/srv/Ask", "uint8 x\n----\nuint8 y"),
        ("a_msgs/srv/Ask", "uint8 x\n---#\nuint8 y"),
        ("a_msgs/srv/Ask", "uint8 x"),
        ("a_msgs/srv/Ask", "---\n---"),
        ("a_msgs/srv/Ask", "uint8 A=1\n---\nuint8 A=2\nAsk_Request r\nOther o"),
        ("a_msgs/srv/Ask", "# comment\n---\n# comment"),
        ("a_msgs/srv/Ask", "uint8 x\r\n---\r\nuint8 y\r\n"),
        ("a_msgs/srv/Ask", "uint8 x 300\n---\n"),
        ("a_msgs/action/Do", "---\n---"),
        ("a_msgs/action/Do", "---"),
        ("a_msgs/action/Do", "---\n---\n---"),
        ("a_msgs/action/Do", "int32 a\n---\nint32[] b [1,2]\nstring S=x\n---\nOther[2] c"),
        ("a_msgs/action/Do", "int32 a\n---\nint32 b\n---\nint32 b\nint32 b"),
    ],
)
def test_rosidl_agrees_about_services_and_actions(rosidl: Rosidl, name: str, text: str) -> None:
    compare(rosidl, text, name)


# --- at random --------------------------------------------------------------------------------------------------------

_PRIMITIVE = st.sampled_from(
    [
        *("bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
        *("float32", "float64", "string", "wstring"),
    ]
)
_BASE = st.one_of(
    _PRIMITIVE,
    st.sampled_from(["string<=3", "wstring<=2", "string<=12", "Other", "b_msgs/Other", "string<=0", "int", "uint8<=2"]),
)
_ARRAY = st.sampled_from(["", "", "", "", "[]", "[2]", "[<=2]", "[3]", "[1]", "[0]", "[<=0]", "[x]", "[", "[2][2]"])
_NAMES = st.sampled_from(
    ["x", "y", "abc", "a_b", "a__b", "a_", "aB", "A", "ABC", "A_B", "A__B", "in", "self", "long", "struct", "1x"]
)
_SOUP = st.text(st.sampled_from("ab01 ,.'\"\\[]{}()=#-+xuntTq_é€😀"), max_size=10)
_NUMBER = st.one_of(
    st.integers(-300, 300).map(str),
    st.integers(-(2**65), 2**65).map(str),
    st.integers(0, 300).map(hex),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(["true", "false", "TRUE", "1", "0", "inf", "nan", "-inf"]),
)
_WORD = st.text(st.sampled_from("abc é€\\'\"ntx0"), max_size=4)
_QUOTED = st.builds(lambda quote, text: quote + text + quote, st.sampled_from(["'", '"']), _WORD)
_ITEM = st.one_of(_NUMBER, _NUMBER, _QUOTED, _WORD)
_LIST = st.builds(
    lambda items, comma: "[" + comma.join(items) + "]", st.lists(_ITEM, max_size=3), st.sampled_from([",", ", ", " , "])
)
_VALUE = st.one_of(st.just(""), _NUMBER, _QUOTED, _LIST, _WORD, _SOUP)
_COMMENT = st.sampled_from(["", "", "", " # text", "#", " # [m]", '   # "q" [a,b]', " # ハ"])
_SCALARS = {
    "bool": st.sampled_from(["true", "FALSE", "1", "0"]),
    "byte": st.integers(0, 255).map(str),
    "char": st.integers(0, 255).map(hex),
    "uint8": st.integers(0, 255).map(str),
    "int16": st.integers(-(2**15), 2**15 - 1).map(str),
    "uint64": st.integers(0, 2**64 - 1).map(str),
    "int64": st.integers(-(2**63), 2**63 - 1).map(str),
    "float32": st.floats(width=32, allow_nan=False, allow_infinity=False).map(repr),
    "float64": st.floats(allow_nan=False, allow_infinity=False).map(repr),
    "string": st.one_of(_QUOTED, _WORD),
    "wstring": st.one_of(_QUOTED, _WORD),
    "string<=3": st.one_of(_QUOTED, _WORD),
}


@st.composite
def _legal(draw: st.DrawFn) -> str:
    """Draw a field or constant that is valid in most cases."""
    base = draw(st.sampled_from(sorted(_SCALARS)))
    comment = draw(_COMMENT)
    if draw(st.integers(0, 3)) == 0:
        return f"{base} {draw(st.sampled_from(['A', 'B_1', 'C']))}={draw(_SCALARS[base])}{comment}"
    size = draw(st.integers(1, 3))
    array = draw(st.sampled_from(["", "", f"[{size}]", f"[<={size}]", "[]"]))
    value = draw(_SCALARS[base])
    if array:
        value = f"[{', '.join(draw(st.lists(_SCALARS[base], min_size=size, max_size=size)))}]"
    name = draw(st.sampled_from(["a", "b", "c_1", "long", "self"]))
    return f"{base}{array} {name} {draw(st.sampled_from([value, value, '']))}{comment}"


_FIELD = st.builds(
    lambda base, array, gap, name, value, comment: f"{base}{array}{gap}{name} {value}{comment}",
    _BASE,
    _ARRAY,
    st.sampled_from([" ", " ", "  ", "\t", ""]),
    _NAMES,
    _VALUE,
    _COMMENT,
)
_CONSTANT = st.builds(
    lambda base, name, equals, value, comment: f"{base} {name}{equals}{value}{comment}",
    _BASE,
    _NAMES,
    st.sampled_from(["=", " = ", "= ", "=="]),
    _VALUE,
    _COMMENT,
)
_LINE = st.one_of(_FIELD, _FIELD, _CONSTANT, st.sampled_from(["", "# text", "   # indented", "---", "#"]), _SOUP)


@settings(max_examples=examples(500), deadline=None, suppress_health_check=list(HealthCheck))
@given(lines=st.lists(_legal(), min_size=1, max_size=3))
def test_rosidl_agrees_about_generated_mostly_valid_messages(rosidl: Rosidl, lines: list[str]) -> None:
    text = "\n".join(lines)
    compare_or_explain(rosidl, ("a_msgs/msg/Sample", text, "msg"))


@settings(max_examples=examples(500), deadline=None, suppress_health_check=list(HealthCheck))
@given(lines=st.lists(_LINE, min_size=1, max_size=2))
def test_rosidl_agrees_about_random_messages(rosidl: Rosidl, lines: list[str]) -> None:
    text = "\n".join(lines)
    compare_or_explain(rosidl, ("a_msgs/msg/Sample", text, "msg"))


@settings(max_examples=examples(300), deadline=None, suppress_health_check=list(HealthCheck))
@given(
    base=st.sampled_from(["string", "wstring", "string<=4", "string[]", "wstring[<=2]", "string<=3[]"]), value=_VALUE
)
def test_rosidl_agrees_about_random_strings(rosidl: Rosidl, base: str, value: str) -> None:
    for text in (f"{base} x {value}", f"{base} X={value}"):
        compare_or_explain(rosidl, ("a_msgs/msg/Sample", text, "msg"))


@settings(max_examples=examples(100), deadline=None, suppress_health_check=list(HealthCheck))
@given(kind=st.sampled_from(["srv", "action"]), lines=st.lists(st.one_of(_FIELD, st.just("---")), max_size=4))
def test_rosidl_agrees_about_random_services_and_actions(rosidl: Rosidl, kind: str, lines: list[str]) -> None:
    text = "\n".join(lines)
    compare_or_explain(rosidl, (f"a_msgs/{kind}/Sample", text, kind))
