"""``rosidl-py`` and ``rosidl-py-gen diff`` with rclpy nodes whose types the commands know only from these nodes."""

from __future__ import annotations

import asyncio
import json
import shutil
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from peer_helpers import fresh, without_definitions
from rclpy_peer import Peer
from support.folders import ROOT
from support.processes import WAITS, start_process
from support.waiting import until

from rosidl_py_gen.bags import BagReader

if TYPE_CHECKING:
    from pathlib import Path


STRINGS, BASIC, FIBONACCI = "test_msgs/msg/Strings", "test_msgs/srv/BasicTypes", "test_msgs/action/Fibonacci"
WITHIN_S = 40
WITH_TIMEOUT = "--timeout", "20"


@dataclass(frozen=True)
class Ended:
    code: int
    out: str
    err: str


class Tool:
    """Runs ``rosidl-py`` in processes, because a class that a test has compiled is available to all tests in it."""

    def __init__(self, cache: Path, peer: Peer) -> None:
        self._environment = without_definitions(cache)
        if peer.distro == "humble":  # whose nodes do not describe types
            self._environment |= {"AMENT_PREFIX_PATH": str(peer.share.parent), "ROS_DISTRO": "humble"}

    async def start(self, *words: str) -> asyncio.subprocess.Process:
        command = (sys.executable, "-m", "rosidl_py_gen.ros_cli", *words)
        pipe = asyncio.subprocess.PIPE
        return await start_process(*command, env=self._environment, stdout=pipe, stderr=pipe)

    async def end(self, process: asyncio.subprocess.Process) -> Ended:
        try:
            out, err = await asyncio.wait_for(process.communicate(), WITHIN_S)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        assert process.returncode is not None
        return Ended(process.returncode, out.decode(), WAITS.sub("", err.decode()))

    async def __call__(self, *words: str) -> str:
        """Return the output of a command that succeeds."""
        ended = await self.end(await self.start(*words))
        assert (ended.code, ended.err) == (0, ""), ended
        return ended.out


def count_of(bag: str) -> int:
    with BagReader(bag) as reader:
        return sum(topic.count or 0 for topic in reader.topics.values())


@pytest.fixture
def tool(tmp_path: Path, shared_peer: Peer) -> Tool:
    return Tool(tmp_path / "cache", shared_peer)


@pytest.fixture
def share(shared_peer: Peer) -> str:
    """Return the folder of the peer's definitions; rclpy describes types of services and actions only by hash."""
    return str(shared_peer.share)


@dataclass(frozen=True)
class Overview:
    """Entities of a peer, and the output of commands that wait for a fixed time, which all run at once."""

    topic: str
    service: str
    action: str
    node: str
    managed: str
    outputs: dict[str, str]


_overviews: dict[Peer, Overview] = {}


async def overview_of(peer: Peer, tool: Tool) -> Overview:
    if peer not in _overviews:
        topic, service, action, node, managed = map(fresh, ("words", "answers", "counts", "holder", "managed"))
        await peer.do("publisher", topic=topic, type=STRINGS)
        await peer.do("serve", name=service, type=BASIC, how="echo")
        await peer.do("action_server", name=action, type=FIBONACCI, how="succeed")
        await peer.do("add_node", name=node.strip("/"))
        await peer.do("lifecycle_node", name=managed.strip("/"))
        lists = ("topic list -t", "service list -t", "action list -t", "node list", "lifecycle nodes", "param list")
        about = (f"action info {action}", f"node info /{peer.name} --json", f"graph --json --node {peer.name}")
        words = (*lists, "lifecycle get", *about, "doctor --json")
        answers = await asyncio.gather(*(tool(*one.split(), "--spin-time", "10") for one in words))
        outputs = {" ".join(one.split()[:2]): answer for one, answer in zip(words, answers, strict=True)}
        _overviews[peer] = Overview(topic, service, action, node, managed, outputs)
    return _overviews[peer]


async def test_list_commands_print_entities_of_rclpy_peer(shared_peer: Peer, tool: Tool) -> None:
    overview = await overview_of(shared_peer, tool)
    expected = {
        "topic list": f"{overview.topic} [{STRINGS}]",
        "service list": f"{overview.service} [{BASIC}]",
        "action list": f"{overview.action} [{FIBONACCI}]",
        "node list": overview.node,
        "lifecycle nodes": overview.managed,
        "param list": f"{overview.node}:",
        "lifecycle get": f"{overview.managed}: unconfigured [1]",
    }
    for words, one in expected.items():
        assert one in overview.outputs[words].splitlines()


async def test_info_commands_describe_action_and_node_of_rclpy_peer(shared_peer: Peer, tool: Tool) -> None:
    overview = await overview_of(shared_peer, tool)
    action = overview.action
    of_action = f"Action: {action}\nAction clients: 0\nAction servers: 1\n    /{shared_peer.name}\n"
    assert overview.outputs["action info"] == of_action
    found = json.loads(overview.outputs["node info"])
    assert (found["publishers"][overview.topic], found["service_servers"][overview.service]) == ([STRINGS], [BASIC])
    assert found["action_servers"][action] == [FIBONACCI]


async def test_info_commands_describe_topic_and_service_of_rclpy_peer(shared_peer: Peer, tool: Tool) -> None:
    topic, service = map(fresh, ("words", "answers"))
    await shared_peer.do("publisher", topic=topic, type=STRINGS)
    await shared_peer.do("serve", name=service, type=BASIC, how="echo")
    of_topic, of_service = await asyncio.gather(tool("topic", "info", topic), tool("service", "info", service))
    assert of_topic.startswith(f"Type: {STRINGS}\n")
    assert of_service == f"Type: {BASIC}\nClients count: 0\nServices count: 1\n"


async def test_graph_and_doctor_report_rclpy_peer_with_its_middleware(shared_peer: Peer, tool: Tool) -> None:
    overview = await overview_of(shared_peer, tool)
    (node,) = json.loads(overview.outputs["graph --json"])["nodes"]
    shown = {(row["kind"], row["name"], *row["types"]) for role in ("publishes", "serves") for row in node[role]}
    expected_entities = {
        ("topic", overview.topic, STRINGS),
        ("service", overview.service, BASIC),
        ("action", overview.action, FIBONACCI),
    }
    assert expected_entities <= shown
    assert not any("parameter" in name for _, name, *_ in shown)
    texts = [row["text"] for row in json.loads(overview.outputs["doctor --json"])["peers"]]
    kind = "ROS Humble or earlier (no type hashes)" if shared_peer.distro == "humble" else "ROS Iron or later"
    (peers,) = [text for text in texts if text.startswith(f"{shared_peer.middleware}, {kind}: ")]
    assert f"/{shared_peer.name}" in peers
    assert any("a message went there and back" in text for text in texts)


async def test_service_call_command_calls_rclpy_server(shared_peer: Peer, tool: Tool, share: str) -> None:
    name = fresh("answers")
    await shared_peer.do("serve", name=name, type=BASIC, how="echo")
    values = "{int32_value: -5, string_value: grüße}"
    answer = json.loads(await tool("service", "call", name, values, "--json", "--path", share))
    assert (answer["int32_value"], answer["string_value"]) == (-5, "grüße")
    shown = await tool("service", "call", name, BASIC, "{bool_value: true}", "--path", share)
    assert "response:\ntest_msgs.srv.BasicTypes_Response(bool_value=True, byte_value=0," in shown


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_service_echo_prints_events_of_unknown_type(shared_peer: Peer, tool: Tool) -> None:
    name = fresh("answers")
    await shared_peer.do("serve", name=name, type=BASIC, how="echo")
    await shared_peer.do("introspect", kind="service", name=name, state="CONTENTS")
    await shared_peer.do("client", name=name, type=BASIC)
    process = await tool.start("service", "echo", name, "--once", "--json")  # its hash is announced with its events
    while process.returncode is None:
        await asyncio.sleep(0.2)
        await shared_peer.do("call", name=name, requests_=[{"int32_value": 7}])
    ended = await tool.end(process)
    assert ended.code == 0, ended.err
    event = json.loads(ended.out)
    # The command may discover the topic between the two events of a call.
    parts = {"REQUEST_RECEIVED": event["request"], "RESPONSE_SENT": event["response"]}
    assert [one["int32_value"] for one in parts[event["info"]["event_type"]]] == [7]


async def test_param_commands_read_and_set_parameters_of_rclpy_node(shared_peer: Peer, tool: Tool) -> None:
    name = fresh("holder").strip("/")
    await shared_peer.do("add_node", name=name)
    await shared_peer.do("declare", node=name, parameters={"speed": 1.5, "arm.names": ["a", "ü"], "count": 3})
    listed, got, done, described, wrong = await asyncio.gather(
        tool("param", "list", f"/{name}", "--param-type", *WITH_TIMEOUT),
        tool("param", "get", f"/{name}", "arm.names", *WITH_TIMEOUT),
        tool("param", "set", f"/{name}", "speed", "2.5", *WITH_TIMEOUT),
        tool("param", "describe", f"/{name}", "count", *WITH_TIMEOUT),
        tool.end(await tool.start("param", "set", f"/{name}", "speed", "fast", *WITH_TIMEOUT)),
    )
    assert "  arm.names (type: string array)\n" in listed
    assert (got, done) == ("String values are: ['a', 'ü']\n", "Set parameter successful\n")
    assert (wrong.code, "  Type: integer\n" in described) == (1, True)
    assert wrong.err.startswith("error: Setting parameter failed: ")
    assert await shared_peer.do("parameters", node=name, names=["speed"]) == [2.5]


async def test_param_commands_dump_and_load_parameters_of_rclpy_node(
    shared_peer: Peer, tool: Tool, tmp_path: Path
) -> None:
    name = fresh("holder").strip("/")
    await shared_peer.do("add_node", name=name)
    await shared_peer.do("declare", node=name, parameters={"speed": 1.5, "arm.names": ["a", "ü"], "count": 3})
    dumped = yaml.safe_load(await tool("param", "dump", f"/{name}", *WITH_TIMEOUT))[f"/{name}"]["ros__parameters"]
    assert (dumped["speed"], dumped["arm"], dumped["count"]) == (1.5, {"names": ["a", "ü"]}, 3)
    file = tmp_path / "holder.yaml"
    file.write_text(f"/{name}:\n  ros__parameters: {{count: 4}}\n")
    assert await tool("param", "load", f"/{name}", str(file), *WITH_TIMEOUT) == "Set parameter count successful\n"
    assert await shared_peer.do("parameters", node=name, names=["count"]) == [4]


async def test_send_goal_command_prints_feedback_and_result_of_rclpy_server(
    shared_peer: Peer, tool: Tool, share: str
) -> None:
    name, steps = fresh("fibonacci"), [{"sequence": [0]}, {"sequence": [0, 1]}]
    done = {"sequence": [0, 1, 1]}
    await shared_peer.do("action_server", name=name, type=FIBONACCI, how="succeed", feedback=steps, result=done)
    out = await tool("action", "send_goal", name, "{order: 2}", "--feedback", "--json", "--path", share)
    *feedback, end = map(json.loads, out.splitlines())
    assert [one["feedback"] for one in feedback] == steps
    assert (end["status"], end["result"]) == ("SUCCEEDED", done)


async def test_ctrl_c_cancels_goal_of_rclpy_server(shared_peer: Peer, tool: Tool, share: str) -> None:
    name = fresh("fibonacci")
    await shared_peer.do("action_server", name=name, type=FIBONACCI, how="cancel", result={"sequence": [9]})
    process = await tool.start("action", "send_goal", name, "{order: 2}", "--path", share)
    assert process.stdout is not None
    while b"accepted" not in await asyncio.wait_for(process.stdout.readline(), WITHIN_S):
        pass
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.code, ended.out.splitlines()[-1]) == (130, "Goal finished with status: CANCELED")


async def test_lifecycle_commands_change_state_of_rclpy_node(shared_peer: Peer, tool: Tool) -> None:
    name = fresh("managed")
    await shared_peer.do("lifecycle_node", name=name.strip("/"))
    assert await tool("lifecycle", "set", name, "configure", *WITH_TIMEOUT) == "Transitioning successful\n"
    state, possible = await asyncio.gather(
        tool("lifecycle", "get", name, *WITH_TIMEOUT), tool("lifecycle", "list", name, *WITH_TIMEOUT)
    )
    assert (state, "- activate [3]\n" in possible) == ("inactive [2]\n", True)


async def test_topic_echo_prints_unknown_type_of_rclpy_publisher(shared_peer: Peer, tool: Tool) -> None:
    topic = fresh("words")
    await shared_peer.do("publisher", topic=topic, type=STRINGS)
    process = await tool.start("topic", "echo", topic, "--once", "--json")
    message: dict[str, Any] = {"string_value": "grüße"}
    while process.returncode is None:
        await shared_peer.do("publish", topic=topic, messages_=[message])
        await asyncio.sleep(0.2)
    ended = await tool.end(process)
    assert json.loads(ended.out)["string_value"] == "grüße"


async def test_topic_pub_reaches_rclpy_and_topic_hz_measures_rclpy_publisher(shared_peer: Peer, tool: Tool) -> None:
    received, published = fresh("received"), fresh("published")
    await shared_peer.do("subscribe", topic=received, type=STRINGS)
    await shared_peer.do("publisher", topic=published, type=STRINGS)
    await tool("topic", "pub", received, "string_value: grüße", "--times", "2", "--rate", "20")
    taken = await shared_peer.do("take", topic=received, count=2)
    assert [one["string_value"] for one in taken] == ["grüße", "grüße"]
    process = await tool.start("topic", "hz", published, "--times", "1", "--json")
    while process.returncode is None:
        await shared_peer.do("publish", topic=published, messages_=[{}])
        await asyncio.sleep(0.05)
    report = json.loads((await tool.end(process)).out)
    assert (report["topic"], report["window"] > 1) == (published, True)


async def test_topic_of_unknown_type_is_recorded_from_and_played_to_rclpy(
    shared_peer: Peer, tool: Tool, tmp_path: Path
) -> None:
    published, received, bag = fresh("published"), fresh("received"), str(tmp_path / "bag")
    await shared_peer.do("publisher", topic=published, type=STRINGS)
    process = await tool.start("bag", "record", published, "-o", bag)
    assert process.stderr is not None
    while (
        line := await asyncio.wait_for(process.stderr.readline(), WITHIN_S)
    ) != f"recording {published} [{STRINGS}]\n".encode():
        assert line.startswith(b"no publisher of")  # as far as this process knows yet
    await shared_peer.do("matched", topic=published)
    for number in range(5):
        await shared_peer.do("publish", topic=published, messages_=[{"string_value": f"grüße {number}"}])
    await until(lambda: count_of(bag) == 5, WITHIN_S)  # flushed once a second
    process.send_signal(signal.SIGTERM)
    assert (await tool.end(process)).code == 0
    (topic,) = json.loads(await tool("bag", "info", bag, "--json"))["topics"]
    assert (topic["type"], topic["count"], topic["has_definition"]) == (STRINGS, 5, True)
    await shared_peer.do("subscribe", topic=received, type=STRINGS)
    played = await tool.end(await tool.start("bag", "play", bag, "--remap", f"{published}:={received}"))
    assert (played.code, played.err) == (0, "published 5 messages of 1 topic\n")
    taken = await shared_peer.do("take", topic=received, count=5)
    assert [one["string_value"] for one in taken] == [f"grüße {number}" for number in range(5)]


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_service_and_action_events_of_rclpy_are_recorded(
    shared_peer: Peer, distro: str, tool: Tool, tmp_path: Path
) -> None:
    service, action, bag = fresh("asked"), fresh("counted"), tmp_path / "bag"
    await shared_peer.do("serve", name=service, type=BASIC, how="echo")
    await shared_peer.do("client", name=service, type=BASIC)
    await shared_peer.do("action_server", name=action, type=FIBONACCI, how="succeed", feedback=[{"sequence": [7]}])
    await shared_peer.do("action_client", name=action, type=FIBONACCI)
    introspected = [("service", service), ("client", service)]
    expected = {f"{service}/_service_event": f"{BASIC}_Event"}
    expected |= {
        f"{action}/_action/feedback": f"{FIBONACCI}_FeedbackMessage",
        f"{action}/_action/status": "action_msgs/msg/GoalStatusArray",
    }
    if distro == "kilted":
        introspected += [("action server", action), ("action client", action)]
        for part, kind in (("send_goal", f"{FIBONACCI}_SendGoal"), ("get_result", f"{FIBONACCI}_GetResult")):
            expected[f"{action}/_action/{part}/_service_event"] = f"{kind}_Event"
        expected[f"{action}/_action/cancel_goal/_service_event"] = "action_msgs/srv/CancelGoal_Event"
    for kind, name in introspected:
        await shared_peer.do("introspect", kind=kind, name=name, state="CONTENTS")
    options = ("--services", service, "--actions", action, "-o", str(bag), "--max-cache-size", "0")
    process = await tool.start("bag", "record", *options)
    assert process.stderr is not None
    pending, lines = {f"recording {name} [{kind}]" for name, kind in expected.items()}, []
    while pending:
        lines.append((await asyncio.wait_for(process.stderr.readline(), WITHIN_S)).decode())
        assert lines[-1], (pending, lines, await tool.end(process))
        pending.discard(lines[-1].strip())
    for topic in expected:
        listeners = 1 if topic.endswith("_event") else 2  # their client of the action, too
        await shared_peer.do("until_subscribed", topic=topic, count=listeners)
    await shared_peer.do("call", name=service, requests_=[{"int32_value": 5}])
    assert await shared_peer.do("send_goal", name=action, key=action, goal={"order": 3})
    await shared_peer.do("result", key=action)
    least = 4 + 1 + 3 + (8 if distro == "kilted" else 0)  # accepted, executing, succeeded; two calls of the client
    await until(lambda: count_of(str(bag)) >= least, WITHIN_S)
    process.send_signal(signal.SIGTERM)
    ended = await tool.end(process)
    assert ended.code == 0, ended.err
    with BagReader(bag) as reader:
        assert {one.name: one.type_name for one in reader.channels} == expected
        assert all(one.type_hash for one in reader.channels)
        events = [one.message for one in reader.messages(f"{service}/_service_event")]
        assert sorted(one.info.event_type for one in events) == [0, 1, 2, 3]
        assert {one.request[0].int32_value for one in events if one.request} == {5}
        assert {one.name: one.count for one in reader.channels}[f"{action}/_action/feedback"] == 1
        if distro == "kilted":  # which tells of goal and result, so that the action is known
            (feedback,) = [one.message for one in reader.messages(f"{action}/_action/feedback")]
            assert [*feedback.feedback.sequence] == [7]
            goals = [one.message for one in reader.messages(f"{action}/_action/send_goal/_service_event")]
            assert {one.request[0].goal.order for one in goals if one.request} == {3}


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_diff_compares_rclpy_node_with_workspace(shared_peer: Peer, tmp_path: Path) -> None:
    topic = fresh("compared")
    await shared_peer.do("publisher", topic=topic, type="test_msgs/msg/BasicTypes")
    for kind in ("msg", "srv", "action"):
        shutil.copytree(ROOT / "tests/interfaces/test_msgs" / kind, tmp_path / "test_msgs" / kind)
    changed = tmp_path / "test_msgs/msg/BasicTypes.msg"
    changed.write_text(changed.read_text().replace("int16 int16_value", "uint16 int16_value") + "int8 more\n")
    options = (f"/{shared_peer.name}", str(tmp_path), "--json", "--timeout", "15")
    command = (sys.executable, "-m", "rosidl_py_gen.generator_cli", "diff", *options)
    pipe = asyncio.subprocess.PIPE
    process = await start_process(*command, env=without_definitions(tmp_path / "cache"), stdout=pipe, stderr=pipe)
    out, err = await asyncio.wait_for(process.communicate(), 80)
    assert process.returncode == 1, err
    differences = json.loads(out)
    (change,) = [type_ for type_ in differences["changed"] if type_["name"] == "test_msgs/msg/BasicTypes"]
    message = change["messages"][0]
    assert [(one["what"], one["name"]) for one in message["fields"]] == [("type", "int16_value"), ("added", "more")]
    assert message["reads_old_data"] is False and message["constants"] == []
    assert differences["removed"] == []
