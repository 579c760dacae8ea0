"""``rosidl-py node`` beside nodes of the test's own."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING

from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import Trigger

from rosidl_py_gen.base.names import snake_case
from rosidl_py_gen.runtime.qos import DEFAULT
from rosidl_py_gen.runtime.transport.api import EndpointSpec, NodeEntities, TopicKey
from rosidl_py_gen.runtime.transport.service_api import ServiceSpec

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool
    from support.node_fixtures import World


async def test_list_shows_names_and_leaves_hidden_ones_out(memory: World, tool: Tool) -> None:
    memory.node("talker", "/left"), memory.node("_secret"), memory.node("twin"), memory.node("twin")
    plain, count, every = await asyncio.gather(
        *(tool("node", "list", *words, "--spin-time", "1.5") for words in ([], ["-c"], ["-a", "--json"]))
    )
    assert plain.out == "/left/talker\n/twin\n/twin\n"
    assert plain.err == "several nodes have one name, so their services are mixed up: /twin\n"
    assert (count.code, count.out) == (0, "3\n")
    assert "/_secret" in [one["name"] for one in json.loads(every.out)]


async def test_info_shows_what_a_node_has(network: World, tool: Tool) -> None:
    node = network.node("busy", start_services=False, enable_rosout=False, parameter_events=False)
    node.create_publisher(String, "out")
    node.create_subscription(String, "in")
    node.create_service(Trigger, "trigger")
    node.create_client(Trigger, "other")
    node.create_action_server(Fibonacci, "count", lambda goal: None)
    node.create_action_client(Fibonacci, "ask")
    plain, as_json = await asyncio.gather(
        *(tool("node", "info", *words, "--spin-time", "3") for words in (["busy"], ["/busy", "--json", "-a"]))
    )
    type_services = "/busy/get_type_description: type_description_interfaces/srv/GetTypeDescription"
    assert [line for line in plain.out.splitlines() if type_services not in line] == [
        *("/busy", "  Subscribers:", "    /in: std_msgs/msg/String", "  Publishers:", "    /out: std_msgs/msg/String"),
        *("  Service Servers:", "    /trigger: std_srvs/srv/Trigger"),
        *("  Service Clients:", "    /other: std_srvs/srv/Trigger"),
        *("  Action Servers:", "    /count: example_interfaces/action/Fibonacci"),
        *("  Action Clients:", "    /ask: example_interfaces/action/Fibonacci"),
    ]
    found = json.loads(as_json.out)
    assert "/count/_action/status" in found["publishers"]
    assert found["action_clients"] == {"/ask": ["example_interfaces/action/Fibonacci"]}


async def test_an_unknown_node_is_an_error_that_names_another(memory: World, tool: Tool) -> None:
    memory.node("talker")
    ended = await tool("node", "info", "/tolker", "--spin-time", "1")
    assert (ended.code, ended.out) == (1, "")
    assert 'did you mean "/talker"?' in ended.err


async def test_names_that_ros_refuses_hide_no_others(memory: World, tool: Tool, tmp_path: Path) -> None:
    participant = (robot := memory.node("good"))._scope.participant
    robot.create_publisher(String, "chatter")
    kinds = "GetParameters", "SetParameters", "ListParameters", "DescribeParameters", "GetParameterTypes"
    for number, (namespace, name) in enumerate((("/", ""), ("/n s", "a\x1b[31m"), ("/b//c", "1")), 1000):
        robot._scope.discovery._nodes[number] = NodeEntities(namespace, name, frozenset(), frozenset())
        for kind in kinds:
            told = ServiceSpec(
                f"{namespace}/{name}/{snake_case(kind)}", f"rcl_interfaces/srv/{kind}", "", "", "", False, any
            )
            participant.create_server(told, DEFAULT)
        participant.create_writer(
            EndpointSpec(TopicKey("topic", f"{namespace}/{name}/x"), String._TYPE.name, DEFAULT, "", 1)
        )
    participant.create_writer(EndpointSpec(TopicKey("topic", "/typeless"), "no::ROS type", DEFAULT, "", 1))
    robot._scope.discovery.publish()
    for words, wanted in (
        (["node", "list"], "/good"),
        (["service", "list"], "/good/get_parameters"),
        (["param", "list"], "/good"),
        (["graph", "--format", "json"], '"/good"'),
        (["topic", "list"], "/chatter"),
        (["bag", "record", "-a", "-o", str(tmp_path / "bag"), "--duration", "1"], "recording /chatter"),
    ):
        ended = await tool(*words)
        assert ended.code == 0 and wanted in ended.out + ended.err, (words, ended)
    assert ended.err.count("skipped a topic: ") == 4
