"""Node that publishes the transforms of a robot: fixed joints on ``/tf_static``, the others on ``/tf``.

Topics, parameters and rules are those of robot_state_publisher, docs/internals/protocol.md 13.2.
"""

from __future__ import annotations

from math import cos, isfinite, sin
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp, stamp_ns
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.robot.node_program import WARNING_INTERVAL_S, ProgramError, serve, transform_message
from rosidl_py_gen.robot.urdf import parse_urdf, read_description, resolve_mimics
from rosidl_py_gen.runtime import Durability, Node, QoSProfile, SetResult
from rosidl_py_gen.runtime.qos import SENSOR_DATA
from rosidl_py_gen.tf import StaticTransformBroadcaster, TransformBroadcaster
from rosidl_py_gen.tf.quaternion_math import product, rotate

if TYPE_CHECKING:
    from rosidl_py_gen.robot.urdf import Joint
    from rosidl_py_gen.runtime import Context, Parameter

NAME = "robot_state_publisher"
LATCHED = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
"""QoS of the topic ``robot_description``."""


class _MovingTransform:
    """Transform of a movable joint, as a message that is reused: its fields follow the position.

    The rotation by an angle is ``cos(angle / 2) * still + sin(angle / 2) * turned``, with two constant quaternions.
    """

    __slots__ = ("_axis", "_origin", "_still", "_turned", "message")

    def __init__(self, joint: Joint) -> None:
        self.message = transform_message("", "", joint.translation, joint.rotation)
        self._origin, self._still = joint.translation, joint.rotation
        self._turned = product(joint.rotation, (*joint.axis, 0.0))
        self._axis = rotate(joint.rotation, joint.axis) if joint.type == "prismatic" else None

    def move(self, position: float) -> None:
        """Set the fields to those of a position in radians or metres."""
        if self._axis is not None:
            (x, y, z), (dx, dy, dz) = self._origin, self._axis
            move = self.message.transform.translation
            move.x, move.y, move.z = x + dx * position, y + dy * position, z + dz * position
        else:
            c, s = cos(position / 2), sin(position / 2)
            (x, y, z, w), (dx, dy, dz, dw) = self._still, self._turned
            turn = self.message.transform.rotation
            turn.x, turn.y, turn.z, turn.w = c * x + s * dx, c * y + s * dy, c * z + s * dz, c * w + s * dw


class RobotStatePublisher:
    """Node of a context whose first argument may be the file of a URDF; raises errors of this package."""

    def __init__(self, *, context: Context | None = None) -> None:
        self.node = node = Node(NAME, context=context)
        text = node.declare_parameter("robot_description", "")
        frequency = node.declare_parameter("publish_frequency", 20.0)
        self._prefix = node.declare_parameter("frame_prefix", "")
        self._ignore_timestamp = node.declare_parameter("ignore_timestamp", False)
        if reason := _refused_frequency(frequency):
            raise ProgramError(reason)
        self._interval_ns = _interval_ns(frequency)
        arguments = node.context.arguments[1:]
        if not text and not arguments:
            expected = "the text of a URDF, such as Command(['xacro ', path]) in a launch file"
            raise ProgramError(f"parameter robot_description: not set; expected {expected}")
        if not text:
            node.logger.warning("robot_description is not set; the file of a URDF as argument is deprecated")
            text = read_description(arguments[0])
            node.set_parameter("robot_description", text)
        self._broadcaster = TransformBroadcaster(node)
        self._static_broadcaster = StaticTransformBroadcaster(node)
        self._string: Any = get_message("std_msgs/msg/String")
        self._descriptions = node.create_publisher(self._string, "robot_description", LATCHED)
        self._published_ns: dict[str, int] = {}
        self._last_callback_ns = 0
        self._parsed = (text, parse_urdf(text))
        self._use_robot(*self._parsed)
        states = get_message("sensor_msgs/msg/JointState")
        node.create_subscription(states, "joint_states", self._on_joint_state, SENSOR_DATA)
        node.add_on_set_callback(self._check_parameters)
        node.add_post_set_callback(self._apply_parameters)

    def _use_robot(self, text: str, joints: dict[str, Joint]) -> None:
        """Publish a description and its fixed transforms."""
        self._joints = joints
        self._moving = {
            name: _MovingTransform(joint) for name, joint in joints.items() if joint.is_movable and any(joint.axis)
        }
        self._mimics = {name: joint.mimic for name, joint in joints.items() if joint.mimic is not None}
        self._mimic_order, problems = resolve_mimics(self._mimics, joints)
        for problem in problems:
            self.node.logger.warning(f"{problem}; without a position of its own it is not published")
        self._publish_fixed()
        self._descriptions.publish(self._string(data=text))
        self.node.logger.info("Robot initialized")

    def _publish_fixed(self) -> None:
        """Publish fixed and planar joints; floating joints are left to other nodes. Set the frames of the others."""
        now, messages = self.node.clock.now().nanoseconds, []
        for joint in self._joints.values():
            parent, child = self._prefix + joint.parent, self._prefix + joint.child
            if moving := self._moving.get(joint.name):
                moving.message.header.frame_id, moving.message.child_frame_id = parent, child
            elif joint.type in ("fixed", "planar"):
                messages.append(transform_message(parent, child, joint.translation, joint.rotation))
                set_stamp(messages[-1].header.stamp, now)
        self._static_broadcaster.send(messages)

    def _on_joint_state(self, message: Any) -> None:
        names, positions, warn = message.name, message.position.tolist(), self.node.logger.warning
        if len(names) != len(positions):
            found = f"{len(names)} names{f', such as {names[0]!r:.60},' * bool(names)} and {len(positions)} positions"
            warn(f"joint_states: message ignored, which has {found}; expected as many", throttle_s=WARNING_INTERVAL_S)
            return
        now, published = self.node.clock.now().nanoseconds, self._published_ns
        if now < self._last_callback_ns:
            warn("time has jumped back; all joints of the next message are published")
            published.clear()
        self._last_callback_ns = now
        states: dict[str, float] = {}
        for name, position in zip(names, positions, strict=True):
            if name in self._joints:
                states.setdefault(name, position)
        stamp = stamp_ns(message.header.stamp)
        oldest = min((published.get(name, 0) for name in states), default=now)
        if not states or (not self._ignore_timestamp and stamp < min(oldest, now) + self._interval_ns):
            return
        published.update(dict.fromkeys(states, stamp))
        for name in self._mimic_order:
            mimic = self._mimics[name]
            if name not in states and mimic.joint in states:
                states[name] = states[mimic.joint] * mimic.multiplier + mimic.offset
        transforms = []
        for name, position in states.items():
            moving = self._moving.get(name)
            if moving is None:
                continue
            if isfinite(position):
                moving.move(position)
                moving.message.header.stamp = message.header.stamp
                transforms.append(moving.message)
            else:
                text = f"joint_states: position {position} of joint {name!r} ignored; expected a finite number"
                warn(text, throttle_s=WARNING_INTERVAL_S)
        if transforms:
            self._broadcaster.send(transforms)

    def _check_parameters(self, parameters: list[Parameter]) -> SetResult:
        reason = ""
        for parameter in parameters:
            value: Any = parameter.value.value
            if parameter.name == "publish_frequency":
                reason = reason or _refused_frequency(value)
            elif parameter.name == "robot_description":
                try:
                    self._parsed = (value, parse_urdf(value))
                except DefinitionError as error:
                    reason = str(error.diagnostics[0])
        if reason:
            self.node.logger.warning(reason)
        return SetResult(not reason, reason)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            value: Any = parameter.value.value
            if parameter.name == "publish_frequency":
                self._interval_ns = _interval_ns(value)
            elif parameter.name == "ignore_timestamp":
                self._ignore_timestamp = value
            elif parameter.name == "frame_prefix":
                self._prefix = value
                self._publish_fixed()
            elif parameter.name == "robot_description":
                text, joints = self._parsed
                self._use_robot(value, joints if text == value else parse_urdf(value))


def _refused_frequency(frequency: float) -> str:
    return "" if 0 <= frequency <= 1000 else f"publish_frequency: got {frequency:g}; expected from 0 to 1000 Hz"


def _interval_ns(frequency: float) -> int:
    """Return the smallest time between two transforms, in whole milliseconds; 0 without limit."""
    return int(min(1000 / frequency, 1e9)) * 1_000_000 if frequency else 0


def main() -> int:
    """Run the node; return the exit code."""
    return serve(NAME, RobotStatePublisher)
