"""``rosidl-py-gen diff`` with a running node: types that the node describes, and types that it does not."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.interface_packages import write
from support.processes import start_process

from rosidl_py_gen import compile_definition
from rosidl_py_gen.generator_cli.compare import known_constants
from rosidl_py_gen.generator_cli.diff import SourceError, definitions_of_node

if TYPE_CHECKING:
    from support.worlds import World

BATTERY = "robot_msgs/msg/Battery"


async def test_node_describes_types_of_its_topics_services_and_actions(memory: World) -> None:
    robot, other = memory.pair()
    robot.create_publisher(compile_definition(BATTERY, "uint8 FULL=100\nfloat32 volts 24.0\n"), "battery")
    robot.create_service(
        compile_definition("robot_msgs/srv/Dock", "string station\n---\nbool ok\n"), "dock", lambda _: None
    )
    robot.create_action_server(
        compile_definition("robot_msgs/action/Go", "int8 a\n---\nint8 b\n---\nint8 c\n"), "go", lambda goal: None
    )
    facts, notes = await definitions_of_node(other, "/alice", 5)
    assert {BATTERY, "robot_msgs/srv/Dock", "robot_msgs/action/Go"} <= {*facts.interfaces}, notes
    assert "rcl_interfaces/srv/SetParameters" in facts.interfaces  # which every node has
    battery = facts.messages[BATTERY]
    assert [(one.name, str(one.type), one.default) for one in battery.fields] == [("volts", "float32", 24.0)]
    assert known_constants(battery) is None  # the node has no text of it that it could tell them from
    assert facts.interfaces["robot_msgs/srv/Dock"] == ("robot_msgs/srv/Dock_Request", "robot_msgs/srv/Dock_Response")
    assert [note for note in notes if "skipped" in note] == []


async def test_missing_node_is_an_error_with_suggestion(memory: World) -> None:
    _, other = memory.pair()
    with pytest.raises(SourceError, match='no node /alic appeared; did you mean "/alice"'):
        await definitions_of_node(other, "/alic", 0.2)


async def test_types_not_described_by_node_are_skipped_with_a_note(memory: World) -> None:
    robot = memory.node("silent", parameter_overrides={"start_type_description_service": False}, enable_rosout=False)
    robot.create_publisher(compile_definition(BATTERY, "int8 a\n"), "battery")
    facts, notes = await definitions_of_node(memory.node("asking"), "/silent", 5)
    assert BATTERY not in facts.interfaces
    assert [note for note in notes if note.startswith(f"/silent: skipped {BATTERY} of /battery: ")]


async def test_running_node_is_compared_with_workspace(dds: World, tmp_path: Path) -> None:
    robot = dds.node("robot", parameter_events=False, enable_rosout=False)
    robot.create_publisher(compile_definition(BATTERY, "float32 volts\nuint8 cells\n"), "battery")
    write(tmp_path, {"robot_msgs/msg/Battery.msg": "float32 volts\n"})
    command = (sys.executable, "-m", "rosidl_py_gen.generator_cli", "diff", "/robot", str(tmp_path))
    process = await start_process(*command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    out, err = await asyncio.wait_for(process.communicate(), 60)
    assert process.returncode == 1, err
    assert b"field     - cells: uint8" in out and b"old data  not read as before" in out
    assert out.endswith(b" unchanged; changes of code, data, hash; breaking: code, data\n")
