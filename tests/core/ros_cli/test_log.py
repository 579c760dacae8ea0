"""``rosidl-py log``: log messages of nodes and of bags."""

from __future__ import annotations

import asyncio
import json
import logging
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli.log import LogPrinter
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from support.commands import Tool
    from support.worlds import World

Log: Any = get_message("rcl_interfaces/msg/Log")


@pytest.fixture(autouse=True)
def all_levels() -> Any:
    root = logging.getLogger()
    before, root.level = root.level, logging.DEBUG
    yield
    root.setLevel(before)


async def test_retained_log_messages_are_printed_first_ordered_by_time(memory: World, tool: Tool) -> None:
    talker, camera = memory.node("talker"), memory.node("left", "/camera")
    talker.logger.info("one")
    await asyncio.sleep(0.1)
    camera.logger.warning("two\x1b[2J")
    await asyncio.sleep(0.1)
    talker.logger.error("three\nlines")
    process = await tool.start("log", "-n", "4")
    await asyncio.sleep(3)
    camera.logger.get_child("driver").info("four")
    done = await tool.end(process)
    stamp = r"\[\d+\.\d{9}\]"
    pattern = (
        rf"\[INFO\] {stamp} \[talker\]: one\n\[WARN\] {stamp} \[camera.left\]: two\ufffd\[2J\n"
        rf"\[ERROR\] {stamp} \[talker\]: three\n    lines\n\[INFO\] {stamp} \[camera.left.driver\]: four\n"
    )
    assert re.fullmatch(pattern, done.out), done.out


async def test_options_filter_log_messages_by_level_node_and_text(memory: World, tool: Tool) -> None:
    talker, camera = memory.node("talker"), memory.node("left", "/camera")
    talker.logger.info("hello %d", 5)
    talker.logger.warning("late by 5 s")
    camera.logger.get_child("driver").error("lost a frame")

    async def texts(*options: str) -> list[str]:
        process = await tool.start("log", *options)
        await asyncio.sleep(3)
        process.kill()
        done = await tool.end(process)
        return [line.rpartition("]: ")[2] for line in done.out.splitlines()]

    cases = {
        ("--level", "warn"): ["late by 5 s", "lost a frame"],
        ("--node", "/camera/left"): ["lost a frame"],
        ("--node", "/camera/*", "--node", "talker"): ["hello 5", "late by 5 s", "lost a frame"],
        ("--node", "/camera"): ["lost a frame"],  # also a logger of that name would have the node's below it
        ("--text", "lost|hel+o"): ["hello 5", "lost a frame"],
        ("--new",): [],
    }
    assert await asyncio.gather(*(texts(*options) for options in cases)) == [*cases.values()]


async def test_log_messages_of_volatile_best_effort_publisher_are_printed(memory: World, tool: Tool) -> None:
    publisher = memory.node("bare", enable_rosout=False).create_publisher(Log, "/rosout", QoSProfile().best_effort())
    process = await tool.start("log", "-n", "1", "--json", "-v")
    await asyncio.sleep(3)
    publisher.publish(Log(level=35, name="strange", msg="x", file="a.cpp", line=3, function="f"))
    done = await tool.end(process)
    expected = {
        "time_ns": 0,
        "level": "35",
        "name": "strange",
        "text": "x",
        "file": "a.cpp",
        "line": 3,
        "function": "f",
    }
    assert json.loads(done.out) == expected


def bag(path: Path) -> str:
    with BagWriter(path) as writer:
        for number, level in enumerate((10, 20, 30, 40, 50)):
            message = Log(level=level, name="arm.driver", msg=f"text {number}", file="a.py", line=7, function="go")
            message.stamp.sec = number
            writer.write("/rosout", message, log_time_ns=number * 10**9)
    return str(path)


def test_log_messages_of_bag_need_no_network(tmp_path: Path, run_here: Any) -> None:
    path = bag(tmp_path / "drive.mcap")
    code, out, err = run_here("log", "--bag", path, "--level", "ERROR", "-v")
    assert (code, err) == (0, "")
    assert out == (
        "[ERROR] [3.000000000] [arm.driver]: text 3\n    at a.py:7 in go\n"
        "[FATAL] [4.000000000] [arm.driver]: text 4\n    at a.py:7 in go\n"
    )
    assert run_here("log", "--bag", path, "-n", "1", "--node", "arm*")[1].endswith("[arm.driver]: text 0\n")
    with BagWriter(tmp_path / "none.mcap") as writer:
        writer.write("/words", String(data="x"), log_time_ns=0)
    code, _, err = run_here("log", "--bag", str(tmp_path / "none.mcap"))
    assert code == 1 and "has no topic of rcl_interfaces/msg/Log" in err


def test_invalid_log_options_are_reported(run_here: Any) -> None:
    code, printed, err = run_here("log", "--bag", "x.mcap", "--new")
    assert (code, printed) == (2, "") and "use either --bag or --new" in err
    code, _, err = run_here("log", "--bag", "x", "--text", "(")
    assert code == 1 and err.startswith('error: --text: "(" is not a regular expression: ')


def test_log_levels_are_coloured_on_terminal(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(terminal_output, "is_terminal", lambda: True)
    lines = LogPrinter("debug", (), None, times=None, verbose=False, as_json=False)
    for level in (10, 20, 30, 40, 50):
        lines.show(Log(level=level, name="n", msg="m"))
    shown = capsys.readouterr().out.splitlines()
    assert [line.startswith("\x1b[") for line in shown] == [True, False, True, True, True]
    assert "\x1b[33m" in shown[2] and "\x1b[31m" in shown[3] and "\x1b[1;31m" in shown[4]


@pytest.mark.slow
async def test_log_command_process_receives_messages_on_dds(dds: World, tool: Tool) -> None:
    node = dds.node("talker")
    node.logger.warning("before")
    done = await tool("log", "-n", "1", "--node", "/talker")
    assert done.out.endswith("[talker]: before\n")
