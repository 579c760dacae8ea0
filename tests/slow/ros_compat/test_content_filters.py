"""Content filters of subscriptions, as rclpy of Lyrical has them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from support.interface_packages import write
from support.local_network import domain_id
from support.program_processes import output_lines

from rosidl_py_gen.base.fieldtype import PRIMITIVES

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.real_time("programs are processes")

ACCEPTED: list[tuple[str, list[str]]] = [
    ("level = 40", []),
    ("level > %0", ["39"]),
    ("%0 < level", ["39"]),
    ("level BETWEEN 10 AND 40", []),
    ("level NOT BETWEEN 50 AND 60", []),
    ("name = %0", ["'arm.left'"]),
    ("name LIKE 'arm%'", []),
    ("name LIKE 'arm_left'", []),
    ("name LIKE 'a%.*ft'", []),
    ("name LIKE '%'", []),
    ("name like '%arm.left%' and not level = 0x29", []),
    ("level between 0x28 and %0 or level = 1", ["0x29"]),
    ("name = `arm.left'", []),
    ("name <> file", []),
    ("stamp.sec >= 5 AND stamp.nanosec != 1", []),
    ("NOT level = 41", []),
    ("level = 1 AND level = 2 OR level = 40", []),
    ("level = 40 OR level = 1 AND line = 7", []),
    ("(level = 40 OR level = 1) AND line = 7", []),
    ("NOT level = 40 AND level = 1", []),  # NOT negates both conditions
    ("level = 4.0e1", []),
]
"""Expressions and parameters that accept the message of the program."""
REFUSED: list[tuple[str, list[str]]] = [
    ("level = 40 OR level = 1 AND line = 8", []),  # from left to right
    ("level = 41", []),
    ("level < %0", ["40"]),
    ("level NOT BETWEEN 10 AND 40", []),
    ("name LIKE 'left'", []),
    ("name LIKE 'arm?'", []),
    ("name LIKE 'arm.l%left'", []),
    ("name LIKE ''", []),
    ("NOT (level = 40 OR level = 1)", []),
]
INVALID = {
    "level >": "got 'the end'; expected a field, number, text in quotes, TRUE, FALSE or parameter",
    "level ~ 1": "got '~ 1'; expected a field, value or operator",
    "levle = 1": "got the field 'levle'; Log has the fields stamp, level, name, msg, file, function, line",
    "level.x = 1": "got 'level.x'; level is uint8, which has no fields",
    "stamp = 1": "got 'stamp', which is builtin_interfaces/Time; expected a number, bool or string",
    "level = 'x'": "got a comparison of int with text; expected the same kind of values",
    "level LIKE 'x'": "got int LIKE text; expected texts",
    "1 = 1": "got a comparison of two values; expected a field on one side",
    "level = %1": "got %1, but 1 parameters; pass one for each number",
    "name = %0": "parameter %0: got 'arm'; expected a number, TRUE, FALSE or a text in quotes, as \"'x'\"",
    "name[0] = 1": "got 'name[0]'; name is string: expected no index",
    "name MATCH '('": "got MATCH, which is not supported; use LIKE, or filter in the callback",
    f"level[{'1' * 5000}] = 1": f"got '[{'1' * 48}; expected a field, value or operator",
    "level = 1 level = 2": "got 'level'; expected AND or OR",
    "(level = 1": "got 'the end'; expected ')'",
    "(" * 101 + "level = 1" + ")" * 101: "got more than 100 levels of parentheses and NOT; write it with fewer",
}
EVALUATE = """
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Log
from rclpy.impl.content_filter import ContentFilter

message = Log(stamp=Time(sec=5), level=40, name="arm.left", line=7)
for expression, parameters in CASES:
    try:
        print(ContentFilter(Log, expression, parameters).matches(message))
    except RuntimeError as error:
        print(type(error).__bases__[0].__name__, error)
"""
ARRAYS = """
from rclpy.impl.content_filter import ContentFilter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import BatteryState, JointState, PointCloud2
from std_msgs.msg import Byte

def matches(message, expression):
    message = deserialize_message(serialize_message(message), type(message))  # rounds to 32 bits
    return ContentFilter(type(message), expression, []).matches(message)

state = JointState(name=["elbow"], position=[0.5])
expressions = "name[0] = 'elbow'", "position[0] <= 0.5", "position[1] = 0", "NOT position[1] = 0"
print([matches(state, expression) for expression in expressions])
print(matches(BatteryState(voltage=0.1), "voltage = 0.1"), matches(BatteryState(voltage=0.1), "voltage < 1e39"))
print(matches(PointCloud2(is_dense=True), "is_dense = TRUE"), matches(Byte(data=b"\\x05"), "data = 5"))
print(matches(BatteryState(cell_voltage=[1.0]), "cell_voltage[0] BETWEEN 1 AND 2"))
"""
TYPES = """
from ast import literal_eval
from field_types_msgs import msg
from rclpy.impl.content_filter import ContentFilter
from rclpy.serialization import deserialize_message, serialize_message

for name, value, expression in CASES:
    cls = getattr(msg, name)
    message = deserialize_message(serialize_message(cls(one=literal_eval(value))), cls)  # rounds floats
    print(name, ContentFilter(cls, expression, []).matches(message))
"""
RECEIVE = """
import time
import rclpy
from rclpy.serialization import deserialize_message
from rclpy.subscription_content_filter_options import ContentFilterOptions
from std_msgs.msg import Int32

def spin_until(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)

with rclpy.init(), rclpy.create_node("filters") as node:
    received, raw, later, infos = [], [], [], []
    options = ContentFilterOptions("data >= %0 AND data < 100", ["5"])
    filtered = node.create_subscription(
        Int32, "numbers", lambda message: received.append(message.data), 1, content_filter_options=options
    )
    node.create_subscription(
        Int32, "numbers", lambda data: raw.append(deserialize_message(data, Int32).data), 50, raw=True,
        content_filter_options=options,
    )
    plain = node.create_subscription(Int32, "numbers", lambda message, info: later.append(message.data), 50)
    publisher = node.create_publisher(Int32, "numbers", 50)
    spin_until(lambda: publisher.get_subscription_count() == 3)
    print(plain.is_cft_supported, plain.is_cft_enabled, filtered.is_cft_enabled, filtered.get_content_filter())
    plain.set_content_filter("data = 1", [])
    for number in (1, 7, 8, 2, 300):  # the depth of `filtered` is 1: refused messages do not replace accepted ones
        publisher.publish(Int32(data=number))
    spin_until(lambda: received and len(raw) == 2 and later)
    print(received, raw, later)
    plain.set_content_filter("", [])
    publisher.publish(Int32(data=3))
    spin_until(lambda: len(later) == 2)
    print(later, plain.is_cft_enabled)
    try:
        plain.get_content_filter()
    except RuntimeError as error:
        print(error)
    try:
        node.create_subscription(Int32, "numbers", print, 1, content_filter_options=ContentFilterOptions("x = 1", []))
    except RuntimeError as error:
        print(error)
    print(len(list(node.subscriptions)))
"""
EVENTS = """
import time
import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_event_handler import ParameterEventHandler

with rclpy.init(), rclpy.create_node("one") as one, rclpy.create_node("two") as two:
    handler, nodes = ParameterEventHandler(one), []
    handler.add_parameter_event_callback(lambda event: nodes.append(event.node))
    print(handler.configure_nodes_filter(["/two"]))
    for number in range(2):
        for node in (one, two):
            node.declare_parameter(f"p{number}", 1)
        end = time.monotonic() + 20
        while len(nodes) < (1, 3)[number] and time.monotonic() < end:
            rclpy.spin_once(one, timeout_sec=0.1)
        print(nodes)
        print(handler.configure_nodes_filter())
"""


def evaluated(folder: Path, cases: list[tuple[str, list[str]]]) -> list[str]:
    program = EVALUATE.replace("CASES", repr(cases))
    return output_lines(folder, program)


def test_filter_expressions_are_evaluated_like_fast_dds(tmp_path: Path) -> None:
    cases = [*ACCEPTED, *REFUSED]
    found = evaluated(tmp_path, cases)
    expected = {expression: expression not in dict(REFUSED) for expression, _ in cases}
    assert {case[0]: text for case, text in zip(cases, found, strict=True)} == {
        expression: str(result) for expression, result in expected.items()
    }


def test_invalid_expressions_raise_rcl_error_with_the_reason(tmp_path: Path) -> None:
    found = evaluated(tmp_path, [(expression, ["arm"]) for expression in INVALID])
    for (expression, reason), text in zip(INVALID.items(), found, strict=True):
        assert text == f"RCLError content filter {expression!r:.200}: {reason}"


def test_filter_arguments_of_wrong_type_or_length_raise_rcl_error(tmp_path: Path) -> None:
    cases: list[tuple[Any, Any]] = [
        (5, []),
        ("level = %0", "5"),
        ("level = 1" + " " * 10_000, []),
        ("level = %0", ["1" * 10_001]),
    ]
    found = evaluated(tmp_path, cases)
    assert [text.partition("got ")[2].partition(";")[0] for text in found] == [
        "int and list",
        "str and str",
        *["more than 10000 characters"] * 2,
    ]


def test_like_operator_takes_linear_time(tmp_path: Path) -> None:
    program = """
import time
from rclpy.impl.content_filter import ContentFilter
from std_msgs.msg import String

began = time.process_time()
for pattern in ("%a%a%a%a%b", "%" + "a%" * 300 + "b", "%" + "_a" * 100 + "%b"):
    assert not ContentFilter(String, f"data LIKE '{pattern}'", []).matches(String(data="a" * 100_000))
print(time.process_time() - began < 5)
"""
    assert output_lines(tmp_path, program) == ["True"]


def test_elements_of_arrays_and_rounded_floats_are_compared(tmp_path: Path) -> None:
    assert output_lines(tmp_path, ARRAYS) == ["[True, True, False, True]", "True True", "True True", "True"]


def test_fields_of_every_primitive_type_are_compared(tmp_path: Path) -> None:
    # Wide characters are refused like wide texts.
    types = {name.title().replace("_", ""): one for name, one in PRIMITIVES.items() if name != "wchar"}
    package = {"package.xml": "<package><name>field_types_msgs</name></package>"}
    for name, one in types.items():
        struct = f"struct {name} {{ {one.idl} one; }};"
        package[f"msg/{name}.idl"] = f"module field_types_msgs {{ module msg {{ {struct} }}; }};"
    write(tmp_path / "src" / "field_types_msgs", package)
    values = {"bool": ("True", "TRUE"), "int": ("100", "100"), "float": ("0.1", "0.1")}
    cases = [
        (name, "b'd'" if one.idl == "octet" else values[one.python][0], f"one = {values[one.python][1]}")
        for name, one in types.items()
    ]
    assert output_lines(tmp_path, TYPES.replace("CASES", repr(cases))) == [f"{name} True" for name in types]


def test_subscription_calls_back_for_accepted_messages_only(tmp_path: Path) -> None:
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert output_lines(tmp_path, RECEIVE, **settings) == [
        "True False True ContentFilterOptions(filter_expression='data >= %0 AND data < 100', "
        "expression_parameters=['5'])",
        "[8] [7, 8] [1]",
        "[1, 3] False",
        "failed to get the content filter: the subscription has none",
        "content filter 'x = 1': got the field 'x'; Int32 has the fields data",
        "3",
    ]


def test_parameter_event_handler_receives_events_of_the_chosen_nodes(tmp_path: Path) -> None:
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    lines = output_lines(tmp_path, EVENTS, **settings)
    assert lines[:3] == ["True", "['/two']", "True"]
    assert sorted(json.loads(lines[3].replace("'", '"'))) == ["/one", "/two", "/two"]


def test_undecodable_message_is_filtered_out_without_ending_executor(tmp_path: Path) -> None:
    program = """
import time
import rclpy
from rclpy.serialization import serialize_message
from rclpy.subscription_content_filter_options import ContentFilterOptions
from std_msgs.msg import String

with rclpy.init(), rclpy.create_node("raw") as node:
    received = []
    node.create_subscription(
        String, "texts", received.append, 10, raw=True, content_filter_options=ContentFilterOptions("data = 'x'", [])
    )
    publisher = node.create_publisher(String, "texts", 10)
    end = time.monotonic() + 20
    while not publisher.get_subscription_count() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    for data in (b"\\x00\\x01\\x00\\x00\\xff\\xff\\xff\\x7f\\x00", serialize_message(String(data="x"))):
        publisher.publish(data)
    while not received and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(len(received), received[0][4:10])
"""
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert output_lines(tmp_path, program, **settings) == ["1 b'\\x02\\x00\\x00\\x00x\\x00'"]
