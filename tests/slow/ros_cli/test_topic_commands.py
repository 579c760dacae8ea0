"""``rosidl-py topic`` with a node of the test, its notes if no messages arrive, and its standard input."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import sys
import threading
import time
from contextlib import aclosing
from typing import TYPE_CHECKING, Any

import pytest
from support.processes import WAITS, start_process
from support.waiting import take, until

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.base.terminal_text import json_text
from rosidl_py_gen.command_support import graph_lookup
from rosidl_py_gen.ros_cli import values
from rosidl_py_gen.ros_cli.topic.statistics import TopicStatistics, report_text
from rosidl_py_gen.runtime import Node, QoSProfile

if TYPE_CHECKING:
    from pathlib import Path

    from support.worlds import World


STRING, BOOL, POSE = "std_msgs/msg/String", "std_msgs/msg/Bool", "geometry_msgs/msg/PoseStamped"


@pytest.fixture
def node(dds: World) -> Node:
    """Node without topics that `topic list` would show."""
    return dds.node("talker", "/demo", enable_rosout=False, parameter_events=False)


def test_topic_list_and_find_print_topics_like_ros2(topic_peer: tuple[str, str], run_here: Any) -> None:
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


def test_topic_info_describes_each_endpoint_like_ros2(topic_peer: tuple[str, str], run_here: Any) -> None:
    def printed(*words: str) -> str:
        return str(run_here("topic", *words, *topic_peer)[1])

    assert printed("type", "/demo/words") == "std_msgs/msg/String\n"
    assert printed("info", "/demo/words") == "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 1\n"
    verbose = re.sub(r"GID: ([0-9a-f]{2}\.){15}[0-9a-f]{2}\n", "GID: ...\n", printed("info", "-v", "demo/words"))
    assert verbose.startswith(
        "Type: std_msgs/msg/String\n\nPublisher count: 1\n\nNode name: talker\nNode namespace: /demo\n"
        f"Topic type: std_msgs/msg/String\nTopic type hash: {type_hash(get_message(STRING))}\n"
        "Endpoint type: PUBLISHER\nGID: ...\nQoS profile:\n  Reliability: RELIABLE\n  History (Depth): KEEP_LAST (7)\n"
        "  Durability: VOLATILE\n  Lifespan: Infinite\n  Deadline: Infinite\n  Liveliness: AUTOMATIC\n"
        "  Liveliness lease duration: Infinite\n\nSubscription count: 1\n\nNode name: talker\n"
    )
    assert json.loads(printed("info", "--json", "/demo/words"))["publishers"][0]["qos"]["depth"] == 7


def test_unknown_topic_error_suggests_similar_topic(topic_peer: tuple[str, str], run_here: Any) -> None:
    code, _, error = run_here("topic", "type", "/demo/wrods", "--timeout", "3", *topic_peer)
    assert code == 1
    expected = f'error: no topic /demo/wrods was found in domain {topic_peer[1]}; did you mean "/demo/words"?\n'
    assert error.splitlines(keepends=True)[-1] == expected


async def test_topic_pub_sends_given_messages_to_subscribers(network: World, tool: Any) -> None:
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


async def test_topic_pub_reads_documents_from_standard_input(node: Node, tool: Any) -> None:
    words = node.create_subscription(STRING, "/words")
    text = 'data: one\n---\n\n{"data": "two"}\n{"data": "three"}\ndata: |\n  four\n  lines\n---\n'
    done = await tool("topic", "pub", "/words", "-", stdin=text)
    assert (done.code, done.err) == (0, "")
    assert [(await take(words))["data"] for _ in range(4)] == ["one", "two", "three", "four\nlines\n"]


async def test_topic_pub_runs_until_interrupted(node: Node, tool: Any) -> None:
    words = node.create_subscription(STRING, "/words")
    endless = await tool.start("topic", "pub", "/words", "data: again", "-r", "100", "-p", "0")
    waiting = await tool.start("topic", "pub", "/other", STRING, "--once")
    reading = await tool.start("topic", "pub", "/words", "-")
    await until(lambda: len(node.get_publishers_info_by_topic("/words")) == 2, 25)
    assert [(await take(words))["data"] for _ in range(3)] == ["again"] * 3
    assert await waiting.stderr.readline() == b"Waiting for at least 1 matching subscription on /other...\n"
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
        (["/words", STRING, "-", "-w", "0"], "{data: a}\n{dta: b}\n", "document 2 of standard input: std_msgs"),
        (["/words", STRING, "-", "-w", "0"], "\udcff", "standard input is not UTF-8"),
        (["/words", STRING, "--once", "--timeout", "0.2"], "", "0 subscriptions on /words in 0.2 s, expected at least"),
        (["/words", "--timeout", "0.2"], "", "no topic /words was found"),
        (["/wo rds", STRING], "", "/wo rds"),
        (["/words", STRING, "--qos-durability", "transient_local", "--qos-depth", "9999999999"], "", "depth must be"),
    ],
)
def test_invalid_topic_pub_arguments_are_reported(words: list[str], stdin: str, reason: str, run_here: Any) -> None:
    code, _, err = run_here("topic", "pub", *words, stdin=stdin)
    assert code == 1 and reason in err


def test_topic_hz_and_bw_measure_without_definition_and_delay_by_stamp(
    topic_peer: tuple[str, str], run_here: Any, monkeypatch: Any
) -> None:
    def report(*words: str) -> str:
        return str(run_here("topic", *words, "-n", "1", *topic_peer)[1])

    spread = r"\n\tmin: (\d+\.\d{3})s max: (\d+\.\d{3})s std dev: \d+\.\d{5}s window: \d+\n"
    with monkeypatch.context() as patched:
        patched.setattr(graph_lookup, "get_message", None)
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


def test_messages_received_at_same_time_have_infinite_rate() -> None:
    rate = TopicStatistics("hz", 10)
    for received_ns in (5, 5, 5):
        rate.add(received_ns, 0)
    report = rate.report()
    assert report is not None
    assert report_text(report).startswith("average rate: inf\n")
    assert json.loads(json_text(report))["rate"] == "Infinity"


async def test_topic_hz_reports_missing_messages_and_ends_with_ctrl_c(node: Node, tool: Any) -> None:
    node.create_publisher(STRING, "/silent")
    process = await tool.start("topic", "hz", "/silent")
    while (line := await asyncio.wait_for(process.stderr.readline(), 25)) != b"no new messages\n":
        assert WAITS.fullmatch(line.decode())
    assert (await tool.interrupt(process)).code == 0


LATCHED = QoSProfile().transient_local()


def test_topic_echo_formats_messages_like_ros2(topic_peer: tuple[str, str], run_here: Any) -> None:

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


def test_messages_on_which_filter_fails_are_noted_once(topic_peer: tuple[str, str], run_here: Any) -> None:
    words = ("--once", "--filter", "m.ranges[0] > 1", "--field", "ranges")
    code, out, err = run_here("topic", "echo", "/demo/_scans", *words, *topic_peer)
    assert (code, out, WAITS.sub("", err)) == (0, "- 4.0\n---\n", "skipped a message: there is no element 0 among 0\n")


async def test_topic_echo_prints_only_messages_that_pass_filter(network: World, tool: Any) -> None:
    node = network.node("robot", enable_rosout=False, parameter_events=False)
    publisher = node.create_publisher(STRING, "/words")
    process = await tool.start("topic", "echo", "/words", "--field", "data", "--filter", "'needle' in m.data")
    await publisher.wait_for_subscribers(timeout_s=25)
    for word in ("a", "needle 1", "b", "needle 2", "\x1b[31mneedle\t3\nnext line"):
        publisher.publish({"data": word})
    for expected in ("needle 1\n", "---\n", "needle 2\n", "---\n", "\ufffd[31mneedle\t3\n", "next line\n"):
        assert (await asyncio.wait_for(process.stdout.readline(), 25)).decode() == expected
    assert (await tool.interrupt(process)).code == 0


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
        (["/words", STRING, "--once", "--timeout", "0.2"], "/words in 0.2 s: no other participant was found"),
    ],
)
def test_invalid_topic_echo_arguments_are_reported(
    words: Any, reason: str, run_here: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run_here("topic", "echo", *words)
    assert (code, os.listdir(), reason in err) == (1, [], True), err


async def test_topic_echo_prints_several_selected_fields_with_truncation(memory: World, tool: Any) -> None:
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


async def test_topic_echo_receives_later_publisher_with_weaker_qos(node: Node, tool: Any) -> None:
    durable = node.create_publisher(STRING, "/words", LATCHED)
    durable.publish({"data": "latched"})
    process = await tool.start("topic", "echo", "/words", "--field", "data")
    assert await asyncio.wait_for(process.stdout.readline(), 25) == b"latched\n"
    careless = node.create_publisher(STRING, "/words", QoSProfile().best_effort())
    assert await careless.wait_for_subscribers(25)
    careless.publish({"data": "careless"})
    await process.stdout.readline()
    assert await asyncio.wait_for(process.stdout.readline(), 25) == b"careless\n"
    ended = await tool.interrupt(process)
    assert ended.code == 0
    assert "some, but not all, publishers are reliable" in ended.err
    assert "some, but not all, publishers are transient local" in ended.err


async def test_topic_echo_qos_options_apply_to_subscription(node: Node, tool: Any) -> None:
    process = await tool.start(
        *("topic", "echo", "/words", STRING, "--qos-profile", "parameters", "--qos-reliability", "best_effort"),
        *("--qos-depth", "3", "--qos-liveliness-lease-duration-seconds", "2.5"),
    )
    await until(lambda: len(node.get_subscriptions_info_by_topic("/words")) == 1, 25)
    (info,) = node.get_subscriptions_info_by_topic("/words")
    qos = info.qos_profile
    assert (qos.reliability.name, qos.durability.name, qos.liveliness_lease_ns) == ("BEST_EFFORT", "VOLATILE", 2.5e9)
    assert (await tool.interrupt(process, signal.SIGTERM)).code == 0


async def test_topic_echo_drops_messages_above_max_rate(memory: World, tool: Any) -> None:
    publisher = memory.node("talker").create_publisher("std_msgs/msg/Int32", "/count")
    words = ("--field", "data", "--csv", "--filter", "m.data % 2 == 0", "--max-rate", "2.5", "--timeout", "0.3")
    process = await tool.start("topic", "echo", "/count", *words)
    assert await publisher.wait_for_subscribers(25)
    for number in range(20):
        publisher.publish({"data": number})
        await asyncio.sleep(0.1)
    ended = await tool.end(process)
    assert (ended.code, ended.out) == (1, "0\n4\n8\n12\n16\n")
    printed = "dropped 5 messages, as --max-rate is 2.5\n"
    assert ended.err.startswith(printed + "error: no message that passes the filter on /count")


async def test_topic_echo_prints_all_messages_at_max_rate(memory: World, tool: Any) -> None:
    publisher = memory.node("talker").create_publisher("std_msgs/msg/Int32", "/count")
    process = await tool.start("topic", "echo", "/count", "--field", "data", "--csv", "--max-rate", "10")
    assert await publisher.wait_for_subscribers(25)
    for number in range(20):
        publisher.publish({"data": number})
        await asyncio.sleep(0.09 if number % 2 else 0.11)
    ended = await tool.interrupt(process)
    assert (ended.out, ended.err) == ("".join(f"{number}\n" for number in range(20)), "")


async def test_topic_echo_waits_for_topic_published_later(node: Node, tool: Any) -> None:
    process = await tool.start("topic", "echo", "/late", "--once", "--timeout", "20")
    line = await asyncio.wait_for(process.stderr.readline(), 25)
    assert line == b"topic /late does not appear to be published yet; waiting for it\n"
    node.create_publisher(STRING, "/late", LATCHED).publish({"data": "here"})
    assert (await tool.end(process)).out == "data: here\n---\n"


async def test_topic_echo_prints_type_known_to_publisher_only(node: Node, tool: Any, tmp_path: Path) -> None:
    cls = compile_definition("far_msgs/msg/Secret", "int32 number 42\nstring[] names")
    node.create_publisher(cls, "/secret", LATCHED).publish(cls(names=["x"]))
    displayed = await tool("topic", "echo", "/secret", "--once", HOME=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert (displayed.out, displayed.err) == ("number: 42\nnames:\n- x\n---\n", "")


async def test_topic_echo_ends_silently_if_its_output_pipe_is_closed(node: Node) -> None:
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


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["std_msgs/msg/Bool"], "types differ, std_msgs/msg/String and std_msgs/msg/Bool"),
        (["--qos-durability", "transient_local"], "their quality of service is incompatible"),
    ],
)
async def test_topic_echo_reports_incompatible_publisher(
    dds: World, tool: Any, arguments: list[str], reason: str
) -> None:
    publisher = dds.node("talker").create_publisher(STRING, "/words")
    done = await tool("topic", "echo", "/words", *arguments, "--timeout", "8")
    assert f"warning: no messages on /words from node /talker to this command: {reason}" in done.err
    assert done.code == 1 and publisher.subscription_count == 0


async def test_topic_pub_reports_incompatible_subscription(dds: World, tool: Any) -> None:
    dds.node("listener").create_subscription(STRING, "/words")
    done = await tool("topic", "pub", "/words", "std_msgs/msg/Bool", "data: true", "-w", "1", "--timeout", "8")
    reason = "types differ, std_msgs/msg/Bool and std_msgs/msg/String"
    assert f"warning: no messages on /words from this command to node /listener: {reason}" in done.err


async def test_topic_info_reports_incompatible_endpoints(dds: World, tool: Any) -> None:
    old, new = (compile_definition("silent_msgs/msg/Changed", text) for text in ("int32 x", "int64 x"))
    alice, bob = dds.pair()
    alice.create_publisher(old, "/changed", QoSProfile())
    bob.create_subscription(new, "/changed")
    bob.create_subscription(BOOL, "/changed")
    await until(lambda: alice.count_subscribers("/changed") == 2)
    displayed, plain = await asyncio.gather(*(tool("topic", "info", "/changed", option) for option in ("-v", "--json")))
    printed = (
        "no messages from /alice to /bob: their definitions of silent_msgs/msg/Changed differ: "
        f"{type_hash(old)} and {type_hash(new)}"
    )
    assert f"warning: {printed}" in displayed.out
    assert (
        "warning: no messages from /alice to /bob: types differ, silent_msgs/msg/Changed and std_msgs" in displayed.out
    )
    assert printed in json.loads(plain.out)["mismatches"]


async def test_lists_of_empty_domain_print_a_note(memory: World, tool: Any) -> None:
    commands = [(group, "list") for group in ("topic", "node", "service", "action", "param")] + [("lifecycle", "nodes")]
    note = "no nodes were found in domain"
    for words in commands:
        for options in ((), ("--json",)):
            ended = await tool(*words, *(option for option in options if words[0] != "param"))
            assert (ended.code, ended.err.count("\n"), ended.err.startswith(note)) == (0, 1, True), words
    memory.node("talker", enable_rosout=False)
    for words in commands:
        assert (await tool(*words)).err == "", words


def test_a_thread_that_reads_on_after_cancellation_reads_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "first").write_text('{"data": "a"}\n')
    (tmp_path / "second").write_bytes(b"of somebody else")
    read, go_on = os.read, threading.Event()
    reads: list[bytes] = []
    before = set(threading.enumerate())

    def late_read(number: int, size: int) -> bytes:
        thread = threading.current_thread()
        if thread.name != "rosidl-py-stdin" or thread in before:
            return read(number, size)
        if reads:
            go_on.wait(10)
        reads.append(read(number, size))
        return reads[-1]

    async def first_document() -> str:
        async with aclosing(values.documents()) as documents:
            return await anext(documents)

    monkeypatch.setattr(os, "read", late_read)
    with open(tmp_path / "first", "rb") as file:
        monkeypatch.setattr(sys, "stdin", file)
        assert asyncio.run(first_document()) == '{"data": "a"}'
    (thread,) = (one for one in {*threading.enumerate()} - before if one.name == "rosidl-py-stdin")
    with open(tmp_path / "second", "rb") as other:
        go_on.set()
        thread.join(10)
        assert other.read() == b"of somebody else"
    assert reads == [b'{"data": "a"}\n', b""]
