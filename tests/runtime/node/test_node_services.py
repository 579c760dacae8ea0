"""Type descriptions and logger levels over the wire (docs/internals/protocol.md 9.1, 9.8)."""

from __future__ import annotations

import pytest
from support.node_fixtures import World

from rosidl_py_gen import get_action, get_message, type_description, type_hash
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log, LoggerLevel
from rosidl_py_gen.msgs.rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rosidl_py_gen.runtime.logs.loggers import get_logger
from rosidl_py_gen.runtime.type_resolution.description_client import TypeDescriptionError
from rosidl_py_gen.runtime.type_resolution.description_service import type_source


@pytest.mark.every_transport
async def test_a_type_in_use_is_described_with_sources(world: World) -> None:
    pose = get_message("geometry_msgs/msg/PoseStamped")
    node = world.node("n")
    node.create_publisher(pose, "pose")
    other = world.node("other")
    got = await other.get_type_description("/n", "geometry_msgs/msg/PoseStamped", type_hash(pose), timeout_s=5)
    expected = type_description(pose)
    assert got.successful and got.failure_reason == ""
    assert got.type_description.type_description.type_name == "geometry_msgs/msg/PoseStamped"
    names = [item["type_name"] for item in expected["referenced_type_descriptions"]]
    assert [item.type_name for item in got.type_description.referenced_type_descriptions] == names
    assert [source.type_name for source in got.type_sources] == ["geometry_msgs/msg/PoseStamped", *sorted(names)]
    assert all(source.encoding == "msg" and source.raw_file_contents for source in got.type_sources)
    without = await other.get_type_description(
        "/n", "x/msg/Ignored", type_hash(pose), include_type_sources=False, timeout_s=5
    )
    assert without.type_sources == []


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        ("nonsense", "Failed to parse type hash"),
        ("RIHS01_" + "0" * 64, "Type not currently in use by this node"),
    ],
)
async def test_failures_say_why(world: World, wanted: str, reason: str) -> None:
    world.node("n")
    with pytest.raises(TypeDescriptionError, match=reason):
        await world.node("other").get_type_description("/n", "std_msgs/msg/String", wanted, timeout_s=5)


@pytest.mark.every_transport
async def test_the_nodes_own_services_count_as_in_use(world: World) -> None:
    world.node("n")
    other = world.node("other")
    for cls in (SetLoggerLevels, Log):
        with pytest.raises(TypeDescriptionError):
            await other.get_type_description("/n", "", type_hash(cls) + "0", timeout_s=5)
    world.node("m", logger_services=True)
    got = await other.get_type_description("/m", "", type_hash(SetLoggerLevels), timeout_s=5)
    sources = {source.type_name: source.encoding for source in got.type_sources}
    assert sources["rcl_interfaces/srv/SetLoggerLevels"] == "srv"
    assert sources["rcl_interfaces/srv/SetLoggerLevels_Request"] == "implicit"


def test_sources_of_derived_types_are_implicit() -> None:
    assert type_source("example_interfaces/action/Fibonacci").encoding == "action"
    assert type_source("example_interfaces/action/Fibonacci_SendGoal").encoding == "implicit"
    assert get_action("example_interfaces/action/Fibonacci")


async def test_logger_levels(world: World) -> None:
    world.node("n", logger_services=True)
    other = world.node("other")
    change = other.create_client(SetLoggerLevels, "/n/set_logger_levels")
    request = SetLoggerLevels.Request(levels=[LoggerLevel(name="svc.a", level=40), LoggerLevel(name="svc.b", level=25)])
    results = (await change.call(request, 5)).results
    assert [(r.successful, bool(r.reason)) for r in results] == [(True, False), (False, True)]
    assert get_logger("svc.a.child").getEffectiveLevel() == 40
    ask = other.create_client(GetLoggerLevels, "/n/get_logger_levels")
    levels = (await ask.call(GetLoggerLevels.Request(names=["svc.a", "svc.a.child"]), 5)).levels
    assert [(level.name, level.level) for level in levels] == [("svc.a", 40), ("svc.a.child", 0)]
