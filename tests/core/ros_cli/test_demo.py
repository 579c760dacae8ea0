"""``rosidl-py demo``: what its robot publishes, how it drives, and what its options do."""

from __future__ import annotations

import asyncio
import math
import signal
import sys
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.bag_samples import file_size_limit

from rosidl_py_gen import ExtraMissingError, get_action, get_message, get_service
from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.numpy import (
    compressedimage_to_array,
    image_to_array,
    laserscan_to_points,
    occupancygrid_to_array,
    points_to_xyz,
    quaternion_to_euler,
)
from rosidl_py_gen.ros_cli import demo as command
from rosidl_py_gen.ros_cli.demo import robot
from rosidl_py_gen.ros_cli.demo.simulation import BODY_COLOR, BODY_RADIUS_M, BOXES, Body, World
from rosidl_py_gen.runtime import Durability, GoalRejectedError, GoalStatus, QoSProfile
from rosidl_py_gen.tf import TransformBuffer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from support.worlds import World as Nodes

    from rosidl_py_gen.runtime import Node

Clock: Any = get_message("rosgraph_msgs/msg/Clock")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
LaserScan: Any = get_message("sensor_msgs/msg/LaserScan")
Imu: Any = get_message("sensor_msgs/msg/Imu")
Log: Any = get_message("rcl_interfaces/msg/Log")
BatteryState: Any = get_message("sensor_msgs/msg/BatteryState")
Image: Any = get_message("sensor_msgs/msg/Image")
OccupancyGrid: Any = get_message("nav_msgs/msg/OccupancyGrid")
Odometry: Any = get_message("nav_msgs/msg/Odometry")
SetBool: Any = get_service("std_srvs/srv/SetBool")
Trigger: Any = get_service("std_srvs/srv/Trigger")
Twist: Any = get_message("geometry_msgs/msg/Twist")
LATCHED = QoSProfile(depth=1).transient_local()

SENSORS = {
    "/scan": ("sensor_msgs/msg/LaserScan", "laser", 10),
    "/odom": ("nav_msgs/msg/Odometry", "odom", 30),
    "/imu": ("sensor_msgs/msg/Imu", "imu", 50),
    "/battery_state": ("sensor_msgs/msg/BatteryState", "base_link", 1),
    "/camera/image_raw": ("sensor_msgs/msg/Image", "camera_optical", 5),
    "/camera/camera_info": ("sensor_msgs/msg/CameraInfo", "camera_optical", 5),
    "/camera/image_raw/compressed": ("sensor_msgs/msg/CompressedImage", "camera_optical", 5),
}
"""Type, frame and rate of each topic of a sensor."""


@pytest.fixture
def node(memory: Nodes) -> Node:
    return memory.node("visitor")


@asynccontextmanager
async def demo(tool: Any, *options: str, number: int = signal.SIGINT) -> AsyncIterator[str]:
    """Run the command until a signal, yield its line, and require exit code 0 and no further output."""
    process = await tool.start("demo", *options)
    line = (await asyncio.wait_for(process.stdout.readline(), 60)).decode()
    if not line:
        pytest.fail((await tool.end(process)).err)
    yield line
    ended = await tool.interrupt(process, number)
    assert (ended.code, ended.out) == (0, "") and "Traceback" not in ended.err, ended.err


def seconds_of(time: Any) -> float:
    return float(time.sec + time.nanosec / 1e9)


async def messages(node: Node, cls: Any, topic: str, seconds: float) -> list[Any]:
    """Return the messages that arrive within a time."""
    received: list[Any] = []
    subscription = node.create_subscription(cls, topic, received.append, QoSProfile(depth=100))
    await asyncio.sleep(seconds)
    subscription.close()
    return received


async def command_for(node: Node, seconds: float, speed: float, turn_rate: float) -> None:
    """Publish commands at 10 Hz."""
    publisher = node.create_publisher(Twist, "/cmd_vel")
    await publisher.wait_for_subscribers(timeout_s=5)
    for _ in range(round(seconds * 10)):
        message = Twist()
        message.linear.x, message.angular.z = speed, turn_rate
        publisher.publish(message)
        await asyncio.sleep(0.1)
    publisher.close()


async def speeds(node: Node) -> tuple[float, float]:
    twist = (await messages(node, Odometry, "/odom", 0.05))[-1].twist.twist
    return twist.linear.x, twist.angular.z


def texts_of(logs: Any) -> list[str]:
    """Return the texts of the log messages that have arrived."""
    texts = []
    while (log := logs.take()) is not None:
        texts.append(log.msg)
    return texts


# ------------------------------------------------------------------------------------------------------------- sensors


async def test_each_sensor_publishes_its_type_frame_and_rate(tool: Any, node: Node) -> None:
    async with demo(tool) as line:
        assert line == "/robot drives in a room of 8 m x 6 m; Ctrl-C ends the demo\n"
        types = dict(node.get_topic_names_and_types())
        assert {topic: types[topic] for topic in SENSORS} == {name: [row[0]] for name, row in SENSORS.items()}
        assert {"/map", "/tf", "/tf_static", "/cmd_vel", "/rosout"} <= types.keys() and "/clock" not in types
        all_received = await asyncio.gather(
            *(messages(node, get_message(kind), topic, 3) for topic, (kind, _, _) in SENSORS.items())
        )
        for received, (topic, (_, frame, rate)) in zip(all_received, SENSORS.items(), strict=True):
            assert {one.header.frame_id for one in received} == {frame}, topic
            assert len(received) == pytest.approx(3 * rate, abs=1), topic
            stamps = [seconds_of(one.header.stamp) for one in received]
            assert np.allclose(np.diff(stamps), 1 / rate, atol=1e-4), topic


async def test_scan_agrees_with_latched_map(tool: Any, node: Node) -> None:
    async with demo(tool):
        await asyncio.sleep(3)  # the map was published before
        grid = await node.create_subscription(OccupancyGrid, "/map", None, LATCHED).receive(timeout_s=1)
        buffer = TransformBuffer(node)
        scans = await messages(node, LaserScan, "/scan", 20)
        cells, info = occupancygrid_to_array(grid), grid.info
        corner = np.array((info.origin.position.x, info.origin.position.y))
        rows, columns = np.nonzero(cells == 100)
        occupied = corner + (np.stack([columns, rows], axis=1) + 0.5) * info.resolution
        assert len(scans) == 200 and grid.header.frame_id == "map" and info.resolution == pytest.approx(0.05)
        for scan in scans[101::20]:  # a buffer has the transforms of 10 s
            stamp = scan.header.stamp
            transform = buffer.lookup_transform("map", "laser", stamp)
            points = transform.apply(points_to_xyz(laserscan_to_points(scan)))[:, :2]
            assert len(points) == 360
            distances = np.linalg.norm(points[:, None] - occupied[None], axis=2).min(axis=1)
            assert distances.max() < 0.1


async def test_odometry_drifts_and_transforms_correct_it(tool: Any, node: Node) -> None:
    async with demo(tool):
        buffer = TransformBuffer(node)
        received = await messages(node, Odometry, "/odom", 12)
        stamp, pose = received[-1].header.stamp, received[-1].pose.pose
        base = buffer.lookup_transform("odom", "base_link", stamp)
        assert np.allclose(base.translation[:2], (pose.position.x, pose.position.y))
        correction = buffer.lookup_transform("map", "odom", stamp)
        first = buffer.lookup_transform("map", "odom", received[-240].header.stamp)
        assert not np.allclose(correction.matrix, first.matrix, atol=1e-3)
        # The angle driven by odometry, and the one of the gyroscope, differ by one percent.
        turns = [quaternion_to_euler(one.pose.pose.orientation)[2] for one in received]
        assert np.ptp(np.unwrap(turns)) > 0.5
        frames = {name: info.parent for name, info in buffer.frames().items()}
        assert frames == {"map": None, "odom": "map", "base_link": "odom", "camera_optical": "camera"} | dict.fromkeys(
            ("laser", "imu", "camera"), "base_link"
        )
        optical = buffer.lookup_transform("base_link", "camera_optical")
        assert np.allclose(optical.rotate((0, 0, 1)), (1, 0, 0)) and np.allclose(optical.rotate((0, 1, 0)), (0, 0, -1))


async def test_imu_measures_turns_and_gravity(tool: Any, node: Node) -> None:
    async with demo(tool):
        await command_for(node, 1, 0.0, 0.8)
        received, _ = await asyncio.gather(messages(node, Imu, "/imu", 1), command_for(node, 1, 0.0, 0.8))
        rates = [one.angular_velocity.z for one in received]
        assert np.mean(rates) == pytest.approx(0.8, abs=0.02) and 0.005 < np.std(rates) < 0.1
        assert np.mean([one.linear_acceleration.z for one in received]) == pytest.approx(9.81, abs=0.05)
        yaws = np.unwrap([quaternion_to_euler(one.orientation)[2] for one in received])
        assert yaws[-1] - yaws[0] == pytest.approx(0.8 * (len(received) - 1) / 50, abs=0.01)


async def test_pictures_show_the_room(tool: Any, node: Node) -> None:
    async with demo(tool):
        compressed: Any = get_message("sensor_msgs/msg/CompressedImage")
        plain, small, infos = await asyncio.gather(
            messages(node, Image, "/camera/image_raw", 1),
            messages(node, compressed, "/camera/image_raw/compressed", 1),
            messages(node, get_message("sensor_msgs/msg/CameraInfo"), "/camera/camera_info", 1),
        )
        picture = image_to_array(plain[0])
        assert picture.shape == (infos[0].height, infos[0].width, 3) == (120, 160, 3)
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
        error = np.abs(compressedimage_to_array(small[0]).astype(int) - picture)
        assert error.mean() < 10 and small[0].header == plain[0].header


def test_picture_has_boxes_where_they_stand() -> None:
    world = World()
    box = BOXES[5]
    body = Body((box.x_min + box.x_max) / 2, box.y_min - 1.0, math.pi / 2)  # one metre in front of its middle
    picture = robot.render(world, body).astype(int)
    middle, ceiling, floor = picture[60, 80], picture[0, 80], picture[-1, 80]
    assert middle.argmax() == np.argmax(box.color) and not (middle == ceiling).all() and not (middle == floor).all()
    assert (picture[60, 75:85] == middle).all(axis=1).mean() > 0.5
    body.place(body.x, body.y, math.pi / 2)
    world.bodies += [body, Body(body.x, body.y + 0.5, 0.0)]
    nearer = robot.render(world, body)
    assert nearer[60, 80].min() > 0.8 * min(BODY_COLOR)


async def test_without_pillow_compressed_images_are_omitted_with_a_note(
    tool: Any, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: Any, **__: Any) -> None:
        raise ExtraMissingError("needs Pillow: pip install x")

    monkeypatch.setattr(robot, "array_to_compressedimage", missing)
    process = await tool.start("demo", "--count", "2", "--duration", "1")
    await asyncio.sleep(0.5)
    topics = dict(node.get_topic_names_and_types())
    assert "/robot1/camera/image_raw" in topics and "/robot1/camera/image_raw/compressed" not in topics
    ended = await tool.end(process)
    assert ended.code == 0
    assert ended.err == "no topic camera/image_raw/compressed: needs Pillow: pip install x\n"


async def test_battery_drains_and_is_replaced(tool: Any, node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    async with demo(tool):
        logs = node.create_subscription(Log, "/rosout", None, QoSProfile(depth=1000))
        first, *_, last = await messages(node, BatteryState, "/battery_state", 20)
        assert 0.95 < last.percentage < first.percentage <= 1 and last.voltage < first.voltage and last.current < 0
        assert last.present and last.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        monkeypatch.setattr(robot, "LOW_BATTERY", last.percentage - 0.001)
        charges = [one.percentage for one in await messages(node, BatteryState, "/battery_state", 10)]
        assert max(charges) > last.percentage
        assert "the battery was empty; it has been replaced" in texts_of(logs)


# ------------------------------------------------------------------------------------------------------------- driving


async def test_robot_drives_through_the_room_without_touching_anything_for_long(tool: Any, node: Node) -> None:
    async with demo(tool, "--seed", "5"):
        buffer = TransformBuffer(node)
        places = []
        for _ in range(40):
            await asyncio.sleep(1)
            places.append(buffer.lookup_transform("map", "base_link").translation[:2])
        assert np.ptp(places, axis=0).min() > 2
        world = World()
        assert min(world.clearance(*place) for place in places) > BODY_RADIUS_M - 0.05
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert steps.max() < 0.45 and np.mean(steps > 0.1) > 0.4


async def test_robot_follows_commands_stops_and_drives_autonomously_again(tool: Any, node: Node) -> None:
    async with demo(tool):
        logs = node.create_subscription(Log, "/rosout", None, QoSProfile(depth=1000))
        await asyncio.sleep(1)
        await command_for(node, 2, -0.05, 0.5)
        assert await speeds(node) == pytest.approx((-0.05 * 1.01, 0.5 * 1.01), abs=1e-3)
        await asyncio.sleep(0.8)
        assert await speeds(node) == (0, 0)
        await asyncio.sleep(3)
        assert await speeds(node) == (0, 0)
        await asyncio.sleep(3)
        assert await speeds(node) != (0, 0)
        kept = [text for text in texts_of(logs) if "obstacle" not in text]
        assert kept == [
            *("driving autonomously", "following the commands on cmd_vel", "stopped: no command on cmd_vel"),
            "driving autonomously",
        ]


async def test_speed_is_limited_and_invalid_commands_are_ignored(tool: Any, node: Node) -> None:
    async with demo(tool):
        await command_for(node, 1, 0.0, 100.0)
        assert (await speeds(node))[1] == pytest.approx(1.5 * 1.01)
        logs = node.create_subscription(Log, "/rosout", None, QoSProfile(depth=1000))
        await command_for(node, 1, math.nan, math.inf)
        assert (await logs.receive(timeout_s=1)).msg == "ignored a command that is not finite"
        assert await speeds(node) == (0, 0)


async def test_wall_blocks_the_robot(tool: Any, node: Node) -> None:
    async with demo(tool):
        buffer = TransformBuffer(node)
        await command_for(node, 16, 0.5, 0.0)
        before = buffer.lookup_transform("map", "base_link").translation
        assert World().clearance(*before[:2]) < BODY_RADIUS_M + 0.05
        await command_for(node, 2, 0.4, 0.0)
        assert np.allclose(buffer.lookup_transform("map", "base_link").translation, before)
        await command_for(node, 2, -0.2, 0.0)
        assert np.linalg.norm(buffer.lookup_transform("map", "base_link").translation - before) > 0.2


async def drive(tool: Any, node: Node, *options: str) -> list[Any]:
    """Return the first seconds of a new demo; a message is comparable as a whole."""
    topics = ("/scan", "/odom", "/imu", "/camera/image_raw")
    received: list[list[Any]] = [[] for _ in topics]
    subscriptions = [
        node.create_subscription(get_message(SENSORS[topic][0]), topic, received[number].append, 100, raw=True)
        for number, topic in enumerate(topics)
    ]
    async with demo(tool, "--sim-time", *options):
        await asyncio.sleep(5)
    for subscription in subscriptions:
        subscription.close()
    return [one[:20] for one in received]


async def test_drive_is_repeated_with_the_same_seed_only(tool: Any, node: Node) -> None:
    first, second, other = [await drive(tool, node, "--seed", seed) for seed in ("3", "3", "4")]
    assert first == second and all(len(one) == 20 for one in first)
    assert all(one != different for one, different in zip(first, other, strict=True))


# ------------------------------------------------------------------------------------- services, action and parameters


async def test_reset_puts_the_robot_back(tool: Any, node: Node) -> None:
    async with demo(tool):
        start = TransformBuffer(node)
        await start.wait_for_transform("map", "base_link", timeout_s=5)
        home = start.lookup_transform("map", "base_link").translation
        await asyncio.sleep(10)
        assert np.linalg.norm(start.lookup_transform("map", "base_link").translation - home) > 0.5
        response = await node.create_client(Trigger, "/reset").call(Trigger.Request(), timeout_s=5)
        assert (response.success, response.message) == (True, "back at the start")
        first, *_ = await messages(node, Odometry, "/odom", 0.1)
        assert math.hypot(first.pose.pose.position.x, first.pose.pose.position.y) < 0.05
        assert np.allclose(start.lookup_transform("map", "base_link").translation, home, atol=0.05)


async def test_motors_can_be_turned_off(tool: Any, node: Node) -> None:
    async with demo(tool):
        client = node.create_client(SetBool, "/set_motors")
        off = await client.call(SetBool.Request(data=False), timeout_s=5)
        assert (off.success, off.message) == (True, "motors are off")
        await command_for(node, 1, 0.1, 0.3)
        assert await speeds(node) == (0, 0)
        assert (await client.call(SetBool.Request(data=True), timeout_s=5)).message == "motors are on"
        await command_for(node, 1, 0.0, 0.3)
        assert (await speeds(node))[1] == pytest.approx(0.3 * 1.01)


async def test_spiral_of_quarter_circles_is_driven(tool: Any, node: Node) -> None:
    async with demo(tool):
        await asyncio.sleep(1)
        client = node.create_action_client(Fibonacci, "/drive_spiral")
        await client.wait_for_server(timeout_s=5)
        before = (await messages(node, Odometry, "/odom", 0.05))[-1]
        goal = await client.send_goal(Fibonacci.Goal(order=4), timeout_s=5)
        with pytest.raises(GoalRejectedError):
            await client.send_goal(Fibonacci.Goal(order=4), timeout_s=5)  # one at a time
        status, result = await goal.result(timeout_s=30)
        assert (status, list(result.sequence)) == (GoalStatus.SUCCEEDED, [0, 1, 1, 2, 3])
        assert [len(message.sequence) async for message in goal.feedback()] == [1, 2, 3, 4, 5]
        after = (await messages(node, Odometry, "/odom", 0.05))[0]
        yaws = [quaternion_to_euler(one.pose.pose.orientation)[2] for one in (before, after)]
        assert math.remainder(yaws[1] - yaws[0] - 5 * math.pi / 2, math.tau) == pytest.approx(0, abs=0.6)


@pytest.mark.parametrize("order", [-1, 0, 11])
async def test_spiral_of_invalid_order_is_rejected(tool: Any, node: Node, order: int) -> None:
    async with demo(tool):
        client = node.create_action_client(Fibonacci, "/drive_spiral")
        await client.wait_for_server(timeout_s=5)
        with pytest.raises(GoalRejectedError):
            await client.send_goal(Fibonacci.Goal(order=order), timeout_s=5)


async def test_spiral_ends_when_cancelled_or_when_a_command_arrives(tool: Any, node: Node) -> None:
    async with demo(tool):
        client = node.create_action_client(Fibonacci, "/drive_spiral")
        await client.wait_for_server(timeout_s=5)
        goal = await client.send_goal(Fibonacci.Goal(order=8), timeout_s=5)
        await asyncio.sleep(2)
        await goal.cancel(timeout_s=5)
        status, result = await goal.result(timeout_s=5)
        assert (status, list(result.sequence)) == (GoalStatus.CANCELED, [0])
        goal = await client.send_goal(Fibonacci.Goal(order=8), timeout_s=5)
        await command_for(node, 0.5, 0.0, 0.3)
        status, result = await goal.result(timeout_s=5)
        assert (status, list(result.sequence)) == (GoalStatus.ABORTED, [])


async def test_parameters_have_descriptions_limits_and_effects(tool: Any, node: Node) -> None:
    async with demo(tool):
        base, lens = node.create_parameter_client("/robot"), node.create_parameter_client("/camera")
        await base.wait_for_services(timeout_s=5)
        described = await base.describe(["max_speed", "scan_rate"], timeout_s=5)
        assert [one.description for one in described] == ["Maximum speed in m/s.", "Scans per second."]
        results = await base.set({"max_speed": 5.0, "scan_rate": 20.0, "max_turn_rate": 0.2}, timeout_s=5)
        assert [one.successful for one in results] == [False, True, True]
        await lens.set({"image_rate": 10.0}, timeout_s=5)
        await command_for(node, 1, 0.0, 1.0)
        assert (await speeds(node))[1] == pytest.approx(0.2 * 1.01)
        scans, images = await asyncio.gather(
            messages(node, LaserScan, "/scan", 2), messages(node, Image, "/camera/image_raw", 2)
        )
        assert len(scans) == pytest.approx(40, abs=1) and len(images) == pytest.approx(20, abs=1)
        assert scans[0].scan_time == pytest.approx(0.05)
        await base.set({"scan_noise": 0.0, "autonomy_delay": 3600.0, "command_timeout": 0.1}, timeout_s=5)
        await command_for(node, 0.1, 0.0, 0.1)
        await asyncio.sleep(0.5)
        first, *_, last = await messages(node, LaserScan, "/scan", 20)  # at rest, without noise
        assert (first.ranges == last.ranges).all()


async def test_camera_publishes_only_while_active(tool: Any, node: Node) -> None:
    async with demo(tool):
        state = await tool("lifecycle", "get", "/camera")
        assert state.out == "active [3]\n"
        assert (await tool("lifecycle", "set", "/camera", "deactivate")).code == 0
        assert await messages(node, Image, "/camera/image_raw", 2) == []
        assert (await tool("lifecycle", "set", "/camera", "cleanup")).code == 0
        assert "/camera/image_raw" not in dict(node.get_topic_names_and_types())
        assert (await tool("lifecycle", "set", "/camera", "configure")).code == 0
        assert (await tool("lifecycle", "set", "/camera", "activate")).code == 0
        assert len(await messages(node, Image, "/camera/image_raw", 2)) == pytest.approx(10, abs=1)


# ------------------------------------------------------------------------------------------------------------- options


async def test_robots_have_own_namespaces_and_share_one_frame_tree(tool: Any, node: Node) -> None:
    async with demo(tool, "--count", "2", "--namespace", "/lab/") as line:
        assert line.startswith("/lab/robot1/robot and /lab/robot2/robot drive in a room")
        names = {one.fully_qualified_name for one in node.get_nodes()} - {"/visitor"}
        assert names == {
            *("/lab/room", "/lab/robot1/robot", "/lab/robot1/camera"),
            *("/lab/robot2/robot", "/lab/robot2/camera"),
        }
        buffer = TransformBuffer(node)
        for name in ("lab/robot1", "lab/robot2"):
            await buffer.wait_for_transform("map", f"{name}/laser", timeout_s=5)
            (scan, *_) = await messages(node, LaserScan, f"/{name}/scan", 0.2)
            assert scan.header.frame_id == f"{name}/laser"
        assert await node.create_subscription(OccupancyGrid, "/lab/map", None, LATCHED).receive(timeout_s=1)


def test_robots_see_each_other_and_do_not_collide() -> None:
    world = World()
    left, right = Body(-1.0, 0.0, 0.0, target_speed=0.5), Body(1.0, 0.0, math.pi, target_speed=0.5)
    world.bodies += [left, right]
    lengths, colors = world.cast(left.x, left.y, np.array([0.0, math.pi / 2]), left)
    assert lengths[0] == pytest.approx(2 - BODY_RADIUS_M) and tuple(colors[0]) == BODY_COLOR
    assert tuple(colors[1]) != BODY_COLOR
    for _ in range(1000):
        world.advance(0.01)
    assert left.is_blocked and right.is_blocked and right.x - left.x == pytest.approx(2 * BODY_RADIUS_M, abs=0.02)


async def test_simulated_time_starts_at_zero_and_passes_at_the_given_speed(tool: Any, node: Node) -> None:
    clocks: list[float] = []
    node.create_subscription(Clock, "/clock", lambda message: clocks.append(seconds_of(message.clock)))
    async with demo(tool, "--sim-time", "--speed", "4"):
        await asyncio.sleep(5)
        scans = await messages(node, LaserScan, "/scan", 1)
        assert len(scans) == pytest.approx(40, abs=2)
        assert seconds_of(scans[0].header.stamp) == pytest.approx(20, abs=0.5)
        assert clocks[0] < 0.1 and clocks == sorted(clocks) and clocks[-1] == pytest.approx(24, abs=0.5)
        assert await node.create_parameter_client("/robot").get("use_sim_time", timeout_s=5) is True


@pytest.mark.parametrize("name", ["drive", "drive.mcap"])
async def test_recorded_bag_has_everything_of_the_drive(tool: Any, node: Node, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    process = await tool.start("demo", "--sim-time", "--duration", "4", "--record", str(path))
    await process.stdout.readline()
    await command_for(node, 1, 0.0, 0.5)
    ended = await tool.end(process)
    assert ended.code == 0
    with BagReader(path) as reader:
        counts = {topic.name: topic.count for topic in reader.topics.values()}
        assert ended.err == f"recorded {sum(counts.values())} messages in {path}\n"
        assert {name: counts[name] for name in SENSORS} == {name: row[2] * 4 for name, row in SENSORS.items()}
        assert counts["/map"] == counts["/tf_static"] == 1 and counts["/cmd_vel"] == 10 and counts["/rosout"] > 1
        (offered,) = OfferedQoS.parse(reader.topics["/map"].offered_qos)
        assert offered.durability is Durability.TRANSIENT_LOCAL
        scans = [item for item in reader if item.topic == "/scan"]
        assert scans[-1].message.header.stamp.sec == 4 and scans[-1].log_time == 4_000_000_000


async def test_full_disk_ends_the_recording_and_is_the_result(tool: Any, node: Node, tmp_path: Path) -> None:
    with file_size_limit(10_000):
        ended = await tool("demo", "--sim-time", "--duration", "8", "--record", str(tmp_path / "drive"))
    assert ended.code == 1 and "the recording ends here: " in ended.err and "error: " in ended.err


async def test_interrupted_recording_can_be_read(tool: Any, node: Node, tmp_path: Path) -> None:
    process = await tool.start("demo", "--record", str(tmp_path / "drive"))
    await asyncio.sleep(2)
    ended = await tool.interrupt(process)
    assert ended.code == 0 and ended.err.startswith("recorded ")
    with BagReader(tmp_path / "drive") as reader:
        times = [item.log_time for item in reader]
    assert len(times) > 150 and times == sorted(times)


async def test_invalid_options_are_reported(tool: Any, node: Node, tmp_path: Path) -> None:
    without = await tool("demo", "--speed", "2")
    assert without.code == 2 and "--speed requires --sim-time" in without.err
    assert (await tool("demo", "--count", "0")).code == 2
    wrong = await tool("demo", "--namespace", "a b")
    assert wrong.code == 1 and wrong.err.startswith("error: ") and "namespace" in wrong.err
    existing = await tool("demo", "--record", str(tmp_path))
    assert existing.code == 1 and "exists already" in existing.err


async def test_terminal_gets_commands_to_try(tool: Any, node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    process = await tool.start("demo", "--namespace", "r2d2", "--duration", "1")
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda self: True)
    ended = await tool.end(process)
    examples = [line.strip() for line in ended.out.splitlines()[2:]]
    assert len(examples) > 4 and all(line.startswith("rosidl-py ") for line in examples)
    assert "rosidl-py topic echo /r2d2/scan --once" in examples
    monkeypatch.undo()


async def test_log_messages_are_published_and_only_errors_printed(tool: Any, node: Node) -> None:
    process = await tool.start("demo", "--duration", "5")
    (first, *_) = await messages(node, Log, "/rosout", 4)
    assert first.name in ("robot", "camera", "room")
    ended = await tool.end(process)
    assert (ended.code, ended.err) == (0, "")
    import logging

    assert not [one for one in logging.getLogger().handlers if one.level == logging.ERROR]


@pytest.mark.slow
async def test_demo_process_is_found_on_the_network(network: Nodes, tool: Any) -> None:
    node = network.node("visitor")
    async with demo(tool, "--seed", "1", number=signal.SIGTERM):
        scan = await node.create_subscription(LaserScan, "/scan").receive(timeout_s=20)
        assert len(scan.ranges) == 360
        grid = await node.create_subscription(OccupancyGrid, "/map", None, LATCHED).receive(timeout_s=20)
        assert grid.info.width == 164
        response = await node.create_client(Trigger, "/reset").call(Trigger.Request(), timeout_s=20)
        assert response.success


def test_examples_of_the_terminal_name_existing_commands() -> None:
    from rosidl_py_gen import ros_cli

    for line in command.EXAMPLES.format(ns="").splitlines()[1:]:
        _, *words = line.split()
        group = ros_cli.root()
        with ros_cli.click_module().Context(group) as context:
            found = group.get_command(context, words[0])
            assert found is not None and found.get_command(context, words[1]) is not None, line
