"""``rosidl-py graph`` and ``rosidl-py tf``: pictures and tables, in which names of peers are escaped."""

from __future__ import annotations

import asyncio
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from support.transform_frames import LEVEL, QUARTER, S, moved
from support.waiting import until

from rosidl_py_gen import get_action, get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.ros_cli import graph as graph_module
from rosidl_py_gen.ros_cli import tf as tf_module
from rosidl_py_gen.ros_cli.graph import Edge, Picture
from rosidl_py_gen.ros_cli.tf import png
from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics
from rosidl_py_gen.runtime.qos import SENSOR_DATA
from rosidl_py_gen.tf import StaticTransformBroadcaster, Transform, TransformBroadcaster

if TYPE_CHECKING:
    from support.commands import Tool
    from support.worlds import World


EVIL = '/a"><script>alert(1)</script>&#x;]) --> x\n```\x1b[31m\ud800\ufffe#quot;%%{init}%%'


async def robot(dds: World) -> None:
    """Two nodes that share a topic, a service and an action, and a third that has nothing."""
    fibonacci = get_action("example_interfaces/action/Fibonacci")
    base, pilot = dds.node("base"), dds.node("pilot", "/cockpit")
    dds.node("idle")
    base.create_subscription(String, "/speed")
    base.create_publisher(Bool, "/bumper")
    base.create_publisher(Bool, "/_hidden")
    base.create_service(SetBool, "/enable", lambda request: SetBool.Response())
    base.create_action_server(fibonacci, "/drive", lambda goal: None)
    pilot.create_publisher(String, "/speed")
    pilot.create_client(SetBool, "/enable")
    pilot.create_action_client(fibonacci, "/drive")
    await until(lambda: pilot.count_services("/drive/_action/get_result") == 1)


def with_names(answer: dict[str, Any], node: str, role: str) -> list[tuple[str, str, list[str]]]:
    (found,) = [one for one in answer["nodes"] if one["name"] == node]
    return [(row["kind"], row["name"], row["with"]) for row in found[role]]


async def test_graph_lists_connections_of_nodes_by_topic_service_and_action(memory: World, tool: Tool) -> None:
    await robot(memory)
    answer = json.loads((await tool("graph", "--json", "--spin-time", "3")).out)
    assert [one["name"] for one in answer["nodes"]] == ["/base", "/cockpit/pilot", "/idle"]
    assert with_names(answer, "/base", "publishes") == [("topic", "/bumper", [])]
    assert with_names(answer, "/base", "subscribes") == [("topic", "/speed", ["/cockpit/pilot"])]
    for name, role, other in (("/base", "serves", "/cockpit/pilot"), ("/cockpit/pilot", "calls", "/base")):
        assert with_names(answer, name, role) == [("action", "/drive", [other]), ("service", "/enable", [other])]
    types = [["example_interfaces/action/Fibonacci"], ["std_srvs/srv/SetBool"]]
    assert [row["types"] for row in answer["nodes"][0]["serves"]] == types
    assert answer["nodes"][2] == {"name": "/idle", "publishes": [], "subscribes": [], "serves": [], "calls": []}
    answer = json.loads((await tool("graph", "--json", "--all", "--spin-time", "3")).out)
    names = {name for _, name, _ in with_names(answer, "/base", "publishes")}
    assert names == {"/bumper", "/_hidden", "/rosout", "/parameter_events"}
    assert "/base/get_parameters" in {name for _, name, _ in with_names(answer, "/base", "serves")}
    assert not any("_rosidl_py" in one["name"] for one in answer["nodes"])


async def test_incompatible_endpoints_are_not_connected_in_graph(memory: World, tool: Tool) -> None:
    base, pilot = memory.node("base"), memory.node("pilot")
    base.create_publisher(String, "/best_effort", SENSOR_DATA)
    pilot.create_subscription(String, "/best_effort", qos=10)
    base.create_publisher(String, "/typed")
    pilot.create_subscription(Bool, "/typed")
    base.create_service(SetBool, "/served", lambda request: SetBool.Response())
    pilot.create_client(Trigger, "/served")
    base.create_publisher(String, "/twice")
    pilot.create_subscription(Bool, "/twice")
    pilot.create_subscription(String, "/twice")
    answer = json.loads((await tool("graph", "--json", "--spin-time", "3")).out)
    for name, role, peer in (("/base", "publishes", "/pilot"), ("/pilot", "subscribes", "/base")):
        known = [("topic", "/best_effort", []), ("topic", "/twice", [peer]), ("topic", "/typed", [])]
        assert with_names(answer, name, role) == known
    assert with_names(answer, "/base", "serves") == [("service", "/served", [])]


async def test_graph_filters_keep_selected_names_and_their_counterparts(
    memory: World, tool: Tool, tmp_path: Path
) -> None:
    await robot(memory)
    text, mermaid, wrong = await asyncio.gather(
        tool("graph", "--node", "cockpit/*", "--topic", "/speed", "--spin-time", "3"),
        tool("graph", "--topic", "/enable", "--format", "mermaid", "--spin-time", "3"),
        tool("graph", "--node", "/bse", "--spin-time", "3"),
    )
    assert text.out == "/cockpit/pilot\n  publishes\n    /speed [std_msgs/msg/String]\n      -> /base\n"
    assert mermaid.out == (
        'flowchart LR\n  n0["/base"]\n  n1["/cockpit/pilot"]\n  t0{{"/enable<br/>std_srvs/srv/SetBool"}}\n'
        "  t0 -.-> n0\n  n1 -.-> t0\n"
    )
    assert (wrong.code, wrong.err) == (1, 'error: no node /bse; did you mean "/base"?\n')


async def test_graph_file_format_follows_file_ending(memory: World, tool: Tool, tmp_path: Path) -> None:
    await robot(memory)
    endings = ("svg", "md", "json", "txt")
    files = [str(tmp_path / f"g.{ending}") for ending in endings]
    done = await asyncio.gather(*(tool("graph", "-o", file, "--spin-time", "1") for file in files))
    assert [one.code for one in done] == [0] * 4, done
    texts = {ending: (tmp_path / f"g.{ending}").read_text() for ending in endings}
    assert ElementTree.fromstring(texts["svg"]).tag == "{http://www.w3.org/2000/svg}svg"
    assert texts["md"].startswith("```mermaid\nflowchart LR\n") and texts["md"].endswith("\n```\n")
    assert json.loads(texts["json"])["nodes"] and texts["txt"].startswith("/base\n")


async def test_unwritable_graph_files_are_reported(memory: World, tool: Tool, tmp_path: Path) -> None:
    ending, missing = await asyncio.gather(
        tool("graph", "-o", str(tmp_path / "g.png")), tool("graph", "-o", str(tmp_path / "no" / "g.svg"))
    )
    assert ending.code == 1 and "expected one of .svg" in ending.err
    assert missing.code == 1 and "No such file" in missing.err and "Traceback" not in missing.err


def hostile() -> Picture:
    edges = [
        Edge(EVIL, "publishes", "topic", EVIL, (EVIL,)),
        Edge("/b", "subscribes", "topic", EVIL, ("x" * 300,)),
        Edge("/b", "serves", "service", EVIL, (EVIL,)),
        Edge(EVIL, "calls", "action", EVIL, ()),
    ]
    return Picture(0, sorted({EVIL, "/b", "/c\x00"}), edges)


def test_svg_escapes_names_of_peers() -> None:
    root = ElementTree.fromstring(graph_module.svg_picture(hostile()).encode())
    tags = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert tags == {"svg", "style", "defs", "marker", "path", "rect", "g", "title", "text"}
    boxes = [element for element in root.iter() if element.tag.endswith("title")]
    assert any("<script>alert(1)</script>" in (box.text or "") for box in boxes)
    assert all(len(element.text or "") <= 1000 for element in root.iter() if not element.tag.endswith("style"))


def test_mermaid_escapes_names_of_peers() -> None:
    first, *lines = graph_module.mermaid_text(hostile()).splitlines()
    label = r"(?:[A-Za-z0-9_/ .,()-]|#\d+;|<br/>)*"
    box = rf'  [nt]\d+(?:\["{label}"\]|\(\["{label}"\]\)|\{{\{{"{label}"\}}\}}|\[\["{label}"\]\])'
    assert first == "flowchart LR"
    assert [line for line in lines if not re.fullmatch(rf"{box}|  [nt]\d+ (-->|-\.->) [nt]\d+", line)] == []


@pytest.mark.parametrize("nodes", [[], ["/alone"]])
def test_graph_without_connections_can_be_drawn(nodes: list[str]) -> None:
    picture = Picture(5, nodes, [])
    assert ElementTree.fromstring(graph_module.svg_picture(picture)) is not None
    assert [text for text, _ in graph_module.text_lines(picture)] == (nodes or ["no nodes in domain 5"])


def test_boxes_of_svg_graph_do_not_overlap() -> None:
    edges = [Edge(f"/n{one % 7}", "publishes", "topic", f"/t{one}", ("a/msg/B",)) for one in range(30)]
    edges += [Edge(f"/m{one % 5}", "subscribes", "topic", f"/t{one}", ("a/msg/B",)) for one in range(30)]
    root = ElementTree.fromstring(graph_module.svg_picture(Picture(0, sorted({edge.node for edge in edges}), edges)))
    boxes = [
        tuple(float(one.attrib[key]) for key in ("x", "y", "width", "height"))
        for one in root.iter("{http://www.w3.org/2000/svg}rect")
        if "class" in one.attrib
    ]
    assert len(boxes) == 7 + 30 + 5
    for number, (x, y, width, height) in enumerate(boxes):
        for a, b, c, d in boxes[:number]:
            assert x >= a + c or a >= x + width or y >= b + d or b >= y + height
    assert max(x + width for x, _, width, _ in boxes) <= float(root.attrib["width"])


TFMessage: Any = get_message("tf2_msgs/msg/TFMessage")
EVIL_FRAME = '"];f0-->x\x1b[31m\u202e<script>&#x;'


async def moving_robot(world: World, *, late_s: float = 0.0) -> None:
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


async def test_tf_echo_prints_transform_like_tf2_echo(memory: World, tool: Tool) -> None:
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


async def test_tf_echo_reports_missing_and_invalid_frames(memory: World, tool: Tool) -> None:
    await moving_robot(memory)
    done = await tool("tf", "echo", "map", "tool", "--timeout", "2")
    assert done.code == 1
    assert done.err.startswith(
        'error: no transform from "tool" to "map": after 2 s: the source frame "tool" is not known (known: base, '
    )
    wrong = await tool("tf", "echo", "/map", "tool")
    assert wrong.code == 1 and "begins with /" in wrong.err


async def test_tf_tree_shows_parents_rates_delays_and_nodes(memory: World, tool: Tool) -> None:
    await moving_robot(memory, late_s=0.5)
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


async def test_tf_tree_file_format_follows_file_ending(memory: World, tool: Tool, tmp_path: Path) -> None:
    await moving_robot(memory)
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


async def test_invalid_tf_tree_output_options_are_reported(memory: World, tool: Tool) -> None:
    ending, no_file = await asyncio.gather(tool("tf", "tree", "-o", "f.bmp"), tool("tf", "tree", "--format", "png"))
    assert ending.code == 1 and "expected one of .png, .mmd" in ending.err
    assert no_file.code == 1 and "write it to a file: -o frames.png" in no_file.err
    nothing = await tool("tf", "tree", "--wait-time", "0.1")
    assert (nothing.code, nothing.out) == (0, "no transforms\n")


async def test_tf_tree_warns_of_loops_disconnected_trees_and_several_publishers(memory: World, tool: Tool) -> None:
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


async def test_tf_monitor_prints_rates_and_delays(memory: World, tool: Tool) -> None:
    await moving_robot(memory, late_s=0.25)
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


async def test_tf_monitor_reports_unknown_frame_and_invalid_arguments(memory: World, tool: Tool) -> None:
    process = await tool.start("tf", "monitor", "map", "nowhere")
    await moving_robot(memory)
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


def test_tf_tree_of_bag_needs_no_network(tmp_path: Path, run_here: Any) -> None:
    code, out, err = run_here("tf", "tree", "--bag", bag(tmp_path / "drive.mcap"))
    assert (code, err) == (0, "")
    assert out == "map\n└─ base      10.0 Hz, 0.250 s late, /tf\n   └─ lidar  static, /tf_static\n"


def frame_statistics(transforms: list[Any]) -> FrameStatistics:
    frames = FrameStatistics()
    for number in (1, 2):
        message = TFMessage(transforms=[one.to_message() for one in transforms])
        frames.add_message(message, number * S, "peer", static=False)
    return frames


def test_tf_tree_escapes_frame_names_in_every_format(tmp_path: Path) -> None:
    frames = frame_statistics([moved("map", EVIL_FRAME), moved(EVIL_FRAME, "x" * 300)])
    label = r"(?:[A-Za-z0-9_/ .,()-]|#\d+;)*"
    first, *lines = tf_module.mermaid(frames, {"peer": EVIL_FRAME}).splitlines()
    form = rf'  f\d+(?:\["{label}"\]| -->\|"{label}"\| f\d+)'
    assert first == "flowchart TD" and [line for line in lines if not re.fullmatch(form, line)] == []
    assert tf_module.document(frames, {"peer": EVIL_FRAME})["frames"][0]["frame"] == EVIL_FRAME
    png.write_picture(frames, {"peer": EVIL_FRAME}, tmp_path / "evil.png")


@pytest.mark.slow
def test_very_deep_and_very_wide_trees_have_limited_output(tmp_path: Path) -> None:
    deep = frame_statistics([moved(f"f{number}", f"f{number + 1}") for number in range(3000)])
    shown = [line for line, _ in tf_module.lines(deep, {})]
    assert len(shown) == 3001 and max(map(len, shown)) < 250
    png.write_picture(
        frame_statistics([moved(f"f{number}", f"f{number + 1}") for number in range(100)]), {}, tmp_path / "deep.png"
    )
    wide = frame_statistics([moved("map", f"child{number}") for number in range(3000)])
    with pytest.raises(CommandError, match=r"3001 frames need a picture of .* pixels; --format mermaid"):
        png.write_picture(wide, {}, tmp_path / "wide.png")


@pytest.mark.slow
async def test_tf_tree_and_echo_work_between_processes_on_dds(dds: World, tool: Tool) -> None:
    await moving_robot(dds)
    tree, echo = await asyncio.gather(
        tool("tf", "tree", "--json", "--wait-time", "6"),
        tool("tf", "echo", "map", "lidar", "--once", "--json", "--timeout", "20"),
    )
    answer = json.loads(tree.out)
    expected = {"base": "/base", "camera": "/description", "lidar": "/description", "odom": "/localizer"}
    assert {one["frame"]: "".join(one["publishers"]) for one in answer["frames"]} == expected
    assert json.loads(echo.out)["translation"] == pytest.approx([4.5, 0, 0])
