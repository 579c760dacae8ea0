"""``rosidl-py bag`` with a node of the test: recording, playing and keyboard control."""

from __future__ import annotations

import asyncio
import json
import os
import re
import resource
import signal
import sys
import termios
import time
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.typesys import Stores, get_typestore
from support.bag_samples import count_of, wait_for_lines, write_foreign, write_map_and_words
from support.generated_packages import GENERATED
from support.processes import start_process
from support.waiting import until

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.ros_cli.bag.player_recorder import keys_of, read_keys
from rosidl_py_gen.runtime import BackendMissingError, Durability, QoSProfile, Reliability

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.worlds import World

    from rosidl_py_gen.runtime import Node


S = 1_000_000_000
RIGHT, UP, DOWN, SPACE = b"\x1b[C", b"\x1bOA", b"\x1b[B", b" "
HIDE_CURSOR = "\x1b[?25l"
TERMINAL = "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
RUN = f"{TERMINAL}os.execv(sys.executable, [sys.executable, '-m', 'rosidl_py_gen.ros_cli', *sys.argv[1:]])"
LATCHED = QoSProfile().transient_local()
String: Any = get_message("std_msgs/msg/String")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
ODD = "string name\nother/Inner inner\n" + "=" * 80 + "\nMSG: other/Inner\nint32[] numbers\n"


@pytest.fixture
def node(dds: World) -> Node:
    return dds.node("robot", enable_rosout=False, parameter_events=False)


# ------------------------------------------------------------------------------------------------------------- record


async def test_record_all_stores_messages_and_offered_qos_readable_by_rosbags(
    network: World, tool: Any, tmp_path: Path
) -> None:
    node = network.node("robot", enable_rosout=False, parameter_events=False)
    words = node.create_publisher(String, "words", QoSProfile().best_effort())
    node.create_publisher(String, "map", LATCHED).publish(String(data="map"))
    node.create_publisher(String, "_hidden", LATCHED).publish(String(data="no"))
    node.create_publisher(String, "left_out", LATCHED).publish(String(data="no"))
    process = await tool.start("bag", "record", "-a", "-x", "left", "-o", str(tmp_path / "bag"))
    assert await words.wait_for_subscribers(20)
    before = time.time_ns()
    for number in range(50):
        words.publish(String(data=f"w{number}"))
    late = node.create_publisher(String, "late")
    assert await late.wait_for_subscribers(20)
    late.publish(String(data="late"))
    await until(lambda: count_of(tmp_path / "bag") == 52, 20)  # flushed once a second
    ended = await tool.interrupt(process, signal.SIGTERM)
    assert ended.code == 0, ended.err
    size = 628 if network.kind == "dds" else 615  # DDS fills up to multiples of four bytes
    assert f"recorded 52 messages of 3 topics, {size} B, in {tmp_path / 'bag'}\n" in ended.err
    with BagReader(tmp_path / "bag") as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {"/late": 1, "/map": 1, "/words": 50}
        (offered,) = OfferedQoS.parse(reader.topics["/map"].offered_qos)
        assert (offered.durability, offered.reliability) == (Durability.TRANSIENT_LOCAL, Reliability.RELIABLE)
        assert reader.has_index
        items = list(reader.messages("/words"))
    assert [item.message.data for item in items] == [f"w{number}" for number in range(50)]
    assert all(before <= item.publish_time <= item.log_time <= time.time_ns() for item in items)
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsReader(tmp_path / "bag") as rosbags_reader:
        decoded = [store.deserialize_cdr(data, one.msgtype) for one, _, data in rosbags_reader.messages()]
    assert sorted(one.data for one in decoded)[0] == "late"  # type: ignore[attr-defined]


async def test_unknown_type_is_recorded_with_definition_from_its_node(node: Node, tool: Any, tmp_path: Path) -> None:
    cls = compile_definition("nobody_has/msg/Odd", ODD)
    sample = cls(name="odd")
    node.create_publisher(cls, "odd", LATCHED).publish(sample)
    process = await tool.start("bag", "record", "/odd", "-o", str(tmp_path / "bag"), ROSIDL_PY_GEN_CACHE=str(tmp_path))
    await wait_for_lines(process, "recording /odd [nobody_has/msg/Odd]")
    await until(lambda: count_of(tmp_path / "bag") == 1, 20)
    ended = await tool.interrupt(process)
    assert ended.code == 0 and "recorded 1 message of 1 topic" in ended.err
    script = (
        "import sys\nfrom rosidl_py_gen.bags import BagReader\n"
        "for item in BagReader(sys.argv[1]): print(item.topic, item.message.name, item.message.inner.numbers.dtype)\n"
    )
    process = await start_process(
        *(sys.executable, "-c", script, str(tmp_path / "bag")), stdout=asyncio.subprocess.PIPE
    )
    out, _ = await process.communicate()
    assert out == b"/odd odd int32\n"


async def test_recording_on_full_disk_fails_and_leaves_readable_file(node: Node, tool: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    process = await tool.start("bag", "record", "/words", "-o", str(path), "--compression", "none")
    await wait_for_lines(process, "no publisher of /words yet")
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (12_000_000, 12_000_000))
    words = node.create_publisher(String, "words")
    assert await words.wait_for_subscribers(20)
    while process.returncode is None:
        words.publish(String(data="x" * 100_000))
        await asyncio.sleep(0.005)
    ended = await tool.end(process)
    assert (ended.code, ended.out) == (1, "")
    assert f"error: {path}: File too large; earlier messages can be read" in ended.err
    with BagReader(path) as reader:
        assert sum(1 for _ in reader) > 10


# --------------------------------------------------------------------------------------------------------------- play


def test_record_without_middleware_fails_and_creates_no_bag(run_here: Any, tmp_path: Path, monkeypatch: Any) -> None:
    def missing(*_: object) -> None:
        raise BackendMissingError("no middleware")

    monkeypatch.setattr("rosidl_py_gen.runtime.node.context.resolve_transport", missing)
    assert run_here("bag", "record", "--all", "-o", str(tmp_path / "bag")) == (1, "", "error: no middleware\n")
    assert list(tmp_path.iterdir()) == []


async def test_play_publishes_with_recorded_qos_at_requested_rate(network: World, tool: Any, tmp_path: Path) -> None:
    node = network.node("robot", enable_rosout=False, parameter_events=False)
    path = write_map_and_words(tmp_path / "bag")
    words = node.create_subscription(String, "received_texts", qos=QoSProfile(depth=100).best_effort())
    latched = node.create_subscription(String, "map", qos=LATCHED)
    clock = node.create_subscription(Clock, "clock", qos=QoSProfile(depth=100))
    process = await tool.start(
        *(
            "bag",
            "play",
            str(path),
            "--remap",
            "/words:=/received_texts",
            "--rate",
            "2",
            "--clock",
            "50",
            "--delay",
            "2",
        )
    )
    times = []
    for number in range(20):
        message, info = await words.receive_with_info(20)
        assert message.data == f"w{number}"
        times.append(info.source_timestamp_ns)
    assert times[-1] - times[0] > 0.02 * S
    assert median(after - before for before, after in pairwise(times)) < 0.04 * S  # 0.05 at the rate of the bag
    assert (await latched.receive(10)).data == "map"
    stamps = [(await clock.receive(10)).clock.sec for _ in range(5)]
    assert set(stamps) == {1000}
    ended = await tool.end(process)
    assert (ended.code, ended.err) == (0, "published 21 messages of 2 topics\n")


# ---------------------------------------------------------------------------------------------------- info and convert


def test_info_prints_contents_of_bag_and_reports_damaged_files(run_here: Any, tmp_path: Path) -> None:
    path = write_map_and_words(tmp_path / "bag")
    code, out, _ = run_here("bag", "info", str(path), "--json")
    document = json.loads(out)
    assert (code, document["messages"], document["duration_ns"], document["storage"]) == (0, 21, 19 * S // 20, "mcap")
    assert document["topics"][1]["offered_qos"][0]["reliability"] == "best_effort"
    out = run_here("bag", "info", str(path))[1]
    assert "Duration:   0.950 s\n" in out and "/map\tstd_msgs/msg/String\t1\treliable, transient local\n" in out
    (tmp_path / "no.mcap").write_bytes(b"no bag")
    for name, text in (("no.mcap", "damaged"), ("nowhere", "file does not exist"), ("nowhere.mcap", "No such file")):
        code, _, err = run_here("bag", "info", str(tmp_path / name))
        assert (code, text in err, "Traceback" in err) == (1, True, False), err


def test_info_counts_messages_of_file_without_statistics(run_here: Any, tmp_path: Path) -> None:
    channels = [
        (topic, "std_msgs/msg/String", "string data", [(number, String(data="x").encode()) for number in range(count)])
        for topic, count in (("/a", 3), ("/b", 2), ("/c", 0))
    ]
    path = write_foreign(tmp_path / "a.mcap", *channels, use_statistics=False)  # as rosbags wrote them until 0.10
    code, out, _ = run_here("bag", "info", str(path))
    assert code == 0 and "Messages:   5\n" in out and "None" not in out
    assert [row.split("\t")[2] for row in out.splitlines() if row.startswith("/")] == ["3", "2", "0"]
    document = json.loads(run_here("bag", "info", str(path), "--json")[1])
    assert (document["messages"], [one["count"] for one in document["topics"]]) == (5, [3, 2, 0])


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_convert_writes_selection_in_other_storage_and_back(run_here: Any, tmp_path: Path, storage: str) -> None:
    path, part, back = write_map_and_words(tmp_path / "bag"), tmp_path / "part", tmp_path / "back.mcap"
    options = ("--topics", "/words", "--start-offset", "0.5", "--max-bag-duration", "0.25")
    code, out, err = run_here("bag", "convert", str(path), str(part), "-s", storage, *options)
    assert len(list(part.glob("part_*"))) == 2
    assert (code, out) == (0, f"10 messages of 1 topic in {part}\n"), err
    with RosbagsReader(part) as rosbags_reader:
        assert rosbags_reader.message_count == 10 and next(rosbags_reader.messages())[1] == 1000 * S + S // 2
    assert run_here("bag", "convert", str(part), str(back), "--compression", "none")[0] == 0
    with BagReader(path) as one, BagReader(back) as two:
        assert two.topics["/words"] == replace(one.topics["/words"], count=10)
        assert [item.message.data for item in two] == [f"w{number}" for number in range(10, 20)]


def test_invalid_play_and_convert_arguments_are_reported(run_here: Any, tmp_path: Path) -> None:
    path = str(write_map_and_words(tmp_path / "a.mcap"))
    out = str(tmp_path / "out")
    for words, text in (
        (["play", path, "--remap", "x"], "--remap x: expected FROM:=TO"),
        (["play", path, "--remap", "/x:=/y", "--discovery", "off"], "/x is not played; topics are /map, /words"),
        (["play", path, "--start-offset", "9"], "a.mcap is 0.950 s long"),
        (["convert", path, path], "exists already"),
        (["convert", path, out + ".mcap", "--max-bag-size", "9"], "out.mcap is one file; only a folder can be split"),
        (["convert", path, out + ".db3", "-s", "sqlite3"], "is a folder; pass a name without .db3"),
    ):
        code, _, err = run_here("bag", *words)
        assert (code, text in err) == (1, True), err


@pytest.mark.parametrize(
    ("data", "keys", "rest"),
    [
        (b" ", ["space"], b""),
        (b"\x1b[C\x1bOC", ["right", "right"], b""),
        (b"x\x1b[A\x1b[B\x1b[D y", ["up", "down", "left", "space"], b""),
        (b"\x1b", [], b"\x1b"),
        (b" \x1b[", ["space"], b"\x1b["),
        (b"\x1b[1;5C\xff\x00", [], b""),
    ],
)
def test_terminal_escape_sequences_are_parsed_into_keys(data: bytes, keys: list[str], rest: bytes) -> None:
    assert keys_of(data) == (keys, rest)


class Terminal:
    """Terminal in whose foreground a command runs, with the displayed text."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        self.before = self.state()
        self.seen = ""
        self.process: asyncio.subprocess.Process | None = None

    def state(self) -> list[Any]:
        return termios.tcgetattr(self._theirs)

    @property
    def gives_keys(self) -> bool:
        return not self.state()[3] & (termios.ICANON | termios.ECHO)

    async def start(self, *arguments: str) -> None:
        asyncio.get_running_loop().add_reader(self._ours, self._read)
        environment = {**os.environ, "PYTHONPATH": GENERATED.name, "TERM": "xterm", "NO_COLOR": ""}
        stream: Any = self._theirs
        self.process = await start_process(
            *(sys.executable, "-c", RUN, *arguments), stdin=stream, stdout=stream, stderr=stream, env=environment
        )
        await until(lambda: self.gives_keys, 60)

    def _read(self) -> None:
        with suppress(OSError):
            self.seen += os.read(self._ours, 1 << 16).decode(errors="replace")

    @property
    def last(self) -> str:
        return ["", *re.findall(r"\d s of [^;]*;", self.seen)][-1]

    def press(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    async def ended(self) -> int:
        assert self.process is not None
        return await asyncio.wait_for(self.process.wait(), 60)

    def close(self) -> None:
        if self.process is not None and self.process.returncode is None:
            self.process.kill()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


@pytest.fixture
def bag(tmp_path: Path) -> str:
    """Three strings within a thousand seconds."""
    with BagWriter(tmp_path / "bag") as writer:
        for number in range(3):
            writer.write("/words", String(data=f"w{number}"), 1000 * S + number * 500 * S)
    return str(tmp_path / "bag")


async def test_player_keys_step_pause_and_change_rate(dds: World, terminal: Terminal, bag: str) -> None:
    received_texts: list[str] = []
    node = dds.node("robot", enable_rosout=False, parameter_events=False)
    node.create_subscription(
        String, "words", lambda message: received_texts.append(message.data), qos=QoSProfile(depth=100)
    )
    await terminal.start("bag", "play", bag, "--start-paused")
    await until(lambda: "paused; space: pause" in terminal.seen, 60)
    terminal.press(RIGHT)
    await until(lambda: received_texts == ["w0"], 60)
    terminal.press(UP + UP + DOWN)
    await until(lambda: "at 1.1 times the rate" in terminal.seen, 60)
    terminal.press(SPACE)
    await until(lambda: ", paused" not in terminal.last, 60)
    terminal.press(RIGHT + SPACE + RIGHT[:1])  # no step while it plays
    await until(lambda: ", paused" in terminal.last, 60)
    terminal.press(RIGHT[1:] + RIGHT)
    await until(lambda: received_texts == ["w0", "w1", "w2"], 60)
    terminal.press(SPACE)
    assert await terminal.ended() == 0
    assert terminal.state() == terminal.before
    assert "published 3 messages of 1 topic" in terminal.seen


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGTERM, 130), (signal.SIGQUIT, -signal.SIGQUIT)],
)
async def test_signal_that_ends_player_restores_terminal(
    dds: World, terminal: Terminal, bag: str, number: int, code: int
) -> None:
    await terminal.start("bag", "play", bag, "--start-paused", "--discovery", "off")
    assert terminal.process is not None
    await until(lambda: terminal.last.endswith(", paused;"), 60)
    os.kill(terminal.process.pid, number)
    assert await terminal.ended() == code
    assert terminal.state() == terminal.before
    assert "paused" in terminal.seen and HIDE_CURSOR not in terminal.seen


async def test_suspended_player_restores_terminal_until_resumed(dds: World, terminal: Terminal, bag: str) -> None:
    await terminal.start("bag", "play", bag, "--discovery", "off")
    assert terminal.process is not None
    for _ in range(2):
        os.kill(terminal.process.pid, signal.SIGTSTP)
        await until(lambda: terminal.state() == terminal.before, 60)
        os.kill(terminal.process.pid, signal.SIGCONT)
        await until(lambda: terminal.gives_keys, 60)
    terminal.press(b"\x03")
    assert await terminal.ended() == 130
    assert terminal.state() == terminal.before


async def test_read_keys_leaves_terminal_of_another_session_unchanged(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The terminal does not control the process of the test, so it must stay unchanged."""

    class Stream:
        def fileno(self) -> int:
            return terminal._theirs

    monkeypatch.setattr(sys, "stdin", Stream())
    with pytest.raises(ZeroDivisionError), read_keys({}) as has_keys:
        assert not has_keys and terminal.state() == terminal.before
        raise ZeroDivisionError
    assert terminal.state() == terminal.before


async def test_space_key_resumes_and_pauses_recorder(dds: World, terminal: Terminal, tmp_path: Path) -> None:
    node = dds.node("robot", enable_rosout=False, parameter_events=False)
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    await terminal.start("bag", "record", "/words", "-o", str(path), "--start-paused", "--max-cache-size", "0")
    assert terminal.process is not None
    await until(lambda: "recording /words" in terminal.seen, 60)
    await publisher.wait_for_subscribers(20)
    terminal.press(b"x ")
    await until(lambda: "recording resumed" in terminal.seen, 60)
    publisher.publish(String(data="a"))
    await until(lambda: count_of(path) == 1, 20)
    terminal.press(SPACE)
    await until(lambda: "paused" in terminal.seen.rpartition("recording resumed")[2], 60)
    os.kill(terminal.process.pid, signal.SIGHUP)
    assert await terminal.ended() == -signal.SIGHUP
    assert terminal.state() == terminal.before


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (("play", "{bag}", "--start-paused"), b"paused, until the service /rosbag2_player/resume is called\n"),
        (("record", "/words", "-o", "{out}"), b"no publisher of /words yet; waiting for it\n"),
    ],
)
async def test_disabled_keyboard_controls_leave_terminal_unchanged(
    dds: World, terminal: Terminal, bag: str, tmp_path: Path, command: tuple[str, ...], line: bytes
) -> None:
    arguments = [word.format(bag=bag, out=tmp_path / "out") for word in command]
    stream: Any = terminal._theirs
    process = await start_process(
        *(sys.executable, "-c", RUN, "bag", *arguments, "--disable-keyboard-controls", "--discovery", "off"),
        stdin=stream,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stderr is not None
    assert await asyncio.wait_for(process.stderr.readline(), 60) == line
    assert terminal.state() == terminal.before
    process.terminate()
    _, rest = await asyncio.wait_for(process.communicate(), 60)
    assert b"space" not in rest
