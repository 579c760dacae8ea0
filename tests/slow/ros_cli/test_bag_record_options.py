"""``rosidl-py bag record`` with random options, against a model of what must be in the bag."""

from __future__ import annotations

import asyncio
import re
import tempfile
from collections import deque
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import event, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader as RosbagsReader
from support.bag_samples import ROSBAG2_SERVICES, Rosbag2Services, wait_for_lines
from support.commands import Tool
from support.example_counts import examples
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import compile_definition, get_action, get_message, get_service, type_hash
from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.runtime import Durability, Node, QoSProfile

S = 1_000_000_000
RECORDER = "rosbag2_recorder"
String: Any = get_message("std_msgs/msg/String")
Int32: Any = get_message("std_msgs/msg/Int32")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
AddTwoInts: Any = get_service("example_interfaces/srv/AddTwoInts")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
IsPaused: Any = compile_definition("rosbag2_interfaces/srv/IsPaused", ROSBAG2_SERVICES["is_paused"])
LATCHED = QoSProfile(depth=100).transient_local()
WAITING_BYTES = 200
"""Bytes that a retained message counts in addition to its data."""


@dataclass(frozen=True)
class Topic:
    """A topic of the graph; it belongs to itself, a service or an action."""

    name: str
    cls: Any
    kind: str = "topic"
    owner: str = ""
    is_published: bool = True
    has_subscribers: bool = False

    @property
    def owner_name(self) -> str:
        return self.owner or self.name

    @property
    def type_name(self) -> str:
        """Name of the type, of those that `TYPES` has."""
        return next((name for name, cls in TYPES.items() if cls is self.cls), "")

    def message(self, number: int, size: int) -> Any:
        """Return a message that contains the number, with a text of some size if it can have one."""
        if self.cls is String:
            return String(data=f"{number}-".ljust(size, "x"))
        if self.cls is Int32:
            return Int32(data=number)
        made = self.cls()
        if self.kind == "service":
            made.info.sequence_number = number
        else:
            made.feedback.sequence = [number]
        return made


TYPES = {"std_msgs/msg/String": String, "std_msgs/msg/Int32": Int32}
TOPICS = (
    Topic("/camera/left", String, has_subscribers=True),
    Topic("/camera/depth", String),
    Topic("/camera/_raw", String, has_subscribers=True),
    Topic("/count", Int32),
    Topic("/unpublished", String, is_published=False, has_subscribers=True),
    Topic("/add/_service_event", AddTwoInts.Event, "service", "/add"),
    Topic("/sum/_service_event", AddTwoInts.Event, "service", "/sum", has_subscribers=True),
    Topic("/fib/_action/feedback", Fibonacci.FeedbackMessage, "action", "/fib"),
)
SERVICES, ACTIONS = ["/add", "/sum"], ["/fib"]
PATTERNS = ["^/camera", "t", "add|fib", "^/count$", "raw", "/no"]


@dataclass(frozen=True)
class Options:
    """Options of the command, with the names of `Topic`; the last ones are of the storage."""

    topics: list[str]
    more_topics: list[str]
    services: list[str]
    actions: list[str]
    types: list[str]
    everything: bool
    all_topics: bool
    all_services: bool
    all_actions: bool
    regex: str | None
    exclude: list[str]
    exclude_topics: list[str]
    exclude_services: list[str]
    exclude_actions: list[str]
    exclude_types: list[str]
    hidden: bool
    unpublished: bool
    no_leaves: bool
    no_discovery: bool
    volatile: str | None
    start_paused: bool
    sim_time: bool
    snapshot_bytes: int | None
    storage: str
    compression: str | None
    mode: str | None
    threads: int | None
    split_bytes: int | None
    split_s: float | None
    is_folder: bool

    def words(self, folder: Path) -> list[str]:
        """Return the command line; each name may be written with or without its slash."""
        lists = {
            "--topics": self.more_topics,
            "--services": self.services,
            "--actions": [name.removeprefix("/") for name in self.actions],
            "--topic-types": self.types,
            "--exclude-topics": [*self.exclude_topics, *["/clock"] * self.sim_time],
            "--exclude-services": [name.removeprefix("/") for name in self.exclude_services],
            "--exclude-actions": self.exclude_actions,
            "--exclude-topic-types": self.exclude_types,
        }
        flags = {
            "--all": self.everything,
            "--all-topics": self.all_topics,
            "--all-services": self.all_services,
            "--all-actions": self.all_actions,
            "--include-hidden-topics": self.hidden,
            "--include-unpublished-topics": self.unpublished,
            "--ignore-leaf-topics": self.no_leaves,
            "--no-discovery": self.no_discovery,
            "--start-paused": self.start_paused,
            "--use-sim-time": self.sim_time,
            "--snapshot-mode": self.snapshot_bytes is not None,
        }
        values = {
            "--regex": self.regex,
            "--qos-profile-overrides-path": None if self.volatile is None else folder / "qos.yaml",
            "--max-cache-size": self.snapshot_bytes,
            "--storage": self.storage,
            "--compression": self.compression,
            "--compression-mode": self.mode,
            "--compression-threads": self.threads,
            "--max-bag-size": self.split_bytes,
            "--max-bag-duration": self.split_s,
            "--output": folder / ("bag" if self.is_folder else "bag.mcap"),
        }
        return [
            *self.topics,
            *(word for name, items in lists.items() if items for word in (name, *items)),
            *(name for name, is_set in flags.items() if is_set),
            *(word for name, value in values.items() if value is not None for word in (name, str(value))),
            *(word for pattern in self.exclude for word in ("-x", pattern)),
        ]

    def is_excluded(self, kind: str, name: str, type_name: str) -> bool:
        names = {"topic": self.exclude_topics, "service": self.exclude_services, "action": self.exclude_actions}[kind]
        is_type_excluded = kind == "topic" and type_name in self.exclude_types
        return name in names or is_type_excluded or any(re.search(pattern, name) for pattern in self.exclude)

    def is_recorded(self, topic: Topic) -> bool:
        if not (topic.is_published or self.unpublished) or (self.no_leaves and not topic.has_subscribers):
            return False
        if topic.name in (*self.topics, *self.more_topics):
            return not self.is_excluded("topic", topic.name, topic.type_name)
        if self.is_excluded(topic.kind, topic.owner_name, topic.type_name):
            return False
        is_hidden = topic.kind == "topic" and "/_" in topic.name and not self.hidden
        is_chosen = (
            self.everything
            or {"topic": self.all_topics, "service": self.all_services, "action": self.all_actions}[topic.kind]
            or topic.owner_name in {"topic": [], "service": self.services, "action": self.actions}[topic.kind]
            or (topic.kind == "topic" and topic.type_name in self.types)
            or (self.regex is not None and re.search(self.regex, topic.owner_name) is not None)
        )
        return is_chosen and not is_hidden

    def are_names_missing(self, recorded: list[Topic]) -> bool:
        """Return True if a topic, service or action that is named is not recorded."""
        named = {("topic", name) for name in (*self.topics, *self.more_topics)}
        named |= {("service", name) for name in self.services} | {("action", name) for name in self.actions}
        return not named <= {("topic", one.name) for one in recorded} | {(one.kind, one.owner_name) for one in recorded}


@st.composite
def all_options(draw: st.DrawFn) -> Options:
    def some(names: list[str]) -> list[str]:
        return draw(st.lists(st.sampled_from(names), max_size=2, unique=True)) if draw(st.integers(0, 2)) == 0 else []

    def rarely() -> bool:
        return draw(st.integers(0, 4)) == 0

    published = [one.name for one in TOPICS]
    chosen: dict[str, Any] = {
        "topics": some(published),
        "more_topics": some(published),
        "services": some(SERVICES),
        "actions": some(ACTIONS),
        "types": some([*TYPES]),
        "everything": draw(st.booleans()),
        "all_topics": rarely(),
        "all_services": rarely(),
        "all_actions": rarely(),
        "regex": draw(st.none() | st.sampled_from(PATTERNS)),
    }
    storage = draw(st.sampled_from(["mcap", "sqlite3"]))
    mode = draw(st.sampled_from([None, None, "none", "file", "message"]))
    split_bytes = draw(st.sampled_from([None, 0, 1, 300, 1000]))
    sim_time = draw(st.booleans())
    split_s = draw(st.sampled_from([None, 0, 0.5, 2])) if sim_time else None
    may_be_file = storage == "mcap" and mode in (None, "none") and not split_bytes and not split_s
    return Options(
        **chosen,
        exclude=some(PATTERNS),
        exclude_topics=some(published),
        exclude_services=some(SERVICES),
        exclude_actions=some(ACTIONS),
        exclude_types=some([*TYPES]),
        hidden=draw(st.booleans()),
        unpublished=draw(st.booleans()),
        no_leaves=rarely(),
        no_discovery=not sim_time and rarely(),
        volatile=draw(st.none() | st.sampled_from(published)),
        start_paused=rarely(),
        sim_time=sim_time,
        snapshot_bytes=draw(st.sampled_from([500, 2000])) if rarely() else None,
        storage=storage,
        compression=draw(st.sampled_from([None, "zstd", "lz4", "none"])) if storage == "mcap" else None,
        mode=mode,
        threads=draw(st.sampled_from([None, 0, 2])),
        split_bytes=split_bytes,
        split_s=split_s,
        is_folder=not may_be_file or draw(st.booleans()),
    )


STEPS = st.one_of(
    st.tuples(st.just("publish"), st.sampled_from([1, 100, 600])),
    st.tuples(st.just("publish"), st.sampled_from([1, 100, 600])),
    st.tuples(st.sampled_from(["pause", "resume", "toggle_paused", "split_bagfile", "snapshot"]), st.just(0)),
    st.tuples(st.just("clock"), st.sampled_from([0.2, 0.5, 3.0])),
)


@dataclass
class Model:
    """The files that the recorder must write."""

    options: Options
    is_paused: bool = False
    now_ns: int = 0
    files: list[list[tuple[str, bytes, int]]] = field(default_factory=lambda: [[]])
    retained: deque[tuple[str, bytes, int]] = field(default_factory=deque)

    def receive(self, topic: str, data: bytes) -> None:
        if self.is_paused or (self.options.sim_time and not self.now_ns):
            return
        message = topic, data + bytes(-len(data) % 4), self.now_ns  # DDS fills the last four bytes
        room = self.options.snapshot_bytes
        if room is None:
            self.write(message)
        elif len(message[1]) + WAITING_BYTES <= room:
            self.retained.append(message)
            while sum(len(one[1]) + WAITING_BYTES for one in self.retained) > room:
                self.retained.popleft()

    def write(self, message: tuple[str, bytes, int]) -> None:
        file, limits = self.files[-1], self.options
        is_large = limits.split_bytes and sum(len(data) for _, data, _ in file) >= limits.split_bytes
        is_long = limits.split_s and file and message[2] - file[0][2] >= limits.split_s * S
        if is_large or is_long:
            self.files.append([])
        self.files[-1].append(message)

    def split(self) -> None:
        if self.options.is_folder and self.files[-1]:
            self.files.append([])

    def snapshot(self) -> None:
        self.split()
        while self.retained:
            self.write(self.retained.popleft())

    @property
    def messages(self) -> list[tuple[str, bytes, int]]:
        return [message for file in self.files for message in file]


async def record(options: Options, steps: list[tuple[str, float]], world: World, tool: Tool, folder: Path) -> None:
    """Run the recorder, do the steps, and compare the bag with the model."""
    node = world.node("robot", enable_rosout=False, parameter_events=False)
    publishers = {one.name: node.create_publisher(one.cls, one.name, LATCHED) for one in TOPICS if one.is_published}
    for topic in TOPICS:
        if topic.has_subscribers:
            node.create_subscription(topic.cls, topic.name)
    (folder / "qos.yaml").write_text(f"{options.volatile}: {{durability: volatile}}\n")
    recorded = [one for one in TOPICS if options.is_recorded(one)]
    model = Model(options, options.start_paused)
    early = publishers["/count"]  # one message, because messages of several topics arrive in any order
    early.publish(Int32(data=-1))
    is_paused = node.create_client(IsPaused, f"/{RECORDER}/is_paused")
    process = await tool.start("bag", "record", *options.words(folder))
    if options.no_discovery and options.are_names_missing(recorded):
        ended = await tool.end(process)
        assert ended.code == 1 and "--no-discovery does not wait for one" in ended.err
        return
    await is_paused.wait_for_service(20)
    await wait_for_lines(process, *(f"recording {one.name} [" for one in recorded))
    if any(one.name == "/count" for one in recorded) and options.volatile != "/count":
        model.receive("/count", Int32(data=-1).encode())
    clock = node.create_publisher(Clock, "/clock", QoSProfile(depth=1)) if options.sim_time else None
    if clock is not None:
        await clock.wait_for_subscribers(20)
    service = Rosbag2Services(node, f"/{RECORDER}")
    for number, (step, size) in enumerate(steps):
        if step == "publish":
            for topic in recorded:
                if topic.is_published:
                    message = topic.message(number, int(size))
                    publishers[topic.name].publish(message)
                    await is_paused.call(IsPaused.Request(), 20)  # the message has been received
                    model.receive(topic.name, message.encode())
        elif step == "clock":
            if clock is not None:
                model.now_ns += round(size * S)
                now = Clock()
                now.clock.sec, now.clock.nanosec = divmod(model.now_ns, S)
                clock.publish(now)
        elif step == "snapshot":
            if options.snapshot_bytes is not None:
                while not (await service("snapshot")).success:
                    pass  # the one before is still being written
                model.snapshot()
        else:
            await service(step)
            model.is_paused = {"pause": True, "resume": False, "toggle_paused": not model.is_paused}.get(
                step, model.is_paused
            )
            if step == "split_bagfile":
                model.split()
        assert (await is_paused.call(IsPaused.Request(), 20)).paused == model.is_paused
    await until(lambda: {*profiles_of(node)} == {one.name for one in recorded})
    for name, profile in profiles_of(node).items():
        if name in publishers:
            assert (profile.durability is Durability.VOLATILE) == (name == options.volatile), name
    ended = await tool.interrupt(process)
    assert ended.code == 0
    counts = f"{pluralize(len(model.messages), 'message')} of {pluralize(len(recorded), 'topic')}"
    assert f"recorded {counts}, " in ended.err and "more arrived" not in ended.err
    event("files", min(len(model.files), 3))
    compare(model, recorded, folder / ("bag" if options.is_folder else "bag.mcap"))


def profiles_of(node: Node) -> dict[str, QoSProfile]:
    """Return the topics that the recorder has subscribed to, with its QoS."""
    return {
        topic.name: one.qos_profile
        for topic in TOPICS
        for one in node.get_subscriptions_info_by_topic(topic.name)
        if one.node_name == RECORDER
    }


def compare(model: Model, recorded: list[Topic], path: Path) -> None:
    options = model.options
    with BagReader(path) as reader:
        found = [(one.channel.name, bytes(one.data), one.log_time) for one in reader.raw_messages()]
        topics = {name: (topic.count, topic.type_hash) for name, topic in reader.topics.items()}
        for topic in recorded:
            offered = {one.durability for one in OfferedQoS.parse(reader.topics[topic.name].offered_qos)}
            assert offered == ({Durability.TRANSIENT_LOCAL} if topic.is_published else set())
    if not options.sim_time:
        assert [at for _, _, at in found] == sorted(at for _, _, at in found)
        found = [(name, data, 0) for name, data, _ in found]
    assert found == model.messages
    names = [name for name, _, _ in model.messages]
    assert topics == {one.name: (names.count(one.name), type_hash(one.cls)) for one in recorded}
    files = [path]
    if options.is_folder:
        metadata = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        mode = (options.mode or "none").replace("none", "").upper()
        assert (metadata["storage_identifier"], metadata["compression_mode"]) == (options.storage, mode)
        assert metadata["message_count"] == len(found)
        assert [one["message_count"] for one in metadata["files"]] == [*map(len, model.files)]
        suffix = {"mcap": ".mcap", "sqlite3": ".db3"}[options.storage] + ".zstd" * (mode == "FILE")
        assert metadata["relative_file_paths"] == [f"bag_{number}{suffix}" for number in range(len(model.files))]
        files = [path / name for name in metadata["relative_file_paths"]]
        with RosbagsReader(path) as rosbags_reader:
            assert [(one.topic, bytes(data)) for one, _, data in rosbags_reader.messages()] == [
                (name, data) for name, data, _ in model.messages
            ]
    if options.storage == "mcap" and options.mode != "file":
        expected = options.compression or ("zstd" if options.mode in (None, "none") else "none")
        for file, messages in zip(files, model.files, strict=True):
            with file.open("rb") as stream:
                summary = make_reader(stream).get_summary()
                assert summary is not None
                kinds = {one.compression or "none" for one in summary.chunk_indexes if one.message_index_offsets}
                assert kinds == ({expected} if messages else set())


@settings(max_examples=examples(100))
@given(all_options(), st.lists(STEPS, max_size=8))
def test_bag_contains_what_random_options_and_steps_select(options: Options, steps: list[tuple[str, float]]) -> None:
    with (
        tempfile.TemporaryDirectory() as folder,
        pytest.MonkeyPatch.context() as patch,
        closing(World("memory")) as world,
    ):
        lists = options.topics, options.more_topics, options.services, options.actions, options.types
        flags = options.everything, options.all_topics, options.all_services, options.all_actions, options.regex
        tool = Tool(world, patch)
        if not any((*lists, *flags)):
            ended = asyncio.run(tool("bag", "record", *options.words(Path(folder))))
            assert ended.code == 2 and "expected topics, --services" in ended.err
            return
        asyncio.run(asyncio.wait_for(record(options, steps, world, tool, Path(folder)), 120))
