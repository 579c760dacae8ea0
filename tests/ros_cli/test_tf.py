"""``rosidl-py tf``: one transform, the tree of frames in four forms, rates and delays."""

from __future__ import annotations

import asyncio
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from support.transform_frames import LEVEL, QUARTER, S, moved

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.tf import png, tree
from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics
from rosidl_py_gen.tf import StaticTransformBroadcaster, Transform, TransformBroadcaster

if TYPE_CHECKING:
    from conftest import Tool
    from support.node_fixtures import World

TFMessage: Any = get_message("tf2_msgs/msg/TFMessage")
EVIL = '"];f0-->x\x1b[31m\u202e<script>&#x;'


async def robot(world: World, *, late_s: float = 0.0) -> None:
    """map <- odom at 5 Hz <- base at 20 Hz <- lidar, camera, which are static."""
    localizer, base, description = world.node("localizer"), world.node("base"), world.node("description")
    fixed = [moved("base", "lidar", 0, 0.5, QUARTER), moved("base", "camera", 0, 0.25)]
    StaticTransformBroadcaster(description).send(fixed)
    one, two = TransformBroadcaster(localizer), TransformBroadcaster(base)

    def send(broadcaster: Any, parent: str, child: str) -> None:
        stamp_s = base.clock.now().nanoseconds / S - late_s
        broadcaster.send(moved(parent, child, stamp_s, 2))

    localizer.create_timer(0.2, lambda: send(one, "map", "odom"))
    base.create_timer(0.05, lambda: send(two, "odom", "base"))


async def test_echo_shows_one_transform_as_tf2_echo_does(memory: World, tool: Tool) -> None:
    node = memory.node("robot")
    latched = StaticTransformBroadcaster(node)
    latched.send([Transform("map", "base", 0, np.array([1.0, -2, 3]), QUARTER), moved("base", "lidar", 0, 1)])
    done = await tool("tf", "echo", "map", "lidar", "--once", "-p", "2")
    assert done.out == (
        "At time 0.000000000\n"
        "- Translation: [1.00, -1.00, 3.00]\n"
        "- Rotation: in Quaternion (xyzw) [0.00, 0.00, 0.71, 0.71]\n"
        "- Rotation: in RPY (radian) [0.00, 0.00, 1.57]\n"
        "- Rotation: in RPY (degree) [0.00, 0.00, 90.00]\n"
        "- Matrix:\n"
        "  0.00  -1.00  0.00  1.00\n"
        "  1.00  0.00  0.00  -1.00\n"
        "  0.00  0.00  1.00  3.00\n"
        "  0.00  0.00  0.00  1.00\n"
    )
    data = await tool("tf", "echo", "map", "lidar", "-n", "2", "--rate", "10", "--json")
    rows = [json.loads(line) for line in data.out.splitlines()]
    assert len(rows) == 2 and rows[0] == rows[1]
    assert np.allclose(rows[0]["translation"], [1, -1, 3]) and math.isclose(rows[0]["euler"][2], math.pi / 2)
    assert (rows[0]["target"], rows[0]["source"], rows[0]["stamp_ns"]) == ("map", "lidar", 0)


async def test_echo_says_what_is_missing(memory: World, tool: Tool) -> None:
    await robot(memory)
    done = await tool("tf", "echo", "map", "tool", "--timeout", "2")
    assert done.code == 1
    assert done.err.startswith(
        'error: no transform from "tool" to "map": after 2 s: the source frame "tool" is not known (known: base, '
    )
    wrong = await tool("tf", "echo", "/map", "tool")
    assert wrong.code == 1 and "begins with /" in wrong.err


async def test_the_tree_shows_parents_rates_delays_and_nodes(memory: World, tool: Tool) -> None:
    await robot(memory, late_s=0.5)
    plain, data, mermaid = await asyncio.gather(
        tool("tf", "tree"), tool("tf", "tree", "--json", "--wait-time", "6"), tool("tf", "tree", "--format", "mermaid")
    )
    assert plain.out == (
        "map\n"
        "└─ odom          5.0 Hz, 0.500 s late, /localizer\n"
        "   └─ base       20.0 Hz, 0.500 s late, /base\n"
        "      ├─ camera  static, /description\n"
        "      └─ lidar   static, /description\n"
    )
    answer = json.loads(data.out)
    assert answer["roots"] == ["map"]
    assert [(one["frame"], one["parent"], one["static"]) for one in answer["frames"]] == [
        ("base", "odom", False),
        ("camera", "base", True),
        ("lidar", "base", True),
        ("odom", "map", False),
    ]
    base = answer["frames"][0]
    assert base["rate_hz"] == pytest.approx(20, abs=1) and base["delay_s"]["mean"] == pytest.approx(0.5, abs=0.01)
    assert base["publishers"] == ["/base"] and answer["frames"][1]["rate_hz"] is None
    first, *rest = mermaid.out.splitlines()
    assert first == "flowchart TD" and '  f0["base"]' in rest
    assert '  f0 -.->|"static, /description"| f1' in rest
    assert '  f3 -->|"5.0 Hz, 0.500 s late, /localizer"| f4' in rest


async def test_the_tree_is_written_into_files_by_their_ending(memory: World, tool: Tool, tmp_path: Path) -> None:
    await robot(memory)
    endings = ("png", "md", "json", "txt")
    files = [str(tmp_path / f"frames.{ending}") for ending in endings]
    done = await asyncio.gather(*(tool("tf", "tree", "-o", file, "--wait-time", "1") for file in files))
    assert [(one.code, one.out) for one in done] == [(0, "")] * 4, done
    assert done[0].err == f"wrote {files[0]}: 5 frames\n"
    with Image.open(files[0]) as picture:
        assert picture.format == "PNG" and picture.width >= 300 and picture.height > 3 * 92
        colors = {color for _, color in picture.getcolors(1 << 20) or []}
    assert {(0xE8, 0xF0, 0xFE), (0xEE, 0xF7, 0xEE), (0xFF, 0xF4, 0xE2)} <= colors
    assert Path(files[1]).read_text().startswith("```mermaid\nflowchart TD\n")
    assert json.loads(Path(files[2]).read_text())["roots"] == ["map"]
    assert Path(files[3]).read_text().startswith("map\n└─ odom ")


async def test_files_that_cannot_be_written_are_told_before_anybody_waits(memory: World, tool: Tool) -> None:
    ending, no_file = await asyncio.gather(tool("tf", "tree", "-o", "f.bmp"), tool("tf", "tree", "--format", "png"))
    assert ending.code == 1 and "expected one of .png, .mmd" in ending.err
    assert no_file.code == 1 and "write it to a file: -o frames.png" in no_file.err
    nothing = await tool("tf", "tree", "--wait-time", "0.1")
    assert (nothing.code, nothing.out) == (0, "no transforms\n")


async def test_what_is_wrong_with_the_whole_is_told(memory: World, tool: Tool) -> None:
    one, two = TransformBroadcaster(memory.node("one")), TransformBroadcaster(memory.node("two"))
    node = memory.node("timer")

    def send() -> None:
        one.send([moved("map", "odom"), moved("a", "b"), moved("b", "c"), moved("c", "a"), moved("c", "d")])
        two.send([moved("map", "odom", 1, 5), moved("bench", "tool"), moved("x", "x")])

    node.create_timer(0.1, send)
    done = await tool("tf", "tree", "--wait-time", "1")
    assert done.err == (
        'ignored a transform: "x": frame_id and child_frame_id are the same\n'
        "warning: 2 trees that are not connected: bench, map\n"
        "warning: frames that form a loop, or are below one: a, b, c, d\n"
        "warning: odom comes from 2 publishers\n"
    )
    assert done.out.startswith("bench\n└─ tool ") and "/one, /two" in done.out


async def test_monitor_tells_rates_and_delays_every_second(memory: World, tool: Tool) -> None:
    await robot(memory, late_s=0.25)
    every, way, data = await asyncio.gather(
        tool("tf", "monitor", "-n", "2"),
        tool("tf", "monitor", "map", "lidar", "-n", "2"),
        tool("tf", "monitor", "odom", "lidar", "-n", "1", "--json"),
    )
    rows = [line.split("\t") for line in every.out.splitlines()]
    assert [row[0] for row in rows] == ["base", "camera", "lidar", "odom"] * 2
    base = rows[4]
    assert base[1] == "odom" and float(base[2]) == pytest.approx(20, abs=1) and base[5] == "/base"
    assert float(base[3]) == pytest.approx(0.25, abs=0.01) and rows[5][2:5] == ["static", "", ""]
    last = way.out.splitlines()[-1]
    found = re.fullmatch(r"lidar in map: net delay (0\.\d{3}) s, max (0\.\d{3}) s", last)
    assert found and 0.25 <= float(found[1]) <= float(found[2]) < 0.5
    assert [line.split("\t")[0] for line in way.out.splitlines()[:3]] == ["lidar", "base", "odom"]
    answer = json.loads(data.out)
    assert {one["frame"] for one in answer["frames"]} == {"base", "lidar"}
    assert answer["net_delay_s"]["mean"] == pytest.approx(0.25, abs=0.06)


async def test_monitor_of_what_is_not_connected_says_so(memory: World, tool: Tool) -> None:
    process = await tool.start("tf", "monitor", "map", "nowhere")
    await robot(memory)
    await asyncio.sleep(4)
    process.kill()
    done = await tool.end(process)
    assert 'the source frame "nowhere" is not known' in done.err
    one, same = await asyncio.gather(tool("tf", "monitor", "map"), tool("tf", "monitor", "map", "map"))
    assert one.code == same.code == 1 and "no frames or two" in one.err and "two different frames" in same.err


def bag(path: Path) -> str:
    """A recording of four seconds."""
    with BagWriter(path) as writer:
        writer.add_topic("/tf", TFMessage)
        writer.add_topic("/tf_static", TFMessage)
        lidar = moved("base", "lidar", 0).to_message()
        writer.write("/tf_static", TFMessage(transforms=[lidar]), log_time_ns=1 * S)
        for number in range(41):
            stamp = 1 * S + number * S // 10
            base = Transform("map", "base", stamp - S // 4, np.zeros(3), LEVEL).to_message()
            writer.write("/tf", TFMessage(transforms=[base]), log_time_ns=stamp)
    return str(path)


def test_the_frames_of_a_bag_need_no_network(tmp_path: Path, run_here: Any) -> None:
    code, out, err = run_here("tf", "tree", "--bag", bag(tmp_path / "drive.mcap"))
    assert (code, err) == (0, "")
    assert out == "map\n└─ base      10.0 Hz, 0.250 s late, /tf\n   └─ lidar  static, /tf_static\n"


def taken(transforms: list[Any]) -> FrameStatistics:
    frames = FrameStatistics()
    for number in (1, 2):
        message = TFMessage(transforms=[one.to_message() for one in transforms])
        frames.add_message(message, number * S, "peer", static=False)
    return frames


def test_names_of_peers_are_text_in_every_form(tmp_path: Path) -> None:
    frames = taken([moved("map", EVIL), moved(EVIL, "x" * 300)])
    label = r"(?:[A-Za-z0-9_/ .,()-]|#\d+;)*"
    first, *lines = tree.mermaid(frames, {"peer": EVIL}).splitlines()
    form = rf'  f\d+(?:\["{label}"\]| -->\|"{label}"\| f\d+)'
    assert first == "flowchart TD" and [line for line in lines if not re.fullmatch(form, line)] == []
    assert tree.document(frames, {"peer": EVIL})["frames"][0]["frame"] == EVIL
    png.write(frames, {"peer": EVIL}, tmp_path / "evil.png")


def test_very_deep_and_very_wide_trees_stay_small(tmp_path: Path) -> None:
    deep = taken([moved(f"f{number}", f"f{number + 1}") for number in range(3000)])
    shown = [line for line, _ in tree.lines(deep, {})]
    assert len(shown) == 3001 and max(map(len, shown)) < 250
    png.write(taken([moved(f"f{number}", f"f{number + 1}") for number in range(100)]), {}, tmp_path / "deep.png")
    wide = taken([moved("map", f"child{number}") for number in range(3000)])
    with pytest.raises(CommandError, match=r"3001 frames need a picture of .* pixels; --format mermaid"):
        png.write(wide, {}, tmp_path / "wide.png")


async def test_everything_works_between_processes_on_dds(dds: World, tool: Tool) -> None:
    await robot(dds)
    tree, echo = await asyncio.gather(
        tool("tf", "tree", "--json", "--wait-time", "6"),
        tool("tf", "echo", "map", "lidar", "--once", "--json", "--timeout", "20"),
    )
    answer = json.loads(tree.out)
    expected = {"base": "/base", "camera": "/description", "lidar": "/description", "odom": "/localizer"}
    assert {one["frame"]: "".join(one["publishers"]) for one in answer["frames"]} == expected
    assert json.loads(echo.out)["translation"] == pytest.approx([4.5, 0, 0])
