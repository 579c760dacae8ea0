"""``rosidl-py service`` beside a server of the test's own."""

from __future__ import annotations

import asyncio
import json
import signal
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from example_interfaces.srv import AddTwoInts
from geometry_msgs.msg import Polygon, TransformStamped
from std_msgs.msg import UInt8MultiArray
from support.node_fixtures import until

from rosidl_py_gen.ros_cli.message_text import rclpy_repr
from rosidl_py_gen.runtime import IntrospectionState
from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node, ServiceServer

TYPE = "example_interfaces/srv/AddTwoInts"


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


def serve(world: World) -> tuple[Node, ServiceServer[Any, Any]]:
    node = world.node("adder")
    return node, node.create_service(AddTwoInts, "/add", add)


async def test_a_call_prints_request_and_response(network: World, tool: Tool) -> None:
    serve(network)
    ended = await tool("service", "call", "/add", "{a: 1, b: 2}")
    assert ended.out == (
        "requester: making request: example_interfaces.srv.AddTwoInts_Request(a=1, b=2)\n\n"
        "response:\nexample_interfaces.srv.AddTwoInts_Response(sum=3)\n\n"
    )
    assert (ended.code, ended.err) == (0, "")


async def test_a_call_prints_the_response_alone_as_json(memory: World, tool: Tool) -> None:
    serve(memory)
    ended = await tool("service", "call", "add", TYPE, "--stdin", "--json", stdin='{"a": 40, "b": 2}')
    assert (ended.code, json.loads(ended.out)) == (0, {"sum": 42})


async def test_a_call_goes_by_the_definition_of_the_server_when_the_local_one_differs(
    network: World, tool: Tool, tmp_path: Path
) -> None:
    package = tmp_path / "example_interfaces"
    (package / "srv").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>example_interfaces</name></package>")
    (package / "srv" / "AddTwoInts.srv").write_text("int64 other\n---\nint64 sum\n")
    serve(network)
    ended = await tool("service", "call", "/add", TYPE, "{a: 1, b: 2}", "--json", "--path", str(tmp_path))
    assert (ended.code, ended.out, ended.err) == (0, '{"sum": 3}\n', "")


async def test_calls_go_on_at_a_rate_until_they_are_interrupted(memory: World, tool: Tool) -> None:
    serve(memory)
    process = await tool.start("service", "call", "/add", "{a: 1}", "--rate", "50", "--json")
    assert process.stdout is not None
    assert [await process.stdout.readline() for _ in range(3)] == [b'{"sum": 1}\n'] * 3
    process.send_signal(signal.SIGINT)
    assert (await tool.end(process)).code == 0


async def test_a_server_that_never_answers_is_an_error(memory: World, tool: Tool) -> None:
    node = memory.node("silent")
    server = node.create_service(AddTwoInts, "/never")
    ended = await tool("service", "call", "/never", "--timeout", "1")
    assert ended.code == 1
    assert ended.err == f"error: no response from /never ({TYPE}) in 1 s\n"
    assert server is not None


async def test_ctrl_c_ends_a_call_that_waits(memory: World, tool: Tool) -> None:
    server = memory.node("silent").create_service(AddTwoInts, "/never")
    process = await tool.start("service", "call", "/never")
    await asyncio.wait_for(server.__anext__(), 10)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.code, ended.err) == (130, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["/add", "{a: 1"], "error: not YAML: 2:1: "),
        (["/add", "{c: 1}"], 'unknown field "c"'),
        (["/add", "{a: x}"], "AddTwoInts_Request.a"),
        (["/add", "std_srvs/srv/Empty"], f"service /add has type {TYPE}, not std_srvs/srv/Empty"),
        (["/ad", "--timeout", "1"], 'did you mean "/add"?'),
    ],
)
async def test_a_wrong_call_says_why(memory: World, tool: Tool, words: list[str], said: str) -> None:
    serve(memory)
    ended = await tool("service", "call", *words)
    assert (ended.code, ended.out) == (1, "")
    assert said in ended.err
    assert "Traceback" not in ended.err


async def test_list_shows_services_and_hides_those_of_actions(memory: World, tool: Tool) -> None:
    node, _ = serve(memory)
    node.create_action_server("example_interfaces/action/Fibonacci", "/count", lambda goal: {})
    ended = await tool("service", "list", "-t")
    assert f"/add [{TYPE}]" in ended.out.splitlines()
    assert "_action" not in ended.out
    found = {one["name"]: one for one in json.loads((await tool("service", "list", "-a", "--json")).out)}
    assert found["/add"] == {"name": "/add", "types": [TYPE], "servers": 1, "clients": 0}
    assert "/count/_action/send_goal" in found


async def test_find_and_type_are_each_others_inverse(memory: World, tool: Tool) -> None:
    serve(memory)
    assert (await tool("service", "type", "/add")).out == f"{TYPE}\n"
    assert (await tool("service", "find", "example_interfaces/AddTwoInts")).out == "/add\n"


async def test_info_counts_and_names_both_ends(memory: World, tool: Tool) -> None:
    node, _ = serve(memory)
    node.create_client(AddTwoInts, "/add")
    ended = await tool("service", "info", "/add", "-v")
    assert ended.out.startswith(f"Type: {TYPE}\nClients count: 1\nServices count: 1\n\nNode: /adder\n")
    found = json.loads((await tool("service", "info", "/add", "-v", "--json")).out)
    assert [one["endpoint"] for one in found["endpoints"]] == ["SERVER", "CLIENT"]
    assert found["endpoints"][0]["reliability"] == "RELIABLE"


async def test_echo_shows_what_passes(network: World, tool: Tool) -> None:
    node, server = serve(network)
    server.configure_introspection(node.clock, SERVICES_DEFAULT, IntrospectionState.CONTENTS)
    process = await tool.start("service", "echo", "/add", "--json")
    await until(lambda: node.count_subscribers("/add/_service_event") > 0, 25)
    client = node.create_client(AddTwoInts, "/add")
    assert process.stdout is not None
    first = asyncio.ensure_future(process.stdout.readline())
    while not first.done():  # the command may learn of the publisher of events later than this node of its subscription
        await client.call(AddTwoInts.Request(a=2, b=3), 5)
        await asyncio.wait([first], timeout=1)
    events = [json.loads(await first), json.loads(await process.stdout.readline())]
    process.send_signal(signal.SIGINT)
    assert (await tool.end(process)).code == 0
    assert [one["info"]["event_type"] for one in events] == ["REQUEST_RECEIVED", "RESPONSE_SENT"]
    assert (events[0]["request"], events[1]["response"]) == ([{"a": 2, "b": 3}], [{"sum": 5}])


async def test_echo_says_when_introspection_is_off(memory: World, tool: Tool) -> None:
    serve(memory)
    process = await tool.start("service", "echo", "/add")
    assert process.stderr is not None
    assert b"introspection is off at all servers and clients of /add" in await process.stderr.readline()
    process.send_signal(signal.SIGINT)
    assert (await tool.end(process)).code == 0


def test_messages_are_shown_as_rclpy_shows_them() -> None:
    assert rclpy_repr(UInt8MultiArray(data=np.arange(3, dtype=np.uint8)), None) == (
        "std_msgs.msg.UInt8MultiArray(layout=std_msgs.msg.MultiArrayLayout(dim=[], data_offset=0), data=[0, 1, 2])"
    )
    assert rclpy_repr(UInt8MultiArray(data=np.zeros(200, np.uint8)), 2).endswith("data=[0, 0, ...])")
    assert rclpy_repr(TransformStamped(child_frame_id="a" * 5), 3).count("child_frame_id='aaa'...") == 1
    assert rclpy_repr(Polygon(), 3) == "geometry_msgs.msg.Polygon(points=[])"
