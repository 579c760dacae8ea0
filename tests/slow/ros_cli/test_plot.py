"""``rosidl-py bag plot`` and ``rosidl-py topic plot``, checked by reading back pictures and text."""

from __future__ import annotations

import asyncio
import io
import math
import os
import re
import time
import xml.etree.ElementTree as ET
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.terminal_theme import MONOKAI
from support.browser import browser
from support.docs_pictures import update_picture

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.plotting import output
from rosidl_py_gen.plotting.lines import BUCKETS, PlotLine, PlotPanel, TimeAxis, TopicLines, reduced
from rosidl_py_gen.plotting.text_plot import plain_text, text_plot

if TYPE_CHECKING:
    from pathlib import Path

    from support.browser import Browser
    from support.worlds import World

    from rosidl_py_gen.runtime import Node

__all__ = ["browser"]

pytestmark = pytest.mark.needs("matplotlib", "plotext")

Bool: Any = get_message("std_msgs/msg/Bool")
Float64: Any = get_message("std_msgs/msg/Float64")
Imu: Any = get_message("sensor_msgs/msg/Imu")
LaserScan: Any = get_message("sensor_msgs/msg/LaserScan")
Odometry: Any = get_message("nav_msgs/msg/Odometry")
String: Any = get_message("std_msgs/msg/String")
START_NS = 1_700_000_000_000_000_000
SVG = "{http://www.w3.org/2000/svg}"
CELLS = """
const walker = document.createTreeWalker(document.querySelector("pre"), NodeFilter.SHOW_TEXT), nodes = []
while (walker.nextNode()) nodes.push(walker.currentNode)
for (const node of nodes) node.replaceWith(...[...node.data].map(char => {
  if (char === "\\n") return char
  const cell = document.createElement("span")
  cell.style = "display: inline-block; width: 1ch; white-space: pre"
  cell.textContent = char
  return cell
}))
"""
"""Gives each character the same width, as terminals do; browsers take braille from another font."""
BLUE = np.array([31, 119, 180]) / 255


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SSH_CONNECTION", "1")
    monkeypatch.setenv("COLUMNS", "80")


def wave(second: float) -> float:
    return math.sin(2 * second) * 0.3 + 0.05 * math.sin(31 * second)


def drive(path: Path, count: int = 800, step_ns: int = 10_000_000) -> str:
    """Write a bag of 8 s: an IMU, an odometry that is slower, a switch and a scan."""
    with BagWriter(path) as bag:
        bag.add_topic("/words", String)
        for number in range(count):
            second, at = number * step_ns / 1e9, START_NS + number * step_ns
            imu = Imu()
            imu.header.stamp.sec, imu.header.stamp.nanosec = divmod(at - 5_000_000_000 + number * 1_000_000, 10**9)
            imu.angular_velocity.x, imu.angular_velocity.z = wave(second), 0.6 * math.cos(second)
            bag.write("/imu", imu, at)
            if number % 10 == 0:
                odometry = Odometry()
                odometry.twist.twist.linear.x = min(1.0, second / 3)
                bag.write("/odom", odometry, at)
                bag.write("/on", Bool(data=second >= 4), at)
                scan = LaserScan(ranges=[float("inf"), *(float(place) + second for place in range(24))])
                bag.write("/scan", scan, at)
    return str(path)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    return drive(tmp_path_factory.mktemp("plots") / "drive")


def drawn_lines(path: Path) -> dict[str, list[np.ndarray[Any, Any]]]:
    """Return the points of each line of an SVG, in its coordinates; a line that is interrupted has several pieces."""
    lines: dict[str, list[np.ndarray[Any, Any]]] = {}
    for group in ET.parse(path).iter(f"{SVG}g"):
        name, paths = group.get("id", ""), group.findall(f"{SVG}path")
        if name.startswith("/") and paths:
            pieces = re.findall(r"M[^M]+", paths[0].get("d", ""))
            numbers = ([float(text) for text in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", piece)] for piece in pieces)
            lines[name] = [np.array(piece).reshape(-1, 2) for piece in numbers]
    return lines


def texts(path: Path) -> list[str]:
    return ["".join(one.itertext()).strip() for one in ET.parse(path).iter(f"{SVG}text")]


def check_drawn(points: np.ndarray[Any, Any], expected: Any, start_s: float, end_s: float) -> None:
    """Check that a line in a picture is a function of time, whose ends are those of the line."""
    seconds = start_s + (points[:, 0] - points[0, 0]) / (points[-1, 0] - points[0, 0]) * (end_s - start_s)
    values = np.array([expected(second) for second in seconds])
    slope, offset = np.polyfit(points[:, 1], values, 1)
    assert slope < 0  # coordinates of SVG count downwards
    assert np.abs(slope * points[:, 1] + offset - values).max() < 0.02 * np.ptp(values)


def test_bag_plot_draws_fields_into_png_and_svg(run_here: Any, bag: str, tmp_path: Path) -> None:
    picture, drawing = tmp_path / "drive.png", tmp_path / "drive.svg"
    words = ("/imu", "angular_velocity.x", "angular_velocity.z", "/odom", "twist.twist.linear.x")
    for out in (picture, drawing):
        code, printed, err = run_here("bag", "plot", bag, *words, "--out", str(out))
        assert (code, printed, err) == (0, f"880 messages of 2 topics in {out}\n", "")
    displayed = texts(drawing)
    assert {"/imu", "/odom", "time [s]", *words[1:3], words[4]} <= {*displayed}
    lines = drawn_lines(drawing)
    assert [*lines] == ["/imu.angular_velocity.x", "/imu.angular_velocity.z", "/odom.twist.twist.linear.x"]
    check_drawn(lines["/imu.angular_velocity.x"][0], wave, 0, 7.99)
    check_drawn(lines["/imu.angular_velocity.z"][0], lambda second: 0.6 * math.cos(second), 0, 7.99)
    check_drawn(lines["/odom.twist.twist.linear.x"][0], lambda second: min(1.0, second / 3), 0, 7.9)
    from matplotlib.image import imread

    pixels = imread(picture)
    assert pixels.shape[1] == 1080
    lower = pixels[len(pixels) // 2 :, :, :3]  # the odometry rises in its first three seconds
    rows, columns = np.nonzero(np.abs(lower - BLUE).max(axis=2) < 0.05)
    assert len(rows) > 250 and np.ptp(columns) > 200
    assert np.corrcoef(rows, columns)[0, 1] < -0.95
    update_picture("bag_plot_command.png", picture.read_bytes())


def test_plot_draws_numbers_booleans_stamps_and_array_elements(run_here: Any, bag: str, tmp_path: Path) -> None:
    out = tmp_path / "a.svg"
    words = ("/on", "/scan", "ranges[0:3]", "ranges[-1]", "/imu", "header", "orientation_covariance[8]")
    code, _, err = run_here("bag", "plot", bag, *words, "-o", str(out))
    assert (code, err) == (0, "")
    lines = drawn_lines(out)
    ranges = [f"/scan.ranges[{number}]" for number in (0, 1, 2, -1)]
    assert {*lines} == {"/on.data", *ranges, "/imu.header.stamp", "/imu.orientation_covariance[8]"}
    steps = lines["/on.data"][0]
    assert len({*steps[:, 1]}) == 2 and (np.diff(steps, axis=0) == 0).any(axis=1).all()  # across or upwards
    check_drawn(lines["/scan.ranges[-1]"][0], lambda second: 23 + second, 0, 7.9)
    check_drawn(lines["/imu.header.stamp"][0], lambda second: 1.1 * second, 0, 7.99)
    code, _, err = run_here("bag", "plot", bag, "/scan", "ranges", "--out", str(out))
    assert (code, err) == (0, "ranges: only the first 20 elements are drawn; name others, such as ranges[20:40]\n")
    assert len(drawn_lines(out)) == 20


def test_time_axis_is_bag_offset_header_stamp_or_wall_clock(
    run_here: Any, bag: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    out = tmp_path / "a.svg"
    part = ("/imu", "angular_velocity.x", "--start-offset", "2", "--duration", "3", "-o", str(out))
    assert run_here("bag", "plot", bag, *part)[1] == f"300 messages of /imu in {out}\n"
    check_drawn(drawn_lines(out)["/imu.angular_velocity.x"][0], wave, 2, 4.99)
    assert run_here("bag", "plot", bag, *part, "--stamp")[0] == 0
    check_drawn(drawn_lines(out)["/imu.angular_velocity.x"][0], wave, 2, 4.99)  # the stamps advance evenly, too
    assert "time of header.stamp [s]" in texts(out)
    assert run_here("bag", "plot", bag, *part, "--wall-clock")[0] == 0
    assert {"22:13:22", "22:13:24", "2023-Nov-14 22:13"} & {*texts(out)}, texts(out)
    code, printed, _ = run_here("bag", "plot", bag, *part[:6], "--wall-clock")
    assert code == 0 and re.search(r"2023-11-14 22:13:22 +time +2023-11-14 22:13:24\n", printed)
    code, _, err = run_here("bag", "plot", bag, "/odom", "twist.twist.linear.x", "/on", "data", "--stamp")
    assert (code, err) == (1, "error: messages of /on have no header with a stamp: std_msgs/msg/Bool\n")


def test_several_bags_are_drawn_with_their_names(run_here: Any, tmp_path: Path) -> None:
    first, second = drive(tmp_path / "a", 100), drive(tmp_path / "b", 200)
    out = tmp_path / "two.svg"
    code, printed, err = run_here("bag", "plot", first, second, "/imu", "angular_velocity.z", "--out", str(out))
    assert (code, printed, err) == (0, f"300 messages of 2 topics in {out}\n", "")
    assert {"a: /imu", "b: /imu"} <= {*texts(out)}


def test_terminal_plot_shows_lines_axes_and_legend(run_here: Any, bag: str) -> None:
    code, printed, err = run_here("bag", "plot", bag, "/odom", "twist.twist.linear")
    rows = printed.splitlines()
    assert (code, err) == (0, "")
    assert rows[0] == "/odom" and max(map(len, rows)) <= 80
    assert rows[-1] == "  ━ twist.twist.linear.x  ━ twist.twist.linear.y  ━ twist.twist.linear.z"
    assert re.fullmatch(r" +0\.00 +3\.95 time \[s\] +7\.90", rows[-2])
    assert rows[2].startswith("1.00┤") and rows[-4].startswith("0.00┤")
    body = [row[5:].rstrip("│") for row in rows[2:-3]]
    dots = {(number, column) for number, row in enumerate(body) for column, char in enumerate(row) if char != " "}
    width, height = 74, len(body)
    for column in range(width):
        level = min(1.0, 7.9 * column / (width - 1) / 3)
        assert any(abs(row - (1 - level) * (height - 1)) <= 1.2 for row, at in dots if at == column)
    assert all(row > 0 for row, column in dots if column < 20)  # not yet at the top
    assert "\x1b" not in printed


@pytest.mark.parametrize("gap", [math.nan, math.inf, -math.inf])
def test_terminal_line_has_steps_and_gaps_at_values_that_are_not_finite(gap: float) -> None:
    panel = PlotPanel("/t")
    waves, steps = PlotLine("wave"), PlotLine("on", is_steps=True)
    for number in range(100):
        waves.add(number, gap if 40 <= number < 60 else 1.0)
        steps.add(number, 0.0)
    panel.lines += [waves, steps]
    rows = plain_text(text_plot([panel], TimeAxis(), 80, 12)).splitlines()
    top, bottom = (row[5:79] for row in (rows[2], rows[-4]))
    assert " " not in bottom and re.fullmatch(r"[^ ]{29,31} {13,16}[^ ]{29,31}", top)


def test_terminal_plot_fits_width_with_long_names_and_extreme_values() -> None:
    panel = PlotPanel("/\x1b[31mevil" + "x" * 300)
    lines = TopicLines(panel, "/t", ["ranges"])
    for number in range(5):
        lines.add(LaserScan(ranges=[float("nan")] * 5 + [1e300 * number, -1e-300]), number)
    plot = text_plot([panel], TimeAxis(), 40, 20)
    rows = plain_text(plot).splitlines()
    assert "\x1b[31m" not in plot and "\x1b" not in "".join(rows) and max(map(len, rows)) <= 40
    far = PlotPanel("/t")
    huge = TopicLines(far, "/t", ["data"])
    for number, value in enumerate((1.7e308, -1.7e308, 5e-324, 0.0)):
        huge.add(Float64(data=value), number)
    assert "8e+307" in plain_text(text_plot([far], TimeAxis(), 40, 20)).splitlines()[2]
    empty = plain_text(text_plot([PlotPanel("/t")], TimeAxis(), 60, 12)).splitlines()
    assert empty[0] == "/t" and len(empty) >= 7


@given(
    st.lists(st.floats() | st.sampled_from([1.7976e308, -1.7976e308, 5e-324]), min_size=1, max_size=30),
    st.lists(st.floats(0, 1e12), min_size=30, max_size=30),
    st.booleans(),
    st.integers(20, 200),
    st.integers(1, 60),
)
def test_any_values_are_drawn(values: list[float], times: list[float], is_steps: bool, width: int, height: int) -> None:
    panel, line = PlotPanel("/t"), PlotLine("x", is_steps=is_steps)
    for second, value in zip(sorted(times), values, strict=False):
        line.add(second, value)
    panel.lines.append(line)
    rows = plain_text(text_plot([panel], TimeAxis(), width, height)).splitlines()
    assert max(map(len, rows)) <= width and rows[0] == "/t"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["/imu", "angular_velocityz"], 'no field angular_velocityz; did you mean "angular_velocity.z"?; numeric fi'),
        (["/imu"], "expected a field after the topic; numeric fields of sensor_msgs/msg/Imu: header.stamp, ori"),
        (["/imu", "header.frame_id"], "header.frame_id has no number, but text; numeric fields of sensor_msgs/msg/Imu"),
        (["/words", "data"], "/words: data has no number, but text; numeric fields of std_msgs/msg/String: none\n"),
        (["/imu", "angular_velocity.x.y"], "angular_velocity.x is float64, which has no fields; numeric fields"),
        (["/imu", "orientation_covariance[9]"], "the array has 9 elements; numeric fields"),
        (["/im", "x"], 'has no topic /im; did you mean "/imu"?'),
        (["angular_velocity.x"], "angular_velocity.x: expected a topic such as /odom, which begins with a slash"),
        ([], "expected a topic and fields after the bag; topics of "),
        (["/imu", "angular_velocity", "--start-offset", "60"], "is 7.990 s long; expected a start offset within it"),
        (["/imu", "angular_velocity", "--out", "a.xyz"], "the ending selects the format; expected one of .png, "),
        (["/imu", "angular_velocity", "--out", "no/folder/a.png"], "no/folder/a.png: No such file or directory"),
    ],
)
def test_plot_errors_name_available_topics_and_fields(
    words: Any, reason: str, run_here: Any, bag: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, printed, err = run_here("bag", "plot", bag, *words)
    assert (code, printed) == (1, "") and reason in err and os.listdir() == []


def test_plot_of_topic_without_messages_is_an_error(run_here: Any, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as bag:
        bag.add_topic("/f", Float64)
        bag.write("/s", String(), 1)
    code, _, err = run_here("bag", "plot", str(tmp_path / "a.mcap"), "/f")
    assert code == 1 and err.endswith("a.mcap has no messages on /f in the selected time\n")


def test_plot_without_matplotlib_is_drawn_as_text(run_here: Any, bag: str, tmp_path: Path, monkeypatch: Any) -> None:
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "matplotlib" else find(name))
    code, _, err = run_here("bag", "plot", bag, "/on", "data", "--out", str(tmp_path / "a.png"))
    assert code == 1 and re.search(r"needs matplotlib, which is not installed: pip install .*\[plot\]", err)
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("SSH_CONNECTION")
    code, printed, err = run_here("bag", "plot", bag, "/on", "data")
    assert code == 0 and printed.startswith("/on\n") and err.startswith("a window needs matplotlib: pip install ")
    assert run_here("bag", "plot", bag, "/on", "data", "--terminal")[2] == ""


@pytest.mark.parametrize("command", ["bag", "topic"])
def test_without_plotext_the_terminal_has_an_error(run_here: Any, bag: str, monkeypatch: Any, command: str) -> None:
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "plotext" else find(name))
    code, printed, err = run_here(command, "plot", *([bag] if command == "bag" else []), "/on", "data", "--terminal")
    assert (code, printed) == (1, "")
    assert re.search(r"needs plotext, which is not installed: pip install .*\[plot\]", err)


def test_plot_window_is_shown_until_closed(run_here: Any, bag: str, monkeypatch: Any) -> None:
    import matplotlib.pyplot as plt

    from rosidl_py_gen.plotting import figure

    displayed: list[Any] = []
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("SSH_CONNECTION")
    code, printed, err = run_here("bag", "plot", bag, "/on", "data")
    assert code == 0 and printed.startswith("/on\n")  # matplotlib finds no toolkit
    assert err == "matplotlib cannot open a window: no display, or no toolkit such as tkinter or PyQt6\n"
    monkeypatch.setattr(plt, "get_backend", lambda: "tkagg")

    def show(**settings: Any) -> None:
        displayed.append([one.get_title(loc="left") for one in plt.gcf().axes])

    monkeypatch.setattr(plt, "show", show)
    assert run_here("bag", "plot", bag, "/on", "data", "/odom", "twist.twist.linear.x") == (0, "", "")
    assert displayed == [["/on", "/odom"]] and not plt.get_fignums()
    with figure.open_window(1) as window:
        assert window is not None and window.is_open
        window.update([PlotPanel("/t")], TimeAxis())
        plt.close("all")
        assert not window.is_open


def test_plot_line_retains_extremes_with_bounded_memory() -> None:
    line, times = PlotLine("x"), np.arange(200_000) * 0.001
    values = np.sin(times)
    values[[1234, 150_001]] = 7.0, -9.0
    values[5000:5100] = np.nan
    for second, value in zip(times.tolist(), values.tolist(), strict=True):
        line.add(second, value)
    retained_times, retained = line.points()
    assert len(retained) <= 8 * BUCKETS and (np.diff(retained_times) >= 0).all()
    assert (np.nanmax(retained), np.nanmin(retained)) == (7.0, -9.0)
    assert retained_times[np.nanargmax(retained)] == 1.234 and (retained_times[0], retained_times[-1]) == (
        times[0],
        times[-1],
    )
    known = np.isfinite(retained)
    assert np.isin(retained[known], values).all()  # each is a point of the data
    assert np.diff(retained_times).max() < 2 * 200 / BUCKETS  # spread over the whole time


@pytest.mark.parametrize("seed", range(5))
def test_reduced_lines_have_first_last_and_extremes_of_each_bucket(seed: int) -> None:
    random = np.random.default_rng(seed)
    times = np.sort(random.uniform(0, 10, 5000))
    values = np.where(random.random(5000) < 0.3, np.nan, random.normal(size=5000))
    some_times, some = reduced(times, values, 50)
    assert len(some) <= 200
    for number in range(50):
        start, end = (times[0] + np.ptp(times) * (number + part) / 50 for part in (0, 1))
        inside = (times >= start + 1e-4) & (times <= end - 1e-4)
        chosen = some[(some_times >= start - 1e-9) & (some_times <= end + 1e-9)]
        assert np.nanmax(chosen) >= np.nanmax(values[inside]) and np.nanmin(chosen) <= np.nanmin(values[inside])
    same = reduced(np.zeros(1000), np.arange(1000.0), 10)
    assert same[1].tolist() == [0.0, 999.0]


@pytest.fixture
def node(memory: World) -> Node:
    return memory.node("robot", enable_rosout=False, parameter_events=False)


async def send_numbers(publisher: Any, count: int, interval_s: float, factor: float = 1.0) -> None:
    """Publish 0, 1, ... as soon as there is a subscriber."""
    await publisher.wait_for_subscribers(5)
    for number in range(count):
        publisher.publish(Float64(data=number * factor))
        await asyncio.sleep(interval_s)


async def test_topic_plot_writes_received_messages_to_file(node: Node, tool: Any, tmp_path: Path) -> None:
    publisher, switch = node.create_publisher(Imu, "/imu"), node.create_publisher(Bool, "/on")
    out = tmp_path / "live.svg"
    words = ("/imu", "angular_velocity.x", "/on", "data", "--stamp")
    with_stamps = await tool("topic", "plot", *words)
    assert with_stamps.code == 1 and "messages of /on have no header with a stamp" in with_stamps.err
    process = await tool.start("topic", "plot", *words[:4], "--out", str(out))
    await publisher.wait_for_subscribers(5)
    await switch.wait_for_subscribers(5)
    for number in range(50):
        imu = Imu()
        imu.angular_velocity.x = float(number)
        publisher.publish(imu)
        switch.publish(Bool(data=number > 20))
        await asyncio.sleep(0.02)
    ended = await tool.interrupt(process)
    assert (ended.code, ended.out) == (0, f"100 messages of 2 topics in {out}\n")
    lines = drawn_lines(out)
    assert [*lines] == ["/imu.angular_velocity.x", "/on.data"]
    heights = lines["/imu.angular_velocity.x"][0][:, 1]
    assert (np.diff(heights) < 0).all()


async def test_topic_plot_ends_after_message_count_or_duration(node: Node, tool: Any, tmp_path: Path) -> None:
    publisher = node.create_publisher(Float64, "/f")
    process = await tool.start("topic", "plot", "/f", "-n", "3")
    await send_numbers(publisher, 4, 0.1, factor=2.0)
    ended = await tool.end(process)
    assert ended.code == 0 and re.match(r"/f\n +┌─+┐\n4\.00┤", ended.out) and "━ data\n" in ended.out
    silent = await tool("topic", "plot", "/f", "data", "--duration", "2")
    assert (silent.code, silent.err) == (1, "error: no message on /f in 2 s\n")
    wrong = await tool("topic", "plot", "/f", "dat")
    assert wrong.code == 1 and 'no field dat; did you mean "data"?' in wrong.err
    missing = await tool("topic", "plot", "/g", "data", "--timeout", "0.2")
    assert missing.code == 1 and "no topic /g was found" in missing.err
    options = ("--duration", "10", "--last", "1", "--out", str(tmp_path / "a.png"))
    process = await tool.start("topic", "plot", "/f", *options)
    await send_numbers(publisher, 1, 0)
    ended = await tool.end(process)
    assert (ended.code, ended.out) == (0, f"1 message of /f in {tmp_path / 'a.png'}\n")


async def test_topic_plot_redraws_window_until_closed(node: Node, tool: Any, monkeypatch: Any) -> None:
    drawn: list[int] = []

    class Window:
        @property
        def is_open(self) -> bool:
            return not drawn or drawn[-1] < 4

        def update(self, panels: Any, axis: TimeAxis) -> None:
            if panels is not None:
                drawn.append(panels[0].count)

    monkeypatch.setattr(output, "plot_window", lambda count, in_terminal: nullcontext(Window()))
    process = await tool.start("topic", "plot", "/f")
    await send_numbers(node.create_publisher(Float64, "/f"), 5, 0.4)
    ended = await tool.end(process)
    assert (ended.code, ended.out, drawn) == (0, "4 messages of /f\n", [1, 2, 3, 4])


async def test_topic_plot_redraws_terminal(node: Node, tool: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []
    monkeypatch.setattr(output.terminal_output, "is_terminal", lambda: True)
    monkeypatch.setattr(
        "rosidl_py_gen.plotting.text_plot.text_plot", lambda panels, *_: drawn.append(panels[0].count) or ""
    )
    process = await tool.start("topic", "plot", "/f", "--duration", "2")
    await send_numbers(node.create_publisher(Float64, "/f"), 6, 0.3)
    assert (await tool.end(process)).code == 0
    assert drawn == sorted(drawn) and len({*drawn}) >= 4 and drawn[-1] == 6


def test_terminal_plot_is_rendered_in_browser(tmp_path: Path, browser: Browser) -> None:
    panels = [PlotPanel("/imu"), PlotPanel("/odom")]
    imus = TopicLines(panels[0], "/imu", ["angular_velocity"])
    speeds = TopicLines(panels[1], "/odom", ["twist.twist.linear.x"])
    for number in range(400):
        imu, odometry, second = Imu(), Odometry(), number / 50
        imu.angular_velocity.x, imu.angular_velocity.z = wave(second), 0.6 * math.cos(second)
        odometry.twist.twist.linear.x = min(1.0, second / 3)
        imus.add(imu, number * 20_000_000)
        speeds.add(odometry, number * 20_000_000)
    console = Console(record=True, force_terminal=True, color_system="standard", width=80, file=io.StringIO())
    console.print(output.rich_text(text_plot(panels, TimeAxis(), 80, 28)))
    page = tmp_path / "terminal.html"
    page.write_text(console.export_html(inline_styles=True, theme=MONOKAI), encoding="utf-8")
    browser.resize(800, 560)
    browser.open(page.as_uri())
    browser.run("document.querySelector('code').style.fontFamily = 'DejaVu Sans Mono, monospace'")
    browser.run("document.querySelector('pre').style.lineHeight = '1.16'")
    assert "━ angular_velocity.x  ━ angular_velocity.y" in browser.run("return document.body.innerText")
    browser.run(CELLS)
    bottom = browser.run("return document.querySelector('pre').getBoundingClientRect().bottom")
    browser.resize(800, math.ceil(bottom) + 12)
    update_picture("topic_plot.png", browser.screenshot())
