"""The rosidl subset of IDL (docs/internals/protocol.md 1.8), alone and against the real rosidl_parser."""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.interface_packages import message, parse, read
from support.rosidl_oracle import OTHERS, accepted, compare, ours

from rosidl_py_gen.compiler.frontend.model import ServiceDef

if TYPE_CHECKING:
    from support.rosidl_oracle import Rosidl


def module(body: str, kind: str = "msg") -> str:
    return f"module a_msgs {{ module {kind} {{ {body} }}; }};"


def struct(members: str) -> str:
    return module(f"struct Sample {{ {members} }};")


def fields(text: str) -> dict[str, str]:
    return {item.name: str(item.type) for item in message(text, format="idl").fields}


MEMBERS = (
    *("boolean x;", "octet x;", "char x;", "wchar x;", "int8 x;", "uint8 x;", "int16 x;", "short x;"),
    *("unsigned short x;", "long x;", "unsigned long x;", "long long x;", "unsigned long long x;", "uint64 x;"),
    *("float x;", "double x;", "string x;", "string<5> x;", "wstring x;", "wstring<5> x;"),
    *("sequence<double> x;", "sequence<double, 3> x;", "sequence<string<5>> x;", "sequence<string<5>, 3> x;"),
    *("double x[3];", "string<5> x[3];", "b_msgs::msg::Other x;", "sequence<b_msgs::msg::Other> x;"),
    *("sequence<b_msgs::msg::Other, 2> x;", "b_msgs::msg::Other x[2];"),
)

AGREED = [
    *map(struct, MEMBERS),
    module("typedef double double__3[3]; struct Sample { double__3 x; };"),
    module("typedef b_msgs::msg::Other other; typedef other other__2[2]; struct Sample { other__2 x; };"),
    module("typedef sequence<long> longs; struct Sample { longs x; };"),
    module("typedef string<4> short_text; struct Sample { sequence<short_text> x; };"),
    module("module Sample_Constants { const long A = 3; const string B = \"text\"; const boolean C = TRUE; };"
           " struct Sample { long x; };"),
    module("module Sample_Constants { const double A = -1.5; const octet B = 7; const int64 C = -9; };"
           " struct Sample { long x; };"),
    module("module Other_Constants { const long A = 3; }; struct Sample { long x; };"),
    struct("@default(value=5) long x;"),
    struct("@default (value=-5) long x;"),
    struct("@default (value=TRUE) boolean x;"),
    struct('@default (value="a\\"b") string x;'),
    struct('@default (value="tab\\there") string x;'),
    struct('@default (value="one" "two") string x;'),
    struct('@default (value="(1, 2)") sequence<long> x;'),
    struct('@default (value="(\'a\', \'b\')") sequence<string> x;'),
    struct("@default (value=1.5) double x;"),
    struct("@key long x; @range(min=1, max=5) long y; @unit(value=\"m\") double z;"),
    struct('@verbatim (language="comment", text="first" "\\n" "second") long x;'),
    struct("long a, b;"),
    struct("uint8 structure_needs_at_least_one_member;"),
    "// comment\n" + struct("long x; // behind"),
    "/* block */ " + struct("long /* inside */ x;"),
    "#include \"b_msgs/msg/Other.idl\"\n" + struct("b_msgs::msg::Other x;"),
    struct(""),
    struct("long x"),
    struct("long 1x;"),
    struct("long x[2][3];"),
    struct("unknown x;"),
    "struct Sample { long x; };".replace("struct", "union"),
    "module a_msgs { };",
    "",
    "interface X {};",
    struct("@default(5) long x;"),
    struct("@default long x;"),
    struct("@default(val=5) long x;"),
    struct("@key() long x;"),
    module("typedef long t; typedef long t; struct Sample { t x; };"),
    module("typedef long t; typedef short t; struct Sample { t x; };"),
    module("typedef long Other; struct Sample { b_msgs::msg::Other x; Other y; };"),
    "#include b.idl\n" + struct("long x;"),
    "#include <b.idl> #include \"c.idl\" " + struct("long x;"),
    module("struct Sample { long x; }; struct Another { long x; }; struct Third { long x; }; struct Fourth { long x; };"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("text", AGREED)
def test_rosidl_agrees_about_idl(rosidl: Rosidl, text: str) -> None:
    compare(rosidl, text, format="idl")


@pytest.mark.slow
def test_rosidl_agrees_about_services_and_actions_in_idl(rosidl: Rosidl) -> None:
    request, response = "struct Ask_Request { long a; };", "struct Ask_Response { long b; };"
    compare(rosidl, module(request + response, "srv"), "a_msgs/srv/Ask", "idl")
    compare(rosidl, module(response + request, "srv"), "a_msgs/srv/Ask", "idl")
    do = module("struct Do_Goal { long a; }; struct Do_Result { long b; }; struct Do_Feedback { long c; };", "action")
    compare(rosidl, do, "a_msgs/action/Do", "idl")


def test_annotations_set_default_comment_and_unit() -> None:
    text = struct(
        '@verbatim (language="comment", text="How far it went." "\\n" "Since the start.")\n'
        '@default (value=1.5)\n@unit (value="m")\n@key @range (min=0, max=9) double distance;'
    )
    (item,) = message(text, format="idl").fields
    assert (item.default, item.comment, item.unit) == (1.5, ("How far it went.", "Since the start."), "m")


FILES = [
    (
        "module Sample_Constants { const long SIZE = 3; }; struct Sample { sequence<long, SIZE> x; long y[SIZE]; };",
        {"x": "int32[<=3]", "y": "int32[3]"},
    ),
    ("typedef long Other; struct Sample { b_msgs::msg::Other x; Other y; };", {"x": "b_msgs/msg/Other", "y": "int32"}),
    (
        "module Sample_Constants { const long N = 2; }; module More { const long N = 3; };"
        " struct Sample { long x[More::N]; };",
        {"x": "int32[3]"},
    ),
]


@pytest.mark.parametrize(("body", "found"), FILES)
def test_constants_and_typedefs_in_idl_types_are_resolved(body: str, found: dict[str, str]) -> None:
    assert fields(module(body)) == found
    assert fields('#include "b_msgs/msg/Other.idl" #include <c>' + module(body)) == found


def test_identical_typedef_may_be_repeated() -> None:
    other = "typedef b_msgs::msg::Other other; typedef other other__3[3];"
    text = module(
        f"{other} struct Ask_Request {{ other__3 a; }}; {other} struct Ask_Response {{ other__3 b; }};", "srv"
    )
    service = parse(text, "a_msgs/srv/Ask", "idl")
    assert isinstance(service, ServiceDef)
    assert {str(one.fields[0].type) for one in (service.request, service.response)} == {"b_msgs/msg/Other[3]"}


ERRORS = [
    ("", "1:1: expected the struct Sample, found none"),
    (struct("long x"), '1:53: expected "," or ";" or "[", found "}"'),
    ("module a_msgs {\n  module msg {\n    struct Sample {\n      long 1x;\n    };\n  };\n};", '4:12: expected a basic type or a name, found "1"'),
    (struct("long x[2][3];"), "1:51: arrays of more than one dimension are not supported"),
    (struct("sequence<sequence<long>> x;"), "1:64: sequences of sequences or arrays are not supported"),
    (struct("unknown x;"), '1:46: expected a message name package::msg::Name or a typedef, found "unknown"'),
    (struct("long double x;"), '1:46: the type "long double" is not supported'),
    (struct("sequence<long, 0> x;"), '1:61: expected a whole number above 0, found "0"'),
    (struct("string<-1> x;"), '1:53: expected a whole number above 0, found "-1"'),
    (struct("long x[N];"), '1:53: unknown constant "N"'),
    (struct("long x; long x;"), '1:59: "x" clashes with another member or constant'),
    (struct("@default(value=300) octet x;"), "1:61: expected a value of type byte, found '300'"),
    (struct('@default(value="(1, 2)") long x[3];'), "1:61: expected 3 values for int32[3], found 2"),
    (struct('@default(value="__import__(\'os\')") long x[3];'), "1:61: expected the text of a tuple"),
    (struct("@default(value=1) b_msgs::msg::Other x;"), 'cannot have a default'),
    (module("enum Color { RED, GREEN }; struct Sample { long x; };"), "enums are not usable"),
    (module("struct Other { long x; };"), "expected the struct Sample, found ['Other']"),
    ("struct Sample { long x; };", "1:8: expected Sample in module a_msgs::msg, found no module"),
    ("module b { module msg { struct Sample { long x; }; }; };", "expected Sample in module a_msgs::msg, found b::msg"),
    ("module a_msgs { \x00 };", "1:17: expected "),
    (struct("@default(5) long x;"), '1:63: expected one @default(value=...) of "x"'),
    (struct("@default long x;"), '1:60: expected one @default(value=...) of "x"'),
    (struct("@default(value=1) @default(value=2) long x;"), '1:87: expected one @default(value=...) of "x"'),
    (struct("@key() long x;"), '1:51: expected "::" or'),
    (module("typedef long t; typedef short t; struct Sample { t x; };"), '1:60: "t" is already defined differently'),
    (module("module A { const long N = 1; }; module B { const long N = 2; }; struct Sample { long x[N]; };"), '1:117: "N" can mean 2 constants'),
    (module("typedef wstring<3> t; struct Sample { sequence<t> y; };"), "1:77: expected sequence<wstring<3>>, found a typedef in it"),
    ("#include b.idl\n" + struct("long x;"), '1:1: expected "@" or'),
    ("module a {" * 5000, "1:"),
    ("module a {" * 5000 + "struct Sample { long x; };" + "};" * 5000, "1:1: nested too deeply"),
    ("/* never closed", "1:1: the comment is never closed"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "problem"), ERRORS, ids=range(len(ERRORS)))
def test_invalid_definitions_are_reported_with_location(text: str, problem: str) -> None:
    _, problems = read(text, format="idl")
    assert len(problems) == 1
    assert problem in problems[0], problems
    if problem[0].isdigit():
        assert problems[0].startswith(problem), problems


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unused", "problem"),
    [
        ('boolean t["text"]', 'expected a whole number above 0, found "text"'),
        ("boolean t[0]", 'expected a whole number above 0, found "0"'),
        ("boolean t[2][3]", "arrays of more than one dimension are not supported"),
        ("string<1.5> t", 'expected a whole number above 0, found "1.5"'),
        ("string<1d> t", 'expected a whole number above 0, found "1d"'),
        ("sequence<boolean, 0> t", 'expected a whole number above 0, found "0"'),
        ("sequence<string<0> > t", 'expected a whole number above 0, found "0"'),
        ("long unsigned t", 'the type "long unsigned" is not supported'),
        ("sequence<short short> t", 'the type "short short" is not supported'),
        ("sequence<sequence<boolean> > t", "sequences of sequences or arrays are not supported"),
    ],
)
def test_unused_typedef_is_checked_as_rosidl_checks_it(rosidl: Rosidl, unused: str, problem: str) -> None:
    text = f"module a_msgs {{ module msg {{ typedef {unused}; struct Sample {{ long x; }}; }}; }};"
    definition = ("a_msgs/msg/Sample", text, "idl")
    (mine,) = ours([definition], OTHERS)["refused"]
    assert problem in mine
    assert not any(accepted(reply) for reply in rosidl.compile([definition]).values())


def test_byte_order_mark_and_union_are_reported_but_forward_declarations_are_accepted() -> None:
    text = "module a_msgs { struct Later; module msg { struct Other; struct Sample; struct Sample { long x; }; }; };"
    assert [item.name for item in message(text, format="idl").fields] == ["x"]
    assert read(f"\ufeff{text}", format="idl")[1] == [
        "1:1: found a byte order mark; save the file as UTF-8 without one"
    ]
    assert (
        "unions are not supported" in read(text.replace("struct Other;", "union Other {long x;};"), format="idl")[1][0]
    )
