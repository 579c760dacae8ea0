"""Output on terminals: names in one piece at 80 columns, one line for texts of peers, progress of long commands."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import os
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import zstandard
from mcap.writer import MCAP0_MAGIC
from support.terminals import CONTROL, on_terminal
from support.waiting import until

from rosidl_py_gen import compile_definition, get_message, get_service
from rosidl_py_gen.bags import BagError, BagReader, BagWriter
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.command_support.terminal_output import StatusLine
from rosidl_py_gen.ros_cli import exit_on_error
from rosidl_py_gen.ros_cli.bag import reading
from rosidl_py_gen.ros_cli.bag.reading import ProgressBar, progress_text
from rosidl_py_gen.runtime import ParameterDescriptor, QoSProfile

if TYPE_CHECKING:
    from support.commands import Tool
    from support.worlds import World


LONG_TOPIC = "/robot_with_a_long_name/perception/front_left/object_candidates"
LONG_TYPE = "a_package_with_a_long_name_msgs/msg/ObjectCandidateWithCovariance"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
assert len(LONG_TOPIC) >= 60 and len(LONG_TYPE) >= 60


def printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, columns: int, *args: Any) -> list[str]:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))
    terminal_output.table(*args)
    return [line.rstrip() for line in CONTROL.sub("", capsys.readouterr().out).splitlines()]


def test_fitting_table_wraps_at_spaces_only(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [["/imu", "sensor_msgs/msg/Imu", "reliable, volatile"]]
    assert printed(capsys, monkeypatch, 80, rows, "topic", "type", "QoS")[::2] == [
        "topic   type                  QoS",
        "/imu    sensor_msgs/msg/Imu   reliable, volatile",
    ]
    rows = [["/diagnostics_of_a_whole_robot", DIAGNOSTICS, "reliable, volatile"]]
    lines = printed(capsys, monkeypatch, 80, rows, "topic", "type", "QoS")
    assert lines[2:] == [f"{rows[0][0]}   {DIAGNOSTICS}   reliable,", f"{'':70}volatile"]
    assert all(len(line) <= 80 for line in lines)


def test_names_too_long_for_table_are_printed_on_separate_lines(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [[LONG_TOPIC, LONG_TYPE, "7"], ["/imu", "sensor_msgs/msg/Imu", "9"]]
    assert printed(capsys, monkeypatch, 80, rows, "topic", "type", "count") == [
        *(LONG_TOPIC, f"  type   {LONG_TYPE}", "  count  7"),
        *("/imu", "  type   sensor_msgs/msg/Imu", "  count  9"),
    ]
    assert printed(capsys, monkeypatch, 20, [["/a_long_name_of_a_topic"]], "topic") == ["/a_long_name_of_a_topic"]
    assert printed(capsys, monkeypatch, 80, [], "topic", "type")[0].split() == ["topic", "type"]


@pytest.mark.slow
async def test_bag_is_listed_at_80_columns_without_broken_names(tmp_path: Path) -> None:
    long_class: Any = compile_definition(LONG_TYPE, "float64 x")
    diagnostics: Any = get_message(DIAGNOSTICS)
    with BagWriter(tmp_path / "bag.mcap") as bag:
        bag.write(LONG_TOPIC, long_class(), 1)
        bag.write("/diagnostics_of_the_whole_robot", diagnostics(), 2)
    for options in ((), ("--verbose",)):
        done = await on_terminal("bag", "info", str(tmp_path / "bag.mcap"), *options)
        assert done.code == 0
        words = done.screen.split()
        for name in (LONG_TOPIC, LONG_TYPE, DIAGNOSTICS, "/diagnostics_of_the_whole_robot"):
            assert name in words
        assert all(len(line) <= 80 for line in done.lines)


@pytest.mark.slow
@pytest.mark.real_time("commands are processes")
async def test_commands_do_not_break_names_at_80_columns(dds: World) -> None:
    node_name, service = "a_node_with_a_name_that_is_as_long_as_it_may_sensibly_be_here", f"{LONG_TOPIC}/reset_all"
    parameter = "perception.front_left.object_candidates.minimum_score_of_all"
    robot, other = dds.node(node_name, "/robot"), dds.node("other")
    long_class: Any = compile_definition(LONG_TYPE, "float64 x")
    publishers = [robot.create_publisher(long_class, topic) for topic in (LONG_TOPIC, "/measured")]
    robot.create_publisher(get_message(DIAGNOSTICS), "/diagnostics")
    robot.create_service(get_service("std_srvs/srv/SetBool"), service, lambda request: None)
    robot.declare_parameter(parameter, 1.5)
    await until(lambda: other.count_publishers(LONG_TOPIC) == 1)

    async def publish() -> None:
        while True:
            for publisher in publishers:
                publisher.publish(long_class())
            await asyncio.sleep(0.02)

    publishing = asyncio.ensure_future(publish())
    commands: dict[tuple[str, ...], tuple[str, ...]] = {
        ("topic", "list", "-t"): (LONG_TOPIC, f"[{LONG_TYPE}]", f"[{DIAGNOSTICS}]"),
        ("topic", "info", "-v", LONG_TOPIC): (LONG_TYPE, node_name),
        ("topic", "bw", "--times", "1", LONG_TOPIC, "/measured"): (LONG_TOPIC,),
        ("node", "list"): (f"/robot/{node_name}",),
        ("node", "info", f"/robot/{node_name}"): (f"{LONG_TOPIC}:", LONG_TYPE, f"{service}:"),
        ("service", "list", "-t"): (service,),
        ("param", "list", f"/robot/{node_name}"): (parameter,),
        ("graph",): (f"/robot/{node_name}", LONG_TOPIC),
    }
    try:
        results = await asyncio.gather(*(on_terminal(*command) for command in commands))
    finally:
        publishing.cancel()
    for (command, names), done in zip(commands.items(), results, strict=True):
        assert done.code == 0, (command, done)
        for name in names:
            assert any(name in line for line in done.lines), (command, name, done.screen)


EVIL = "x\nerror: y\r\x1b[2J\u2028\u202ez\tw"
SHOWN = "x\\nerror: y\\r\ufffd[2J\ufffd\ufffdz\\tw"
LATCHED = QoSProfile().transient_local().keep_last(10)


async def test_parameters_and_their_descriptions_take_one_line_each(memory: World, tool: Tool) -> None:
    node = memory.node("drive")
    node.declare_parameter(EVIL, EVIL, ParameterDescriptor(description=EVIL, additional_constraints=EVIL))
    listed, described, missing, dumped = await asyncio.gather(
        tool("param", "list", "/drive"),
        tool("param", "describe", "/drive", EVIL),
        tool("param", "get", "/drive", EVIL + "w"),
        tool("param", "dump", "/drive", "--json"),
    )
    assert listed.out.splitlines()[1:] == ["  use_sim_time", f"  {SHOWN}"]
    assert described.out.splitlines() == [
        *(f"Parameter name: {SHOWN}", "  Type: string", f"  Description: {SHOWN}"),
        *("  Constraints:", f"    Additional constraints: {SHOWN}"),
    ]
    assert missing.err.count("\n") == 1
    assert json.loads(dumped.out)["/drive"] | {EVIL: EVIL} == json.loads(dumped.out)["/drive"]
    assert dumped.out.count("\n") == 1


async def test_frames_loggers_and_csv_take_one_line_each(memory: World, tool: Tool) -> None:
    node = memory.node("robot", enable_rosout=False)
    types: Any = map(get_message, ("rcl_interfaces/msg/Log", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"))
    log, frames, string = types
    log_publisher = node.create_publisher(log, "/rosout", LATCHED)
    tf_publisher = node.create_publisher(frames, "/tf_static", LATCHED)
    words = node.create_publisher(string, "/words", LATCHED)
    log_publisher.publish(log(level=20, name=EVIL, msg="a\nb", file=EVIL, function=EVIL))
    transform = get_message("geometry_msgs/msg/TransformStamped")(child_frame_id=EVIL)
    transform.header.frame_id = "map" + EVIL
    tf_publisher.publish(frames(transforms=[transform]))
    words.publish(string(data=f'a,"b"{EVIL}'))
    logged, tree, mermaid, table, echoed = await asyncio.gather(
        tool("log", "-n", "1", "-v"),
        tool("tf", "tree", "--wait-time", "1"),
        tool("tf", "tree", "--wait-time", "1", "--format", "mermaid"),
        tool("tf", "monitor", "-n", "1"),
        tool("topic", "echo", "/words", "--once", "--csv"),
    )
    assert logged.out == f"[INFO] [0.000000000] [{SHOWN}]: a\n    b\n    at {SHOWN}:0 in {SHOWN}\n"
    assert [line.split()[0] for line in tree.out.splitlines()] == ["map" + SHOWN.split()[0], "└─"]
    assert len(mermaid.out.splitlines()) == 4
    assert len(table.out.splitlines()) == 1
    assert list(csv.reader(echoed.out.splitlines())) == [[f'a,"b"{SHOWN}']]


def test_error_with_line_breaks_takes_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for text in (EVIL, "a\n    b", "a\n    b\n    c"):
        try:
            with exit_on_error():
                raise OSError(text)
        except SystemExit:
            assert capsys.readouterr().err.count("\n") == 1


Image: Any = get_message("sensor_msgs/msg/Image")
MESSAGES = 200
BYTES = re.compile(r"\d+ % of \d+\.\d MiB, [\d.]+ [KMG]?i?B/s, \d:\d\d:\d\d left")
COUNT = re.compile(rf"\d+ % of {MESSAGES} messages, \d+ messages/s, \d:\d\d:\d\d left")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "a.mcap", compression="") as made:
        for number in range(MESSAGES):
            made.write("/camera", Image(data=bytes(1 << 15)), number * 10**6 + 1)
    return tmp_path / "a.mcap"


def without_index(bag: Path) -> Path:
    killed = bag.with_name("killed.mcap")
    killed.write_bytes(bag.read_bytes()[: -(1 << 15)])
    return killed


@pytest.mark.parametrize(
    ("state", "text"),
    [
        ((50, 200, 2.0, "messages"), " 25 % of 200 messages, 25 messages/s, 0:00:06 left"),
        ((1 << 20, 1 << 30, 0.5, "bytes"), "  0 % of 1.0 GiB, 2.0 MiB/s, 0:08:32 left"),
        ((50, None, 2.0, "messages"), "50 messages, 25 messages/s"),
        ((1 << 20, None, 1.0, "bytes"), "1.0 MiB, 1.0 MiB/s"),
        ((0, 200, 0.0, "messages"), "  0 % of 200 messages, 0 messages/s, ? left"),
        ((300, 200, 2.0, "messages"), "100 % of 200 messages, 150 messages/s, 0:00:00 left"),
        ((1, 20_000, 1.0, "messages"), "  0 % of 20000 messages, 1 messages/s, 5:33:19 left"),
    ],
)
def test_progress_has_rate_and_remaining_time(state: Any, text: str) -> None:
    assert progress_text(*state) == text


def test_progress_bar_appears_after_delay_and_is_cleared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", screen := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    now_s = 0.0
    monkeypatch.setattr(reading, "monotonic", lambda: now_s)
    with ProgressBar("messages") as show:
        show(1, 100)
        assert screen.getvalue() == ""
        now_s = 1.0
        show(25, 100)
        now_s = 1.1
        show(26, 100)  # too early after the last one
    clear, bar = "\r\x1b[2K", "━" * 5 + "─" * 15
    assert screen.getvalue() == f"{clear}{bar}   25 % of 100 messages, 25 messages/s, 0:00:03 left{clear}"


@pytest.mark.parametrize(("terminal", "term"), [(io.StringIO, "xterm"), (Terminal, "dumb")])
def test_progress_is_not_written_to_pipes_and_dumb_terminals(
    terminal: Any, term: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr", screen := terminal())
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(reading, "PROGRESS_DELAY_S", 0)
    with ProgressBar("messages") as show:
        show(50, 100)
    assert screen.getvalue() == ""


def test_output_lines_are_printed_above_status_line(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    with StatusLine() as status:
        status.show("first\x1b[2J")
        terminal_output.line("on standard output")
        terminal_output.note("on standard error")
        status.show("x" * 100)
    clear = "\r\x1b[2K"
    assert screen.getvalue() == (
        f"{clear}first\ufffd[2J{clear}on standard output\non standard error\n{clear}{'x' * 78}…{clear}"
    )


@pytest.mark.slow
def test_commands_that_read_whole_bags_show_progress(
    run_here: Any, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "PROGRESS_DELAY_S", 0)
    monkeypatch.setattr(reading, "PROGRESS_INTERVAL_S", 0)
    monkeypatch.setattr(terminal_output, "is_error_terminal", lambda: True)
    killed, folder = without_index(bag), tmp_path / "folder"
    folder.mkdir()
    shutil.copy(bag, folder)
    for *command, pattern in (
        ("info", str(killed), BYTES),
        ("convert", str(bag), str(tmp_path / "b.mcap"), "--json", COUNT),
        ("convert", str(killed), str(tmp_path / "c.mcap"), BYTES),
        ("table", str(bag), "--include-large", "--out", str(tmp_path / "dataset"), BYTES),
        ("reindex", str(folder), BYTES),
        ("sql", 'select count(*) from "/camera"', str(bag), COUNT),
        ("reindex", str(killed), BYTES),
    ):
        code, out, err = run_here("bag", *command)
        assert code == 0 and pattern.search(err), (command, err)
        assert out and not pattern.search(out + err.rpartition("\r\x1b[2K")[2]), (command, out, err)


def test_progress_is_reported_for_scanned_bytes_but_not_for_index(bag: Path) -> None:
    states: list[tuple[int, int]] = []
    with BagReader(bag, on_progress=lambda *state: states.append(state)):
        pass
    assert states == []
    killed = without_index(bag)
    with pytest.warns(), BagReader(killed, on_progress=lambda *state: states.append(state)):
        pass
    size = killed.stat().st_size - len(MCAP0_MAGIC)
    assert states == sorted(states) and states[-1] == (size, size) and {total for _, total in states} == {size}
    compressed = bag.with_name("b.mcap.zstd")
    compressed.write_bytes(zstandard.compress(os.urandom(1 << 22) + bag.read_bytes()))
    states.clear()
    with pytest.raises(BagError):
        BagReader(compressed, on_progress=lambda *state: states.append(state))
    size = compressed.stat().st_size
    assert states == sorted(states) and states[-1] == (size, size) and len(states) > 3
