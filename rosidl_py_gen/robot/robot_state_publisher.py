"""Node that publishes the transforms of a robot: fixed joints on ``/tf_static``, the others on ``/tf``.

Topics, parameters and rules are the same as in robot_state_publisher, docs/internals/protocol.md 13.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.robot.node_program import LATCHED, WARNING_INTERVAL_S, ProgramError, serve
from rosidl_py_gen.robot.urdf import MOVABLE_TYPES, Joint, parse_urdf, read_description, resolve_mimics
from rosidl_py_gen.runtime import Context, Node, Parameter, Range, qos
from rosidl_py_gen.tf import StaticTransformBroadcaster, Transform, TransformBroadcaster

NAME = "robot_state_publisher"


@dataclass
class RobotParameters:
    robot_description: str = ""
    publish_frequency: Annotated[float, Range(0.0, 1000.0)] = 20.0
    frame_prefix: str = ""
    ignore_timestamp: bool = False


class RobotStatePublisher:
    """ROS node `robot_state_publisher`; the first argument of its context may be the path of a URDF file.

    Raises:
        ParameterError: a parameter has an invalid value.
        ProgramError: there is no robot description.
        DefinitionError: the file of the URDF cannot be read.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        self.node = node = Node(NAME, context=context)
        self._parsed: dict[str, dict[str, Joint]] = {}
        self._parameters = node.declare_parameters(RobotParameters, validator=self._refusal)
        if not self._parameters.robot_description:
            arguments = node.context.arguments[1:]
            if not arguments:
                expected = "the text of a URDF, such as Command(['xacro ', path]) in a launch file"
                raise ProgramError(f"parameter robot_description: not set; expected {expected}")
            node.logger.warning("robot_description is not set; the file of a URDF as argument is deprecated")
            self._parameters.robot_description = read_description(arguments[0])
        self._broadcaster = TransformBroadcaster(node)
        self._static_broadcaster = StaticTransformBroadcaster(node)
        self._string: Any = get_message("std_msgs/msg/String")
        self._descriptions = node.create_publisher(self._string, "robot_description", LATCHED)
        self._last_callback_ns = 0
        self._use_robot()
        joint_state = get_message("sensor_msgs/msg/JointState")
        node.create_subscription(joint_state, "joint_states", self._on_joint_state, qos.SENSOR_DATA)
        node.add_post_set_callback(self._apply_parameters)

    def _refusal(self, new: RobotParameters) -> str | None:
        """Return why new parameter values are refused, or None if they are accepted.

        The joints of an accepted robot description are stored.
        """
        text = new.robot_description
        try:
            if text not in self._parsed and (text or self._parsed):  # at the start, a file may replace no text
                self._parsed = {text: parse_urdf(text)}
        except DefinitionError as error:
            return str(error.diagnostics[0])
        return None

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        names = [parameter.name for parameter in parameters]
        if "robot_description" in names:
            self._use_robot()
        elif "frame_prefix" in names:
            self._publish_fixed()

    def _use_robot(self) -> None:
        """Publish the current robot description and the transforms of its fixed joints."""
        text = self._parameters.robot_description
        self._joints = self._parsed[text]
        self._published_ns: dict[str, int] = {}
        mimics = {name: joint.mimic for name, joint in self._joints.items() if joint.mimic is not None}
        self._mimics, problems = resolve_mimics(mimics, self._joints)
        for problem in problems:
            self.node.logger.warning(f"{problem}; without a position of its own it is not published")
        self._publish_fixed()
        self._descriptions.publish(self._string(data=text))
        self.node.logger.info("Robot initialized")

    def _publish_fixed(self) -> None:
        """Publish the transforms of fixed and planar joints, and prepare a message with the frames of each movable
        joint.

        The transforms of floating joints are left to other nodes.
        """
        now, prefix = self.node.clock.now().nanoseconds, self._parameters.frame_prefix
        self._messages: dict[str, Any] = {}  # reused for each position
        for name, joint in self._joints.items():
            origin = map(np.array, joint.origin)
            self._messages[name] = Transform(prefix + joint.parent, prefix + joint.child, now, *origin).to_message()
        fixed = [name for name, joint in self._joints.items() if joint.type in ("fixed", "planar")]
        self._static_broadcaster.send([self._messages[name] for name in fixed])

    def _on_joint_state(self, message: Any) -> None:
        names, positions, warn = message.name, message.position.tolist(), self.node.logger.warning
        if len(names) != len(positions):
            found = (
                f"{pluralize(len(names), 'name')}{f', such as {names[0]!r:.60},' * bool(names)} and "
                f"{pluralize(len(positions), 'position')}"
            )
            warn(f"joint_states: message ignored, which has {found}; expected as many", throttle_s=WARNING_INTERVAL_S)
            return
        now, published = self.node.clock.now().nanoseconds, self._published_ns
        if now < self._last_callback_ns:
            text = "time has jumped back; all joints of the next message are published"
            warn(text, throttle_s=WARNING_INTERVAL_S)
            published.clear()
        self._last_callback_ns = now
        states: dict[str, float] = {}
        for name, position in zip(names, positions, strict=True):
            if name in self._joints:
                states.setdefault(name, position)
        stamp, frequency = stamp_ns(message.header.stamp), self._parameters.publish_frequency
        interval_ms = int(min(1000 / frequency, 1e9)) if frequency else 0
        oldest = min([now, *(published.get(name, 0) for name in states)])
        if stamp < oldest + interval_ms * 1_000_000 and not self._parameters.ignore_timestamp:
            return
        published.update(dict.fromkeys(states, stamp))
        for name, mimic in self._mimics.items():
            if name not in states and mimic.joint in states:
                states[name] = states[mimic.joint] * mimic.multiplier + mimic.offset
        transforms = []
        for name, position in states.items():
            joint = self._joints[name]
            if joint.type in MOVABLE_TYPES and any(joint.axis) and isfinite(position):
                transform = self._messages[name]
                transform.header.stamp = message.header.stamp
                move, turn = transform.transform.translation, transform.transform.rotation
                (move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w) = joint.pose(position)
                transforms.append(transform)
            elif not isfinite(position):
                text = f"joint_states: position {position} of joint {name!r} ignored; expected a finite number"
                warn(text, throttle_s=WARNING_INTERVAL_S)
        if transforms:
            self._broadcaster.send(transforms)


def main() -> int:
    """Run the node robot_state_publisher until SIGINT or SIGTERM; return the exit code."""
    return serve(NAME, RobotStatePublisher)
