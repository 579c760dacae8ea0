"""``rosidl-py topic`` beside a node of the test: list, info, type, find, pub, hz, bw, delay."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import time
from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import WAITS, take, until

from rosidl_py_gen import get_message
from rosidl_py_gen.base.terminal_text import json_text
from rosidl_py_gen.ros_cli import type_resolution
from rosidl_py_gen.ros_cli.topic.statistics import RateStatistics
from rosidl_py_gen.runtime import Node

if TYPE_CHECKING:
    from support.node_fixtures import World

STRING, BOOL, POSE = "std_msgs/msg/String", "std_msgs/msg/Bool", "geometry_msgs/msg/PoseStamped"


@pytest.fixture
def node(dds: World) -> Node:
    """Node without topics that `topic list` would show."""
    return dds.node("talker", "/demo", enable_rosout=False, parameter_events=False)


def test_list_and_find_show_topics_as_ros2_does(topic_peer: tuple[str, str], run_here: Any) -> None:
    def listed(*words: str) -> str:
        return str(run_here("topic", *words, *topic_peer)[1])

    assert listed("list").split() == ["/demo/pose", "/demo/scan", "/demo/switch", "/demo/words"]
    assert listed("list", "-t").splitlines()[3] == "/demo/words [std_msgs/msg/String]"
    assert listed("list", "-v") == (
        "Published topics:\n"
        " * /demo/pose [geometry_msgs/msg/PoseStamped] 1 publisher\n"
        " * /demo/scan [sensor_msgs/msg/LaserScan] 1 publisher\n"
        " * /demo/words [std_msgs/msg/String] 1 publisher\n\n"
        "Subscribed topics:\n"
        " * /demo/switch [std_msgs/msg/Bool] 1 subscriber\n"
        " * /demo/words [std_msgs/msg/String] 1 subscriber\n\n"
    )
    assert listed("list", "-c") == "4\n"
    assert listed("list", "-a").split()[:2] == ["/demo/_imu", "/demo/_poses"]
    assert listed("find", "std_msgs/String") == "/demo/words\n"
    expected = {"name": "/demo/words", "types": [STRING], "publishers": 1, "subscribers": 1}
    assert json.loads(listed("list", "--json"))[3] == expected


def test_info_describes_each_end_as_rclpy_does(topic_peer: tuple[str, str], run_here: Any) -> None:
    def said(*words: str) -> str:
        return str(run_here("topic", *words, *topic_peer)[1])

    assert said("type", "/demo/words") == "std_msgs/msg/String\n"
    assert said("info", "/demo/words") == "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 1\n"
    verbose = re.sub(r"GID: ([0-9a-f]{2}\.){15}[0-9a-f]{2}\n", "GID: ...\n", said("info", "-v", "demo/words"))
    assert verbose.startswith(
        "Type: std_msgs/msg/String\n\nPublisher count: 1\n\nNode name: talker\nNode namespace: /demo\n"
        f"Topic type: std_msgs/msg/String\nTopic type hash: {get_message(STRING)._TYPE.hash}\n"
        "Endpoint type: PUBLISHER\nGID: ...\nQoS profile:\n  Reliability: RELIABLE\n  History (Depth): KEEP_LAST (7)\n"
        "  Durability: VOLATILE\n  Lifespan: Infinite\n  Deadline: Infinite\n  Liveliness: AUTOMATIC\n"
        "  Liveliness lease duration: Infinite\n\nSubscription count: 1\n\nNode name: talker\n"
    )
    assert json.loads(said("info", "--json", "/demo/words"))["publishers"][0]["qos"]["depth"] == 7


def test_an_unknown_topic_is_named_with_the_one_that_was_meant(topic_peer: tuple[str, str], run_here: Any) -> None:
    code, _, error = run_here("topic", "type", "/demo/wrods", "--timeout", "3", *topic_peer)
    assert code == 1
    expected = f'error: no topic /demo/wrods was found in domain {topic_peer[1]}; did you mean "/demo/words"?\n'
    assert error.splitlines(keepends=True)[-1] == expected


async def test_pub_sends_what_the_command_line_says_to_whoever_listens(network: World, tool: Any) -> None:
    node = network.node("robot", enable_rosout=False, parameter_events=False)
    words, poses = node.create_subscription(STRING, "/words"), node.create_subscription(POSE, "/poses")
    once, timed, stamped = await asyncio.gather(
        tool("topic", "pub", "/words", "data: hello", "--once"),
        tool("topic", "pub", "/words", "std_msgs/String", '{"data": "x"}', "-t", "3", "-r", "50", "--json"),
        tool("topic", "pub", "/poses", POSE, "{header: auto, pose: {position: {x: 1}}}", "--once"),
    )
    assert (once.code, timed.code, stamped.code) == (0, 0, 0), (once, timed, stamped)
    assert once.out == "publisher: beginning loop\npublishing #1: std_msgs.msg.String(data='hello')\n\n"
    assert json.loads(timed.out.splitlines()[2]) == {"number": 3, "message": {"data": "x"}}
    assert sorted([(await take(words))["data"] for _ in range(4)]) == ["hello", "x", "x", "x"]
    pose = await take(poses)
    assert pose["pose"]["position"]["x"] == 1.0
    assert abs(pose["header"]["stamp"]["sec"] - time.time()) < 30


async def test_pub_takes_documents_from_standard_input_as_echo_prints_them(node: Node, tool: Any) -> None:
    words = node.create_subscription(STRING, "/words")
    text = 'data: one\n---\n\n{"data": "two"}\n{"data": "three"}\ndata: |\n  four\n  lines\n---\n'
    done = await tool("topic", "pub", "/words", "-", stdin=text)
    assert (done.code, done.err) == (0, "")
    assert [(await take(words))["data"] for _ in range(4)] == ["one", "two", "three", "four\nlines\n"]


async def test_pub_goes_on_until_it_is_interrupted(node: Node, tool: Any) -> None:
    words = node.create_subscription(STRING, "/words")
    endless = await tool.start("topic", "pub", "/words", "data: again", "-r", "100", "-p", "0")
    waiting = await tool.start("topic", "pub", "/other", STRING, "--once")
    reading = await tool.start("topic", "pub", "/words", "-")
    await until(lambda: len(node.get_publishers_info_by_topic("/words")) == 2, 25)
    assert [(await take(words))["data"] for _ in range(3)] == ["again"] * 3
    assert await waiting.stderr.readline() == b"Waiting for at least 1 matching subscription(s) on /other...\n"
    for process in (endless, waiting, reading):
        process.send_signal(signal.SIGINT)
    ends = await asyncio.gather(*map(tool.end, (endless, waiting, reading)))
    assert [(end.code, end.err) for end in (ends[0], ends[2])] == [(0, ""), (130, "")]
    assert ends[1].code == 130


@pytest.mark.parametrize(
    ("words", "stdin", "reason"),
    [
        (["/words", STRING, "dta: 1"], "", 'std_msgs/msg/String: unknown field "dta"; did you mean "data"?'),
        (["/words", STRING, "data: [1"], "", "not YAML: 2:1: did not find expected"),
        (["/words", STRING, "hello"], "", "String takes a mapping such as '{data: ...}', got 'hello'"),
        (["/words", "no_pkg/msg/Nothing", "{}"], "", "no_pkg/msg/Nothing"),
        (["/words", STRING, "data:", "hello"], "", "expected values in one word"),
        (
            ["/words", STRING, "-", "-w", "0"],
            "{data: a}\n{dta: b}\n",
            "document 2 of standard input: std_msgs/msg/String: unknown",
        ),
        (["/words", STRING, "-", "-w", "0"], "\udcff", "standard input is not UTF-8"),
        (
            ["/words", STRING, "--once", "--timeout", "0.2"],
            "",
            "0 subscriptions on /words in 0.2 s, expected at least 1",
        ),
        (["/words", "--timeout", "0.2"], "", "no topic /words was found"),
        (["/wo rds", STRING], "", "/wo rds"),
        (["/words", STRING, "--qos-durability", "transient_local", "--qos-depth", "9999999999"], "", "depth must be"),
    ],
)
def test_pub_says_what_is_wrong(words: list[str], stdin: str, reason: str, run_here: Any) -> None:
    code, _, err = run_here("topic", "pub", *words, stdin=stdin)
    assert code == 1
    assert reason in err


def test_hz_and_bw_need_no_definition_and_delay_only_the_place_of_the_stamp(
    topic_peer: tuple[str, str], run_here: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def report(*words: str) -> str:
        return str(run_here("topic", *words, "-n", "1", *topic_peer)[1])

    spread = r"\n\tmin: (\d+\.\d{3})s max: (\d+\.\d{3})s std dev: \d+\.\d{5}s window: \d+\n"
    with monkeypatch.context() as patched:
        patched.setattr(type_resolution, "get_message", None)
        patched.setattr(Node, "resolve_type", None)
        rate, bandwidth = report("hz", "/demo/_poses"), report("bw", "/demo/_words")
        reports = (report("hz", "/demo/_poses", "/demo/_words") for _ in range(3))
        several = next(text for text in reports if text.count("\n") > 3)  # the peer may pause: one topic is left out
    assert (found := re.fullmatch(r"average rate: (\d+\.\d{3})" + spread, rate))
    assert 0.5 < float(found[1]) < 5000  # one who was held up receives many at once
    assert float(found[2]) - 0.001 <= 1 / float(found[1]) <= float(found[3]) + 0.001
    assert re.fullmatch(
        r"Subscribed to \[/demo/_poses\]\nSubscribed to \[/demo/_words\]\n(/demo/_\w+(\t\d+[.\d]*){5}\n){2}", several
    )
    sizes = r"\n\tMessage size mean: (1[01]\d B|0\.11 KB|0\.00 MB) min: \2 max: \2\n"
    per_s = r"(\d+ B|\d+\.\d\d KB|\d+\.\d\d MB)/s from \d+ messages"
    assert re.fullmatch(r"Subscribed to \[/demo/_words\]\n" + per_s + sizes, bandwidth)
    assert (late := re.fullmatch(r"average delay: (\d+\.\d{3})" + spread, report("delay", "/demo/_poses")))
    assert 2 <= float(late[1]) < 30  # what was held up, is later
    data = json.loads(report("hz", "/demo/_words", "--filter", "len(m.data) > 1", "--json"))
    assert (data["topic"], data["window"] > 0) == ("/demo/_words", True)
    code, _, error = run_here("topic", "delay", "/demo/words", *topic_peer)
    expected = "error: messages of /demo/words have no header with a stamp: std_msgs/msg/String\n"
    assert (code, WAITS.sub("", error)) == (1, expected)


def test_messages_received_together_have_no_rate_of_0() -> None:
    rate = RateStatistics(10)
    for received_ns in (5, 5, 5):
        rate.add(received_ns, 0)
    report = rate.report()
    assert report is not None
    assert rate.text(report).startswith("average rate: inf\n")
    assert json.loads(json_text(report))["rate"] == "Infinity"


async def test_measuring_ends_with_ctrl_c_and_says_when_nothing_comes(node: Node, tool: Any) -> None:
    node.create_publisher(STRING, "/silent")
    process = await tool.start("topic", "hz", "/silent")
    while (line := await asyncio.wait_for(process.stderr.readline(), 25)) != b"no new messages\n":
        assert WAITS.fullmatch(line.decode())
    process.send_signal(signal.SIGINT)
    assert (await tool.end(process)).code == 0
