"""``rosidl-py param`` with nodes of the test, and values of the command line."""

from __future__ import annotations

import asyncio
import json
import math
import re
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen import compile_definition, to_dict, to_json
from rosidl_py_gen.base.terminal_text import printable_lines
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.msgs.rcl_interfaces import srv
from rosidl_py_gen.msgs.rcl_interfaces.msg import ListParametersResult
from rosidl_py_gen.ros_cli.message_text import message_from, to_plain, to_yaml
from rosidl_py_gen.ros_cli.param import fit_parameter
from rosidl_py_gen.ros_cli.values import MAX_TEXT
from rosidl_py_gen.runtime import FloatRange, Node, ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.parameters.services import value_to_message

if TYPE_CHECKING:
    from pathlib import Path

    from support.commands import Tool
    from support.worlds import World


def drive(world: World) -> Node:
    node = world.node("drive")
    limits = ParameterDescriptor(description="in m/s", floating_point_range=FloatRange(0.0, 3.0, 0.5))
    node.declare_parameter("speed", 1.5, limits)
    node.declare_parameter("arm.names", ["a", "b"])
    node.declare_parameter("on", True)
    return node


async def test_param_get_prints_value_with_or_without_type(memory: World, tool: Tool) -> None:
    drive(memory)
    speed, names, alone, as_json = await asyncio.gather(
        tool("param", "get", "/drive", "speed"),
        tool("param", "get", "drive", "arm.names"),
        tool("param", "get", "/drive", "on", "--hide-type"),
        tool("param", "get", "/drive", "arm.names", "--json"),
    )
    assert (speed.out, names.out) == ("Double value is: 1.5\n", "String values are: ['a', 'b']\n")
    assert (alone.out, json.loads(as_json.out)) == ("True\n", ["a", "b"])


@pytest.mark.parametrize(
    ("words", "expected_text"),
    [
        (["/drive", "sped"], '/drive has no parameter sped; did you mean "speed"?'),
        (["/driv", "speed", "--timeout", "1"], 'did you mean "/drive"?'),
        (["/drive/", "speed"], "error: "),
    ],
)
async def test_param_get_errors_name_the_reason(
    memory: World, tool: Tool, words: list[str], expected_text: str
) -> None:
    drive(memory)
    ended = await tool("param", "get", *words)
    assert (ended.code, ended.out, expected_text in ended.err, "Traceback" in ended.err) == (1, "", True, False), (
        ended.err
    )


async def test_missing_parameter_services_of_node_are_reported(memory: World, tool: Tool) -> None:
    memory.node("bare", start_services=False)
    ended = await tool("param", "get", "/bare", "speed", "--timeout", "1")
    assert ended.err == "error: node /bare exists, but offered no parameter services in 1 s\n"


async def test_empty_list_keeps_declared_array_type(memory: World, tool: Tool) -> None:
    node = memory.node("empty")
    for name, value in {"Integer": [1], "String": ["a"], "Double": [1.5], "Boolean": [True], "Byte": [b"a"]}.items():
        node.declare_parameter(name, value)
        assert (await tool("param", "set", "/empty", name, "[]")).code == 0
        assert (await tool("param", "get", "/empty", name)).out == f"{name} values are: []\n"


async def test_rejected_param_set_fails_with_reason_of_node(memory: World, tool: Tool) -> None:
    drive(memory)
    negative, text, yaml, as_json = await asyncio.gather(
        tool("param", "set", "/drive", "speed", "-1.5"),
        tool("param", "set", "/drive", "speed", "fast"),
        tool("param", "set", "/drive", "speed", "[1, a]"),
        tool("param", "set", "/drive", "speed", "9.0", "--json"),
    )
    assert negative.err.startswith("error: Setting parameter failed: ")
    assert "-1.5" in negative.err
    assert "STRING" in text.err
    assert "all items of an array must have one type" in yaml.err
    assert {one.code for one in (negative, text, yaml, as_json)} == {1}
    assert json.loads(as_json.out)["successful"] is False


async def test_param_delete_undeclares_only_dynamic_parameters(memory: World, tool: Tool) -> None:
    node = drive(memory)
    node.declare_parameter("label", "x", ParameterDescriptor(dynamic_typing=True))
    gone, refused = await asyncio.gather(*(tool("param", "delete", "/drive", one) for one in ("label", "speed")))
    assert (gone.out, node.has_parameter("label")) == ("Deleted parameter successfully\n", False)
    assert (refused.code, refused.err[:35]) == (1, "error: Deleting parameter failed: S")


async def test_param_describe_prints_type_and_constraints(memory: World, tool: Tool) -> None:
    drive(memory)
    ended, as_json = await asyncio.gather(
        tool("param", "describe", "/drive", "speed", "on"), tool("param", "describe", "/drive", "speed", "--json")
    )
    assert ended.out == (
        "Parameter name: speed\n  Type: double\n  Description: in m/s\n  Constraints:\n    Min value: 0.0\n"
        "    Max value: 3.0\n    Step: 0.5\nParameter name: on\n  Type: boolean\n  Constraints:\n"
    )
    assert json.loads(as_json.out)[0]["floating_point_range"] == {"from_value": 0.0, "to_value": 3.0, "step": 0.5}


@pytest.mark.slow
async def test_dumped_parameters_can_be_loaded(network: World, tool: Tool, tmp_path: Path) -> None:
    node, file = drive(network), tmp_path / "drive.yaml"
    printed, written, as_json = await asyncio.gather(
        tool("param", "dump", "/drive", "--timeout", "20"),
        tool("param", "dump", "/drive", "--timeout", "20", "-o", str(file)),
        tool("param", "dump", "/drive", "--timeout", "20", "--json"),
    )
    assert (written.out, file.read_text()) == ("", printed.out)
    assert json.loads(as_json.out)["/drive"]["arm.names"] == ["a", "b"]
    node.set_parameters({"speed": 3.0, "arm.names": ["z"]})
    loaded = await tool("param", "load", "/drive", str(file))
    assert (loaded.code, node.get_parameters(["speed", "arm.names"])) == (0, [1.5, ("a", "b")])
    assert "Set parameter speed successful" in loaded.out
    assert "start_type_description_service successful: it is read-only and has this value" in loaded.out
    file.write_text("/drive:\n  ros__parameters: {speed: 2, start_type_description_service: false}\n")
    differs = await tool("param", "load", "/drive", str(file))
    assert (differs.code, node.get_parameter("speed", float)) == (1, 2.0)
    assert "failed: it is read-only with True; the file has False" in differs.err


async def test_param_dump_requests_values_in_batches_within_one_timeout(memory: World, tool: Tool) -> None:
    names, unset = [f"p{number}" for number in range(3000)], {"p7", "p8", "p2999"}
    requests: list[int] = []
    delay_s = 0.0

    async def get(request: Any) -> Any:
        requests.append(len(request.names))
        await asyncio.sleep(delay_s)
        if unset.intersection(request.names):  # as rclcpp and rclpy do
            return srv.GetParameters.Response()
        return srv.GetParameters.Response(values=[value_to_message(parameter_value(name)) for name in request.names])

    node = memory.node("many", start_services=False)
    answers: dict[Any, Any] = {
        srv.GetParameters: get,
        srv.GetParameterTypes: lambda request: srv.GetParameterTypes.Response(
            types=bytes(0 if name in unset else 4 for name in request.names)
        ),
        srv.ListParameters: lambda request: srv.ListParameters.Response(result=ListParametersResult(names=names)),
        **dict.fromkeys((srv.DescribeParameters, srv.SetParameters, srv.SetParametersAtomically)),
    }
    for cls, answer in answers.items():
        name = re.sub("(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        node.create_service(cls, f"/many/{name}", answer or (lambda request: None))
    dumped = await tool("param", "dump", "/many", "--json")
    assert json.loads(dumped.out) == {"/many": {name: name for name in names if name not in unset}}
    assert len(requests) < 12
    delay_s, requests[:] = 0.9, []
    started_s = asyncio.get_running_loop().time()
    late = await tool("param", "dump", "/many", "--timeout", "3")
    assert (late.code, late.out, len(requests)) == (1, "", 4)
    assert late.err == "error: node /many: 150 of 3000 parameters were read in time\n"
    assert 3 <= asyncio.get_running_loop().time() - started_s < 3.5


async def test_param_load_reports_missing_node_invalid_text_and_rejected_value(
    memory: World, tool: Tool, tmp_path: Path
) -> None:
    drive(memory)
    other, wrong = tmp_path / "other.yaml", tmp_path / "wrong.yaml"
    other.write_text("/other:\n  ros__parameters: {speed: 1.0}\n")
    wrong.write_text("/drive:\n  ros__parameters: {speed: 0.5, on: 3}\n")
    nothing, partly = await asyncio.gather(*(tool("param", "load", "/drive", str(file)) for file in (other, wrong)))
    assert "no parameters for /drive; the file has parameters of /other" in nothing.err
    other.write_bytes(b"/drive:\n  ros__parameters: {speed: '\xff'}\n")
    no_text = await tool("param", "load", "/drive", str(other))
    assert no_text.err == f"error: {other}: expected UTF-8, found the byte 0xff\n"
    assert (partly.code, partly.out) == (1, "Set parameter speed successful\n")
    assert partly.err.startswith("error: Set parameter on failed: ")


async def test_param_list_queries_all_nodes_despite_one_without_response(memory: World, tool: Tool) -> None:
    drive(memory)
    silent = memory.node("silent", start_services=False)
    servers = [silent.create_service(srv.ListParameters, "/silent/list_parameters")]
    clients = [silent.create_client(srv.ListParameters, "/gone/list_parameters")]
    every, one, typed = await asyncio.gather(
        tool("param", "list", "--timeout", "1.25", "--spin-time", "1.25", "--filter", "(?!start_type)"),
        tool("param", "list", "/drive", "--param-prefixes", "arm"),
        tool("param", "list", "--param-type", "--json", "--timeout", "1.25", "--spin-time", "1.25"),
    )
    assert every.out == "/drive:\n  arm.names\n  on\n  speed\n  use_sim_time\n"
    assert every.err == (
        "/silent: no response from /silent/list_parameters (rcl_interfaces/srv/ListParameters) in 1.25 s\n"
    )
    assert (every.code, one.out) == (0, "  arm.names\n")
    assert {"name": "speed", "type": "double"} in json.loads(typed.out)["/drive"]
    assert servers and clients
    ended = await tool("param", "list", "--filter", "*x")
    assert ended.code == 1 and ended.err.startswith("error: --filter: ") and "nothing to repeat" in ended.err


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


def test_yaml_values_are_converted_to_type_of_field() -> None:
    for text, expected in TAKEN:
        found = to_dict(message_from(_CLASS, text))
        assert {name: found[name] for name in expected} == expected, text
    bools = to_json(message_from(_CLASS, "{i: true, d: true, f: [on, 2], n: [false, true], inner: [{k: yes, x: on}]}"))
    for part in ('"i":1,', '"d":1.0,', '"f":[1.0,2.0],', '"n":[0,1],', '"inner":[{"x":1.0,"k":1}]'):
        assert part in bools.replace(" ", ""), bools
    assert math.isnan(message_from(_CLASS, '{"d": NaN}').d)
    assert math.isnan(message_from(_CLASS, "{d: .nan}").d)


def test_yaml_values_of_wrong_type_are_refused() -> None:
    for text, reason in REFUSED:
        with pytest.raises(CommandError) as error:
            message_from(_CLASS, text)
        assert reason in str(error.value), text[:100]


def test_yaml_printed_by_echo_parses_to_equal_message() -> None:
    strings = ["é\u202e\u200b\u2028", "a\r\nb\x1b", "\x85\x7f\ufeff", "x...", "...", "a\n...", " ", "~"]
    for text in strings:
        message = _CLASS(s=text, t=[text], d=-math.inf)
        printed = printable_lines(to_yaml(to_plain(message)))
        assert message_from(_CLASS, printed).encode() == message.encode(), printed
        assert printable_lines(to_yaml({"s": text})).endswith("\n")
    assert to_yaml({"s": "x..."}) == "s: x...\n"
    assert to_yaml({"s": "é"}) == "s: é\n"
    assert to_yaml("x") == "x\n"


def test_json_printed_by_echo_parses_to_equal_message() -> None:
    message = _CLASS(d=math.nan, f=[1e-07, math.inf, -math.inf], i=-(2**63), s='\u202e"\n\x1b', t=["NaN", "1.0"])
    again = message_from(_CLASS, to_json(message))
    assert again.encode() == message.encode()
    big: Message = _CLASS(bytes=bytes(range(256)) * 4096)  # 2**20 values: more than YAML may have
    assert message_from(_CLASS, json.dumps(to_plain(big, truncate=None))).encode() == big.encode()


async def test_param_set_converts_value_to_declared_type(memory: World, tool: Tool) -> None:
    node = memory.node("drive")
    for name, value in {"d": 1.5, "i": 1, "s": "x", "ds": [1.5], "is": [1], "ss": ["x"], "b": False}.items():
        node.declare_parameter(name, value)
    node.declare_parameter("any", 1.5, ParameterDescriptor(dynamic_typing=True))
    for name, text, expected in [
        *(("d", "1e-3", 0.001), ("d", "2", 2.0), ("d", '"-Infinity"', -math.inf), ("i", "3.0", 3), ("i", "1e3", 1000)),
        *(("s", "5", "5"), ("s", "1.10", "1.10"), ("ds", '[1, 2.5, "Infinity"]', (1.0, 2.5, math.inf))),
        *(("is", "[1.0, 2]", (1, 2)), ("ss", "[1, x]", ("1", "x")), ("any", "3", 3), ("b", "yes", True)),
        *(("b", "off", False), ("ss", "[c, '1']", ("c", "1")), ("ss", "[]", ())),
    ]:
        ended = await tool("param", "set", "/drive", name, text)
        assert (ended.out, node.get_parameter(name)) == ("Set parameter successful\n", expected), ended.err
    for name, text in [("i", "3.7"), ("b", "3"), ("is", "3"), ("ss", "[true]"), ("nope", "1"), ("i", "[1, a]")]:
        assert (await tool("param", "set", "/drive", name, text)).code == 1, text
    assert fit_parameter("[1]", ParameterType.BYTE_ARRAY) is None
