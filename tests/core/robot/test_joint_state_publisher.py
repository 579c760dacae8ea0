"""Joint state publisher: positions of all movable joints, sources and parameters."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from support.processes import start_process
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import get_message
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.prefix import executables
from rosidl_py_gen.robot import joint_state_publisher
from rosidl_py_gen.robot.joint_state_publisher import JointStatePublisher
from rosidl_py_gen.robot.node_program import ProgramError
from rosidl_py_gen.runtime import Context, Durability, ParameterError, QoSProfile, Time

JointState: Any = get_message("sensor_msgs/msg/JointState")
String: Any = get_message("std_msgs/msg/String")
LATCHED = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
YAML = {"nan": ".nan", "inf": ".inf"}


def robot(*joints: tuple[str, str, str]) -> str:
    """Return the URDF of a chain of joints, each with name, type and inner elements."""
    links = "".join(f'<link name="l{number}"/>' for number in range(len(joints) + 1))
    made = (
        f'<joint name="{name}" type="{kind}"><parent link="l{n}"/><child link="l{n + 1}"/>{inside}</joint>'
        for n, (name, kind, inside) in enumerate(joints)
    )
    return f'<robot name="chain">{links}{"".join(made)}</robot>'


def limit(lower: float, upper: float) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'


CHAIN = robot(
    ("turn", "continuous", ""),
    ("weld", "fixed", ""),
    ("lift", "prismatic", limit(1, 3)),
    ("fly", "floating", ""),
    ("slide", "planar", ""),
    ("bend", "revolute", limit(-2, 2) + '<safety_controller k_velocity="1" soft_lower_limit="0.5"/>'),
    ("second", "continuous", '<mimic joint="first" multiplier="2" offset="1"/>'),
    ("first", "continuous", '<mimic joint="lift" multiplier="-1"/>'),
)


class Rig:
    def __init__(self, world: World, *arguments: str, **parameters: Any) -> None:
        texts = {name: YAML.get(str(value)) or json.dumps(value) for name, value in parameters.items()}
        words = [word for name, text in texts.items() for word in ("-p", f"{name}:={text}")]
        context = Context(transport=world.transport, args=["test", *arguments, "--ros-args", *words])
        world.contexts.append(context)
        self.peer = world.node("peer")
        self.seen: list[Any] = []
        self.peer.create_subscription(JointState, "joint_states", self.seen.append, 10)
        self.descriptions = self.peer.create_publisher(String, "robot_description", LATCHED)
        self.node = JointStatePublisher(context=context).node

    async def state(self) -> dict[str, tuple[float, ...]]:
        """Return position, velocity and effort by joint of the next message."""
        count = len(self.seen)
        await until(lambda: len(self.seen) > count)
        message = self.seen[-1]
        rows = [values.tolist() for values in (message.position, message.velocity, message.effort) if len(values)]
        return dict(zip(message.name, zip(*rows, strict=True), strict=bool(rows)))


async def test_all_movable_joints_have_positions_in_the_order_of_the_description(memory: World) -> None:
    rig = Rig(memory, robot_description=CHAIN)
    state = await rig.state()
    assert [*state.items()] == [
        ("turn", (0,)),
        ("lift", (2,)),
        ("bend", (1.25,)),
        ("second", (-3,)),
        ("first", (-2,)),
    ]
    stamp = rig.seen[-1].header.stamp
    assert abs(rig.node.clock.now().nanoseconds - Time.from_msg(stamp).nanoseconds) < 1e9


async def test_description_is_read_from_file_or_topic_and_may_change(
    memory: World, tmp_path: Path, caplog: Any
) -> None:
    (tmp_path / "a.urdf").write_text(robot(("a", "continuous", "")))
    rig = Rig(memory, str(tmp_path / "a.urdf"), robot_description=CHAIN)
    assert [*await rig.state()] == ["a"]
    rig.descriptions.publish(String(data=robot(("b", "continuous", ""))))
    await until(lambda: rig.seen[-1].name == ["b"])
    for wrong, error in (
        ("<robot", "robot description ignored: <robot_description>:2:1: not XML"),
        (robot(("c", "continuous", '<mimic joint="c"/>')), "joints mimic themselves: c -> c"),
    ):
        rig.descriptions.publish(String(data=wrong))
        await until(lambda error=error: error in caplog.text)
    assert [*await rig.state()] == ["b"]
    with pytest.raises(DefinitionError, match=r"b\.urdf: cannot be read"):
        Rig(memory, str(tmp_path / "b.urdf"))


async def test_publisher_waits_for_a_robot_description(memory: World, caplog: Any) -> None:
    rig = Rig(memory)
    assert "waiting for a robot description on /robot_description" in caplog.text
    rig.descriptions.publish(String(data=robot(("weld", "fixed", ""))))
    await rig.peer.clock.sleep_for(1)
    assert rig.seen == []
    rig.descriptions.publish(String(data=CHAIN))
    assert len(await rig.state()) == 5


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"zeros.turn": 0.5, "zeros.lift": 7}, {"turn": (0.5,), "lift": (7,), "first": (-7,), "second": (-13,)}),
        ({"use_smallest_joint_limits": False}, {"bend": (0,)}),
        ({"use_mimic_tags": False, "source_list": []}, {"first": (0,), "second": (0,)}),
        (
            {"publish_default_velocities": True, "publish_default_efforts": True},
            {"lift": (2, 0, 0), "first": (-2, 0, 0)},
        ),
        ({"publish_default_positions": False}, {}),
        ({"dependent_joints.turn.parent": "bend"}, {"turn": (1.25,)}),
        (
            {
                "dependent_joints.turn.parent": "second",
                "dependent_joints.turn.factor": 2,
                "dependent_joints.turn.offset": 0.5,
            },
            {"turn": (-5.5,), "second": (-3,)},
        ),
        ({"dependent_joints.first.parent": "bend"}, {"first": (-2,)}),  # the mimic tag is preferred
        ({"dependent_joints.first.parent": "bend", "use_mimic_tags": False}, {"first": (1.25,), "second": (0,)}),
    ],
)
async def test_parameters_set_joint_positions(
    memory: World, parameters: dict[str, Any], expected: dict[str, Any]
) -> None:
    rig = Rig(memory, robot_description=CHAIN, **parameters)
    state = await rig.state()
    assert {name: state[name] for name in expected} == expected
    if not expected:
        assert state == {} and rig.seen[-1].name == ["turn", "lift", "bend", "second", "first"]


async def test_source_topics_set_the_values_of_joints(memory: World, caplog: Any) -> None:
    rig = Rig(memory, robot_description=CHAIN, source_list=["arm", "/base"])
    arm, base = (rig.peer.create_publisher(JointState, topic, 10) for topic in ("arm", "base"))
    assert await arm.wait_for_subscribers(timeout_s=5) and await base.wait_for_subscribers(timeout_s=5)
    arm.publish(JointState(name=["lift", "unknown", "first"], position=[2.5, 1, 9]))
    base.publish(JointState(name=["turn"], velocity=[3], effort=[4]))
    base.publish(JointState(name=["lift", "turn"], position=[1]))
    base.publish(JointState(name=["bend"], position=[math.nan]))
    await rig.state()
    state = await rig.state()
    assert state["lift"] == (2.5, 0, 0) and state["turn"] == (0, 3, 4) and math.isnan(state["bend"][0])
    assert state["first"] == (-2.5, 0, 0)
    assert "message of a source: position ignored, which has 1 value for 2 names" in caplog.text


async def test_joints_move_between_their_limits_or_rotate_continuously(memory: World) -> None:
    chain = robot(("bend", "revolute", limit(0, 0.5)), ("turn", "continuous", ""))
    rig = Rig(memory, robot_description=chain, delta=0.2, **{"zeros.turn": 3.0})
    states = [await rig.state() for _ in range(7)]
    assert [state["bend"][0] for state in states] == pytest.approx([0.2, 0.4, 0.5, 0.3, 0.1, 0, 0.2])
    assert [state["turn"][0] for state in states[:2]] == pytest.approx([-math.pi, 0.2 - math.pi])


@pytest.mark.parametrize("rate", [50, 12.5])
async def test_joint_states_are_published_at_the_configured_rate(memory: World, rate: float) -> None:
    rig = Rig(memory, robot_description=CHAIN, rate=rate)
    await rig.peer.clock.sleep_for(4)
    assert abs(len(rig.seen) - 4 * rate) <= 1


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"rate": 0}, "rate: got 0; expected more than 0 and at most 10000 Hz"),
        ({"rate": "fast"}, "'rate' is of type STRING, expected DOUBLE"),
        ({"zeros.turn": math.nan}, "parameter zeros.turn: got nan; expected a finite number"),
        ({"rate": math.inf}, "parameter rate: got inf; expected a finite number"),
        ({"dependent_joints.turn.parent": "bend", "dependent_joints.turn.factor": math.nan}, "turn.factor: got nan; "),
        ({"source_list": [1]}, "'source_list' is of type INTEGER_ARRAY, expected STRING_ARRAY"),
        (
            {"dependent_joints.a.factor": 1},
            "dependent_joints.a.factor: expected dependent_joints.<joint>.parent, and if",
        ),
        ({"dependent_joints.turn.parent": "weld"}, 'joint "turn" mimics joint "weld", not a moving joint'),
        ({"dependent_joints.turn.parent": "turn"}, "joints mimic themselves: turn -> turn"),
    ],
)
async def test_wrong_parameters_of_joint_state_publisher_are_refused(
    memory: World, parameters: dict[str, Any], error: str
) -> None:
    with pytest.raises((ProgramError, ParameterError)) as caught:
        Rig(memory, robot_description=CHAIN, **parameters)
    assert error in str(caught.value)


async def test_joint_state_publisher_gui_runs_without_window_after_a_note(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    (program,) = executables.of_bundled("joint_state_publisher_gui").values()
    assert (program.module, program.function) == (joint_state_publisher.__name__, "main_without_window")
    context = Context(transport=memory.transport, args=["test"])
    memory.contexts.append(context)
    assert joint_state_publisher.create_without_window(context=context).node.name == "joint_state_publisher"
    assert "has no window with sliders; running joint_state_publisher instead" in caplog.text


@pytest.mark.slow
async def test_robot_moves_by_two_publisher_processes(dds: World, tmp_path: Path) -> None:
    """Start both programs as a user does; check the rate of transforms and the exit."""
    (tmp_path / "chain.urdf").write_text(CHAIN)
    peer = dds.node("peer")
    seen: list[Any] = []
    peer.create_subscription(get_message("tf2_msgs/msg/TFMessage"), "/tf", seen.append, 100)
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run"]
    states = [*command, "joint_state_publisher", "joint_state_publisher", "--ros-args", "-p", "rate:=50"]
    robot_states = [*command, "robot_state_publisher", "robot_state_publisher", str(tmp_path / "chain.urdf")]
    processes = [await start_process(*words, stderr=-1) for words in (states, robot_states)]
    await until(lambda: len(seen) > 10)
    started, count = time.monotonic(), len(seen)
    await until(lambda: time.monotonic() - started > 2)
    assert 15 < (len(seen) - count) / 2 < 21  # publish_frequency is 20: 16.7 Hz of 50 Hz
    assert sorted(one.child_frame_id for one in seen[-1].transforms) == ["l1", "l3", "l6", "l7", "l8"]
    for process in processes:
        process.terminate()
        _, errors = await process.communicate()
        assert process.returncode == 0 and b"Traceback" not in errors
