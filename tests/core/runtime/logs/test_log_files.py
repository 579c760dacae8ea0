"""Log files and switches of log outputs, end to end (docs/internals/protocol.md 9.7, 10.4, 10.6)."""

from __future__ import annotations

import asyncio
import logging
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.logs import (
    LogFile,
    LogFileError,
    get_logger,
    get_logging_directory,
    get_root_logger,
    program_prefix,
)
from rosidl_py_gen.runtime.node.settings import parse_arguments

OpenNode = Callable[..., Node]


@pytest.fixture
def open_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[OpenNode]:
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name in [name for name in os.environ if name.startswith("RCUTILS_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    transport = MemoryTransport()
    nodes: list[Node] = []

    def make(name: str, *ros_arguments: str, program: str = "prog/talker.py") -> Node:
        monkeypatch.setattr(logging.getLogger(), "handlers", [])  # the handlers of pytest would silence the console
        context = Context(0, transport=transport, args=[program, "--ros-args", *ros_arguments])
        nodes.append(Node(name, context=context))
        return nodes[-1]

    yield make
    for node in nodes:
        node.context.close()


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.log"))


# ------------------------------------------------------------------------------------------------ flags and names


@pytest.mark.parametrize(
    ("flags", "environ", "wanted"),
    [
        ("", {}, False),
        ("", {"ROS_HOME": "/h"}, False),
        ("", {"ROS_LOG_DIR": ""}, False),
        ("", {"ROS_LOG_DIR": "/l"}, True),
        ("--log-file-name x", {}, True),
        ("--enable-external-lib-logs", {}, True),
        ("--log-file-name x --disable-external-lib-logs", {"ROS_LOG_DIR": "/l"}, False),
        ("--disable-external-lib-logs --enable-external-lib-logs", {}, True),
    ],
)
def test_log_file_is_written_only_on_request_of_flags_or_environment(
    flags: str, environ: dict[str, str], wanted: bool
) -> None:
    assert parse_arguments(["p", "--ros-args", *flags.split()]).logs.wants_file(environ) is wanted


@pytest.mark.parametrize(
    ("environ", "folder"),
    [
        ({}, "~/.ros/log"),
        ({"ROS_LOG_DIR": "", "ROS_HOME": ""}, "~/.ros/log"),
        ({"ROS_HOME": "/h"}, "/h/log"),
        ({"ROS_HOME": "~/h"}, "~/h/log"),
        ({"ROS_HOME": "/h", "ROS_LOG_DIR": "/l"}, "/l"),
        ({"ROS_LOG_DIR": "~/l"}, "~/l"),
    ],
)
def test_logging_directory_follows_environment_variables(environ: dict[str, str], folder: str) -> None:
    assert get_logging_directory(environ) == Path(folder).expanduser()


def test_logging_directory_of_this_process_is_read_from_environment_and_not_created(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "logs"))
    assert runtime.get_logging_directory() == tmp_path / "logs" and not (tmp_path / "logs").exists()


@pytest.mark.parametrize(
    ("program", "prefix"),
    [
        ("/x/talker.py", "talker"),
        ("talker", "talker"),
        ("", "python"),
        ("-c", "python"),
        ("-m", "python"),
        ("ccc.py", "ccc"),
        ("/site/pkg/__main__.py", "pkg"),
        ("odd name.py", "odd_name"),
    ],
)
def test_log_file_prefix_is_derived_from_program_name(program: str, prefix: str) -> None:
    assert program_prefix(program) == prefix


# ------------------------------------------------------------------------------------------------------ end to end


def test_no_log_file_is_written_by_default(open_node: OpenNode, tmp_path: Path) -> None:
    open_node("n").logger.error("x")
    assert list(tmp_path.iterdir()) == []


def test_named_log_file_contains_the_console_lines(open_node: OpenNode, tmp_path: Path) -> None:
    node = open_node("n", "--log-file-name", "mine", "--log-level", "n.deep:=debug")
    node.logger.info("first\nsecond \ud800")
    node.logger.get_child("deep").debug("third")
    node.logger.debug("not enabled")
    get_logger("of_no_node").warning("fourth")
    (path,) = files(tmp_path)
    assert path.parent == tmp_path / ".ros" / "log"
    assert re.fullmatch(rf"mine_{os.getpid()}_\d{{13}}\.log", path.name)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert [re.sub(r"\[\d+\.\d{9}\]", "[T]", line) for line in lines] == [
        "[INFO] [T] [n]: first",
        "second \\ud800",
        "[DEBUG] [T] [n.deep]: third",
        "[WARN] [T] [of_no_node]: fourth",
    ]


def test_log_file_uses_directory_and_format_of_environment(
    open_node: OpenNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "a" / "b"))
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{severity} {message}")
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "1")
    open_node("n").logger.error("red on the console")
    (path,) = files(tmp_path)
    assert path.parent == tmp_path / "a" / "b" and path.name.startswith(f"talker_{os.getpid()}_")
    assert path.read_text(encoding="utf-8") == "ERROR red on the console\n"


def test_first_context_chooses_log_file_and_last_context_closes_it(open_node: OpenNode, tmp_path: Path) -> None:
    a, b = open_node("a", "--log-file-name", "one"), open_node("b", "--log-file-name", "one")
    c, d = open_node("c", "--log-file-name", "two"), open_node("d")
    for node in (a, b, c, d):
        node.logger.warning(f"by {node.name}")
    for node in (a, b, c):
        node.context.close()
    d.logger.warning("still open")
    d.context.close()
    d.logger.warning("nobody's file")
    (path,) = files(tmp_path)
    assert path.name.startswith("one_")
    first, *lines = [line.rpartition("]: ")[2] for line in path.read_text().splitlines()]
    assert first.startswith("log switches and log file of this context are ignored")
    assert lines == ["by a", "by b", "by c", "by d", "still open"]
    assert [handler for handler in get_root_logger().handlers if isinstance(handler, LogFile)] == []
    open_node("e", "--log-file-name", "two").logger.warning("by e")
    assert [path.name[:4] for path in files(tmp_path)] == ["one_", "two_"]


def test_warnings_of_a_context_name_the_file_that_made_it(
    open_node: OpenNode, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "NOWHERE")
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{file_name} {message}")
    open_node("a", "--log-file-name", "one")
    capsys.readouterr()
    open_node("b", "--log-file-name", "two")
    file, range_file = [line.split(" ")[:2] for line in capsys.readouterr().err.splitlines()]
    assert file == [__file__, "log"] and range_file == [__file__, "ROS_AUTOMATIC_DISCOVERY_RANGE"]


def test_unwritable_log_file_raises_log_file_error(
    open_node: OpenNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "file"))
    with pytest.raises(LogFileError, match=r"log file .* cannot be written: .*; set ROS_LOG_DIR to another") as raised:
        open_node("n")
    assert isinstance(raised.value, OSError)
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "good"))
    open_node("n").logger.info("x")
    assert len(files(tmp_path)) == 1


def test_failed_context_leaves_no_log_file_open(tmp_path: Path, open_node: OpenNode) -> None:
    class Broken(MemoryTransport):
        def open(self, *_: object, **__: object) -> None:  # type: ignore[override]
            raise RuntimeError("no network")

    with pytest.raises(RuntimeError, match="no network"):
        Context(0, transport=Broken(), args=["p", "--ros-args", "--log-file-name", "x"])
    assert [handler for handler in get_root_logger().handlers if isinstance(handler, LogFile)] == []


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_child_does_not_write_to_log_file_of_its_parent(open_node: OpenNode, tmp_path: Path) -> None:
    node = open_node("n", "--log-file-name", "x")
    node.logger.info("before")
    child = os.fork()
    if child == 0:  # no test framework in here
        try:
            node.logger.info("by the child")
            get_logger("of_no_node").info("by the child")
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    node.logger.info("after")
    (path,) = files(tmp_path)
    assert [line.rpartition("]: ")[2] for line in path.read_text().splitlines()] == ["before", "after"]


# -------------------------------------------------------------------------------------------------------- switches


def test_first_context_decides_whether_logs_are_printed(
    open_node: OpenNode, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet = open_node("quiet", "--disable-stdout-logs")
    loud = open_node("loud", "--enable-stdout-logs")
    for node in (quiet, loud):
        node.logger.warning("not printed")
        node.context.close()
    get_logger("of_no_node").warning("all are closed")
    assert capsys.readouterr().err == ""
    loud = open_node("loud")
    quiet = open_node("quiet", "--disable-stdout-logs")
    quiet.logger.warning("printed")
    warning, printed = [line.rpartition("]: ")[2] for line in capsys.readouterr().err.splitlines()]
    assert warning.startswith("log switches and log file of this context are ignored") and printed == "printed"


def test_node_with_disabled_stdout_logs_writes_its_file_and_has_rosout(
    open_node: OpenNode, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    node = open_node("n", "--disable-stdout-logs", "--log-file-name", "x")
    node.logger.warning("x")
    assert capsys.readouterr().err == "" and "[n]: x" in files(tmp_path)[0].read_text()
    assert node.get_publisher_names_and_types_by_node("n")[-1][0] == "/rosout"


def test_rosout_logs_can_be_switched_off(open_node: OpenNode, capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        node, listener = open_node("n", "--disable-rosout-logs"), open_node("listener")
        records = listener.create_subscription("rcl_interfaces/msg/Log", "/rosout", qos=10)
        node.logger.warning("x")
        listener.logger.warning("y")
        listener.logger.warning("z")
        assert [(await records.receive(20))["msg"] for _ in range(2)] == ["y", "z"]
        assert "[n]: x" in capsys.readouterr().err
        assert "/rosout" not in [name for name, _ in node.get_publisher_names_and_types_by_node("n")]

    asyncio.run(main())
