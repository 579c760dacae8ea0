"""The examples as a user runs them: two processes, Ctrl-C at the end, no traceback."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from typing import TYPE_CHECKING

import pytest
from browser import Browser, browser
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker
from worlds import ROOT

from rosidl_py_gen.runtime import Node, SetResult

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

EXAMPLES = ROOT / "examples"
__all__ = ["browser"]


@pytest.fixture(autouse=True)
def no_survivors() -> Iterator[None]:
    """Kill what a failed test left running, so that it cannot disturb the next one."""
    yield
    while _started:
        process = _started.pop()
        if process.poll() is None:
            process.kill()
            process.communicate()


_started: list[subprocess.Popen[str]] = []


@pytest.fixture(autouse=True)
def no_kept_types(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Types that examples ask others for are not known from an earlier run."""
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "types"))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_is_short_says_how_to_run_it_and_is_on_the_page(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    head = text.split('"""')[1]
    assert len(text.splitlines()) <= 80
    assert "Seen" in head and (f"python examples/{path.name}" in head or f"pytest {path.name}" in head)
    assert path.name.removeprefix("test_") in (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")


def start(name: str, *arguments: str) -> subprocess.Popen[str]:
    """Run an example; what this test process may import, it may import too."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-W", "default", str(EXAMPLES / name), *arguments]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    _started.append(process)
    return process


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> None:
    """Press Ctrl-C and expect a clean end within two seconds."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=2)
    assert errors == ""
    assert process.returncode == 0


@pytest.mark.parametrize("listener", ["listener.py", "listener_callbacks.py"])
@pytest.mark.parametrize("talker", ["talker.py", "talker_callbacks.py"])
def test_talker_and_listener(talker: str, listener: str) -> None:
    hearing, talking = start(listener), start(talker)
    assert hearing.stdout is not None
    heard = [hearing.stdout.readline() for _ in range(2)]
    assert all(line.startswith("I heard: Hello World: ") for line in heard)
    stop(hearing)
    stop(talking, signal.SIGTERM)


@pytest.mark.parametrize("service", ["service.py", "service_callbacks.py"])
def test_service_and_client(service: str) -> None:
    serving = start(service)
    output, errors = start("client.py", "40").communicate(timeout=20)
    assert (output.splitlines(), errors) == (["40 + 1 = 41", "40 + 2 = 42", "40 + 3 = 43"], "")
    assert start("client_sync.py").communicate(timeout=20) == ("40 + 2 = 42\n", "")
    stop(serving)


def test_ctrl_c_ends_asyncio_run_at_once_although_the_loop_waits_in_dds() -> None:
    program = (
        "import asyncio\nfrom rosidl_py_gen.runtime import Node\n"
        "async def main():\n    async with Node('n') as node:\n        print('up', flush=True)\n"
        "        await asyncio.Event().wait()\n"
        "try:\n    asyncio.run(main())\nexcept KeyboardInterrupt:\n    print('interrupted')\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "up\n"
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=2)
    assert (output, errors) == ("interrupted\n", "")


def test_fibonacci_with_a_cancel() -> None:
    serving = start("fibonacci_server.py")
    output, errors = start("fibonacci_client.py", "4").communicate(timeout=20)
    lines = output.splitlines()
    assert (lines[:4], errors) == (
        ["so far: 0 1 1", "so far: 0 1 1 2", "so far: 0 1 1 2 3", "SUCCEEDED: 0 1 1 2 3"],
        "",
    )
    (cancelled,) = lines[4:]
    words = cancelled.split()
    assert words[:2] == ["CANCELED", "after"] and 3 <= int(words[2]) < 41
    assert serving.stdout is not None and serving.stdout.readline().startswith("cancelled after ")
    stop(serving)


def test_parameters_from_a_file_and_set_from_outside() -> None:
    driving = start("parameters.py", "--ros-args", "--params-file", str(EXAMPLES / "parameters.yaml"))
    assert driving.stdout is not None
    assert driving.stdout.readline() == "manual, 1.2 m/s, left 120, tags ['indoor', 'slow']\n"

    async def change() -> list[SetResult]:
        async with Node("asker") as node:
            client = node.create_parameter_client("/drive")
            return await client.set({"max_speed": 2.0, "mode": "wild", "frame": "map", "left.pwm": 256}, timeout_s=10)

    results = asyncio.run(change())
    assert [result.successful for result in results] == [True, False, False, False]
    lines = iter(driving.stdout.readline, "")
    assert next(line for line in lines if line.startswith("max_speed = 2.0")) == (
        "max_speed = 2.0; the maximum speed is 2.0 m/s\n"
    )
    stop(driving)


def test_points_are_turned_and_filtered() -> None:
    turning = start("points.py")

    async def ask() -> Marker:
        async with Node("asker") as node:
            near = node.create_subscription(Marker, "points_near")
            out = node.create_publisher(Marker, "points")
            assert await out.wait_for_subscribers(10) and await near.wait_for_publishers(10)
            out.publish(Marker(points=[Point(x=1.0, z=7.0), Point(y=6.0), Point(y=2.0)]))
            return await near.receive(timeout_s=10)

    points = asyncio.run(ask()).points
    assert [(round(point.x, 3), round(point.y, 3), point.z) for point in points] == [(0.866, 0.5, 7), (-1, 1.732, 0)]
    stop(turning)


def test_simulated_time_runs_ten_times_as_fast_and_others_follow() -> None:
    simulating = start("sim_time.py")
    listening = start("listener.py")
    talking = start("talker_callbacks.py", "--ros-args", "-p", "use_sim_time:=true")
    assert simulating.stdout is not None and listening.stdout is not None
    begin = time.monotonic()
    times = [float(simulating.stdout.readline().split()[2]) for _ in range(20)]
    assert times == sorted(times) and times[-1] - times[0] > 15
    assert time.monotonic() - begin < 15
    listening.stdout.readline()
    begin = time.monotonic()
    for _ in range(20):
        assert listening.stdout.readline().startswith("I heard: ")
    assert time.monotonic() - begin < 10
    for process in (simulating, listening, talking):
        stop(process)


def test_a_handler_calls_other_services_and_answers_when_one_is_gone() -> None:
    output, errors = start("service_chain.py").communicate(timeout=20)
    assert (output.splitlines(), errors) == (
        ["ready: battery: 87 %; camera: 30 frames/s", "not ready: battery: 87 %; camera: no answer within 1 s"],
        "",
    )


def test_both_sides_agree_how_goals_that_are_cancelled_at_random_end() -> None:
    output, errors = start("random_cancel.py", "30").communicate(timeout=30)
    *goals, last = output.splitlines()
    assert (len(goals), errors) == (30, "")
    ends = {"accepted": "CANCELED", "refused": "SUCCEEDED", "too late": "SUCCEEDED"}
    found = [re.fullmatch(r"goal \d+: cancel after \d\.\d\d s, ([a-z ]+): (\w+) at \d+", line) for line in goals]
    outcomes = Counter(match[1] for match in found if match and ends[match[1]] == match[2])
    canceled = outcomes["accepted"]
    assert outcomes.total() == 30 and 0 < canceled < 30
    assert last == f"the server ended 30 goals: {canceled} CANCELED, {30 - canceled} SUCCEEDED"


def test_the_tests_of_a_node_pass_as_a_user_runs_them_and_find_a_mistake(tmp_path: Path) -> None:
    def run_tests() -> str:
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_speed_guard.py"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
        return done.stdout

    code = (EXAMPLES / "speed_guard.py").read_text()
    shutil.copy(EXAMPLES / "test_speed_guard.py", tmp_path)
    (tmp_path / "speed_guard.py").write_text(code)
    assert "5 passed" in run_tests()
    (tmp_path / "speed_guard.py").write_text(code.replace("max(-fastest, min(fastest, speed))", "min(fastest, speed)"))
    assert "1 failed, 4 passed" in run_tests()


def test_a_page_shows_a_live_topic(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PORT", "0")  # any that is free
    showing = start("web_page.py")
    assert showing.stdout is not None
    line = re.fullmatch(r"/wave data at (http://127\.0\.0\.1:\d+), stop with Ctrl-C\n", showing.stdout.readline())
    assert line
    browser.open(line[1])
    assert browser.run("return document.querySelector('h1').textContent") == "/wave data"
    browser.wait_for("return values.length > 20")
    numbers = {browser.wait_for("return number.textContent") for _ in range(20)}
    assert len(numbers) > 1 and all(-1 <= float(number) <= 1 for number in numbers)
    points = browser.run("return plot.points.length")
    assert 20 < points <= 200
    assert browser.screenshot().startswith(b"\x89PNG")
    stop(showing)
    browser.wait_for("return state.textContent.includes('gone')")


def test_a_type_that_only_its_publisher_has_is_copied_and_printed_by_others() -> None:
    robot, copying = start("strange_robot.py"), start("echo_any.py", "/battery", "/copy")
    assert copying.stdout is not None
    assert copying.stdout.readline() == "copying /battery, a strange_msgs/msg/Battery, to /copy\n"
    echoes = start("echo_any.py", "/battery"), start("echo_any.py", "/copy")
    for echo in echoes:
        assert echo.stdout is not None
        assert echo.stdout.readline() == "strange_msgs/msg/Battery RIHS01_45fd688a...\n"
        battery = json.loads(echo.stdout.readline())
        assert battery["name"] == "main" and [3 < cell["voltage"] < 4 for cell in battery["cells"]] == [True, True]
    for process in (robot, copying, *echoes):
        stop(process)


def test_a_script_stops_a_robot_whose_types_it_never_saw() -> None:
    robot = start("strange_robot.py")
    output, errors = start("meet_robot.py").communicate(timeout=30)
    *watched, last = output.splitlines()
    assert (watched[:2], errors) == (
        [
            '/battery is strange_msgs/msg/Battery: {"name": "", "cells": []}',
            '/drive is strange_msgs/msg/Drive: {"speed": 0.0, "reason": ""}',
        ],
        "",
    )
    assert re.fullmatch(r"stop: cell 1 is at 3\.3\d V", last)
    assert all(re.fullmatch(r"the lowest cell is at 3\.4\d V", line) for line in watched[2:])
    output, errors = robot.communicate(timeout=10)
    assert (output.splitlines()[-1], errors) == (f"stopped by a visitor: {last.removeprefix('stop: ')}", "")
