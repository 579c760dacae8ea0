"""Robot state publisher: transforms against an independent computation, topics, and rules of time and parameters."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from support.kinematics import link_poses, robots
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.robot.node_program import ProgramError
from rosidl_py_gen.robot.robot_state_publisher import RobotStatePublisher
from rosidl_py_gen.runtime import ClockType, Context, Durability, ParameterError, QoSProfile, Reliability, Time
from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop
from rosidl_py_gen.tf import TransformBuffer

JointState: Any = get_message("sensor_msgs/msg/JointState")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
S = 10**9
ARM = """<robot name="arm">
<link name="base"/><link name="upper"/><link name="hand"/><link name="finger"/><link name="thumb"/><link name="cart"/>
<link name="ball"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/>
 <axis xyz="0 0 2"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="wrist" type="fixed"><parent link="upper"/><child link="hand"/><origin xyz="1 0 0"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 3 0"/>
 <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
<joint name="also_grip" type="prismatic"><parent link="hand"/><child link="thumb"/><axis xyz="0 1 0"/>
 <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="grip" multiplier="-1" offset="0.25"/></joint>
<joint name="rails" type="planar"><parent link="base"/><child link="cart"/><origin xyz="0 5 0"/></joint>
<joint name="thrown" type="floating"><parent link="base"/><child link="ball"/><origin xyz="0 6 0"/></joint>
</robot>"""
TWO = """<robot name="two"><link name="base"/><link name="lamp"/>
<joint name="j" type="fixed"><parent link="base"/><child link="lamp"/></joint></robot>"""


class Rig:
    """Robot state publisher, a node that feeds it, and the messages that it sends."""

    def __init__(self, world: World, urdf: str | None = ARM, **parameters: Any) -> None:
        if urdf is not None:
            parameters["robot_description"] = urdf
        self.peer = world.node("peer")
        self.sent: list[Any] = []
        self.fixed: list[Any] = []
        self.descriptions: list[str] = []
        latched = QoSProfile(depth=10, durability=Durability.TRANSIENT_LOCAL)
        tf: Any = get_message("tf2_msgs/msg/TFMessage")
        self.peer.create_subscription(tf, "/tf", self.sent.append, 100)
        self.peer.create_subscription(tf, "/tf_static", self.fixed.append, latched)
        string: Any = get_message("std_msgs/msg/String")
        self.peer.create_subscription(string, "robot_description", lambda m: self.descriptions.append(m.data), latched)
        self.buffer = TransformBuffer(self.peer)
        self.states = self.peer.create_publisher(JointState, "joint_states", 10)
        self.program = RobotStatePublisher(context=with_parameters(world, parameters))
        self.node = self.program.node

    async def ready(self) -> Rig:
        await self.states.wait_for_subscribers(timeout_s=10)
        await until(lambda: self.fixed and self.descriptions and self.node.count_subscribers("/tf") >= 2)
        return self

    def move(self, stamp_s: float = 1, **positions: float) -> None:
        self.send([*positions], [*positions.values()], stamp_s)

    def send(self, names: Sequence[str], positions: Sequence[float], stamp_s: float) -> None:
        message = JointState(name=[*names], position=[*positions])
        set_stamp(message.header.stamp, round(stamp_s * S))
        self.states.publish(message)

    async def moved(self, count: int) -> list[str]:
        """Wait for exactly `count` messages; return the child frames of the last message."""
        await until(lambda: len(self.sent) >= count)
        await asyncio.sleep(0.2)
        assert len(self.sent) == count
        return sorted(one.child_frame_id for one in self.sent[-1].transforms) if count else []


def with_parameters(world: World, parameters: dict[str, Any]) -> Context:
    """Return a context with a command line that sets parameters."""
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={json.dumps(value)}")]
    context = Context(transport=world.transport, args=["test", "--ros-args", *words])
    world.contexts.append(context)
    return context


@given(robots())
def test_transforms_match_an_independent_computation(case: tuple[str, dict[str, float]]) -> None:
    urdf, positions = case
    loop = VirtualTimeLoop(limit_s=90)
    world = World("memory", loop.clocks)

    async def main() -> None:
        rig = await Rig(world, urdf).ready()
        wanted = link_poses(urdf, positions)
        assert rig.descriptions == [urdf]
        (root,) = (link for link, pose in wanted.items() if pose is wanted[next(iter(wanted))])
        rig.move(**positions)
        if positions:
            await until(lambda: rig.sent)
        await asyncio.sleep(0.1)
        frames = set(rig.buffer.frames())
        for link, pose in wanted.items():
            if link != root:
                assert np.allclose(rig.buffer.lookup_transform(root, link).matrix, pose, atol=1e-9), link
        below_floating = {name for name in frames if name not in wanted}
        assert not any(rig.buffer.can_transform(root, link) for link in below_floating)

    try:
        loop.run(main())
    finally:
        world.close()


@pytest.mark.every_transport
async def test_topics_have_the_names_types_and_qos_of_ros(world: World) -> None:
    rig = await Rig(world).ready()
    topics = dict(rig.peer.get_topic_names_and_types())
    assert topics["/tf"] == topics["/tf_static"] == ["tf2_msgs/msg/TFMessage"]
    assert topics["/robot_description"] == ["std_msgs/msg/String"]
    for topic, depth, durability in (("/tf", 100, 2), ("/tf_static", 1, 1), ("/robot_description", 1, 1)):
        (info,) = (i for i in rig.peer.get_publishers_info_by_topic(topic) if i.node_name == "robot_state_publisher")
        assert info.qos_profile.reliability == Reliability.RELIABLE
        assert (info.qos_profile.durability == Durability.TRANSIENT_LOCAL) == (durability == 1)
        assert info.qos_profile.depth in (depth, 0)  # DDS does not announce the depth to all
    (info,) = rig.peer.get_subscriptions_info_by_topic("/joint_states")
    assert info.qos_profile.reliability == Reliability.BEST_EFFORT
    rig.move(shoulder=0.0, grip=0.5)
    await until(lambda: rig.sent)
    late = TransformBuffer(world.node("late"))
    await late.wait_for_transform("base", "cart", timeout_s=10)


async def test_fixed_and_planar_joints_are_static_and_floating_joints_are_skipped(memory: World) -> None:
    rig = await Rig(memory).ready()
    (message,) = rig.fixed
    assert [one.child_frame_id for one in message.transforms] == ["hand", "cart"]
    assert all(one.header.stamp.sec > 0 for one in message.transforms)
    assert rig.buffer.lookup_transform("base", "cart").translation.tolist() == [0, 5, 0]
    rig.move(2.5, shoulder=3.0, grip=0.5, thrown=1.0, unknown=1.0, wrist=1.0)  # limits are not those of positions
    assert await rig.moved(1) == ["finger", "thumb", "upper"]
    assert {one.header.stamp.sec for one in rig.sent[0].transforms} == {2}
    assert rig.buffer.lookup_transform("hand", "thumb").translation.tolist() == [0, -0.25, 0]


async def test_joints_are_published_at_most_at_the_frequency_of_their_stamps(memory: World) -> None:
    rig = await Rig(memory, publish_frequency=30.0).ready()  # every 33 ms: whole milliseconds, rounded down
    for stamp, sent in ((1.0, 1), (1.032, 1), (1.033, 2), (1.05, 2), (1.066, 3)):
        rig.move(stamp, shoulder=0.1)
        await rig.moved(sent)
    rig.move(1.067, shoulder=0.1, grip=0.1)  # grip is new
    assert await rig.moved(4) == ["finger", "thumb", "upper"]
    rig.move(1.08, grip=0.2)
    rig.move(1.101, grip=0.2)
    assert await rig.moved(5) == ["finger", "thumb"]
    rig.move(1.101, shoulder=0.1)  # the least recent of all in the message counts
    await rig.moved(6)
    rig.move(0.5, shoulder=0.1)
    rig.move(5, nothing=0.1)
    rig.send([], [], 5)
    await rig.moved(6)


async def test_old_stamps_are_published_if_stamps_are_ignored_or_time_jumps_back(memory: World) -> None:
    rig = await Rig(memory, ignore_timestamp=True).ready()
    rig.move(5, shoulder=0.1)
    rig.move(0, shoulder=0.1)
    await rig.moved(2)
    rig.node.set_parameter("ignore_timestamp", False)
    rig.move(5.01, shoulder=0.1)
    await rig.moved(3)  # the last stamp was 0
    rig.move(4, shoulder=0.1)
    await rig.moved(3)
    rig.node.clock.enable_ros_time_override()
    rig.node.clock.set_ros_time_override(Time(seconds=1000, clock_type=ClockType.ROS_TIME))
    rig.move(4, shoulder=0.1)
    await rig.moved(4)


async def test_joint_states_that_cannot_be_used_are_ignored(memory: World, caplog: Any) -> None:
    rig = await Rig(memory).ready()
    rig.send(["shoulder"], [], 1)
    rig.send(["shoulder", "grip"], [1.0], 1.1)
    await rig.moved(0)
    assert "ignored, which has 1 name, such as 'shoulder', and 0 positions; expected as many" in caplog.text
    rig.move(2, shoulder=float("nan"), grip=1.0)
    assert await rig.moved(1) == ["finger", "thumb"]
    assert "position nan of joint 'shoulder' ignored; expected a finite number" in caplog.text
    rig.move(3, shoulder=0.5, grip=float("inf"), also_grip=1.0)  # a position is preferred to a mimic tag
    assert await rig.moved(2) == ["thumb", "upper"]
    rig.send(["shoulder", "shoulder"], [0.0, 1.0], 4)
    await rig.moved(3)
    assert rig.sent[-1].transforms[0].transform.rotation.w == 1  # the first


async def test_publish_frequency_is_validated_and_may_change(memory: World) -> None:
    rig = await Rig(memory, publish_frequency=0.0).ready()
    for number in range(3):
        rig.move(1, shoulder=number)
    await rig.moved(3)
    for value in (-1.0, 1000.5, float("nan")):
        with pytest.raises(ParameterError, match=r"publish_frequency out of range Min: 0\.0, Max: 1000\.0"):
            rig.node.set_parameter("publish_frequency", value)
    rig.node.set_parameter("publish_frequency", 10.0)
    rig.move(1.09, shoulder=1)
    rig.move(1.1, shoulder=1)
    await rig.moved(4)


async def test_frames_have_the_prefix_of_parameter_frame_prefix(memory: World) -> None:
    rig = await Rig(memory, frame_prefix="left/").ready()
    rig.move(shoulder=0.1)
    assert await rig.moved(1) == ["left/upper"]
    assert rig.sent[0].transforms[0].header.frame_id == "left/base"
    assert {one.child_frame_id for one in rig.fixed[0].transforms} == {"left/hand", "left/cart"}
    rig.node.set_parameter("frame_prefix", "right/")
    assert len(rig.descriptions) == 1  # a new one would reset the positions of joint_state_publisher
    rig.move(2, shoulder=0.1)
    assert await rig.moved(2) == ["right/upper"]
    assert rig.buffer.can_transform("right/base", "right/hand", 2 * S)


async def test_a_new_description_replaces_the_robot(memory: World) -> None:
    rig = await Rig(memory).ready()
    for wrong, error in (("", "found ''"), ("<robot", "not XML"), (TWO.replace("fixed", "odd"), "found type 'odd'")):
        with pytest.raises(ParameterError, match=error):
            rig.node.set_parameter("robot_description", wrong)
    assert rig.node.get_parameter("robot_description") == ARM and len(rig.descriptions) == 1
    client = rig.peer.create_parameter_client("robot_state_publisher")
    await client.set({"robot_description": TWO})
    await until(lambda: rig.descriptions == [ARM, TWO])
    rig.node.set_parameters_atomically({"robot_description": ARM, "frame_prefix": "two/"})
    await until(lambda: rig.descriptions == [ARM, TWO, ARM])
    assert rig.fixed[-1].transforms[-1].child_frame_id == "two/cart"
    rig.node.set_parameters_atomically({"robot_description": TWO, "frame_prefix": ""})
    await until(lambda: len(rig.descriptions) == 4)
    assert rig.buffer.lookup_transform("base", "lamp").translation.tolist() == [0, 0, 0]
    rig.move(shoulder=1.0)
    await rig.moved(0)


async def test_publisher_without_a_valid_description_or_frequency_fails(memory: World) -> None:
    with pytest.raises(ProgramError, match="robot_description: not set; expected the text of a URDF"):
        RobotStatePublisher(context=with_parameters(memory, {}))
    for parameters, error in (
        ({"robot_description": "<robot"}, "not XML"),
        ({"robot_description": ARM, "publish_frequency": -1.0}, "publish_frequency out of range"),
        ({"robot_description": ARM, "publish_frequency": "fast"}, "publish_frequency"),
    ):
        with pytest.raises(ParameterError, match=error):
            RobotStatePublisher(context=with_parameters(memory, parameters))


async def test_urdf_file_may_be_given_as_argument_with_a_warning(memory: World, tmp_path: Path, caplog: Any) -> None:
    file = tmp_path / "two.urdf"
    file.write_text(TWO)
    program = RobotStatePublisher(context=memory.context(str(file), "--ros-args -p use_sim_time:=true"))
    assert program.node.get_parameter("robot_description") == TWO
    assert "as argument is deprecated" in caplog.text
    with pytest.raises(DefinitionError, match=r"missing\.urdf: cannot be read"):
        RobotStatePublisher(context=memory.context(str(tmp_path / "missing.urdf")))


async def test_static_transforms_have_simulated_time(memory: World) -> None:
    clock = memory.node("world").create_publisher(Clock, "/clock")
    rig = Rig(memory, use_sim_time=True)
    await rig.ready()
    assert rig.fixed[0].transforms[0].header.stamp.sec == 0
    now = Clock()
    now.clock.sec = 100
    clock.publish(now)
    await until(lambda: rig.node.clock.now().nanoseconds == 100 * S)
    rig.node.set_parameter("robot_description", TWO)
    await until(lambda: len(rig.fixed) > 1)
    assert rig.fixed[-1].transforms[-1].header.stamp.sec == 100


async def test_joints_without_axis_or_mimicked_joint_are_warned_about(memory: World, caplog: Any) -> None:
    shoulder = ARM.replace('xyz="0 0 2"', 'xyz="0 0 0"')
    rig = await Rig(memory, shoulder.replace('joint="grip"', 'joint="gripp"')).ready()
    assert 'joint "also_grip" mimics joint "gripp", not a moving joint; did you mean "grip"?; without' in caplog.text
    rig.move(grip=0.5)
    assert await rig.moved(1) == ["finger"]
    rig.move(2, also_grip=0.5, shoulder=1.0)  # which has no axis
    assert await rig.moved(2) == ["thumb"]
