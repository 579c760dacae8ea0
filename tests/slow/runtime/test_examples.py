"""Examples as a user runs them: two processes, Ctrl-C at the end, no traceback."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from geometry_msgs.msg import Point
from matplotlib.image import imread
from sensor_msgs.msg import Image, Imu, PointCloud2
from std_msgs.msg import Header
from support.browser import Browser, browser
from support.docs_pictures import update_picture
from support.folders import ROOT
from visualization_msgs.msg import Marker

from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.numpy import array_to_pointcloud, image_to_array, pointcloud_to_array
from rosidl_py_gen.runtime import Node, QoSProfile, SetResult
from rosidl_py_gen.runtime.qos import SENSOR_DATA

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

EXAMPLES = ROOT / "examples"
__all__ = ["browser"]


@pytest.fixture(autouse=True)
def no_survivors() -> Iterator[None]:
    """Kill the processes of failed tests."""
    yield
    while _started:
        process = _started.pop()
        if process.poll() is None:
            process.kill()
            process.communicate()


_started: list[Example] = []


@pytest.fixture(autouse=True)
def empty_type_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty cache of type descriptions."""
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "types"))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_example_is_short_documented_and_listed_on_its_page(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    head = text.split('"""')[1]
    assert len(text.splitlines()) <= 80
    assert "Seen" in head and (f"python examples/{path.name}" in head or f"pytest {path.name}" in head)
    assert path.name.removeprefix("test_") in (ROOT / "docs/howto/index.md").read_text(encoding="utf-8")


class Example(subprocess.Popen[str]):
    def line(self) -> str:
        assert self.stdout is not None
        return self.stdout.readline()


def start(name: str, *arguments: str) -> Example:
    """Run an example with the import path of this process."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-W", "default", str(EXAMPLES / name), *arguments]
    process = Example(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    _started.append(process)
    return process


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> None:
    """Press Ctrl-C and expect an end without error."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert errors == ""
    assert process.returncode == 0


@pytest.mark.usefixtures("network")
@pytest.mark.parametrize(
    ("talker", "listener"), [("talker.py", "listener_callbacks.py"), ("talker_callbacks.py", "listener.py")]
)
def test_talker_and_listener_examples_exchange_messages(talker: str, listener: str) -> None:
    listening_process, talking_process = start(listener), start(talker)
    heard = [listening_process.line() for _ in range(2)]
    assert all(line.startswith("I heard: Hello World: ") for line in heard)
    stop(listening_process)
    stop(talking_process, signal.SIGTERM)


@pytest.mark.usefixtures("network")
@pytest.mark.parametrize("service", ["service.py", "service_callbacks.py"])
def test_service_and_client_examples_add_numbers(service: str) -> None:
    serving = start(service)
    output, errors = start("client.py", "40").communicate(timeout=60)
    assert (output.splitlines(), errors) == (["40 + 1 = 41", "40 + 2 = 42", "40 + 3 = 43"], "")
    assert start("client_sync.py").communicate(timeout=60) == ("40 + 2 = 42\n", "")
    stop(serving)


@pytest.mark.usefixtures("network")
def test_fibonacci_example_reports_feedback_result_and_cancel() -> None:
    serving = start("fibonacci_server.py")
    output, errors = start("fibonacci_client.py", "4").communicate(timeout=60)
    lines = output.splitlines()
    assert (lines[:4], errors) == (
        ["so far: 0 1 1", "so far: 0 1 1 2", "so far: 0 1 1 2 3", "SUCCEEDED: 0 1 1 2 3"],
        "",
    )
    (cancelled,) = lines[4:]
    words = cancelled.split()
    assert words[:2] == ["CANCELED", "after"] and 3 <= int(words[2]) < 41
    assert serving.line().startswith("cancelled after ")
    stop(serving)


@pytest.mark.usefixtures("network")
def test_parameters_example_reads_file_and_follows_remote_sets() -> None:
    driving = start("parameters.py", "--ros-args", "--params-file", str(EXAMPLES / "parameters.yaml"))
    assert driving.line() == "manual, 1.2 m/s, left 120, tags ['indoor', 'slow']\n"

    async def change() -> list[SetResult]:
        async with Node("asker") as node:
            client = node.create_parameter_client("/drive")
            return await client.set({"max_speed": 2.0, "mode": "wild", "frame": "map", "left.pwm": 256}, timeout_s=10)

    results = asyncio.run(change())
    assert [result.successful for result in results] == [True, False, False, False]
    lines = iter(driving.line, "")
    assert next(line for line in lines if line.startswith("max_speed = 2.0")) == (
        "max_speed = 2.0; the maximum speed is 2.0 m/s\n"
    )
    stop(driving)


def test_points_example_rotates_and_filters_points() -> None:
    turning = start("points.py")

    async def ask() -> Marker:
        async with Node("asker") as node:
            near = node.create_subscription(Marker, "points_near")
            out = node.create_publisher(Marker, "points")
            assert await out.wait_for_subscribers(30) and await near.wait_for_publishers(30)
            answer = asyncio.ensure_future(near.receive(timeout_s=20))
            while not answer.done():  # the other side may know our publisher, and not our subscription yet
                out.publish(Marker(points=[Point(x=1.0, z=7.0), Point(y=6.0), Point(y=2.0)]))
                await asyncio.wait([answer], timeout=0.2)
            return answer.result()

    points = asyncio.run(ask()).points
    assert [(round(point.x, 3), round(point.y, 3), point.z) for point in points] == [(0.866, 0.5, 7), (-1, 1.732, 0)]
    stop(turning)


@pytest.mark.usefixtures("network")
def test_several_robots_example_finds_robots_of_demo_and_notices_their_end() -> None:
    fleet = start("several_robots.py")
    lines = iter(fleet.line, "")
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "demo", "--count", "3"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as demo:
        try:
            found = [next(line for line in lines if line.startswith("found")) for _ in range(3)]
            assert sorted(found) == ["found /robot1\n", "found /robot2\n", "found /robot3\n"]
            closest = [next(line for line in lines if line.startswith("closest")) for _ in range(3)]
            assert all(re.fullmatch(r"closest: /robot[12] and /robot[23], \d\.\d m\n", line) for line in closest)
        finally:
            demo.send_signal(signal.SIGINT)
    lost = [next(line for line in lines if line.startswith("lost")) for _ in range(3)]
    assert sorted(lost) == ["lost /robot1\n", "lost /robot2\n", "lost /robot3\n"]
    stop(fleet)


@pytest.mark.usefixtures("network")
def test_camera_example_publishes_matching_images_and_depths() -> None:
    camera = start("camera.py")

    async def ask() -> tuple[Image, Image]:
        async with Node("viewer") as node:
            qos = QoSProfile(depth=50).best_effort()
            images = node.create_subscription(Image, "image", qos=qos)
            depths = node.create_subscription(Image, "depth", qos=qos)
            image, depth = await images.receive(timeout_s=20), await depths.receive(timeout_s=20)
            while image.header.stamp != depth.header.stamp:
                if (image.header.stamp.sec, image.header.stamp.nanosec) < (
                    depth.header.stamp.sec,
                    depth.header.stamp.nanosec,
                ):
                    image = await images.receive(timeout_s=20)
                else:
                    depth = await depths.receive(timeout_s=20)
            return image, depth

    image, depth = asyncio.run(ask())
    pixels, metres = image_to_array(image), image_to_array(depth)
    assert (image.encoding, pixels.shape, depth.encoding, metres.shape) == ("rgb8", (240, 320, 3), "32FC1", (240, 320))
    on_disc = (pixels == (255, 160, 0)).all(axis=2)
    assert 2700 < on_disc.sum() < 2950  # pi * 30**2
    assert (np.isfinite(metres) == on_disc).all() and (metres[on_disc] == 1.5).all()
    assert camera.line() == "10 images of 320x240, rgb8 and 32FC1\n"
    stop(camera)


def test_cloud_filter_example_keeps_all_fields() -> None:
    filtering = start("cloud_filter.py")
    points = np.zeros(5, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2")])
    points["x"], points["z"], points["ring"] = [1, 9, 2, np.nan, 3], [1, 1, 0, 1, 2], range(5)

    async def ask() -> PointCloud2:
        async with Node("lidar") as node:
            near = node.create_subscription(PointCloud2, "points_filtered", qos=SENSOR_DATA)
            out = node.create_publisher(PointCloud2, "points", SENSOR_DATA)
            assert await out.wait_for_subscribers(30) and await near.wait_for_publishers(30)
            answer = asyncio.ensure_future(near.receive(timeout_s=20))
            while not answer.done():  # best effort: the other side may not be ready when we are
                out.publish(array_to_pointcloud(points, header=Header(frame_id="lidar"), cls=PointCloud2))
                await asyncio.wait([answer], timeout=0.2)
            return answer.result()

    cloud = asyncio.run(ask())
    left = pointcloud_to_array(cloud)
    assert (cloud.header.frame_id, left["ring"].tolist(), left["x"].tolist()) == ("lidar", [0, 4], [1, 3])
    assert filtering.line() == "5 points, 2 left\n"
    stop(filtering)
    alone = start("cloud_filter.py", "--demo")
    line = re.fullmatch(r"1000 points, (\d+) left\n", alone.line())
    assert line and 100 < int(line[1]) < 300  # pi * 25 / 256 of them are near, half of those above the ground
    stop(alone)


def test_bag_plot_example_plots_fields_of_a_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive") as bag:
        for number in range(300):
            sample = Imu()
            sample.linear_acceleration.x = float(number)
            bag.write("/imu", sample, number * 10_000_000)
    fields = "linear_acceleration.x", "orientation_covariance[0:3]", "angular_velocity_covariance[8]"
    picture, drawing = tmp_path / "imu.png", tmp_path / "imu.svg"
    for output in (picture, drawing):
        output_text = start("bag_plot.py", str(tmp_path / "drive"), "/imu", *fields, "-o", str(output)).communicate(
            timeout=60
        )
        assert output_text == (f"300 messages of /imu, 2.990 s, in {output}\n", "")
    for text in ("/imu", "seconds", *fields):
        assert f"<!-- {text} -->" in drawing.read_text()
    pixels = imread(picture)
    upper = pixels[: len(pixels) // 3, :, :3]
    rows, columns = np.nonzero(np.abs(upper - np.array([31, 119, 180]) / 255).max(axis=2) < 0.05)
    assert len(rows) > 300 and np.corrcoef(rows, columns)[0, 1] < -0.95  # a line that rises: rows count downwards
    failed = start("bag_plot.py", str(tmp_path / "drive"), "/im", "x")
    _, errors = failed.communicate(timeout=60)
    assert failed.returncode == 1 and errors.startswith("error: ") and 'no topic /im; did you mean "/imu"' in errors


def test_transform_lookup_example_transforms_lidar_points_to_the_map() -> None:
    looking = start("transform_lookup.py")
    for _ in range(3):
        line = looking.line()
        found = re.fullmatch(r"\(1\.0, 0\.0, 0\.0\) of lidar is \((\S+), (\S+), 0\.50\) in map\n", line)
        assert found and math.hypot(float(found[1]), float(found[2])) == pytest.approx(4.2, abs=0.02)
    other = start("transform_lookup.py", "lidar", "base_link")
    transforms = (
        line for line in iter(other.line, "") if "after 2 s" not in line
    )  # printed while the robot is not discovered yet
    assert next(transforms) == "(1.0, 0.0, 0.0) of base_link is (0.80, 0.00, -0.50) in lidar\n"
    stop(other)
    stop(looking)


def test_sim_time_example_runs_ten_times_as_fast_and_nodes_follow() -> None:
    simulating = start("sim_time.py")
    listening = start("listener.py")
    talking_process = start("talker_callbacks.py", "--ros-args", "-p", "use_sim_time:=true")
    times = [float(simulating.line().split()[2])]
    begin = time.monotonic()
    times += [float(simulating.line().split()[2]) for _ in range(19)]
    assert times == sorted(times) and times[-1] - times[0] > 15
    assert time.monotonic() - begin < 15
    listening.line()
    begin = time.monotonic()
    for _ in range(20):
        assert listening.line().startswith("I heard: ")
    assert time.monotonic() - begin < 15
    for process in (simulating, listening, talking_process):
        stop(process)


def test_service_chain_example_replies_although_one_service_is_gone() -> None:
    output, errors = start("service_chain.py").communicate(timeout=60)
    assert (output.splitlines(), errors) == (
        ["ready: battery: 87 %; camera: 30 frames/s", "not ready: battery: 87 %; camera: no answer within 2 s"],
        "",
    )


def test_random_cancel_example_reports_same_outcomes_on_both_sides() -> None:
    output, errors = start("random_cancel.py", "30").communicate(timeout=60)
    *goals, last = output.splitlines()
    assert (len(goals), errors) == (30, "")
    ends = {"accepted": "CANCELED", "refused": "SUCCEEDED", "too late": "SUCCEEDED"}
    found = [re.fullmatch(r"goal \d+: cancel after \d\.\d\d s, ([a-z ]+): (\w+) at \d+", line) for line in goals]
    outcomes = Counter(match[1] for match in found if match and ends[match[1]] == match[2])
    canceled = outcomes["accepted"]
    assert outcomes.total() == 30 and 0 < canceled < 30
    assert last == f"the server ended 30 goals: {canceled} CANCELED, {30 - canceled} SUCCEEDED"


def test_example_tests_pass_under_plain_pytest_and_detect_a_mistake(tmp_path: Path) -> None:
    def run_tests(folder: Path = tmp_path) -> str:
        without = [f"-pno:{plugin}" for plugin in ("cacheprovider", "xdist", "timeout")]  # as with pytest alone
        command = [sys.executable, "-m", "pytest", "-q", *without, "test_speed_guard.py"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
        return done.stdout

    assert "5 passed" in run_tests(EXAMPLES)
    code = (EXAMPLES / "speed_guard.py").read_text()
    shutil.copy(EXAMPLES / "test_speed_guard.py", tmp_path)
    (tmp_path / "speed_guard.py").write_text(code.replace("max(-fastest, min(fastest, speed))", "min(fastest, speed)"))
    assert "1 failed, 4 passed" in run_tests()


def test_web_page_example_shows_a_live_topic(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PORT", "0")  # any free port
    showing = start("web_page.py")
    line = re.fullmatch(r"/wave data at (http://127\.0\.0\.1:\d+), stop with Ctrl-C\n", showing.line())
    assert line
    browser.open(line[1])
    assert browser.run("return document.querySelector('h1').textContent") == "/wave data"
    browser.wait_for("return values.length > 100")
    number = browser.wait_for("return number.textContent")
    another = browser.wait_for(f"return number.textContent !== '{number}' && number.textContent")
    assert -1 <= float(number) <= 1 and -1 <= float(another) <= 1
    points = browser.run("return plot.points.length")
    assert 20 < points <= 200
    picture = browser.screenshot()
    assert picture.startswith(b"\x89PNG")
    update_picture("web_page.png", picture)
    stop(showing)
    browser.wait_for("return state.textContent.includes('gone')")


def test_echo_any_example_copies_and_prints_unknown_types() -> None:
    robot, copying = start("strange_robot.py"), start("echo_any.py", "/battery", "/copy")
    assert copying.line() == "copying /battery, a strange_msgs/msg/Battery, to /copy\n"
    echoes = start("echo_any.py", "/battery"), start("echo_any.py", "/copy")
    for echo in echoes:
        assert echo.line() == "strange_msgs/msg/Battery RIHS01_45fd688a...\n"
        battery = json.loads(echo.line())
        assert battery["name"] == "main" and [3 < cell["voltage"] < 4 for cell in battery["cells"]] == [True, True]
    for process in (robot, copying, *echoes):
        stop(process)


def test_meet_robot_example_stops_a_robot_of_unknown_types() -> None:
    robot = start("strange_robot.py")
    output, errors = start("meet_robot.py").communicate(timeout=60)
    *watched, last = output.splitlines()
    assert (watched[:2], errors) == (
        [
            '/battery is strange_msgs/msg/Battery: {"name": "", "cells": []}',
            '/drive is strange_msgs/msg/Drive: {"speed": 0.0, "reason": ""}',
        ],
        "",
    )
    assert re.fullmatch(r"stop: cell 1 is at 3\.(3\d|29) V", last)
    assert all(re.fullmatch(r"the lowest cell is at 3\.4\d V", line) for line in watched[2:])
    output, errors = robot.communicate(timeout=60)
    assert (output.splitlines()[-1], errors) == (f"stopped by a visitor: {last.removeprefix('stop: ')}", "")
