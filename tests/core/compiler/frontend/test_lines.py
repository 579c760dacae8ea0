"""The line algorithm and the value rules of .msg text (docs/internals/protocol.md 1.1 to 1.6), one case a line."""

from __future__ import annotations

import math

import pytest
from each_case import each_case
from support.interface_packages import message, parse, read

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    ConstantDef,
    FieldDef,
    ServiceDef,
    is_interface_name,
)

PRIMITIVE = [
    *("bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32"),
    *("float64", "string", "wstring"),
]

# --- types ------------------------------------------------------------------------------------------------------------

TYPES = [
    *[(name, name) for name in PRIMITIVE],
    *[(f"{name}[]", f"{name}[]") for name in PRIMITIVE],
    *[(f"{name}[7]", f"{name}[7]") for name in PRIMITIVE],
    *[(f"{name}[<=7]", f"{name}[<=7]") for name in PRIMITIVE],
    ("string<=5", "string<=5"),
    ("wstring<=5[]", "wstring<=5[]"),
    ("string<=3[<=4]", "string<=3[<=4]"),
    ("string<=3[4]", "string<=3[4]"),
    ("uint8[+3]", "uint8[3]"),
    ("uint8[4294967295]", "uint8[4294967295]"),
    ("Other", "a_msgs/msg/Other"),
    ("Other[]", "a_msgs/msg/Other[]"),
    ("Other[2]", "a_msgs/msg/Other[2]"),
    ("Other[<=2]", "a_msgs/msg/Other[<=2]"),
    ("b_msgs/Other", "b_msgs/msg/Other"),
    ("b_msgs/Other[]", "b_msgs/msg/Other[]"),
]


@pytest.mark.parametrize(("text", "kind"), TYPES)
def test_field_type_is_parsed(text: str, kind: str) -> None:
    (item,) = message(f"{text} x").fields
    assert str(item.type) == kind


@pytest.mark.parametrize("kind", ["srv", "action"])
def test_type_names_without_package_mean_messages_of_the_own_package(kind: str) -> None:
    interface = parse("Other x\n---\nOther y" + "\n---" * (kind == "action"), f"a_msgs/{kind}/Sample")
    first = interface.messages[0]
    assert str(first.fields[0].type) == "a_msgs/msg/Other"


def test_optional_annotation_does_not_change_a_field() -> None:
    first = message('@optional string<=9 note "a"  # why\n@optional Other[] others\nstring s @optional\n')
    plain = message('string<=9 note "a"  # why\nOther[] others\nstring s @optional\n')
    assert [item._replace(location=None) for item in first.fields] == [
        item._replace(location=None) for item in plain.fields
    ]
    assert first.fields[0].default == "a" and first.fields[0].location.column == 21
    assert first.fields[2].default == "@optional"


# --- refused definitions, location, error texts -----------------------------------------------------------------------

REFUSED = [
    # the shape of a line
    ("uint8", "1:6: expected a type, a space and a name, found no name"),
    (" uint8 x", "1:1: expected the element to begin in column 1, found blanks before it"),
    ("\ufeffuint8 x", "1:1: found a byte order mark; save the file as UTF-8 without one"),
    ("@key uint8 x", '1:1: other annotations than "@optional", in the line of a field and before its type, exist in'),
    ("@optional\nuint8 x", '1:10: other annotations than "@optional", in the line of a field and before its type'),
    ("@optional uint8 X=1", "1:1: a constant is never @optional"),
    ("@optional uint8 Bad", '1:17: "Bad" is not a field name'),
    # types
    ("int x", '1:1: "int" is neither a primitive type nor a message name'),
    ("flaot32 x", 'did you mean "float32"?'),
    ("time x", '1:1: "time" is a ROS 1 type; use builtin_interfaces/Time'),
    ("a/b/C x", '1:4: expected "<=" or "[" or a space, found "/'),
    (
        "b_msgs/msg/Other x",
        '1:11: "b_msgs/msg/Other" is not a type in a .msg, .srv or .action file; write "b_msgs/Other"',
    ),
    ("B_msgs/Other x", '1:1: "B_msgs" is not a package name; expected lower case letters'),
    ("b_msgs/other x", '1:8: "other" is neither a primitive type nor a message name'),
    ("../../etc/Passwd x", "1:6: expected"),
    ("b-msgs/Other x", '1:1: "b-msgs" is not a package name'),
    ("uint8[0] x", '1:7: expected a whole number above 0, found "0"'),
    ("uint8[<=0] x", '1:9: expected a whole number above 0, found "0"'),
    ("uint8[<=] x", '1:9: expected a number, found "]'),
    ("uint8[18446744073709551616] x", "1:7: expected a whole number above 0, found"),
    ("uint8[" + "9" * 5000 + "] x", "1:7: expected a whole number above 0, found"),
    ("uint8[3][3] x", '1:9: expected a space, found "['),
    ("uint8<=3 x", '1:8: only string and wstring take a bound, not "uint8"'),
    ("string<=0 x", '1:9: expected a whole number above 0, found "0"'),
    # names
    ("uint8 aB", '1:7: "aB" is not a field name; expected lower case letters, digits and single underscores'),
    ("uint8 ../x", '1:7: "../x" is not a field name'),
    ("uint8 a=1", '1:7: "a" is not a constant name; expected upper case letters'),
    ("uint8 x\nint8 x", '2:6: "x" is already defined in line 1'),
    ("uint8 X=1\nint8 X=2", '2:6: "X" is already defined in line 1'),
    # a default with "=" makes the line a constant
    ("string x a=b", '1:11: a "=" makes the line a constant'),
    ("uint8 x =1", '1:7: "x" is not a constant name'),
    # constants
    ("uint8[] X=1", '1:1: expected a primitive type or string for a constant, found "uint8[]"'),
    ("Other X=1", '1:1: expected a primitive type or string for a constant, found "a_msgs/msg/Other"'),
    ("uint8 X=", "1:7: expected an integer in 0..255 for uint8, found ''"),
    ("uint8 X=256", "1:9: expected an integer in 0..255 for uint8, found '256'"),
    # values
    ("bool x yes", "1:8: expected true, false, 1 or 0, found 'yes'"),
    ("char x 'a'", "1:8: expected an integer in 0..255 for char, found \"'a'\""),
    ("int32 x 1.0", "1:9: expected an integer in -2147483648..2147483647 for int32, found '1.0'"),
    ("int64 x 9223372036854775808", "1:9: expected an integer in -9223372036854775808..9223372036854775807 for int64"),
    ("int64 x " + "9" * 100_000, "1:9: expected an integer in "),
    ("float32 x 0x1", "1:11: expected a floating point number, found '0x1'"),
    ("float32 x __import__('os')", "1:11: expected a floating point number, found \"__import__('os')\""),
    ("string<=3 x abcd", "1:13: expected at most 3 characters, found 4"),
    ('string x "a"b"', "1:10: expected inner quotes to be escaped"),
    ('string x "a\\nb"', "1:10: expected text whose escapes leave no line break or open quote"),
    ('string x "\\x4"', "1:10: expected text with valid escapes"),
    ('wstring x "\\u00fc"', "1:11: expected text with valid escapes"),
    ("uint8[3] x [1,2]", "1:12: expected exactly 3 values for uint8[3], found 2"),
    ("uint8[<=1] x [1,2]", "1:14: expected at most 1 values for uint8[<=1], found 2"),
    ("uint8[] x 1,2", "1:11: expected values in brackets [..] for uint8[], found '1,2'"),
    ("uint8[] x [1,,2]", "1:11: expected an integer in 0..255 for uint8, found ''"),
    ("string[] x [a,,b]", "1:12: expected a string at character 3 of the list, found nothing"),
    ("string[] x ['a]", "1:12: expected a closing ', found the end of the list"),
    ("Other x 3", '1:9: a field of type "a_msgs/msg/Other" cannot have a default'),
]


@pytest.mark.parametrize(("text", "problem"), REFUSED, ids=[row[0][:40] for row in REFUSED])
def test_invalid_definitions_are_reported_with_location(text: str, problem: str) -> None:
    _, problems = read(text)
    assert len(problems) == 1, problems
    assert problem in problems[0]
    if problem[0].isdigit():
        assert problems[0].startswith(problem)


def test_all_errors_of_a_file_are_reported_together() -> None:
    _, problems = read("int a\nuint8 x\nuint8 B_=1\nuint8 x 300\n  uint8 y")
    assert [one.split(" ")[0] for one in problems] == ["1:1:", "3:7:", "4:9:", "5:1:"]


# --- values -----------------------------------------------------------------------------------------------------------

VALUES = [
    ("bool", "true", True),
    ("bool", "1", True),
    ("byte", "0x41", 65),
    ("int32", "0x1f", 31),
    ("int32", "1_000", 1000),
    ("uint64", "18446744073709551615", 2**64 - 1),
    ("float64", "-1.5e-3", -0.0015),
    ("float64", "inf", math.inf),
    ("string", "two words", "two words"),
    ("string", '"quoted"', "quoted"),
    ("string", '""', ""),
    ("string", '"a\\"b"', 'a"b'),
    ("string", '"it\'s"', "it's"),
    ("string", '"a\\tb"', "a\tb"),
    ("string", '"a\\\\nb"', "a\nb"),
    ("string", "Hellö ハ 😀", "Hellö ハ 😀"),
    ("uint8[3]", "[1, 2 ,3]", (1, 2, 3)),
    ("uint8[]", "[]", ()),
    ("bool[]", "[true, 0]", (True, False)),
    ("string[]", "['a,b', c]", ("a,b", "c")),
    ("string<=2[2]", "[ab, c]", ("ab", "c")),
]


@pytest.mark.parametrize(("kind", "text", "value"), VALUES)
def test_default_value_is_parsed(kind: str, text: str, value: object) -> None:
    (item,) = message(f"{kind} x  {text}").fields
    assert repr(item.default) == repr(value)


@each_case(("kind", "text", "value"), [row for row in VALUES if "[" not in row[0] and "<=" not in row[0]])
@each_case("equals", ["=", " = ", "= ", " ="])
def test_constant_value_is_parsed(kind: str, text: str, value: object, equals: str) -> None:
    (item,) = message(f"{kind} X_1{equals}{text}").constants
    assert repr(item.value) == repr(value)


def test_nan_is_accepted_as_a_default() -> None:
    (item,) = message("float32 x nan").fields
    assert isinstance(item.default, float)
    assert math.isnan(item.default)


def test_missing_default_differs_from_an_empty_default() -> None:
    first, second, third = message('string x\nstring y ""\nuint8[] z []').fields
    assert (first.default, second.default, third.default) == (None, "", ())


def test_locations_of_elements_are_line_and_column_of_their_names() -> None:
    found = message("# head\n\nuint8   first\nstring<=3[] second\nuint8 C = 3")
    elements: list[FieldDef | ConstantDef] = [*found.fields, *found.constants]
    places = [(one.name, one.location.line, one.location.column) for one in elements]
    assert places == [("first", 3, 9), ("second", 4, 13), ("C", 5, 7)]


def test_tabs_count_as_one_column_in_locations() -> None:
    (item,) = message("uint8\t\tx").fields
    assert item.location.column == 8


# --- comments and units -----------------------------------------------------------------------------------------------


def field(text: str) -> FieldDef:
    return message(text).fields[-1]


def test_leading_comment_belongs_to_the_message() -> None:
    found = message("# What it is.\n#   Indented.\n#\n# More.\n\n# Of x.\nuint8 x")
    assert found.comment == ("What it is.", "  Indented.", "", "More.")
    assert found.fields[0].comment == ("Of x.",)


def test_comment_directly_above_the_first_field_belongs_to_the_message() -> None:
    found = message("# What it is.\nuint8 x")
    assert (found.comment, found.fields[0].comment) == (("What it is.",), ())


COMMENTS = [
    ("\nuint8 x # behind", ("behind",), ""),
    ("\n# above\nuint8 x # behind", ("above", "behind"), ""),
    ("\nuint8 x # behind\n   # below", ("behind", "below"), ""),
    ("\nuint8 x\n   # below\n\n   # further", ("below", "further"), ""),
    ("\n# above\n\n# more\nuint8 x", ("above", "more"), ""),
    ("\nuint8 x ## two marks", ("two marks",), ""),
    ("\nuint8 x #no blank", ("no blank",), ""),
    ("\n# a\n#   b\nuint8 x", ("a", "  b"), ""),
    ("\n#\n#\n# a\n#\n#\n# b\n#\nuint8 x", ("a", "", "b"), ""),
    ("\nuint8 x #", (), ""),
    # units: exactly one [..] without a comma
    ("\nuint8 x # distance [m]", ("distance",), "m"),
    ("\nuint8 x # [m/s^2]", (), "m/s^2"),
    ("\nuint8 x # range [0, 1]", ("range [0, 1]",), ""),
    ("\nuint8 x # [m] or [s]", ("[m] or [s]",), ""),
    ("\n# speed [ m/s ] of it\nuint8 x", ("speed of it",), "m/s"),
    ("\n# first\nuint8 x # second [rad]", ("first", "second"), "rad"),
    ("\nuint8 x # []", ("[]",), ""),
    ('\nuint8 x # it\'s "quoted" \\ {{ }} {% %}', ('it\'s "quoted" \\ {{ }} {% %}',), ""),
]


@pytest.mark.parametrize(("text", "comment", "unit"), COMMENTS)
def test_a_field_has_its_comment_and_unit(text: str, comment: tuple[str, ...], unit: str) -> None:
    item = field(text)
    assert (item.comment, item.unit) == (comment, unit)


def test_a_constant_has_comment_and_unit_too() -> None:
    (item,) = message("\n# the most\nfloat64 LIMIT=2.5 # allowed [m]").constants
    assert (item.comment, item.unit, item.value) == (("the most", "allowed"), "m", 2.5)


def test_comment_after_an_indented_comment_belongs_to_the_first_field() -> None:
    found = message("\n   # belongs to nothing\n# of x\nuint8 x\n# of nothing")
    assert found.fields[0].comment == ("of x",)


# --- names ------------------------------------------------------------------------------------------------------------

NAMES = [
    # text, package or field, constant, interface
    ("a", True, False, False),
    ("abc_1", True, False, False),
    ("a_b_c", True, False, False),
    ("a__b", False, False, False),
    ("a_", False, False, False),
    ("_a", False, False, False),
    ("1a", False, False, False),
    ("aB", False, False, False),
    ("A", False, True, True),
    ("A1", False, True, True),
    ("A_B", False, True, False),
    ("A__B", False, False, False),
    ("A_", False, False, False),
    ("AB1_2", False, True, False),
    ("Abc", False, False, True),
    ("AbcDef2", False, False, True),
    ("Sample_Abc", False, False, True),
    ("Abc_Request", False, False, True),
    ("Abc_Event", False, False, False),
    ("Abc_X", False, False, False),
    ("", False, False, False),
    ("ä", False, False, False),
    ("Ä", False, False, False),
    ("a\n", False, False, False),
    ("A\n", False, False, False),
    ("a/b", False, False, False),
    ("..", False, False, False),
]


@pytest.mark.parametrize(("text", "lower", "constant", "interface"), NAMES)
def test_legal_names_of_each_kind_of_definition_element(
    text: str, lower: bool, constant: bool, interface: bool
) -> None:
    assert RosName.PACKAGE_RULE.allows(text) == RosName.FIELD_RULE.allows(text) == lower
    assert RosName.CONSTANT_RULE.allows(text) == constant
    assert is_interface_name(text) == interface


def test_a_hostile_name_is_checked_in_linear_time() -> None:
    assert not RosName.CONSTANT_RULE.allows("A" * 100_000 + "!")
    assert not RosName.FIELD_RULE.allows("a" * 100_000 + "!")


# --- empty, services, actions -----------------------------------------------------------------------------------------


def rows(interface: ServiceDef | ActionDef) -> dict[str, list[str]]:
    return {one.name.name: [f"{item.type} {item.name}" for item in one.fields] for one in interface.messages}


def test_a_service_has_request_response_and_event() -> None:
    service = parse("int64 a\n---\nint64 sum", "a_msgs/srv/Add")
    assert isinstance(service, ServiceDef)
    assert rows(service) == {
        "Add_Request": ["int64 a"],
        "Add_Response": ["int64 sum"],
        "Add_Event": [
            "service_msgs/msg/ServiceEventInfo info",
            "a_msgs/srv/Add_Request[<=1] request",
            "a_msgs/srv/Add_Response[<=1] response",
        ],
    }


def test_action_has_its_messages_and_two_services() -> None:
    action = parse("int32 order\n---\nint32[] sequence\n---\nint32[] partial", "a_msgs/action/Count")
    assert isinstance(action, ActionDef)
    uuid, info = "unique_identifier_msgs/msg/UUID goal_id", "service_msgs/msg/ServiceEventInfo info"
    assert rows(action) == {
        "Count_Goal": ["int32 order"],
        "Count_Result": ["int32[] sequence"],
        "Count_Feedback": ["int32[] partial"],
        "Count_FeedbackMessage": [uuid, "a_msgs/action/Count_Feedback feedback"],
        "Count_SendGoal_Request": [uuid, "a_msgs/action/Count_Goal goal"],
        "Count_SendGoal_Response": ["bool accepted", "builtin_interfaces/msg/Time stamp"],
        "Count_SendGoal_Event": [
            info,
            "a_msgs/action/Count_SendGoal_Request[<=1] request",
            "a_msgs/action/Count_SendGoal_Response[<=1] response",
        ],
        "Count_GetResult_Request": [uuid],
        "Count_GetResult_Response": ["int8 status", "a_msgs/action/Count_Result result"],
        "Count_GetResult_Event": [
            info,
            "a_msgs/action/Count_GetResult_Request[<=1] request",
            "a_msgs/action/Count_GetResult_Response[<=1] response",
        ],
    }


SEPARATORS = [
    ("srv", "uint8 x", '1:1: expected 1 line "---" in a .srv file, found 0'),
    (
        "srv",
        "uint8 x\n--- \nuint8 y",
        '2:1: expected the separator "---" alone in its line, found "--- "; expected 1 line "---" in a .srv file',
    ),
    ("srv", "uint8 x\n----\nuint8 y", '2:1: expected the separator "---" alone in its line, found "----"'),
    ("action", "---\n\u2014\u2014\n", '2:1: expected the separator "---" alone in its line, found "\u2014\u2014"'),
    ("srv", "\ufeff---", "1:1: found a byte order mark; save the file as UTF-8 without one"),
    ("srv", "\ufeff# A comment.\nuint8 x\n---", "1:1: found a byte order mark; save the file as UTF-8 without one"),
    ("action", "\ufeffuint8 x\n---\n---", "1:1: found a byte order mark; save the file as UTF-8 without one"),
    ("srv", "---\n---", '2:1: expected 1 line "---" in a .srv file, found 2'),
    ("srv", "", '1:1: expected 1 line "---" in a .srv file, found 0'),
    ("action", "---", '1:1: expected 2 lines "---" in a .action file, found 1'),
    ("action", "---\n---\n---", '3:1: expected 2 lines "---" in a .action file, found 3'),
    ("msg", "uint8 x\n---\nuint8 y", '2:4: a separator is exactly "---", and only in .srv and .action files'),
]


@pytest.mark.parametrize(("kind", "text", "problem"), SEPARATORS)
def test_wrong_number_or_form_of_separators_is_reported(kind: str, text: str, problem: str) -> None:
    _, problems = read(text, f"a_msgs/{kind}/Sample")
    assert len(problems) == 1
    assert problems[0].startswith(problem)


def test_lines_of_later_sections_are_located_in_the_file() -> None:
    _, problems = read("uint8 x\n---\nuint8 y\n\nint z", "a_msgs/srv/Sample")
    assert problems[0].startswith("5:1: ")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("['\\c']", "\\c"),
        ("[\\c]", "\\c"),
        ("[\\8]", "\\8"),
        ("[\\\\c]", "\\c"),
        ("[\\400]", "\u0100"),
        ("[\\u00e9]", "é"),
        ("[\\x41]", "A"),
    ],
)
def test_escapes_in_string_arrays_are_resolved_without_warnings(text: str, value: str) -> None:
    (item,) = message(f"string[] x {text}").fields
    assert item.default == (value,)
