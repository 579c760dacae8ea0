"""Tracebacks of ``rosidl-py run``: Ctrl-C, and missing message packages."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Any

import pytest
from support.interface_packages import write
from support.program_processes import run

from rosidl_py_gen.program_runner.program import refused_arguments
from rosidl_py_gen.runtime import RosArgumentError
from rosidl_py_gen.runtime.node.settings import parse_arguments

pytestmark = pytest.mark.real_time("programs are processes")

INTERRUPTED = """
import os
import signal
import sys
import threading

import rclpy
from rclpy.node import Node
from std_srvs.srv import Empty

MAIN = threading.main_thread().ident


WANTED = {"shared_loop.py", "client.py"} if sys.argv[1] == "callback" else {"shared_loop.py"}


def interrupt():
    found = set()
    while not found >= WANTED:
        found, frame = set(), sys._current_frames()[MAIN]
        while frame is not None:
            found.add(os.path.basename(frame.f_code.co_filename))
            frame = frame.f_back
    signal.pthread_kill(MAIN, signal.SIGINT)


def tick():
    client.wait_for_service()


def fail():
    node.get_parameters(["nothing"])


rclpy.init()
node = Node("interrupted")
client = node.create_client(Empty, "nobody")
thread = threading.Thread(target=interrupt, daemon=True)
if sys.argv[1] == "callback":
    node.create_timer(0.001, tick)
if sys.argv[1] == "own":
    signal.raise_signal(signal.SIGINT)
if sys.argv[1] == "error":
    fail()
thread.start()
rclpy.spin(node)
"""


def frames(text: str) -> list[tuple[str, str]]:
    """File and function of each frame of a traceback."""
    return [(Path(file).name, name) for file, name in re.findall(r'File "(.*)", line \d+, in (.*)', text)]


@pytest.mark.parametrize(
    ("case", "calls"),
    [
        ("spin", [("program.py", "<module>"), ("__init__.py", "spin")]),
        (
            "callback",
            [
                ("program.py", "<module>"),
                ("__init__.py", "spin"),
                ("program.py", "tick"),
                ("client.py", "wait_for_service"),
            ],
        ),
        ("own", [("program.py", "<module>")]),
    ],
)
def test_ctrl_c_traceback_shows_only_program_and_called_functions(
    case: str, calls: list[tuple[str, str]], tmp_path: Path
) -> None:
    write(tmp_path, {"program.py": INTERRUPTED})
    found = run("program.py", case, cwd=tmp_path)
    traceback_frames = frames(found.stderr)
    if case == "own":  # raised by a function of C, which the signal module wraps
        traceback_frames = [one for one in traceback_frames if one[0] != "signal.py"]
    assert traceback_frames == calls
    assert found.stderr.splitlines()[-1] == "KeyboardInterrupt" and found.returncode == -signal.SIGINT


def test_traceback_of_other_exceptions_is_complete(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": INTERRUPTED})
    found = run("program.py", "error", cwd=tmp_path)
    traceback_frames = frames(found.stderr)
    assert traceback_frames[:2] == [("program.py", "<module>"), ("program.py", "fail")] and len(traceback_frames) > 3, (
        found.stderr
    )


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("from robot_msgs.msg import Arm", 'There is no message package "robot_msgs". If'),
        ("import robot.srv", 'There is no message package "robot". If'),
        ("from robot import action", 'There is no message package "robot". If'),
        (
            "from sensor_msg.msg import Image",
            'There is no message package "sensor_msg"; did you mean "sensor_msgs"? If',
        ),
        ("import rosidl_runtime_py.utilities as u\nu.get_message('robot_msgs/msg/Arm')", '"robot_msgs". If'),
        ("import std_msgs.srv", "which defines no such messages."),
        ("import robot", None),
    ],
)
def test_import_error_names_missing_message_package(line: str, hint: str | None, tmp_path: Path) -> None:
    write(tmp_path, {"program.py": line})
    found = run("program.py", cwd=tmp_path)
    last = [one for one in found.stderr.splitlines() if one.startswith("ModuleNotFoundError: No module named ")]
    below = found.stderr.partition(last[0])[2].strip()
    assert found.returncode == 1 and len(last) == 1
    if hint is None:
        assert below == ""
    else:
        assert hint in below and "\n" not in below
        assert "--path FOLDER" in below or "std_msgs" in line


def test_invalid_ros_arguments_are_reported_despite_later_errors() -> None:
    def fail(cleanup: Exception | None, initial: bool = False) -> str:
        try:
            try:
                if initial:
                    error: Any = TypeError("parameter a")
                    error.is_of_initial_value = True
                    raise error
                try:
                    parse_arguments(["program", "--ros-args", "-p", "a"])
                except RosArgumentError as refused:
                    raise RuntimeError("Failed to parse ROS arguments") from refused
            finally:
                if cleanup is not None:
                    raise cleanup
        except Exception as error:
            return refused_arguments(error)
        raise AssertionError

    reason = "ROS argument -p 'a': there is no ':='; expected [NODE:]name:=value"
    for cleanup in (None, RuntimeError("Context must be initialized"), UnboundLocalError("node")):
        assert fail(cleanup) == reason
    assert fail(None, initial=True) == "parameter a"
    assert refused_arguments(ValueError("other")) == ""
