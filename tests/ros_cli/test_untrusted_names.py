"""Names and texts of peers make no further lines of output, whatever is in them."""

from __future__ import annotations

import asyncio
import csv
import json
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.ros_cli import exit_on_error
from rosidl_py_gen.runtime import ParameterDescriptor, QoSProfile

if TYPE_CHECKING:
    import pytest
    from conftest import Tool
    from support.node_fixtures import World

EVIL = "x\nerror: y\r\x1b[2J\u2028\u202ez\tw"
SHOWN = "x\\nerror: y\\r\ufffd[2J\ufffd\ufffdz\\tw"
LATCHED = QoSProfile().transient_local().keep_last(10)


async def test_parameters_and_their_descriptions_take_one_line_each(memory: World, tool: Tool) -> None:
    node = memory.node("drive")
    node.declare_parameter(EVIL, EVIL, ParameterDescriptor(description=EVIL, additional_constraints=EVIL))
    listed, described, missing, dumped = await asyncio.gather(
        tool("param", "list", "/drive"),
        tool("param", "describe", "/drive", EVIL),
        tool("param", "get", "/drive", EVIL + "w"),
        tool("param", "dump", "/drive", "--json"),
    )
    assert listed.out.splitlines()[1:] == ["  use_sim_time", f"  {SHOWN}"]
    assert described.out.splitlines() == [
        *(f"Parameter name: {SHOWN}", "  Type: string", f"  Description: {SHOWN}"),
        *("  Constraints:", f"    Additional constraints: {SHOWN}"),
    ]
    assert missing.err.count("\n") == 1
    assert json.loads(dumped.out)["/drive"] | {EVIL: EVIL} == json.loads(dumped.out)["/drive"]
    assert dumped.out.count("\n") == 1


async def test_frames_loggers_and_csv_take_one_line_each(memory: World, tool: Tool) -> None:
    node = memory.node("robot", enable_rosout=False)
    types: Any = map(get_message, ("rcl_interfaces/msg/Log", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"))
    log, frames, string = types
    log_publisher = node.create_publisher(log, "/rosout", LATCHED)
    tf_publisher = node.create_publisher(frames, "/tf_static", LATCHED)
    words = node.create_publisher(string, "/words", LATCHED)
    log_publisher.publish(log(level=20, name=EVIL, msg="a\nb", file=EVIL, function=EVIL))
    transform = get_message("geometry_msgs/msg/TransformStamped")(child_frame_id=EVIL)
    transform.header.frame_id = "map" + EVIL
    tf_publisher.publish(frames(transforms=[transform]))
    words.publish(string(data=f'a,"b"{EVIL}'))
    logged, tree, mermaid, table, echoed = await asyncio.gather(
        tool("log", "-n", "1", "-v"),
        tool("tf", "tree", "--wait-time", "1"),
        tool("tf", "tree", "--wait-time", "1", "--format", "mermaid"),
        tool("tf", "monitor", "-n", "1"),
        tool("topic", "echo", "/words", "--once", "--csv"),
    )
    assert logged.out == f"[INFO] [0.000000000] [{SHOWN}]: a\n    b\n    at {SHOWN}:0 in {SHOWN}\n"
    assert [line.split()[0] for line in tree.out.splitlines()] == ["map" + SHOWN.split()[0], "└─"]
    assert len(mermaid.out.splitlines()) == 4
    assert len(table.out.splitlines()) == 1
    assert list(csv.reader(echoed.out.splitlines())) == [[f'a,"b"{SHOWN}']]


def test_an_error_takes_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for text in (EVIL, "a\n    b", "a\n    b\n    c"):
        try:
            with exit_on_error():
                raise OSError(text)
        except SystemExit:
            assert capsys.readouterr().err.count("\n") == 1
