"""``rosidl-py node`` and ``rosidl-py lifecycle`` with nodes of the test."""

from __future__ import annotations

import asyncio
import json
import re
from typing import TYPE_CHECKING

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support.inner_state import participant_of, scope_of

from rosidl_py_gen import type_name
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.msgs.lifecycle_msgs.srv import GetState
from rosidl_py_gen.runtime import LifecycleNode, State, TransitionCallbackReturn
from rosidl_py_gen.runtime.qos import DEFAULT
from rosidl_py_gen.runtime.transport.api import EndpointSpec, ServiceSpec, TopicKey

if TYPE_CHECKING:
    from pathlib import Path

    from support.commands import Tool
    from support.worlds import World


async def test_node_list_omits_hidden_nodes_and_warns_of_duplicates(memory: World, tool: Tool) -> None:
    memory.node("talker", "/left"), memory.node("_secret"), memory.node("twin"), memory.node("twin")
    plain, count, every = await asyncio.gather(
        *(tool("node", "list", *words, "--spin-time", "1.5") for words in ([], ["-c"], ["-a", "--json"]))
    )
    assert plain.out == "/left/talker\n/twin\n/twin\n"
    assert plain.err == "several nodes have one name, so their services are mixed up: /twin\n"
    assert (count.code, count.out) == (0, "3\n")
    assert "/_secret" in [one["name"] for one in json.loads(every.out)]


@pytest.mark.slow
async def test_node_info_lists_all_entities_of_node(network: World, tool: Tool) -> None:
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


@pytest.mark.needs("mcap")
async def test_invalid_names_of_peers_do_not_hide_valid_ones(memory: World, tool: Tool, tmp_path: Path) -> None:
    participant = participant_of(robot := memory.node("good"))
    robot.create_publisher(String, "chatter")
    kinds = "GetParameters", "SetParameters", "ListParameters", "DescribeParameters", "GetParameterTypes"
    for namespace, name in (("/", ""), ("/n s", "a\x1b[31m"), ("/b//c", "1")):
        scope_of(robot).discovery.add_node(name, namespace)
        prefix = f"{namespace}/{name}"
        for kind in kinds:
            name = RosName("rcl_interfaces", "srv", kind)
            spec = ServiceSpec(f"{prefix}/{name.module_name[1:]}", str(name), "", "", "", DEFAULT)
            participant.create_server(spec)
        participant.create_writer(EndpointSpec(TopicKey("topic", f"{prefix}/x"), type_name(String), DEFAULT, "", 1))
    participant.create_writer(EndpointSpec(TopicKey("topic", "/typeless"), "no::ROS type", DEFAULT, "", 1))
    scope_of(robot).discovery.publish()
    for words, expected_text in (
        (["node", "list"], "/good"),
        (["service", "list"], "/good/get_parameters"),
        (["param", "list"], "/good"),
        (["graph", "--format", "json"], '"/good"'),
        (["topic", "list"], "/chatter"),
        (["bag", "record", "-a", "-o", str(tmp_path / "bag"), "--duration", "1"], "recording /chatter"),
    ):
        ended = await tool(*words)
        assert ended.code == 0 and expected_text in ended.out + ended.err, (words, ended)
    assert ended.err.count("skipped a topic: ") == 4


class Camera(LifecycleNode):
    """Configures, but never activates."""

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.FAILURE


@pytest.mark.slow
async def test_lifecycle_commands_change_and_print_states(network: World, tool: Tool) -> None:
    async with Camera("camera", context=network.context()):
        assert (await tool("lifecycle", "get", "/camera")).out == "unconfigured [1]\n"
        assert (await tool("lifecycle", "set", "/camera", "configure")).out == "Transitioning successful\n"
        state, possible, failed = await asyncio.gather(
            tool("lifecycle", "get", "camera", "--json"),
            tool("lifecycle", "list", "/camera"),
            tool("lifecycle", "set", "/camera", "3"),
        )
        assert json.loads(state.out) == {"id": 2, "label": "inactive"}
        assert "- activate [3]\n    Start: inactive\n    Goal: activating\n" in possible.out
        assert (failed.code, failed.err) == (1, "error: Transitioning failed\n")


async def test_lifecycle_errors_name_the_reason(memory: World, tool: Tool) -> None:
    memory.node("plain")
    async with Camera("camera", context=memory.context()):
        unknown, plain, missing, every = await asyncio.gather(
            tool("lifecycle", "set", "/camera", "activate"),
            tool("lifecycle", "get", "/plain"),
            tool("lifecycle", "get", "/camer", "--timeout", "1"),
            tool("lifecycle", "list", "/camera", "-a", "--json"),
        )
    assert "possible now: configure [1]" in unknown.err
    assert plain.err == "error: /plain is not a lifecycle node: it does not serve /plain/get_state\n"
    assert 'did you mean "/camera"?' in missing.err
    assert {unknown.code, plain.code, missing.code} == {1}
    assert len(json.loads(every.out)) > 20


async def test_lifecycle_get_waits_for_services_created_after_node(memory: World, tool: Tool) -> None:
    late, answer = memory.node("late"), GetState.Response()
    answer.current_state.id, answer.current_state.label = 2, "inactive"
    asyncio.get_running_loop().call_later(2, late.create_service, GetState, "/late/get_state", lambda _: answer)
    assert (await tool("lifecycle", "get", "/late")).out == "inactive [2]\n"


async def test_lifecycle_get_prints_states_of_all_nodes_despite_silent_one(memory: World, tool: Tool) -> None:
    silent = memory.node("silent")
    servers = [silent.create_service(GetState, "/silent/get_state"), silent.create_client(GetState, "/gone/get_state")]
    async with Camera("camera", context=memory.context()), Camera("_hidden", context=memory.context()):
        nodes, states = await asyncio.gather(
            tool("lifecycle", "nodes", "--spin-time", "1.25"),
            tool("lifecycle", "get", "--timeout", "1.25", "--spin-time", "1.25"),
        )
    assert nodes.out == "/camera\n/silent\n"
    assert (states.code, states.out) == (0, "/camera: unconfigured [1]\n")
    assert re.fullmatch("/silent: no response from /silent/get_state .*\n", states.err)
    assert servers
