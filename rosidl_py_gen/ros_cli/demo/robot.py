"""Robot of the demo, which drives autonomously or by commands and publishes what its sensors measure, and its camera.

The camera is a lifecycle node that publishes pictures of the room while it is active.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from rosidl_py_gen import ExtraMissingError, get_action, get_message, get_service
from rosidl_py_gen.numpy import array_to_compressedimage, array_to_image
from rosidl_py_gen.ros_cli.demo.simulation import Body, World, along_arc
from rosidl_py_gen.runtime import GoalResult, LifecycleNode, Node, Range, ServerGoal, State
from rosidl_py_gen.tf import StaticTransformBroadcaster, Transform, TransformBroadcaster

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.demo.simulation import Array, Schedule

CameraInfo: Any = get_message("sensor_msgs/msg/CameraInfo")
CompressedImage: Any = get_message("sensor_msgs/msg/CompressedImage")
Header: Any = get_message("std_msgs/msg/Header")
Image: Any = get_message("sensor_msgs/msg/Image")

FORWARD_M, HEIGHT_M = 0.15, 0.3
"""Position of the demo camera on the robot in metres: distance forwards from the centre, and height."""
_WIDTH, _HEIGHT = 160, 120
_FOCAL_LENGTH = 115.0
"""Focal length of the demo camera in pixels; with it the picture is 70 degrees wide."""
_WALL_HEIGHT_M = 0.6
_CEILING, _FLOOR = (150, 180, 205), (110, 95, 80)
_FADE_M = 8.0
"""Distance in metres in which colours in the camera's pictures become darker by the factor e."""


@dataclass
class CameraParameters:
    image_rate: Annotated[float, Range(0.5, 30.0), "Images per second."] = 5.0


class Camera(LifecycleNode):
    """Lifecycle node ``camera`` of the demo: publishes ``camera/image_raw``, ``camera/camera_info`` and, with Pillow,
    compressed images.
    """

    def __init__(
        self, schedule: Schedule, world: World, body: Body, frame: str, namespace: str, **node_options: Any
    ) -> None:
        super().__init__("camera", namespace, **node_options)
        self._schedule, self._world, self._body, self._frame = schedule, world, body, frame
        self._parameters = self.declare_parameters(CameraParameters)
        schedule.every(lambda: self._parameters.image_rate, self._shoot)

    def on_configure(self, state: State) -> None:
        self._images = self.create_lifecycle_publisher(Image, "camera/image_raw")
        self._calibrations = self.create_lifecycle_publisher(CameraInfo, "camera/camera_info")
        self._compressed = None
        if missing_pillow() is None:
            self._compressed = self.create_lifecycle_publisher(CompressedImage, "camera/image_raw/compressed")

    def on_cleanup(self, state: State) -> None:
        for publisher in (self._images, self._calibrations, self._compressed):
            if publisher is not None:
                publisher.close()

    def _shoot(self) -> None:
        if self.state is not State.ACTIVE:
            return
        header = Header(stamp=self._schedule.now.to_msg(), frame_id=self._frame)
        picture = render(self._world, self._body)
        self._images.publish(array_to_image(picture, "rgb8", header=header, cls=Image))
        self._calibrations.publish(camera_info(header))
        if self._compressed is not None:
            compressed = array_to_compressedimage(picture, "rgb8", header=header, cls=CompressedImage)
            self._compressed.publish(compressed)


def missing_pillow() -> ExtraMissingError | None:
    """Return the reason why the camera publishes no compressed images.

    Returns None if Pillow is installed (extra ``images``).
    """
    try:
        array_to_compressedimage(np.zeros((1, 1), np.uint8), cls=CompressedImage)
    except ExtraMissingError as error:
        return error
    return None


def camera_info(header: Any) -> Any:
    """Return the calibration message of the demo camera: a pinhole camera without distortion."""
    info = CameraInfo(header=header, width=_WIDTH, height=_HEIGHT, distortion_model="plumb_bob", d=[0.0] * 5)
    f, x, y = _FOCAL_LENGTH, _WIDTH / 2 - 0.5, _HEIGHT / 2 - 0.5
    info.k = [f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def render(world: World, body: Body) -> Array:
    """Return the picture that a camera on a body sees, as RGB of shape ``(height, width, 3)``.

    One ray is cast for each column of the picture.
    """
    x, y = body.x + FORWARD_M * math.cos(body.yaw), body.y + FORWARD_M * math.sin(body.yaw)
    columns = -np.arctan((np.arange(_WIDTH) + 0.5 - _WIDTH / 2) / _FOCAL_LENGTH)  # left is positive
    lengths, colors = world.cast(x, y, body.yaw + columns, body)
    # The height of a wall in the picture depends on its distance along the axis of the camera, not along the ray.
    scale = _FOCAL_LENGTH / np.maximum(lengths * np.cos(columns), 1e-3)
    top = _HEIGHT / 2 - scale * (_WALL_HEIGHT_M - HEIGHT_M)
    bottom = _HEIGHT / 2 + scale * HEIGHT_M
    rows = np.arange(_HEIGHT)[:, None] + 0.5
    walls = (colors * np.exp(-lengths / _FADE_M)[:, None]).astype(np.uint8)
    picture = np.where((rows < top)[..., None], np.array(_CEILING, np.uint8), walls)
    return np.where((rows > bottom)[..., None], np.array(_FLOOR, np.uint8), picture)


BatteryState: Any = get_message("sensor_msgs/msg/BatteryState")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
Imu: Any = get_message("sensor_msgs/msg/Imu")
LaserScan: Any = get_message("sensor_msgs/msg/LaserScan")
Odometry: Any = get_message("nav_msgs/msg/Odometry")
SetBool: Any = get_service("std_srvs/srv/SetBool")
Trigger: Any = get_service("std_srvs/srv/Trigger")
Twist: Any = get_message("geometry_msgs/msg/Twist")

LASER_FORWARD_M = 0.1
RAYS = 360
MAX_RANGE_M = 12.0
ODOMETRY_ERROR = 1.01
"""Relative error of the wheels' measurement, 1 % too much, so that the frame ``odom`` drifts away from ``map``."""
MAX_ARCS = 10
_ODOM_HZ, _IMU_HZ, _BATTERY_HZ = 30.0, 50.0, 1.0
_NEAR_M, _FREE_M = 0.6, 0.9
"""Distances in metres of an obstacle at which the robot starts to turn (near), and at which it stops turning (free)."""
LOW_BATTERY = 0.05
_SPIRAL = "driving a spiral"


@dataclass
class DriveParameters:
    max_speed: Annotated[float, Range(0.05, 1.0), "Maximum speed in m/s."] = 0.4
    max_turn_rate: Annotated[float, Range(0.1, 3.0), "Maximum turn rate in rad/s."] = 1.5
    scan_rate: Annotated[float, Range(1.0, 40.0), "Scans per second."] = 10.0
    scan_noise: Annotated[float, Range(0.0, 0.2), "Standard deviation of measured distances in m."] = 0.01
    command_timeout: Annotated[float, Range(0.1, 5.0), "Time in s after the last command until the robot stops."] = 0.5
    autonomy_delay: Annotated[
        float, Range(0.0, 3600.0), "Time in s after the last command until the robot drives autonomously again."
    ] = 5.0


def heading(yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion x, y, z, w of a rotation about the vertical axis."""
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


class Robot:
    """Robot with the node ``robot`` in a namespace; its frames have the namespace as prefix."""

    def __init__(
        self, schedule: Schedule, world: World, seed: tuple[int, ...], namespace: str, **node_options: Any
    ) -> None:
        self.node = Node("robot", namespace, **node_options)
        self._schedule, self._world = schedule, world
        # Two generators: with one, the rate of the scans would change the way that the robot drives.
        self._decisions, self._noise = (np.random.default_rng((*seed, purpose)) for purpose in (0, 1))
        self._start = world.free_place(self._decisions)
        self.body = Body(*self._start)
        world.bodies.append(self.body)
        self._parameters = self.node.declare_parameters(DriveParameters)
        self._has_motors = True
        self._mode = ""
        self._command, self._command_s = (0.0, 0.0), -math.inf
        self._arc: tuple[float, float] | None = None
        """Speed and turn rate that the running action goal requests; None without a goal."""
        self._updated = asyncio.Event()
        self._turn_direction = 0
        """Direction in which the robot turns away from an obstacle, 1 (left) or -1 (right), until nothing is near."""
        self._curve = self._next_curve_s = 0.0
        self._reset()
        self._create_endpoints()
        schedule.every(lambda: _ODOM_HZ, self._update)
        schedule.every(lambda: _IMU_HZ, self._publish_imu)
        schedule.every(lambda: self._parameters.scan_rate, self._publish_scan)
        schedule.every(lambda: _BATTERY_HZ, self._publish_battery)

    def frame(self, name: str) -> str:
        """Return the full name of a coordinate frame of the robot; all robots share the frame ``map``."""
        return name if name == "map" else f"{self.node.namespace}/{name}".strip("/")

    def _create_endpoints(self) -> None:
        node = self.node
        # Reliable publishers, because best-effort ones do not match the default QoS of subscriptions.
        self._scans = node.create_publisher(LaserScan, "scan")
        self._odometry = node.create_publisher(Odometry, "odom")
        self._imu = node.create_publisher(Imu, "imu")
        self._batteries = node.create_publisher(BatteryState, "battery_state")
        node.create_subscription(Twist, "cmd_vel", self._on_command)
        node.create_service(Trigger, "reset", self._on_reset)
        node.create_service(SetBool, "set_motors", self._on_set_motors)
        node.create_action_server(
            Fibonacci,
            "drive_spiral",
            self._drive_spiral,
            goal_callback=lambda goal: 1 <= goal.order <= MAX_ARCS,
            goal_policy="reject",
        )
        self._transforms = TransformBroadcaster(node)
        self._static_transforms = StaticTransformBroadcaster(node)
        self._static_transforms.send(
            [
                self._transform("base_link", "laser", (LASER_FORWARD_M, 0.0, 0.2)),
                self._transform("base_link", "imu", (0.0, 0.0, 0.1)),
                self._transform("base_link", "camera", (FORWARD_M, 0.0, HEIGHT_M)),
                # Pictures have z forward and y down (REP 103).
                self._transform("camera", "camera_optical", (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5)),
            ]
        )

    def _transform(
        self, parent: str, child: str, position: Sequence[float], rotation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    ) -> Transform:
        """Return a transform message with the current time; the rotation is a quaternion."""
        stamp_ns = self._schedule.now.nanoseconds
        return Transform(self.frame(parent), self.frame(child), stamp_ns, np.array(position), np.array(rotation))

    def _header(self, frame: str) -> Any:
        return Header(stamp=self._schedule.now.to_msg(), frame_id=self.frame(frame))

    # ------------------------------------------------------------------------------------------------------- driving

    def _update(self) -> None:
        """Measure the movement since the last update, publish it, and decide how the robot drives until the next
        update.
        """
        self._publish_odometry()
        mode, speed, turn_rate = self._decide()
        if mode != self._mode:
            self._mode = mode
            self.node.logger.info(mode)
        limits = self._parameters
        self.body.target_speed = max(-limits.max_speed, min(limits.max_speed, speed))
        self.body.target_turn_rate = max(-limits.max_turn_rate, min(limits.max_turn_rate, turn_rate))
        self._updated.set()  # goals continue
        self._updated.clear()

    def _decide(self) -> tuple[str, float, float]:
        """Return a text about what the robot does, its speed in m/s and its turn rate in rad/s."""
        if not self._has_motors:
            return "the motors are off", 0.0, 0.0
        without_command_s = self._schedule.elapsed_s - self._command_s
        if without_command_s < self._parameters.command_timeout:
            return "following the commands on cmd_vel", *self._command
        if self._arc is not None:
            return _SPIRAL, *self._arc
        if without_command_s < self._parameters.autonomy_delay:
            return "stopped: no command on cmd_vel", 0.0, 0.0
        return "driving autonomously", *self._wander()

    def _wander(self) -> tuple[float, float]:
        """Return speed and turn rate of autonomous driving: ahead in random curves, and away from near obstacles."""
        angles = np.radians(np.arange(-75, 76, 5))
        lengths, _ = self._world.cast(self.body.x, self.body.y, self.body.yaw + angles, self.body)
        ahead = float(lengths[np.abs(angles) < 0.6].min())
        if self._turn_direction and ahead > _FREE_M:
            self._turn_direction = 0
        elif not self._turn_direction and (ahead < _NEAR_M or self.body.is_blocked):
            self._turn_direction = 1 if lengths[angles > 0].mean() > lengths[angles < 0].mean() else -1
            side = "left" if self._turn_direction > 0 else "right"
            self.node.logger.info(f"obstacle at {ahead:.2f} m: turning {side}")
        if self._turn_direction:
            return 0.0, self._turn_direction * self._parameters.max_turn_rate * 0.6
        if self._schedule.elapsed_s >= self._next_curve_s:
            self._next_curve_s = self._schedule.elapsed_s + self._decisions.uniform(2, 5)
            self._curve = self._decisions.uniform(-0.4, 0.4)
        return self._parameters.max_speed * min(1.0, ahead / 1.5), self._curve

    def _on_command(self, command: Any) -> None:
        speed, turn_rate = command.linear.x, command.angular.z
        if not (math.isfinite(speed) and math.isfinite(turn_rate)):
            self.node.logger.warning("ignored a command that is not finite", throttle_s=1.0)
            return
        self._command, self._command_s = (speed, turn_rate), self._schedule.elapsed_s

    def _on_set_motors(self, request: Any) -> Any:
        self._has_motors = request.data
        return SetBool.Response(success=True, message=f"motors are {'on' if request.data else 'off'}")

    def _on_reset(self, request: Any) -> Any:
        self._reset()
        self.node.logger.info("back at the start, with a full battery")
        return Trigger.Response(success=True, message="back at the start")

    def _reset(self) -> None:
        self.body.place(*self._start)
        self._odom = (0.0, 0.0, 0.0)
        self._measured = (self.body.travelled, self.body.turned)
        self._charge = 1.0
        self._imu_speed = 0.0
        self._turn_direction = 0

    async def _drive_spiral(self, goal: ServerGoal[Any]) -> GoalResult:
        """Execute the action ``drive_spiral``: drive quarter circles whose radii in cm are the Fibonacci numbers 0, 1,
        1, 2, 3, 5 and so on.
        """
        sequence: list[int] = []
        radius, following = 0, 1
        try:
            while len(sequence) <= goal.request.order:
                reason = await self._drive_quarter(goal, radius / 100)
                if goal.is_cancel_requested:
                    return goal.canceled(Fibonacci.Result(sequence=sequence))
                if reason:
                    self.node.logger.warning(f"the spiral ends after {len(sequence)} arcs: {reason}")
                    return goal.abort(Fibonacci.Result(sequence=sequence))
                sequence.append(radius)
                goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
                radius, following = following, radius + following
            return goal.succeed(Fibonacci.Result(sequence=sequence))
        finally:
            self._arc = None

    async def _drive_quarter(self, goal: ServerGoal[Any], radius_m: float) -> str:
        """Drive a quarter circle to the left; return why it was not completed, or an empty text."""
        fastest = self._parameters.max_speed / radius_m if radius_m else math.inf
        turn_rate = min(1.0, self._parameters.max_turn_rate, fastest)
        self._arc = (turn_rate * radius_m, turn_rate)
        end = self.body.turned + math.pi / 2
        while self.body.turned < end and not goal.is_cancel_requested:
            await self._updated.wait()
            if self._mode != _SPIRAL:
                return self._mode
            if self.body.is_blocked:
                return "something is in the way"
        return ""

    # ------------------------------------------------------------------------------------------------------- sensors

    def _publish_odometry(self) -> None:
        body = self.body
        distance, turn = body.travelled - self._measured[0], body.turned - self._measured[1]
        self._measured = (body.travelled, body.turned)
        self._odom = x, y, yaw = along_arc(*self._odom, distance * ODOMETRY_ERROR, turn * ODOMETRY_ERROR)
        base = self._transform("odom", "base_link", (x, y, 0.0), heading(yaw))
        # A localization would find map -> odom; here it follows from the true pose.
        true = self._transform("map", "base_link", (body.x, body.y, 0.0), heading(body.yaw))
        odom = true @ base.inverse()
        self._transforms.send([odom, base])
        message = Odometry(header=self._header("odom"), child_frame_id=self.frame("base_link"))
        position, orientation = message.pose.pose.position, message.pose.pose.orientation
        position.x, position.y = x, y
        orientation.x, orientation.y, orientation.z, orientation.w = heading(yaw)
        message.twist.twist.linear.x = body.speed * ODOMETRY_ERROR
        message.twist.twist.angular.z = body.turn_rate * ODOMETRY_ERROR
        self._odometry.publish(message)

    def _publish_scan(self) -> None:
        body, parameters = self.body, self._parameters
        x, y = body.x + LASER_FORWARD_M * math.cos(body.yaw), body.y + LASER_FORWARD_M * math.sin(body.yaw)
        step = 2 * math.pi / RAYS
        lengths, _ = self._world.cast(x, y, body.yaw - math.pi + step * np.arange(RAYS), body)
        lengths += parameters.scan_noise * self._noise.standard_normal(RAYS)
        scan = LaserScan(header=self._header("laser"), angle_min=-math.pi, angle_increment=step)
        scan.angle_max = math.pi - step
        scan.range_min, scan.range_max = 0.05, MAX_RANGE_M
        scan.scan_time = 1 / parameters.scan_rate
        scan.ranges = np.maximum(lengths, scan.range_min).astype(np.float32)
        self._scans.publish(scan)

    def _publish_imu(self) -> None:
        body = self.body
        noise = self._noise.normal(0.0, 0.02, 6).tolist()
        message = Imu(header=self._header("imu"))
        orientation, turn, force = message.orientation, message.angular_velocity, message.linear_acceleration
        orientation.x, orientation.y, orientation.z, orientation.w = heading(body.yaw)
        turn.x, turn.y, turn.z = noise[0], noise[1], body.turn_rate + noise[2]
        force.x = (body.speed - self._imu_speed) * _IMU_HZ + noise[3]
        force.y = body.speed * body.turn_rate + noise[4]
        force.z = 9.81 + noise[5]
        self._imu_speed = body.speed
        self._imu.publish(message)

    def _publish_battery(self) -> None:
        current = 0.4 + 2.0 * abs(self.body.speed)
        self._charge -= 0.001 * current
        if self._charge < LOW_BATTERY:
            self._charge = 1.0
            self.node.logger.warning("the battery was empty; it has been replaced")
        message = BatteryState(header=self._header("base_link"), present=True, percentage=self._charge)
        message.voltage, message.current = 13.2 + 3.6 * self._charge, -current
        message.temperature = message.charge = message.capacity = message.design_capacity = math.nan
        message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        message.power_supply_health = BatteryState.POWER_SUPPLY_HEALTH_GOOD
        message.power_supply_technology = BatteryState.POWER_SUPPLY_TECHNOLOGY_LION
        self._batteries.publish(message)
