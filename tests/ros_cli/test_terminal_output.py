"""Output on terminals: names stay in one piece at 80 columns, whatever else they stand next to."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import until
from support.terminals import CONTROL, on_terminal

from rosidl_py_gen import compile_definition, get_message, get_service
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.ros_cli import terminal_output

if TYPE_CHECKING:
    from pathlib import Path

    from support.node_fixtures import World

LONG_TOPIC = "/robot_with_a_long_name/perception/front_left/object_candidates"
LONG_TYPE = "a_package_with_a_long_name_msgs/msg/ObjectCandidateWithCovariance"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
assert len(LONG_TOPIC) >= 60 and len(LONG_TYPE) >= 60


def printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, columns: int, *args: Any) -> list[str]:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))
    terminal_output.table(*args)
    return [line.rstrip() for line in CONTROL.sub("", capsys.readouterr().out).splitlines()]


def test_a_table_that_fits_stays_a_table(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [["/imu", "sensor_msgs/msg/Imu", "reliable, volatile"]]
    assert printed(capsys, monkeypatch, 80, rows, "topic", "type", "QoS")[::2] == [
        "topic   type                  QoS",
        "/imu    sensor_msgs/msg/Imu   reliable, volatile",
    ]


def test_a_table_wraps_at_spaces_only(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [["/diagnostics_of_a_whole_robot", DIAGNOSTICS, "reliable, volatile"]]
    lines = printed(capsys, monkeypatch, 80, rows, "topic", "type", "QoS")
    assert lines[2:] == [f"{rows[0][0]}   {DIAGNOSTICS}   reliable,", f"{'':70}volatile"]
    assert all(len(line) <= 80 for line in lines)


def test_names_that_do_not_fit_next_to_each_other_get_lines(capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [[LONG_TOPIC, LONG_TYPE, "7"], ["/imu", "sensor_msgs/msg/Imu", "9"]]
    assert printed(capsys, monkeypatch, 80, rows, "topic", "type", "count") == [
        *(LONG_TOPIC, f"  type   {LONG_TYPE}", "  count  7"),
        *("/imu", "  type   sensor_msgs/msg/Imu", "  count  9"),
    ]
    assert printed(capsys, monkeypatch, 20, [["/a_long_name_of_a_topic"]], "topic") == ["/a_long_name_of_a_topic"]
    assert printed(capsys, monkeypatch, 80, [], "topic", "type")[0].split() == ["topic", "type"]


async def test_a_bag_is_listed_at_80_columns_without_broken_names(tmp_path: Path) -> None:
    long_class: Any = compile_definition(LONG_TYPE, "float64 x")
    diagnostics: Any = get_message(DIAGNOSTICS)
    with BagWriter(tmp_path / "bag.mcap") as bag:
        bag.write(LONG_TOPIC, long_class(), 1)
        bag.write("/diagnostics_of_the_whole_robot", diagnostics(), 2)
    for options in ((), ("--verbose",)):
        done = await on_terminal("bag", "info", str(tmp_path / "bag.mcap"), *options)
        assert done.code == 0
        words = done.screen.split()
        for name in (LONG_TOPIC, LONG_TYPE, DIAGNOSTICS, "/diagnostics_of_the_whole_robot"):
            assert name in words
        assert all(len(line) <= 80 for line in done.lines)


@pytest.mark.real_time("commands are processes")
async def test_commands_do_not_break_names_at_80_columns(dds: World) -> None:
    node_name, service = "a_node_with_a_name_that_is_as_long_as_it_may_sensibly_be_here", f"{LONG_TOPIC}/reset_all"
    parameter = "perception.front_left.object_candidates.minimum_score_of_all"
    robot, other = dds.node(node_name, "/robot"), dds.node("other")
    long_class: Any = compile_definition(LONG_TYPE, "float64 x")
    publishers = [robot.create_publisher(long_class, topic) for topic in (LONG_TOPIC, "/measured")]
    robot.create_publisher(get_message(DIAGNOSTICS), "/diagnostics")
    robot.create_service(get_service("std_srvs/srv/SetBool"), service, lambda request: None)
    robot.declare_parameter(parameter, 1.5)
    await until(lambda: other.count_publishers(LONG_TOPIC) == 1)

    async def publish() -> None:
        while True:
            for publisher in publishers:
                publisher.publish(long_class())
            await asyncio.sleep(0.02)

    publishing = asyncio.ensure_future(publish())
    commands: dict[tuple[str, ...], tuple[str, ...]] = {
        ("topic", "list", "-t"): (LONG_TOPIC, f"[{LONG_TYPE}]", f"[{DIAGNOSTICS}]"),
        ("topic", "info", "-v", LONG_TOPIC): (LONG_TYPE, node_name),
        ("topic", "bw", "--times", "1", LONG_TOPIC, "/measured"): (LONG_TOPIC,),
        ("node", "list"): (f"/robot/{node_name}",),
        ("node", "info", f"/robot/{node_name}"): (f"{LONG_TOPIC}:", LONG_TYPE, f"{service}:"),
        ("service", "list", "-t"): (service,),
        ("param", "list", f"/robot/{node_name}"): (parameter,),
        ("graph",): (f"/robot/{node_name}", LONG_TOPIC),
    }
    try:
        results = await asyncio.gather(*(on_terminal(*command) for command in commands))
    finally:
        publishing.cancel()
    for (command, names), done in zip(commands.items(), results, strict=True):
        assert done.code == 0, (command, done)
        for name in names:
            assert any(name in line for line in done.lines), (command, name, done.screen)
