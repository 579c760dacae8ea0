"""Static transform publisher: all forms of its arguments."""

from __future__ import annotations

import json
import math
import signal
import sys
from typing import Any

import pytest
from support.processes import start_process
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import get_message
from rosidl_py_gen.robot.node_program import ProgramError
from rosidl_py_gen.robot.static_transform_publisher import StaticTransformPublisher, parse_transform
from rosidl_py_gen.runtime import Durability, ParameterError, QoSProfile

HALF = math.sqrt(0.5)
NAMES = [f"translation.{key}" for key in "xyz"] + [f"rotation.{key}" for key in "xyzw"] + ["frame_id", "child_frame_id"]
FRAMES = "--frame-id map --child-frame-id odom"


def parsed(words: str) -> Any:
    return parse_transform(words.split())


@pytest.mark.parametrize(
    ("words", "translation", "rotation"),
    [
        (FRAMES, (0, 0, 0), (0, 0, 0, 1)),
        (f"--x 1 --y -2.5 {FRAMES} --z 1e-3", (1, -2.5, 0.001), (0, 0, 0, 1)),
        (f"{FRAMES} --roll {math.pi / 2}", (0, 0, 0), (HALF, 0, 0, HALF)),
        (f"{FRAMES} --yaw {math.pi / 2} --roll {math.pi / 2}", (0, 0, 0), (0.5, 0.5, 0.5, 0.5)),
        (f"{FRAMES} --pitch -1e-1 --x 0", (0, 0, 0), (0, math.sin(-0.05), 0, math.cos(0.05))),
        (f"{FRAMES} --qx 1 --qw 0", (0, 0, 0), (1, 0, 0, 0)),
        (f"{FRAMES} --qx 0.6 --qy 0 --qz 0.8 --qw -0", (0, 0, 0), (0.6, 0, 0.8, 0)),
        (f"--x 1 --x 2 {FRAMES}", (2, 0, 0), (0, 0, 0, 1)),
    ],
)
def test_options_set_translation_and_rotation(words: str, translation: Any, rotation: Any, caplog: Any) -> None:
    found = parsed(words)
    assert [*found.values()] == [pytest.approx(value) for value in (*translation, *rotation)] + ["map", "odom"]
    assert [*found] == NAMES and not caplog.records


@pytest.mark.parametrize(
    ("words", "rotation"),
    [
        (f"1 2 -3 {math.pi / 2} 0 0 map odom", (0, 0, HALF, HALF)),
        (f"1 2 -3 0 {math.pi / 2} 0 map odom", (0, HALF, 0, HALF)),
        (f"1 2 -3 0 0 {math.pi / 2} map odom", (HALF, 0, 0, HALF)),
        ("1 2 -3 0 0.6 0.8 0 map odom", (0, 0.6, 0.8, 0)),
    ],
)
def test_arguments_without_options_are_deprecated(words: str, rotation: Any, caplog: Any) -> None:
    found = parsed(words)
    assert [*found.values()] == [1, 2, -3, *(pytest.approx(value) for value in rotation), "map", "odom"]
    (warning,) = caplog.messages
    assert warning == "arguments without options are deprecated; use --x, ..., --frame-id and --child-frame-id"


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("", "no --frame-id; expected --frame-id and the name of a frame"),
        ("--frame-id a", "no --child-frame-id"),
        ("--frame-id a --child-frame-id", "--child-frame-id needs a value after it"),
        ("--frame-id a --child-frame-id a", "both 'a'; expected two frames"),
        (f"{FRAMES} --x one", "--x: got 'one'; expected a number such as 1.5"),
        (f"{FRAMES} --x nan", "--x: got 'nan'"),
        (f"{FRAMES} --yaw 1 --qw 1", "found --yaw, --qw; expected angles or a quaternion"),
        (f"{FRAMES} --w 1", "found '--w' of 6 arguments; expected options as in --help, or only x y z"),
        ("1 2 3 4 5 6 a b --x 1", "found '1' of 10 arguments"),
        ("1 2 3 4 5 6 a b 100", "--qw: got 'a'"),  # the period of ROS 1
        ("1 2 3 4 5 6 7 8 a b", "found '1' of 10 arguments"),
    ],
)
def test_wrong_arguments_are_refused(words: str, error: str) -> None:
    with pytest.raises(ProgramError) as caught:
        parsed(words)
    assert error in str(caught.value)


def test_quaternion_that_is_not_normalized_is_warned_about(caplog: Any) -> None:
    parsed(f"{FRAMES} --qw 0.7071 --qz 0.7071")
    parsed(f"{FRAMES} --qw 0.7 --qz 0.7")
    assert caplog.messages == ["the quaternion has length 0.99; expected 1; tf2 ignores such transforms"]


async def test_node_publishes_once_and_has_read_only_parameters(memory: World) -> None:
    words = f"--x 1 --qz 1 --qw 0 {FRAMES} --ros-args -r __ns:=/robot -p frame_id:=x"
    program = StaticTransformPublisher(context=memory.context(words))
    assert program.node.name.startswith("static_transform_publisher_") and len(program.node.name) == 43
    assert program.node.get_parameter("frame_id") == "map" and program.node.get_parameter("rotation.z") == 1.0
    with pytest.raises(ParameterError, match="read-only"):
        program.node.set_parameter("translation.x", 2.0)
    seen: list[Any] = []
    latched = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
    memory.node("late").create_subscription(get_message("tf2_msgs/msg/TFMessage"), "/tf_static", seen.append, latched)
    await until(lambda: seen)
    (message,) = seen[0].transforms
    assert (message.header.frame_id, message.child_frame_id, message.transform.translation.x) == ("map", "odom", 1)
    assert message.header.stamp.sec > 0 and message.transform.rotation.z == 1


@pytest.mark.slow
async def test_process_of_the_publisher_exits_with_the_expected_code(dds: World) -> None:
    peer = dds.node("peer")
    seen: list[Any] = []
    latched = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
    peer.create_subscription(get_message("tf2_msgs/msg/TFMessage"), "/tf_static", seen.append, latched)
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "tf2_ros", "static_transform_publisher"]
    process = await start_process(*command, *FRAMES.split(), "--ros-args", "-r", "__node:=fixed", stderr=-1, stdout=-1)
    await until(lambda: seen and any(one.name == "fixed" for one in peer.get_nodes()))
    process.send_signal(signal.SIGINT)
    out, err = await process.communicate()
    assert process.returncode == 0 and b"frame_id map, child_frame_id odom" in out + err
    for words, code in (("--x 1 -h", 0), ("--frame-id a", 1)):
        process = await start_process(*command, *words.split(), stderr=-1, stdout=-1)
        out, err = await process.communicate()
        assert process.returncode == code and out.startswith(b"usage: static_transform_publisher") == (code == 0)
    assert b"no --child-frame-id" in err and json.dumps(err.decode()).count("Traceback") == 0
