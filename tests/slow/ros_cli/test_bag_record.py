"""``rosidl-py bag record``: the bag that each option results in."""

from __future__ import annotations

import tracemalloc
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader as RosbagsReader
from support.announced_types import without_hash
from support.bag_samples import Rosbag2Services, count_of, wait_for_lines
from support.waiting import until

from rosidl_py_gen import compile_definition, get_action, get_message, get_service, type_hash
from rosidl_py_gen.bags import BagError, BagReader, BagWriter
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.ros_cli.recording.writer import WriterThread
from rosidl_py_gen.runtime import Durability, IntrospectionState, QoSProfile, Reliability, ServiceEventType

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from support.worlds import World

    from rosidl_py_gen.runtime import Node

pytestmark = pytest.mark.real_time("a thread writes")
S = 1_000_000_000
LATCHED = QoSProfile().transient_local()
EVENTS_QOS = QoSProfile(depth=7).transient_local()
String: Any = get_message("std_msgs/msg/String")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
Int32: Any = get_message("std_msgs/msg/Int32")
AddTwoInts: Any = get_service("example_interfaces/srv/AddTwoInts")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
SetBool: Any = get_service("std_srvs/srv/SetBool")
GoalStatusArray: Any = get_message("action_msgs/msg/GoalStatusArray")
RECORDER = "/rosbag2_recorder"


@pytest.fixture
def node(memory: World) -> Node:
    return memory.node("robot", enable_rosout=False, parameter_events=False)


def files_of(path: Path) -> list[Path]:
    return [one for one in path.iterdir() if one.suffix in (".mcap", ".db3")]


def words_of(path: Path) -> list[str]:
    with BagReader(path) as reader:
        return [item.message.data for item in reader]


def metadata_of(path: Path) -> dict[str, Any]:
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    return dict(metadata["rosbag2_bagfile_information"])


@asynccontextmanager
async def recording(tool: Any, path: Path, *options: str) -> AsyncIterator[Any]:
    """Run a recorder that writes each message immediately, end it by SIGINT, and require exit code 0."""
    process = await tool.start("bag", "record", "-o", str(path), "--max-cache-size", "0", *options)
    yield process
    process.ended = await tool.interrupt(process)
    assert process.ended.code == 0, process.ended.err


async def taken(node: Node, recorder: str = RECORDER) -> bool:
    """Wait until the recorder has received all earlier messages; return True if it is paused."""
    return bool((await Rosbag2Services(node, recorder)("is_paused")).paused)


async def test_topic_first_published_by_humble_is_recorded_with_its_definition(
    tool: Any, node: Node, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Messages of another definition are dropped, because a topic of a bag has one definition."""
    current: Any = get_message("sensor_msgs/msg/Range")
    of_humble: Any = get_message("sensor_msgs/msg/Range", distro="humble")
    humble = node.create_publisher(without_hash(of_humble), "range")
    async with recording(tool, tmp_path / "bag", "/range") as process:
        await humble.wait_for_subscribers(20)
        humble.publish_raw(of_humble(range=1.0).encode())
        await wait_for_lines(process, "recording /range [sensor_msgs/msg/Range]")
        humble.publish_raw(of_humble(range=2.0).encode())
        later = node.create_publisher(current, "range")  # of a node of Jazzy
        await later.wait_for_subscribers(20)
        later.publish(current(range=3.0, variance=4.0))
        unknown: Any = compile_definition("sensor_msgs/msg/Range", "int32 x")
        stranger = node.create_publisher(unknown, "range", QoSProfile().reliable())
        await stranger.wait_for_subscribers(20)
        stranger.publish(unknown())
        for cls in (current, unknown):
            warning = f"messages on /range from node /robot are dropped: its definition is {type_hash(cls)}; here it is"
            await until(lambda warning=warning: warning in caplog.text)
        humble.publish_raw(of_humble(range=3.0).encode())
        await until(lambda: count_of(tmp_path / "bag") == 3)
    assert "recorded 3 messages of 1 topic, " in process.ended.err
    assert "\ndropped 2 messages of other definitions of their type\n" in process.ended.err
    with BagReader(tmp_path / "bag") as reader:
        topic = reader.topics["/range"]
        assert topic.type_hash == type_hash(of_humble) and "variance" not in topic.definition
        assert [item.message.range for item in reader] == [1.0, 2.0, 3.0]


# ------------------------------------------------------------------------------------------------ what is recorded


PLAIN = {"/camera/left", "/camera/depth", "/count"}
HIDDEN = {"/camera/_raw"}
ADD, SWITCH = "/add/_service_event", "/switch/_service_event"
FIB = {
    "/fib/_action/feedback",
    "/fib/_action/status",
    *(f"/fib/_action/{name}/_service_event" for name in ("send_goal", "get_result", "cancel_goal")),
}
OTHER = {"/other/_action/feedback", "/other/_action/status"}


def publish_all(node: Node) -> None:
    publishers = {
        "/camera/left": String,
        "/camera/depth": String,
        "/camera/_raw": String,
        "/count": Int32,
        ADD: AddTwoInts.Event,
        SWITCH: SetBool.Event,
        "/fib/_action/feedback": Fibonacci.FeedbackMessage,
        "/fib/_action/status": GoalStatusArray,
        "/fib/_action/send_goal/_service_event": Fibonacci.SendGoal.Event,
        "/fib/_action/get_result/_service_event": Fibonacci.GetResult.Event,
        "/fib/_action/cancel_goal/_service_event": get_service("action_msgs/srv/CancelGoal").Event,
        "/other/_action/feedback": Fibonacci.FeedbackMessage,
        "/other/_action/status": GoalStatusArray,
    }
    for name, cls in publishers.items():
        node.create_publisher(cls, name, LATCHED).publish(cls())
    node.create_subscription(String, "/camera/left")
    node.create_subscription(String, "/unpublished")


def followed(node: Node) -> set[str]:
    """The topics that the recorder has subscribed to."""
    return {
        name
        for name in PLAIN | HIDDEN | {ADD, SWITCH} | FIB | OTHER
        for one in node.get_subscriptions_info_by_topic(name)
        if one.node_name == RECORDER[1:]
    }


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--all"], PLAIN | {ADD, SWITCH} | FIB | OTHER),
        (["-a", "--include-hidden-topics"], PLAIN | HIDDEN | {ADD, SWITCH} | FIB | OTHER),
        (["--all-topics"], PLAIN),
        (["--all-topics", "--include-hidden-topics"], PLAIN | HIDDEN),
        (["--all-services"], {ADD, SWITCH}),
        (["--all-services", "--exclude-services", "/switch", "/no"], {ADD}),
        (["--all-actions"], FIB | OTHER),
        (["--all-actions", "--exclude-actions", "/other"], FIB),
        (["--services", "/add", "switch"], {ADD, SWITCH}),
        (["--services", "/add", "--services", "/no"], {ADD}),
        (["--actions", "/fib"], FIB),
        (["--topics", "/count", "/camera/left"], {"/count", "/camera/left"}),
        (["/count", "--topics", "camera/left"], {"/count", "/camera/left"}),
        (["/camera/_raw", ADD], {"/camera/_raw", ADD}),
        (["--topics", "/count", "--services", "/add", "--actions", "/other"], {"/count", ADD} | OTHER),
        (["--topic-types", "std_msgs/msg/Int32", "std_msgs/Bool"], {"/count"}),
        (["--topic-types", "std_msgs/msg/String", "--exclude-topics", "/camera/depth"], {"/camera/left"}),
        (["--all-topics", "--exclude-topic-types", "std_msgs/msg/String"], {"/count"}),
        (["--all-topics", "--exclude-topics", "/count", "/camera/left"], {"/camera/depth"}),
        (["--regex", "^/(camera|add|fib)"], {"/camera/left", "/camera/depth", ADD} | FIB),
        (["--regex", "t", "--exclude-regex", "^/camera|switch"], {"/count"} | OTHER),
        (["-a", "-x", "camera", "--exclude", "^/other$", "-x", "add"], {"/count", SWITCH} | FIB),
        (["--all-topics", "--ignore-leaf-topics"], {"/camera/left"}),
        (["--topics", "/count", "--no-discovery"], {"/count"}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
async def test_selection_options_choose_recorded_topics(
    node: Node, tool: Any, tmp_path: Path, words: list[str], expected: set[str]
) -> None:
    publish_all(node)
    path = tmp_path / "bag"
    async with recording(tool, path, *words) as process:
        await wait_for_lines(process, *(f"recording {name} [" for name in expected))
        await until(lambda: count_of(path) == len(expected))
        # What else it listened to might only be written later.
        await until(lambda: expected <= followed(node))
        assert followed(node) == expected
    with BagReader(path) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == dict.fromkeys(expected, 1)
        assert len(list(reader)) == len(expected)  # each is decoded with the definition that is in the bag
    with RosbagsReader(path) as rosbags_reader:
        assert {one.topic for one in rosbags_reader.connections} == expected


async def test_unpublished_topics_are_recorded_on_request(node: Node, tool: Any, tmp_path: Path) -> None:
    publish_all(node)
    path = tmp_path / "bag"
    async with recording(tool, path, "--regex", "unpublished|count", "--include-unpublished-topics") as process:
        await wait_for_lines(process, "recording /unpublished [std_msgs/msg/String]", "recording /count [")
    assert {
        one["topic_metadata"]["name"]: one["message_count"] for one in metadata_of(path)["topics_with_message_count"]
    } == {"/count": 1, "/unpublished": 0}


async def test_new_topic_is_recorded_depending_on_polling_interval_and_discovery(
    node: Node, tool: Any, tmp_path: Path
) -> None:
    first = node.create_publisher(String, "first", QoSProfile(depth=1).transient_local())
    first.publish(String(data="1"))
    for words, expected in (
        (["--polling-interval", "1"], {"/first", "/late"}),
        (["--polling-interval", "3600000"], {"/first"}),
        (["--no-discovery"], {"/first"}),
    ):
        path = tmp_path / "_".join(words)
        async with recording(tool, path, "--all-topics", *words) as process:
            await wait_for_lines(process, "recording /first")
            late = node.create_publisher(String, "late", LATCHED)
            late.publish(String(data="2"))
            if "/late" in expected:
                await wait_for_lines(process, "recording /late")
            await taken(node)
            first.publish(String(data="3"))
            await until(lambda path=path, expected=expected: count_of(path) == 1 + len(expected))  # type: ignore[misc]
            late.close()
        with BagReader(path) as reader:
            assert {*reader.topics} == expected


async def test_requested_names_without_publisher_are_reported(node: Node, tool: Any, tmp_path: Path) -> None:
    publish_all(node)
    node.create_service(AddTwoInts, "silent", lambda one: AddTwoInts.Response())
    missing = ("--topics", "/no", "/count", "--services", "/silent", "/add", "--actions", "/act", "/fib")
    async with recording(tool, tmp_path / "bag", *missing) as process:
        await wait_for_lines(
            process,
            "no publisher of /no yet; waiting for it",
            "no publisher of events of the service /silent, whose introspection may be off, yet; waiting for it",
            "no publisher of anything of the action /act yet; waiting for it",
        )
        await wait_for_lines(process, *(f"recording {name} [" for name in ("/count", ADD, *FIB)))
    for kind, name in (("--services", "/silent"), ("--actions", "/act"), ("--topics", "/no")):
        ended = await tool("bag", "record", kind, name, "--no-discovery", "-o", str(tmp_path / name[1:]))
        assert (ended.code, f"{name}" in ended.err, "--no-discovery" in ended.err) == (1, True, True), ended.err


# ------------------------------------------------------------------------------------------- services and actions


async def test_service_events_are_recorded_with_type_and_qos(node: Node, tool: Any, tmp_path: Path) -> None:
    server = node.create_service(AddTwoInts, "add", lambda one: AddTwoInts.Response(sum=one.a + one.b))
    client = node.create_client(AddTwoInts, "add")
    for end in (server, client):
        end.configure_introspection(node.clock, EVENTS_QOS, IntrospectionState.CONTENTS)
    path = tmp_path / "bag"
    async with recording(tool, path, "--services", "/add") as process:
        await wait_for_lines(process, f"recording {ADD} [example_interfaces/srv/AddTwoInts_Event]")
        assert (await client.call(AddTwoInts.Request(a=2, b=3), 10)).sum == 5
        await until(lambda: count_of(path) == 4)
    (metadata,) = metadata_of(path)["topics_with_message_count"]
    topic = metadata["topic_metadata"]
    assert (topic["name"], topic["type"]) == (ADD, "example_interfaces/srv/AddTwoInts_Event")
    assert topic["type_description_hash"] == type_hash(AddTwoInts.Event)
    for offered in OfferedQoS.parse(topic["offered_qos_profiles"]):
        assert (offered.durability, offered.reliability) == (Durability.TRANSIENT_LOCAL, Reliability.RELIABLE)
    with BagReader(path) as reader:
        events = [item.message for item in reader]
    assert {one.info.event_type for one in events} == {*map(int, ServiceEventType)}
    assert {(one.request[0].a, one.request[0].b) for one in events if one.request} == {(2, 3)}
    assert {one.response[0].sum for one in events if one.response} == {5}


async def test_feedback_and_status_of_running_action_are_recorded(node: Node, tool: Any, tmp_path: Path) -> None:
    async def run(goal: Any) -> Any:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
        return Fibonacci.Result(sequence=[1, 2])

    node.create_action_server(Fibonacci, "fib", run)
    client = node.create_action_client(Fibonacci, "fib")
    path = tmp_path / "bag"
    async with recording(tool, path, "--actions", "fib") as process:
        await wait_for_lines(process, "recording /fib/_action/feedback [", "recording /fib/_action/status [")
        handle = await client.send_goal(Fibonacci.Goal(order=2))
        assert [*(await handle.result(10))[1].sequence] == [1, 2]
        await until(lambda: count_of(path) >= 3)
    with BagReader(path) as reader:
        (feedback,) = [item.message for item in reader.messages("/fib/_action/feedback")]
        assert [*feedback.feedback.sequence] == [1]
        statuses = [item.message for item in reader.messages("/fib/_action/status")]
        assert statuses[-1].status_list[-1].status == 4  # succeeded
        (offered,) = OfferedQoS.parse(reader.topics["/fib/_action/status"].offered_qos)
        assert offered.durability is Durability.TRANSIENT_LOCAL


# ------------------------------------------------------------------------------------------------------ quality, time


async def test_qos_overrides_apply_to_recorder_subscriptions(node: Node, tool: Any, tmp_path: Path) -> None:
    words = node.create_publisher(String, "words", LATCHED)
    words.publish(String(data="before"))
    node.create_publisher(String, "kept", LATCHED).publish(String(data="kept"))
    file = tmp_path / "qos.yaml"
    file.write_text("/words: {durability: volatile, reliability: best_effort, history: keep_last, depth: 3}\n")
    path = tmp_path / "bag"
    async with recording(tool, path, "/words", "/kept", "--qos-profile-overrides-path", str(file)) as process:
        await wait_for_lines(process, "recording /words", "recording /kept")
        (found,) = node.get_subscriptions_info_by_topic("/words")
        assert (found.qos_profile.durability, found.qos_profile.reliability) == (
            Durability.VOLATILE,
            Reliability.BEST_EFFORT,
        )
        words.publish(String(data="after"))
        await until(lambda: count_of(path) == 2)
    assert sorted(words_of(path)) == ["after", "kept"]
    with BagReader(path) as reader:  # what is in the bag is what was offered
        (offered,) = OfferedQoS.parse(reader.topics["/words"].offered_qos)
        assert offered.durability is Durability.TRANSIENT_LOCAL
    file.write_text("/words:\n  depht: 3\n")
    ended = await tool("bag", "record", "/words", "--qos-profile-overrides-path", str(file))
    assert (ended.code, f"error: {file}:2:3: expected policies" in ended.err) == (1, True)
    ended = await tool("bag", "record", "/words", "--qos-profile-overrides-path", str(tmp_path / "none"))
    assert (ended.code, "No such file" in ended.err) == (1, True)


async def test_use_sim_time_records_simulated_log_times(node: Node, tool: Any, tmp_path: Path) -> None:
    words = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    async with recording(tool, path, "/words", "--use-sim-time") as process:
        await wait_for_lines(process, "recording /words")
        words.publish(String(data="too early"))
        await taken(node)
        clock = node.create_publisher(Clock, "/clock", QoSProfile(depth=1))
        now = Clock()
        now.clock.sec = 50
        await clock.wait_for_subscribers(10)

        def goes_on() -> bool:
            """The recorder writes only after it has received the time."""
            clock.publish(now)
            words.publish(String(data="in time"))
            return count_of(path) > 0

        await until(goes_on)
    with BagReader(path) as reader:
        items = list(reader)
    assert {item.log_time for item in items} == {50 * S}
    assert {item.message.data for item in items} == {"in time"}


# --------------------------------------------------------------------------------------------------- storage, metadata


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize(
    ("words", "mode"),
    [
        ([], ""),
        (["--compression-mode", "file", "--compression-format", "zstd", "--compression-threads", "2"], "FILE"),
        (["--compression-mode", "message"], "MESSAGE"),
    ],
)
async def test_bags_of_both_storages_are_split_and_compressed(
    node: Node, tool: Any, tmp_path: Path, storage: str, words: list[str], mode: str
) -> None:
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    options = ("-b", "1000", "--custom-data", "robot=r2", "run=a=b", "-f", "cdr", *words)
    async with recording(tool, path, "--topics", "/words", "-s", storage, *options) as process:
        await wait_for_lines(process, "recording /words")
        for number in range(6):
            publisher.publish(String(data=f"{number:0600}"))
        await until(lambda: len([*path.glob("bag_2.*")]) == 1)
    metadata = metadata_of(path)
    assert (metadata["storage_identifier"], metadata["compression_mode"]) == (storage, mode)
    assert metadata["custom_data"] == {"robot": "r2", "run": "a=b"}
    suffix = {"mcap": ".mcap", "sqlite3": ".db3"}[storage] + ".zstd" * (mode == "FILE")
    assert metadata["relative_file_paths"] == [f"bag_{number}{suffix}" for number in range(3)]
    assert [int(one) for one in words_of(path)] == [*range(6)]
    with RosbagsReader(path) as rosbags_reader:
        assert rosbags_reader.message_count == len(list(rosbags_reader.messages())) == 6


async def test_recording_is_split_by_max_bag_duration(node: Node, tool: Any, tmp_path: Path) -> None:
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    options = ("--max-bag-duration", "0.05", "--max-bag-size", "0", "--compression", "lz4")
    async with recording(tool, path, "/words", *options) as process:
        await wait_for_lines(process, "recording /words")

        def is_split() -> bool:
            publisher.publish(String(data="w"))
            return len([*path.glob("bag_*.mcap")]) >= 3

        await until(is_split)
    assert len(metadata_of(path)["relative_file_paths"]) >= 3
    with (path / "bag_0.mcap").open("rb") as stream:
        assert {one.compression for one in make_reader(stream).get_summary().chunk_indexes} == {"lz4"}  # type: ignore[union-attr]


# ------------------------------------------------------------------------------------------------- pausing, snapshots


async def test_services_pause_resume_and_split_recording(node: Node, tool: Any, tmp_path: Path) -> None:
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"

    async def publish(text: str, *, recorded: int) -> None:
        publisher.publish(String(data=text))
        await taken(node)
        await until(lambda: count_of(path) == recorded)

    recorder = Rosbag2Services(node, RECORDER)
    async with recording(tool, path, "/words", "--start-paused") as process:
        await wait_for_lines(process, "paused from the start")
        await wait_for_lines(process, "recording /words")
        assert await taken(node)
        await publish("a", recorded=0)
        await recorder("resume")
        await publish("b", recorded=1)
        await recorder("pause")
        await publish("c", recorded=1)
        await recorder("toggle_paused")
        await recorder("split_bagfile")
        await publish("d", recorded=2)
        assert not await taken(node)
    assert words_of(path) == ["b", "d"]
    assert [one["message_count"] for one in metadata_of(path)["files"]] == [1, 1]


async def test_split_service_does_not_split_single_file_bag(node: Node, tool: Any, tmp_path: Path) -> None:
    node.create_publisher(String, "words", LATCHED).publish(String(data="w"))
    path = tmp_path / "a.mcap"
    async with recording(tool, path, "/words") as process:
        await wait_for_lines(process, "recording /words")
        await Rosbag2Services(node, RECORDER)("split_bagfile")
        await wait_for_lines(process, f"{path} is one file; only a folder can be split")
        await until(lambda: count_of(path) == 1)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
async def test_snapshot_contains_most_recent_messages_within_cache_size(
    node: Node, tool: Any, tmp_path: Path, storage: str
) -> None:
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    options = ("--snapshot-mode", "--max-cache-size", "4000", "--node-name", "box", "-s", storage)
    process = await tool.start("bag", "record", "/words", "-o", str(path), *options)
    await wait_for_lines(process, "recording /words")
    box = Rosbag2Services(node, "/box")
    for numbers, there in (((0, 10), 3), ((10, 12), 5), ((12, 12), 5)):
        for number in range(*numbers):
            publisher.publish(String(data=f"{number:01000}"))
        await taken(node, "/box")
        while not (await box("snapshot")).success:
            pass  # the one before is still being written
        await until(lambda there=there: sum(map(count_of, files_of(path))) == there)  # type: ignore[misc]
    publisher.publish(String(data="never"))
    publisher.publish(String(data="x" * 4000))
    await taken(node, "/box")
    ended = await tool.interrupt(process)
    assert ended.code == 0 and "recorded 5 messages of 1 topic" in ended.err
    assert "1 message larger than --max-cache-size, hence not in a snapshot\n" in ended.err
    assert "more arrived" not in ended.err
    assert [int(one) for one in words_of(path)] == [7, 8, 9, 10, 11]
    assert [one["message_count"] for one in metadata_of(path)["files"]][:2] == [3, 2]
    with RosbagsReader(path) as rosbags_reader:
        assert rosbags_reader.message_count == 5


class Slow(BagWriter):
    """A bag on a disk that waits for the test."""

    def __init__(self, path: Path, may_write: Any) -> None:
        super().__init__(path)
        self._may_write = may_write

    def write(self, *arguments: Any) -> None:
        self._may_write.wait(20)
        super().write(*arguments)


def test_writer_drops_messages_beyond_max_bytes_and_refuses_concurrent_snapshots(tmp_path: Path) -> None:
    import threading

    for snapshots in (False, True):
        may_write = threading.Event()
        path = tmp_path / str(snapshots)
        bag = Slow(path, may_write)
        bag.add_topic("/words", String)
        data = String(data="x" * 990).encode()
        writer = WriterThread(bag, lambda: None, max_bytes=3 * len(data) + 700, snapshots=snapshots)
        for number in range(10):
            writer.enqueue("/words", data, number, number)
        if snapshots:
            writer.enqueue("/words", data * 4, 11, 11)  # more than there is room for
            assert (writer.dropped, writer.retained_count) == (1, 3)
            assert writer.snapshot()
            assert not writer.snapshot()
        else:
            assert 10 - writer.messages == writer.dropped == 6
            assert not writer.snapshot()
        may_write.set()
        writer.end()
        with BagReader(path) as reader:
            assert [item.log_time for item in reader] == ([7, 8, 9] if snapshots else [0, 1, 2, 3])


def test_small_messages_take_no_more_memory_than_snapshot_limit(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        writer = WriterThread(bag, lambda: None, max_bytes=1_000_000, snapshots=True)
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        for number in range(20_000):
            at = 10**18 + number
            writer.enqueue("/words", b"\0\1\0\0" + number.to_bytes(4, "little"), at, at + 1)
        taken = tracemalloc.get_traced_memory()[0] - before
        tracemalloc.stop()
        writer.end()
    assert 700_000 < taken < 1_100_000


def test_full_disk_error_contains_path_once(tmp_path: Path) -> None:
    for name, error in (("db3", BagError(f"{tmp_path / 'db3'}: full")), ("mcap", OSError(28, "full", "a file"))):
        with BagWriter(tmp_path / name) as bag:
            writer = WriterThread(bag, lambda: None)
            bag.write = raising(error)  # type: ignore[method-assign]
            writer.enqueue("/a", b"", 0, 0)
            with pytest.raises(CommandError) as caught:
                writer.end()
        assert str(caught.value).startswith(f"{tmp_path / name}: full; earlier messages")


def raising(error: Exception) -> Any:
    def fail(*_: object) -> None:
        raise error

    return fail


# ----------------------------------------------------------------------------------------------------- the command line


def test_invalid_record_arguments_are_reported(run_here: Any, tmp_path: Path) -> None:
    out = str(tmp_path / "bag")
    for words, code, text in (
        ([], 2, "expected topics, --services"),
        (["--exclude-topics", "/a"], 2, "expected topics, --services"),
        (["-a", "-o", str(tmp_path)], 1, "exists already"),
        (["/a", "--compression-format", "zstd"], 2, "--compression-format requires --compression-mode"),
        (["/a", "--compression", "lz4", "-s", "sqlite3"], 2, "--compression applies to chunks of MCAP files"),
        (["/a", "--use-sim-time", "--no-discovery"], 2, "--use-sim-time waits for /clock"),
        (["/a", "--snapshot-mode", "--max-cache-size", "0"], 2, "--snapshot-mode requires a --max-cache-size"),
        (["/a", "--custom-data", "x"], 2, 'expected KEY=VALUE, found "x"'),
        (["/a", "-f", "json"], 2, "'json' is not"),
        (["/a", "--exclude-regex", "("], 1, '"(" is not a regular expression'),
        (["--services", "/a b"], 1, "/a b"),
        (["--topic-types", "a/b/c/d"], 1, "a/b/c/d"),
        (["/a", "--node-name", "no name", "--discovery", "off"], 1, "no name"),
        (["/a", "-o", out + ".mcap", "--compression-mode", "file", "--discovery", "off"], 1, "is one file"),
        (["/a", "-o", out + ".mcap", "-s", "sqlite3", "--discovery", "off"], 1, "is a folder"),
    ):
        found, _, err = run_here("bag", "record", *words)
        assert (found, text in err, "Traceback" in err) == (code, True, False), (words, err)
    assert [*tmp_path.iterdir()] == []
    assert "no publisher of /x" in run_here("bag", "record", "/x", "--no-discovery", "--discovery", "off", "-o", out)[2]
