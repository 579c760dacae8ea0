"""Progress of commands that read whole bags: on standard error, and only while that is a terminal."""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.writer import MCAP0_MAGIC
from support.terminals import on_terminal

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagError, BagReader, BagWriter
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.bag import display
from rosidl_py_gen.ros_cli.bag.display import ProgressBar, progress_text
from rosidl_py_gen.ros_cli.terminal_output import StatusLine

Image: Any = get_message("sensor_msgs/msg/Image")
MESSAGES = 200
AT_ONCE = "from rosidl_py_gen.ros_cli.bag import display; display._PROGRESS_DELAY_S = display._PROGRESS_INTERVAL_S = 0"
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


def test_a_bar_appears_after_a_delay_and_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", screen := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    now_s = 0.0
    monkeypatch.setattr(display, "monotonic", lambda: now_s)
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
def test_other_streams_get_no_progress(terminal: Any, term: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", screen := terminal())
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(display, "_PROGRESS_DELAY_S", 0)
    with ProgressBar("messages") as show:
        show(50, 100)
    assert screen.getvalue() == ""


def test_lines_appear_above_a_status_line(monkeypatch: pytest.MonkeyPatch) -> None:
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


async def test_commands_that_read_whole_bags_show_progress(bag: Path, tmp_path: Path) -> None:
    killed, folder = without_index(bag), tmp_path / "folder"
    folder.mkdir()
    shutil.copy(bag, folder)
    commands = {
        ("info", str(killed)): BYTES,
        ("convert", str(bag), str(tmp_path / "b.mcap")): COUNT,
        ("convert", str(killed), str(tmp_path / "c.mcap")): BYTES,
        ("table", str(bag), "--include-large", "--out", str(tmp_path / "dataset")): BYTES,
        ("reindex", str(folder)): BYTES,
        ("sql", 'select count(*) from "/camera"', str(bag)): COUNT,
    }
    results = await asyncio.gather(*(on_terminal("bag", *command, setup=AT_ONCE) for command in commands))
    for (command, pattern), done in zip(commands.items(), results, strict=True):
        assert done.code == 0, (command, done)
        assert pattern.search(done.screen), (command, done.screen)
        assert done.raw.rpartition("\r\x1b[2K")[2], "the result comes after the bar"
        assert not pattern.search(done.raw.rpartition("\r\x1b[2K")[2])
    again = await on_terminal("bag", "reindex", str(killed), setup=AT_ONCE)
    assert again.code == 0 and BYTES.search(again.screen)


async def test_pipes_get_results_only(bag: Path, tmp_path: Path) -> None:
    as_json, errors = await asyncio.gather(
        on_terminal("bag", "convert", str(bag), str(tmp_path / "b.mcap"), "--json", stdout=False, setup=AT_ONCE),
        on_terminal("bag", "convert", str(bag), str(tmp_path / "c.mcap"), stderr=False, setup=AT_ONCE),
    )
    assert json.loads(as_json.piped)["messages"] == MESSAGES and COUNT.search(as_json.screen)
    assert errors.piped == "" and errors.screen == f"{MESSAGES} messages of 1 topics in {tmp_path / 'c.mcap'}\n"


def test_an_index_is_not_reported_as_reading(bag: Path) -> None:
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
