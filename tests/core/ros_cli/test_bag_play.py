"""``rosidl-py bag play`` with the options of ``ros2 bag play``, in memory, where waiting takes no time."""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import pytest
from click.shell_completion import ShellComplete
from support.bag_samples import Rosbag2Services, copy_to_sqlite
from support.waiting import until

from rosidl_py_gen import compile_definition, get_action, get_message, get_service, ros_cli
from rosidl_py_gen.bags import BagTopic, BagWriter, RawMessage
from rosidl_py_gen.bags.writer import topic_of
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability

if TYPE_CHECKING:
    from pathlib import Path

    from support.worlds import World

    from rosidl_py_gen.runtime import Node

S = 1_000_000_000
START = 1000 * S
KEEP = QoSProfile(depth=1000)
String: Any = get_message("std_msgs/msg/String")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
Add: Any = get_service("example_interfaces/srv/AddTwoInts")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
Status: Any = get_message("action_msgs/msg/GoalStatusArray")
RECEIVED, SENT = 1, 0


@pytest.fixture
def node(memory: World) -> Node:
    return memory.node("robot", enable_rosout=False, parameter_events=False)


@pytest.fixture
def words(tmp_path: Path) -> str:
    """A second of ten strings on /words."""
    return str(strings(tmp_path / "words", {"/words": range(10)}))


def strings(path: Path, topics: dict[str, Any], step_ns: int = S // 10) -> Path:
    """Write a bag of numbered strings, each at its number of steps after the first."""
    with BagWriter(path) as bag:
        for topic in topics:
            bag.add_topic(topic, String)
        for number, topic in sorted((number, topic) for topic, numbers in topics.items() for number in numbers):
            bag.write(topic, String(data=f"{topic[1]}{number}"), START + number * step_ns)
    return path


class MessageRecorder:
    """Received messages of some topics, with the times of the loop."""

    def __init__(self, node: Node, *topics: str, kind: Any = String, qos: QoSProfile = KEEP) -> None:
        self.items: list[tuple[float, Any]] = []
        for topic in topics:
            node.create_subscription(kind, topic, self._take, qos=qos)

    def _take(self, message: Any) -> None:
        self.items.append((asyncio.get_running_loop().time(), message))

    @property
    def data(self) -> list[str]:
        return [message.data for _, message in self.items]

    @property
    def times(self) -> list[float]:
        """Seconds since the first."""
        return [round(at - self.items[0][0], 6) for at, _ in self.items]


async def played(tool: Any, *arguments: str) -> Any:
    ended = await tool("bag", "play", *arguments)
    assert ended.code == 0, ended.err
    return ended


# --------------------------------------------------------------------------------------------------------------- time


@pytest.mark.parametrize(("rate", "step_s"), [("1", 0.1), ("2", 0.05), ("0.5", 0.2)])
async def test_play_keeps_recorded_intervals_scaled_by_rate(
    node: Node, tool: Any, words: str, rate: str, step_s: float
) -> None:
    recorder = MessageRecorder(node, "words")
    ended = await played(tool, words, "--rate", rate)
    assert recorder.data == [f"w{number}" for number in range(10)]
    assert recorder.times == pytest.approx([number * step_s for number in range(10)])
    assert ended.err == "published 10 messages of 1 topic\n"


async def test_late_topic_starts_at_recorded_offset_after_delay(
    memory: World, node: Node, tool: Any, tmp_path: Path
) -> None:
    path = str(strings(tmp_path / "bag", {"/early": [0], "/late": [30]}))
    recorder = MessageRecorder(node, "late")
    clock = MessageRecorder(node, "clock", kind=Clock)
    await played(tool, path, "--topics", "/late", "--clock", "10", "--delay", "5")
    assert recorder.data == ["l30"]
    assert recorder.items[0][0] - clock.items[0][0] == pytest.approx(3)
    assert clock.items[0][0] > 5


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        (("--start-offset", "0.5"), range(5, 10)),
        (("--playback-duration", "0.3"), range(4)),  # its end counts, as in rosbag2
        (("--playback-duration", "-1"), range(10)),
        (("--playback-duration", "0"), ()),
        (("--playback-duration", "0", "--loop"), ()),
        (("--duration", "0.3"), range(3)),
        (("--start-offset", "0.5", "--playback-duration", "0.2"), range(5, 8)),
        (("--playback-until-sec", "1000.2"), range(3)),
        (("--playback-until-nsec", str(START + 2 * S // 10 - 1)), range(2)),
        (("--playback-until-nsec", "-1"), range(10)),
        (("--playback-duration", "0.1", "--playback-until-sec", "1000.4"), range(5)),  # the later one
        (("--playback-duration", "0.6", "--playback-until-sec", "1000.4"), range(7)),
    ],
)
async def test_start_and_duration_options_limit_played_messages(
    node: Node, tool: Any, words: str, options: tuple[str, ...], numbers: Any
) -> None:
    recorder = MessageRecorder(node, "words")
    await played(tool, words, *options)
    assert recorder.data == [f"w{number}" for number in numbers]


async def test_loop_restarts_without_delay_until_stop_service_is_called(node: Node, tool: Any, words: str) -> None:
    recorder, remote = MessageRecorder(node, "words"), Rosbag2Services(node, "/rosbag2_player")
    process = await tool.start("bag", "play", words, "--loop", "--start-offset", "0.8", "--delay", "1")
    await until(lambda: len(recorder.items) == 7)
    await remote("stop")
    assert (await tool.end(process)).code == 0
    assert recorder.data == ["w8", "w9"] * 3 + ["w8"]
    assert recorder.times == pytest.approx([0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3])  # no delay between them


async def test_message_order_option_selects_received_or_sent_order(node: Node, tool: Any, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for number, sent in enumerate([3, 0, 2, 1, 5, 4]):
            bag.write("/words", String(data=str(sent)), START + S + number * S, START + sent * S)
    path = str(tmp_path / "bag")
    recorder = MessageRecorder(node, "words")
    await played(tool, path, "--message-order", "received")
    assert recorder.data == list("302154")
    recorder.items.clear()
    await played(tool, path, "--message-order", "sent")
    assert recorder.data == list("012345")
    assert recorder.times == pytest.approx([0, 0, 1, 2, 3, 4])  # sent when or before the bag begins
    recorder.items.clear()
    await played(tool, path, "--message-order", "sent", "--read-ahead-queue-size", "1")
    assert recorder.data == list("021345")  # more than one message came too early


async def test_several_bags_are_played_merged_by_time(node: Node, tool: Any, tmp_path: Path) -> None:
    one = strings(tmp_path / "one", {"/a": [0, 2, 4], "/b": [0]})
    two = copy_to_sqlite(strings(tmp_path / "x.mcap", {"/a": [1, 3, 9]}), tmp_path / "two")
    recorder = MessageRecorder(node, "a")
    ended = await played(tool, "-i", str(one), "--input", str(two), "--topics", "/a", "/b")
    assert recorder.data == [f"a{number}" for number in (0, 1, 2, 3, 4, 9)]
    assert recorder.times == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.9])
    assert ended.err == "published 7 messages of 2 topics\n"


# ---------------------------------------------------------------------------------------------------------- selection


def events(bag: BagWriter, topic: str, cls: Any, *items: tuple[int, Any, int]) -> None:
    """Events of a service: kind, request (None for metadata only) and time."""
    bag.add_topic(topic, cls.Event)
    for kind, request, at in items:
        event = cls.Event(request=[] if request is None else [request])
        event.info.event_type = kind
        bag.write(topic, event, at)


@pytest.fixture
def mixed(tmp_path: Path) -> str:
    """A bag of topics, events of services, and an action."""
    path = tmp_path / "mixed"
    with BagWriter(path) as bag:
        for topic in ("/a", "/b", "/ns/a"):
            bag.write(topic, String(data=topic), START)
        for service in ("/add", "/ns/add"):
            events(bag, f"{service}/_service_event", Add, (RECEIVED, Add.Request(a=1, b=2), START))
        for part, cls in (("send_goal", Fibonacci.SendGoal), ("get_result", Fibonacci.GetResult)):
            events(bag, f"/count/_action/{part}/_service_event", cls, (RECEIVED, cls.Request(), START))
        bag.write("/count/_action/status", Status(), START)
        bag.write("/count/_action/feedback", Fibonacci.FeedbackMessage(), START)
    return str(path)


TOPICS = {"/a", "/b", "/ns/a"}
SERVICE = {"/add/_service_event", "/ns/add/_service_event"}
PARTS = "send_goal/_service_event", "get_result/_service_event", "status", "feedback"
ACTION = {f"/count/_action/{part}" for part in PARTS}


@pytest.mark.parametrize(
    ("options", "topics"),
    [
        ((), TOPICS | SERVICE | ACTION),
        (("--topics", "/a", "/ns/a"), {"/a", "/ns/a"}),
        (("--topics", "a", "--topics", "/b"), {"/a", "/b"}),
        (("--services", "/add"), {"/add/_service_event"}),
        (("--services", "/add", "ns/add"), SERVICE),
        (("--actions", "/count"), ACTION),
        (("--topics", "/a", "--services", "/add"), {"/a", "/add/_service_event"}),
        (("--regex", "/a.*"), {"/a", "/add/_service_event"}),
        (("-e", "/ns/.*"), {"/ns/a", "/ns/add/_service_event"}),
        (("-e", "/count"), ACTION),
        (("--topics", "/b", "--regex", "/ns/a"), {"/b", "/ns/a"}),
        (("--exclude-topics", "/a", "/b"), {"/ns/a"} | SERVICE | ACTION),
        (("--exclude-services", "/add"), TOPICS | ACTION | {"/ns/add/_service_event"}),
        (("--exclude-actions", "/count"), TOPICS | SERVICE),
        (("--exclude-regex", ".*/a.*"), {"/b"} | ACTION - {one for one in ACTION if "/a" in one} | set()),
        (("-x", "/ns/.*"), {"/a", "/b", "/add/_service_event"} | ACTION),
        (("--exclude", "/ns/.*"), {"/a", "/b", "/add/_service_event"} | ACTION),
        (("--topics", "/a", "/b", "--exclude-topics", "/b"), {"/a"}),
        (("--topics", "/a", "/b", "--exclude-regex", "/b"), {"/a"}),
    ],
)
async def test_selection_and_exclusion_options_choose_played_topics(
    memory: World, node: Node, tool: Any, mixed: str, options: tuple[str, ...], topics: set[str]
) -> None:
    process = await tool.start("bag", "play", mixed, "--start-paused", *options)
    published: set[str] = set()
    await until(lambda: node.count_services("/rosbag2_player/resume") == 1)
    every = [name for name, _ in node.get_topic_names_and_types()]
    published = {name for name in every if name in TOPICS | SERVICE | ACTION and node.count_publishers(name)}
    assert published == topics
    await Rosbag2Services(node, "/rosbag2_player")("resume")
    ended = await tool.end(process)
    counts = f"published {pluralize(len(topics), 'message')} of {pluralize(len(topics), 'topic')}\n"
    assert ended.code == 0 and counts in ended.err


async def test_topic_named_like_service_events_is_played_as_topic(memory: World, tool: Any, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for topic in ("/add/_service_event", "/count/_action/send_goal/_service_event"):
            bag.write(topic, String(), START)
    options = ("--topics", "/add/_service_event", "/count/_action/send_goal/_service_event")
    requests = ("--publish-service-requests", "--send-actions-as-client")
    ended = await played(tool, str(tmp_path / "bag"), *options, *requests)
    assert ended.err == "published 2 messages of 2 topics and sent 0 requests\n"


async def test_excluded_names_missing_in_bag_are_reported(tool: Any, memory: World, mixed: str) -> None:
    ended = await played(tool, mixed, "--exclude-topics", "/c", "--exclude-services", "/a")
    assert f"--exclude-topics: {mixed} has no topic /c" in ended.err
    assert f"--exclude-services: {mixed} has no service /a" in ended.err
    assert "it is a topic: --exclude-topics /a" in ended.err


async def test_remap_renames_topics_and_services(node: Node, tool: Any, mixed: str) -> None:
    recorder = MessageRecorder(node, "x", "ns/y")
    asked = []
    node.create_service(Add, "sum", lambda request: asked.append(request) or Add.Response())
    await played(
        tool,
        *(mixed, "--topics", "/a", "/b", "--services", "/add", "--publish-service-requests"),
        *("--remap", "/a:=/x", "/b:=/ns/y", "-m", "/add:=/sum"),
    )
    assert sorted(recorder.data) == ["/a", "/b"] and len(asked) == 1


# ----------------------------------------------------------------------------------------------------------- progress


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ((), [number / 3 for number in range(27)]),
        (("--progress-bar-update-rate", "1"), range(9)),
        (("--progress-bar-update-rate", "0"), []),
        (("--progress-bar-update-rate", "-1"), range(9)),  # for each message
    ],
)
async def test_progress_is_updated_at_requested_rate(
    memory: World, tool: Any, tmp_path: Path, options: tuple[str, ...], times: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(strings(tmp_path / "bag", {"/words": range(10)}, step_ns=S))
    monkeypatch.setattr(terminal_output, "is_error_terminal", lambda: True)
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "xterm"), ("COLUMNS", "200")):
        monkeypatch.setenv(name, value)
    ended = await played(tool, path, *options)
    displayed = re.findall(r"([0-9.]+) s of 9.000 s, (\d+) messages?; Ctrl-C ends playback", ended.err)
    displayed = [one for one in displayed if float(one[0]) < 8.9]  # the end is at the same time as the last message
    assert [float(at) for at, _ in displayed] == pytest.approx(list(times), abs=0.002)
    assert all(int(count) in (int(float(at)), int(float(at)) + 1) for at, count in displayed)


async def test_progress_is_updated_by_services_of_the_player(
    node: Node, tool: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(strings(tmp_path / "bag", {"/words": range(10)}, step_ns=S))
    monkeypatch.setattr(terminal_output, "is_error_terminal", lambda: True)
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "xterm"), ("COLUMNS", "200")):
        monkeypatch.setenv(name, value)
    remote = Rosbag2Services(node, "/rosbag2_player")
    process = await tool.start("bag", "play", path, "--start-paused", "--progress-bar-update-rate", "-1")
    await remote("burst", num_messages=3)
    await remote("play_next")
    await remote("set_rate", rate=0.5)
    await remote("seek", time=_time(1008))
    await remote("resume")
    await remote("pause")
    await remote("resume")
    ended = await tool.end(process)
    displayed = re.findall(r"([0-9.]+ s of 9.000 s, .*?); Ctrl-C ends playback", ended.err)
    assert [line for line, _ in groupby(displayed)][:10] == [
        "0.000 s of 9.000 s, 1 message, paused",
        "1.000 s of 9.000 s, 2 messages, paused",
        "2.000 s of 9.000 s, 3 messages, paused",
        "3.000 s of 9.000 s, 4 messages, paused",
        "3.000 s of 9.000 s, 4 messages, at 0.5 times the rate, paused",
        "8.000 s of 9.000 s, 4 messages, at 0.5 times the rate, paused",
        "8.000 s of 9.000 s, 4 messages, at 0.5 times the rate",
        "8.000 s of 9.000 s, 5 messages, at 0.5 times the rate",
        "8.000 s of 9.000 s, 5 messages, at 0.5 times the rate, paused",
        "8.000 s of 9.000 s, 5 messages, at 0.5 times the rate",
    ]


# -------------------------------------------------------------------------------------------------------------- clock


async def test_clock_is_published_at_requested_rate_or_for_each_message(node: Node, tool: Any, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/clock", Clock(), START)
        for number in range(11):
            bag.write("/words" if number % 2 else "/other", String(), START + number * S // 10)
    path = str(tmp_path / "bag")
    clock = MessageRecorder(node, "clock", kind=Clock)

    def stamps() -> list[float]:
        found = [message.clock.sec + message.clock.nanosec / S for _, message in clock.items]
        clock.items.clear()
        return found

    ended = await played(tool, path, "--clock")
    assert stamps() == pytest.approx([1000 + number / 40 for number in range(41)], abs=0.0251)
    assert "skipped /clock of the bag" in ended.err
    await played(tool, path, "--clock", "5", "--rate", "2")
    assert stamps()[:3] == pytest.approx([1000, 1000.4, 1000.8])  # the bag's own
    await played(tool, path, "--clock-topics-all")
    assert stamps() == pytest.approx([1000 + number / 10 for number in range(11)])
    await played(tool, path, "--clock-topics", "/words")
    assert stamps() == pytest.approx([1000 + number / 10 for number in range(1, 11, 2)])
    await played(tool, path)
    assert stamps() == [0]


async def test_clock_time_stops_while_player_is_paused(node: Node, tool: Any, words: str) -> None:
    clock, remote = MessageRecorder(node, "clock", kind=Clock), Rosbag2Services(node, "/rosbag2_player")
    process = await tool.start("bag", "play", words, "--clock", "100", "-p")
    await until(lambda: len(clock.items) > 20)
    assert {message.clock.sec * S + message.clock.nanosec for _, message in clock.items} == {START}
    await remote("play_next")
    await remote("play_next")
    clock.items.clear()
    await until(lambda: len(clock.items) > 5)
    assert {message.clock.nanosec for _, message in clock.items} == {S // 10}
    await remote("resume")
    assert (await tool.end(process)).code == 0


# ----------------------------------------------------------------------------------------------------------- services


async def test_player_services_of_rosbag2_control_playback(node: Node, tool: Any, words: str) -> None:
    recorder, remote = MessageRecorder(node, "words"), Rosbag2Services(node, "/rosbag2_player")
    process = await tool.start("bag", "play", words, "--start-paused")
    assert (await remote("is_paused")).paused and not recorder.items
    assert (await remote("play_next")).success
    assert (await remote("burst", num_messages=2)).actually_burst == 2
    await until(lambda: recorder.data == ["w0", "w1", "w2"])
    await asyncio.sleep(100)
    assert len(recorder.items) == 3
    assert (await remote("seek", time=_time(1000.7))).success
    assert not (await remote("seek", time=_time(1001))).success
    assert (await remote("set_rate", rate=0.5)).success and not (await remote("set_rate", rate=-1.0)).success
    assert not (await remote("set_rate", rate=float("nan"))).success
    assert (await remote("get_rate")).rate == 0.5
    assert not (await remote("play")).success  # it plays already
    recorder.items.clear()
    await remote("toggle_paused")
    assert not (await remote("is_paused")).paused
    assert not (await remote("play_next")).success and not (await remote("burst")).actually_burst
    await until(lambda: len(recorder.items) == 2)
    await remote("pause")
    assert recorder.data == ["w7", "w8"] and recorder.times == pytest.approx([0, 0.2])
    await remote("seek", time=_time(5))  # before the bag: its begin
    assert (await remote("burst", num_messages=0)).actually_burst == 10
    await until(lambda: len(recorder.items) == 12)
    assert process.returncode is None  # paused at its end
    await remote("seek", time=_time(1000.9))
    await remote("resume")
    assert (await tool.end(process)).code == 0
    assert recorder.data[12:] == ["w9"]


def _time(seconds: float) -> Any:
    stamp: Any = get_message("builtin_interfaces/msg/Time")()
    stamp.sec, stamp.nanosec = int(seconds), round(seconds % 1 * S)
    return stamp


async def test_service_call_command_resumes_paused_player(memory: World, tool: Any, words: str) -> None:
    process = await tool.start("bag", "play", words, "--start-paused")
    ended = await tool("service", "call", "/rosbag2_player/resume", "rosbag2_interfaces/srv/Resume")
    assert ended.code == 0, ended.err
    assert (await tool.end(process)).code == 0


# ------------------------------------------------------------------------------------------------- quality of service


async def test_qos_overrides_file_replaces_recorded_profiles(node: Node, tool: Any, mixed: str, tmp_path: Path) -> None:
    file = tmp_path / "qos.yaml"
    file.write_text(
        "/a:\n  reliability: best_effort\n  durability: transient_local\n  history: keep_last\n  depth: 3\n"
        "/renamed: {reliability: best_effort}\n/aa: {depth: 3}\n"
    )
    process = await tool.start(
        *("bag", "play", mixed, "--topics", "/a", "/b", "/ns/a", "--remap", "/b:=/renamed", "--start-paused"),
        *("--qos-profile-overrides-path", str(file), "--wait-for-all-acked", "500"),
    )
    await until(lambda: node.count_services("/rosbag2_player/resume") == 1)
    profiles = {topic: node.get_publishers_info_by_topic(topic)[0].qos_profile for topic in ("/a", "/renamed", "/ns/a")}
    assert profiles["/a"].reliability is profiles["/renamed"].reliability is Reliability.BEST_EFFORT
    assert profiles["/a"].durability is Durability.TRANSIENT_LOCAL
    assert profiles["/ns/a"].reliability is Reliability.RELIABLE
    await Rosbag2Services(node, "/rosbag2_player")("resume")
    ended = await tool.end(process)
    assert ended.code == 0
    assert "--wait-for-all-acked: /a is best effort, without acknowledgements\n" in ended.err
    assert f"{file}: the bag has no topic /aa; did you mean" in ended.err and "/renamed;" not in ended.err
    assert "/ns/a" not in ended.err


async def test_invalid_qos_override_is_an_error_with_line(tool: Any, memory: World, words: str, tmp_path: Path) -> None:
    file = tmp_path / "qos.yaml"
    file.write_text("/words:\n  depth: 5\n  reliability: relaible\n")
    ended = await tool("bag", "play", words, "--qos-profile-overrides-path", str(file))
    assert ended.code == 1
    assert ended.err.startswith(f"error: {file}:3:16: reliability: expected one of") and "did you mean" in ended.err


# ----------------------------------------------------------------------------------------------------------- requests


@pytest.fixture
def sums(tmp_path: Path) -> str:
    """Events of /add: two requests, each from client and server, their responses, and an event without contents."""
    path = tmp_path / "sums"
    with BagWriter(path) as bag:
        for number in (1, 2):
            at = START + number * S
            request = Add.Request(a=number, b=10)
            both = (SENT, request, at), (RECEIVED, request, at + S // 10)
            events(bag, "/add/_service_event", Add, *both, (2, None, at + S // 5))
        events(bag, "/add/_service_event", Add, (RECEIVED, None, START + 3 * S))
        bag.write("/words", String(data="w"), START)
    return str(path)


@pytest.mark.parametrize(
    ("source", "first_s", "missing"), [("service_introspection", 1.1, True), ("client_introspection", 1.0, False)]
)
async def test_recorded_requests_are_sent_to_the_service(
    node: Node, tool: Any, sums: str, source: str, first_s: float, missing: bool
) -> None:
    asked: list[tuple[float, int]] = []

    async def add(request: Any) -> Any:
        asked.append((asyncio.get_running_loop().time(), request.a))
        await asyncio.sleep(2)  # the next one does not wait for this response
        return Add.Response(sum=request.a + request.b)

    node.create_service(Add, "add", add)
    recorder = MessageRecorder(node, "words")
    ended = await played(tool, sums, "--publish-service-requests", "--service-requests-source", source)
    assert [number for _, number in asked] == [1, 2]
    assert asked[0][0] - recorder.items[0][0] == pytest.approx(first_s)
    assert asked[1][0] - asked[0][0] == pytest.approx(1)
    assert "published 1 message of 2 topics and sent 2 requests\n" in ended.err
    warning = (
        "/add/_service_event: service_introspection events were recorded without request contents; no request is sent\n"
    )
    assert (warning in ended.err) is missing


async def test_requests_without_server_are_skipped_and_reported_once(memory: World, tool: Any, sums: str) -> None:
    ended = await played(tool, sums, "--publish-service-requests")
    assert ended.err.count("/add: no server exists; requests are skipped\n") == 1
    assert "and sent 0 requests\n" in ended.err


async def test_unanswered_requests_do_not_block_end_of_playback(node: Node, tool: Any, sums: str) -> None:
    async def never(request: Any) -> Any:
        await asyncio.Event().wait()

    node.create_service(Add, "add", never)
    ended = await played(tool, sums, "--publish-service-requests")
    assert "2 requests had no response in 5 s\n" in ended.err


async def test_service_events_are_published_as_messages_by_default(node: Node, tool: Any, sums: str) -> None:
    recorder = MessageRecorder(node, "add/_service_event", kind=Add.Event)
    node.create_service(Add, "add", lambda request: pytest.fail("nobody is to be asked"))
    await played(tool, sums)
    assert [message.info.event_type for _, message in recorder.items] == [0, 1, 2, 0, 1, 2, 1]


@pytest.mark.parametrize("encoding", ["unknown", "ros2msg"])
async def test_request_type_is_read_from_definition_written_by_rosbag2(
    node: Node, tool: Any, tmp_path: Path, encoding: str
) -> None:
    body = "int64 left\n---\nint64 right\n"
    cls: Any = compile_definition("only_here/srv/Turn", body)
    text = "=" * 80 + f"\nSRV: only_here/srv/Turn\n{body}"
    known = BagTopic("/turn/_service_event", "only_here/srv/Turn_Event", text, encoding)
    event = cls.Event(request=[cls.Request(left=7)])
    event.info.event_type = RECEIVED
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_raw(RawMessage(known, event.encode(), START, START))
    asked = []
    node.create_service(cls, "turn", lambda request: asked.append(request.left) or cls.Response())
    await played(tool, str(tmp_path / "bag"), "--publish-service-requests")
    assert asked == [7]


async def test_service_without_definition_is_an_error(memory: World, tool: Any, tmp_path: Path) -> None:
    known = replace(topic_of("/x/_service_event", Add.Event), type_name="nobody_has/srv/X_Event", definition="")
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_raw(RawMessage(replace(known, type_hash=""), b"\0\1\0\0\0\0\0\0", START, START))
    ended = await tool("bag", "play", str(tmp_path / "bag"), "--publish-service-requests")
    assert ended.code == 1 and "requests to /x/_service_event cannot be sent" in ended.err
    assert "pass the folder of its definition with --path" in ended.err


async def test_recorded_goal_is_sent_with_send_actions_as_client(
    memory: World, node: Node, tool: Any, tmp_path: Path
) -> None:
    path = tmp_path / "bag"
    goal_id = get_message("unique_identifier_msgs/msg/UUID")(uuid=bytes(range(16)))
    goal = Fibonacci.SendGoal.Request(goal_id=goal_id, goal=Fibonacci.Goal(order=5))
    with BagWriter(path) as bag:
        events(bag, "/count/_action/send_goal/_service_event", Fibonacci.SendGoal, (RECEIVED, goal, START))
        bag.write("/count/_action/feedback", Fibonacci.FeedbackMessage(), START + S)
        request = Fibonacci.GetResult.Request(goal_id=goal_id)
        events(bag, "/count/_action/get_result/_service_event", Fibonacci.GetResult, (RECEIVED, request, START + S))
    orders = []

    async def count(goal: Any) -> Any:
        orders.append(goal.request.order)
        return Fibonacci.Result(sequence=[0, 1])

    async with node:
        node.create_action_server(Fibonacci, "count", count)
        ended = await played(tool, str(path), "--send-actions-as-client")
    assert orders == [5], ended.err
    assert ended.err == "published 0 messages of 3 topics and sent 2 requests\n"


# -------------------------------------------------------------------------------------------------------------- words


def test_invalid_play_arguments_are_reported(run_here: Any, words: str, mixed: str, tmp_path: Path) -> None:
    for arguments, code, text in (
        ([], 2, "expected BAG, or --input BAG"),
        ([words, "-i", words], 2, "expected BAG, or --input BAG"),
        ([words, "--clock", "--clock-topics-all"], 2, "expected only one of --clock, --clock-topics-all"),
        ([words, "--playback-until-sec", "1", "--playback-until-nsec", "1"], 2, "only one of --playback-until-sec"),
        ([words, "--rate", "nan"], 2, "nan is not a finite number"),
        ([words, "--rate", "0"], 2, "0"),
        ([words, "--playback-duration", "inf"], 2, "inf is not a finite number"),
        ([words, "--start-offset", "nan"], 2, "nan is not a finite number"),
        ([words, "--clock", "x"], 2, "'x' is not a valid"),
        ([words, "--message-order", "x"], 2, "'x' is not one of 'received', 'sent'"),
        ([words, "--read-ahead-queue-size", "0"], 2, "0"),
        ([words, "--regex", "("], 1, '--regex: "(" is not a regular expression'),
        ([words, "--exclude-regex", "["], 1, '--exclude-regex: "[" is not a regular expression'),
        ([words, "--regex", "/wor"], 1, "no topic is selected; topics are /words"),
        ([words, "--services", "/words"], 1, "has no service /words; it is a topic: --topics /words"),
        ([mixed, "--topics", "/coun"], 1, "has no topic /coun"),
        ([mixed, "--actions", "/cuont"], 1, 'has no action /cuont; did you mean "/count"?'),
        ([mixed, "--topics", "/count"], 1, "it is an action: --actions /count"),
        ([words, "-s", "sqlite3"], 1, "words_0.mcap: storage is mcap; expected sqlite3"),
        ([words, "--playback-until-sec", "3"], 1, "expected an end after it"),
        ([words, "--clock-topics", "/x", "--discovery", "off"], 1, "--clock-topics /x: topic is not played"),
        ([words, "--qos-profile-overrides-path", str(tmp_path / "no.yaml")], 1, "no.yaml: No such file"),
    ):
        found, _, err = run_here("bag", "play", *arguments)
        assert (found, text in err, "Traceback" in err) == (code, True, False), (arguments, err)


def test_shell_completion_offers_topics_services_and_actions_of_bag(mixed: str) -> None:
    shell = ShellComplete(ros_cli.root(), {}, "rosidl-py", "_ROSIDL_PY_COMPLETE")
    for words, incomplete, found in (
        ((mixed, "--topics"), "/", ["/a", "/b", "/ns/a"]),
        ((mixed, "--topics", "/a", "--topics"), "/n", ["/ns/a"]),
        ((mixed, "--topics", "/a", "/b"), "/n", ["/ns/a"]),
        ((mixed, "--topics", "/a"), "--publish", ["--publish-service-requests"]),
        ((mixed, "--services"), "", ["/add", "/ns/add"]),
        (("-i", mixed, "--exclude-actions"), "/", ["/count"]),
        (("/nowhere", "--topics"), "/", []),
        (("--topics",), "/", []),
    ):
        offered = shell.get_completions(["bag", "play", *words], incomplete)
        assert [item.value for item in offered] == found, words
