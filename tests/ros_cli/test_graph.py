"""``rosidl-py graph``: what is in the picture, and that names of peers stay text in it."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from support.node_fixtures import until

from rosidl_py_gen import get_action
from rosidl_py_gen.ros_cli.graph import svg as graph_svg
from rosidl_py_gen.ros_cli.graph import text as graph_text
from rosidl_py_gen.ros_cli.graph.text import Edge, Picture
from rosidl_py_gen.runtime.qos import SENSOR_DATA

if TYPE_CHECKING:
    from conftest import Tool
    from support.node_fixtures import World

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


async def test_the_graph_shows_who_is_connected_through_what(memory: World, tool: Tool) -> None:
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


async def test_what_does_not_match_is_not_connected(memory: World, tool: Tool) -> None:
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


async def test_filters_leave_the_chosen_and_their_counterparts(memory: World, tool: Tool, tmp_path: Path) -> None:
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


async def test_files_are_drawn_by_their_ending(memory: World, tool: Tool, tmp_path: Path) -> None:
    await robot(memory)
    endings = ("svg", "md", "json", "txt")
    files = [str(tmp_path / f"g.{ending}") for ending in endings]
    done = await asyncio.gather(*(tool("graph", "-o", file, "--spin-time", "1") for file in files))
    assert [one.code for one in done] == [0] * 4, done
    texts = {ending: (tmp_path / f"g.{ending}").read_text() for ending in endings}
    assert ElementTree.fromstring(texts["svg"]).tag == "{http://www.w3.org/2000/svg}svg"
    assert texts["md"].startswith("```mermaid\nflowchart LR\n") and texts["md"].endswith("\n```\n")
    assert json.loads(texts["json"])["nodes"] and texts["txt"].startswith("/base\n")


async def test_files_that_cannot_be_written_are_told(memory: World, tool: Tool, tmp_path: Path) -> None:
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


def test_names_of_peers_are_text_in_an_svg() -> None:
    root = ElementTree.fromstring(graph_svg.svg(hostile()).encode())
    tags = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert tags == {"svg", "style", "defs", "marker", "path", "rect", "g", "title", "text"}
    boxes = [element for element in root.iter() if element.tag.endswith("title")]
    assert any("<script>alert(1)</script>" in (box.text or "") for box in boxes)
    assert all(len(element.text or "") <= 1000 for element in root.iter() if not element.tag.endswith("style"))


def test_names_of_peers_are_text_in_mermaid() -> None:
    first, *lines = graph_text.mermaid(hostile()).splitlines()
    label = r"(?:[A-Za-z0-9_/ .,()-]|#\d+;|<br/>)*"
    box = rf'  [nt]\d+(?:\["{label}"\]|\(\["{label}"\]\)|\{{\{{"{label}"\}}\}}|\[\["{label}"\]\])'
    assert first == "flowchart LR"
    assert [line for line in lines if not re.fullmatch(rf"{box}|  [nt]\d+ (-->|-\.->) [nt]\d+", line)] == []


@pytest.mark.parametrize("nodes", [[], ["/alone"]])
def test_a_picture_of_nearly_nothing_is_a_picture(nodes: list[str]) -> None:
    picture = Picture(5, nodes, [])
    assert ElementTree.fromstring(graph_svg.svg(picture)) is not None
    assert [text for text, _ in graph_text.lines(picture)] == (nodes or ["no nodes in domain 5"])


def test_boxes_do_not_overlap() -> None:
    edges = [Edge(f"/n{one % 7}", "publishes", "topic", f"/t{one}", ("a/msg/B",)) for one in range(30)]
    edges += [Edge(f"/m{one % 5}", "subscribes", "topic", f"/t{one}", ("a/msg/B",)) for one in range(30)]
    root = ElementTree.fromstring(graph_svg.svg(Picture(0, sorted({edge.node for edge in edges}), edges)))
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
