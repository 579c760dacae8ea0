"""``rosidl-py topic echo`` beside a node of the test."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import WAITS, start_process, until

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from pathlib import Path

    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

LATCHED = QoSProfile().transient_local()
STRING = "std_msgs/msg/String"


@pytest.fixture
def node(dds: World) -> Node:
    return dds.node("talker", enable_rosout=False, parameter_events=False)


def test_messages_look_as_ros2_shows_them(topic_peer: tuple[str, str], run_here: Any) -> None:

    def once(*words: str) -> str:
        return str(run_here("topic", "echo", "--once", *words, *topic_peer)[1])

    long = once("/demo/scan")
    assert (long.count("\n- "), long.endswith("\n- 127.0\n- '...'\nintensities: []\n---\n")) == (129, True)
    assert once("/demo/scan", "-l", "2") == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: la...\nangle_min: 0.0\nangle_max: 0.0\n"
        "angle_increment: 0.0\ntime_increment: 0.0\nscan_time: 0.0\nrange_min: 0.0\nrange_max: .nan\nranges:\n- 0.0\n"
        "- 1.0\n- '...'\nintensities: []\n---\n"
    )
    csv = "0,0,<string length: 5>,0.0,0.0,0.0,0.0,0.0,0.0,nan,0.0,1.0,2.0,...\n"
    assert once("/demo/scan", "--csv", "-l", "3", "--no-str") == csv
    assert once("/demo/scan", "--field", "header") == "stamp:\n  sec: 0\n  nanosec: 0\nframe_id: laser\n---\n"
    assert once("/demo/scan", "--field", "ranges[5]") == "5.0\n---\n"
    assert once("/demo/pose", "--flow-style", "--field", "pose.position") == "{x: 1.5, y: 0.0, z: 0.0}\n---\n"
    data = once("/demo/scan", "--json")
    scan = json.loads(data)
    assert (len(scan["ranges"]), scan["range_max"], data.count("\n")) == (200, "NaN", 1)
    raw = once("/demo/pose", "--raw")
    assert (raw.startswith("b'\\x00\\x01\\x00\\x00"), raw.endswith("'\n---\n")) == (True, True)
    bare = once("/demo/_imu", "--no-arr", "--no-str")
    assert "orientation_covariance: '<array type: float64[9]>'\n" in bare
    assert "frame_id: '<string length: 0>'\n" in bare


def test_messages_the_filter_has_no_value_for_are_noted_once(topic_peer: tuple[str, str], run_here: Any) -> None:
    words = ("--once", "--filter", "m.ranges[0] > 1", "--field", "ranges")
    code, out, err = run_here("topic", "echo", "/demo/_scans", *words, *topic_peer)
    assert (code, out, WAITS.sub("", err)) == (0, "- 4.0\n---\n", "skipped a message: there is no element 0 among 0\n")


async def test_only_what_the_filter_lets_through_is_shown(network: World, tool: Any) -> None:
    node = network.node("robot", enable_rosout=False, parameter_events=False)
    publisher = node.create_publisher(STRING, "/words", LATCHED)
    for word in ("a", "needle 1", "b", "needle 2", "\x1b[31mneedle\t3\nnext line"):
        publisher.publish({"data": word})
    process = await tool.start("topic", "echo", "/words", "--field", "data", "--filter", "'needle' in m.data")
    for expected in (
        b"needle 1\n",
        b"---\n",
        b"needle 2\n",
        b"---\n",
        "\ufffd[31mneedle\t3\n".encode(),
        b"next line\n",
    ):
        assert await asyncio.wait_for(process.stdout.readline(), 25) == expected
    process.send_signal(signal.SIGINT)
    assert (await tool.end(process)).code == 0


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (
            ["/words", STRING, "--filter", "__import__('os').system('touch pwned')"],
            "is not allowed; there are abs, all",
        ),
        (["/words", STRING, "--filter", "m.dta"], 'has no field "dta"; did you mean "data"?'),
        (["/words", STRING, "--field", "data.x"], "m.data is string, which has no fields"),
        (["/words", "std_msgs/msg/Strin"], 'did you mean "std_msgs/msg/String"?'),
        (["/words", "--timeout", "0.2"], "no topic /words was found"),
        (["/words", STRING, "--once", "--timeout", "0.2"], "/words in 0.2 s: no other participant was found"),
        (["/wo rds", STRING], "/wo rds"),
    ],
)
def test_echo_says_what_is_wrong(
    words: list[str], reason: str, run_here: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run_here("topic", "echo", *words)
    assert (code, os.listdir()) == (1, [])
    assert reason in err


async def test_fields_are_cut_as_messages_are_and_several_may_be_asked_for(memory: World, tool: Any) -> None:
    node = memory.node("camera", enable_rosout=False, parameter_events=False)
    scan: Any = get_message("sensor_msgs/msg/LaserScan")(ranges=[1.5, float("nan"), 2.5], range_max=float("inf"))
    scan.header.frame_id = "front, left"
    imu = get_message("sensor_msgs/msg/Imu")()
    for name, message in (("/scan", scan), ("/imu", imu)):
        node.create_publisher(type(message), name, LATCHED).publish(message)
    for words, expected in [
        (["/scan", "--field", "ranges", "--no-arr"], "<sequence type: float32, length: 3>\n---\n"),
        (["/scan", "--field", "ranges[1:9]", "--no-arr", "--no-str"], "<sequence type: float32, length: 2>\n---\n"),
        (["/scan", "--field", "ranges[0]", "--no-arr"], "1.5\n---\n"),
        (["/scan", "--field", "header.frame_id", "--no-str", "--no-arr"], "<string length: 11>\n---\n"),
        (["/imu", "--field", "orientation_covariance", "--no-arr"], "<array type: float64[9]>\n---\n"),
        (["/imu", "--field", "orientation_covariance[:2]", "--no-arr"], "<sequence type: float64, length: 2>\n---\n"),
        (
            ["/scan", "--field", "ranges[0]", "--field", "header.frame_id"],
            "ranges[0]: 1.5\nheader.frame_id: front, left\n---\n",
        ),
        (
            ["/scan", "--field", "ranges", "--field", "angle_min", "--no-arr", "--flow-style"],
            "{ranges: '<sequence type: float32, length: 3>', angle_min: 0.0}\n---\n",
        ),
        (["/scan", "--field", "angle_min", "--field", "header.frame_id", "--csv"], '0.0,"front, left"\n'),
        (
            ["/scan", "--field", "range_max", "--field", "ranges", "--json"],
            '{"range_max": "Infinity", "ranges": [1.5, "NaN", 2.5]}\n',
        ),
    ]:
        ended = await tool("topic", "echo", *words, "--once")
        assert (ended.out, ended.err) == (expected, ""), words
    wrong = await tool("topic", "echo", "/scan", "--field", "ranges", "--field", "nope", "--once")
    assert (wrong.code, wrong.out) == (1, "")


async def test_publishers_that_offer_less_are_heard_too_when_they_come_later(node: Node, tool: Any) -> None:
    durable = node.create_publisher(STRING, "/words", LATCHED)
    durable.publish({"data": "latched"})
    process = await tool.start("topic", "echo", "/words", "--field", "data")
    assert await asyncio.wait_for(process.stdout.readline(), 25) == b"latched\n"
    careless = node.create_publisher(STRING, "/words", QoSProfile().best_effort())
    assert await careless.wait_for_subscribers(25)
    careless.publish({"data": "careless"})
    await process.stdout.readline()
    assert await asyncio.wait_for(process.stdout.readline(), 25) == b"careless\n"
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert ended.code == 0
    assert "some, but not all, publishers are reliable" in ended.err
    assert "some, but not all, publishers are transient local" in ended.err


async def test_quality_of_service_can_be_given(node: Node, tool: Any) -> None:
    process = await tool.start(
        *("topic", "echo", "/words", STRING, "--qos-profile", "parameters", "--qos-reliability", "best_effort"),
        *("--qos-depth", "3", "--qos-liveliness-lease-duration-seconds", "2.5"),
    )
    await until(lambda: len(node.get_subscriptions_info_by_topic("/words")) == 1, 25)
    (info,) = node.get_subscriptions_info_by_topic("/words")
    qos = info.qos_profile
    assert (qos.reliability.name, qos.durability.name, qos.liveliness_lease_ns) == ("BEST_EFFORT", "VOLATILE", 2.5e9)
    process.send_signal(signal.SIGTERM)
    assert (await tool.end(process)).code == 0


async def test_no_more_are_shown_than_the_rate_allows(memory: World, tool: Any) -> None:
    publisher = memory.node("talker").create_publisher("std_msgs/msg/Int32", "/count")
    words = ("--field", "data", "--csv", "--filter", "m.data % 2 == 0", "--max-rate", "2.5", "--timeout", "0.3")
    process = await tool.start("topic", "echo", "/count", *words)
    assert await publisher.wait_for_subscribers(25)
    for number in range(20):
        publisher.publish({"data": number})
        await asyncio.sleep(0.1)
    ended = await tool.end(process)
    assert (ended.code, ended.out) == (1, "0\n4\n8\n12\n16\n")
    said = "5 messages were dropped, as --max-rate is 2.5\n"
    assert ended.err.startswith(said + "error: no message that passes the filter on /count")


async def test_a_topic_as_fast_as_the_rate_is_shown_in_full(memory: World, tool: Any) -> None:
    publisher = memory.node("talker").create_publisher("std_msgs/msg/Int32", "/count")
    process = await tool.start("topic", "echo", "/count", "--field", "data", "--csv", "--max-rate", "10")
    assert await publisher.wait_for_subscribers(25)
    for number in range(20):
        publisher.publish({"data": number})
        await asyncio.sleep(0.09 if number % 2 else 0.11)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.out, ended.err) == ("".join(f"{number}\n" for number in range(20)), "")


async def test_the_dropped_are_told_when_echo_is_interrupted(memory: World, tool: Any) -> None:
    publisher = memory.node("talker").create_publisher(STRING, "/words")
    process = await tool.start("topic", "echo", "/words", "--field", "data", "--max-rate", "0.1")
    assert await publisher.wait_for_subscribers(25)
    for word in ("a", "b", "c"):
        publisher.publish({"data": word})
    await asyncio.sleep(1)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.code, ended.out) == (0, "a\n---\n")
    assert ended.err == "2 messages were dropped, as --max-rate is 0.1\n"


async def test_a_topic_that_comes_later_is_waited_for(node: Node, tool: Any) -> None:
    process = await tool.start("topic", "echo", "/late", "--once", "--timeout", "20")
    assert await asyncio.wait_for(process.stderr.readline(), 25) == (
        b"topic /late does not appear to be published yet; waiting for it\n"
    )
    node.create_publisher(STRING, "/late", LATCHED).publish({"data": "here"})
    assert (await tool.end(process)).out == "data: here\n---\n"


async def test_a_type_that_only_the_publisher_has_is_shown(node: Node, tool: Any, tmp_path: Path) -> None:
    cls = compile_definition("far_msgs/msg/Secret", "int32 number 42\nstring[] names")
    node.create_publisher(cls, "/secret", LATCHED).publish(cls(names=["x"]))
    shown = await tool("topic", "echo", "/secret", "--once", HOME=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert (shown.out, shown.err) == ("number: 42\nnames:\n- x\n---\n", "")


async def test_whoever_has_enough_of_the_output_may_go(node: Node) -> None:
    publisher = node.create_publisher(STRING, "/words")
    reading, writing = os.pipe()
    process = await start_process(
        *(sys.executable, "-m", "rosidl_py_gen.ros_cli", "topic", "echo", "/words"),
        stdout=writing,
        stderr=asyncio.subprocess.PIPE,
    )
    os.close(writing)
    assert await publisher.wait_for_subscribers(20)
    os.close(reading)
    publisher.publish({"data": "x"})
    _, err = await asyncio.wait_for(process.communicate(), 10)
    assert (process.returncode, err) == (141, b"")
