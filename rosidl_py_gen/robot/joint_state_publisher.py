"""Node that publishes a position for every movable joint of a robot on ``joint_states``.

Topics, parameters and rules are the same as in joint_state_publisher, docs/internals/protocol.md 13.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.base.terminal_text import is_logged, pluralize
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.robot.node_program import LATCHED, WARNING_INTERVAL_S, ProgramError, serve
from rosidl_py_gen.robot.urdf import MOVABLE_TYPES, Joint, Mimic, parse_urdf, read_description, resolve_mimics
from rosidl_py_gen.runtime import Context, Node

NAME = "joint_state_publisher"
_KINDS = {"position": "positions", "velocity": "velocities", "effort": "efforts"}
_MAX_RATE_HZ = 10_000


@dataclass(slots=True)
class _FreeJoint:
    """Joint that mimics no other joint, so its position is set independently.

    Attributes:
        values: the values of position, velocity and effort that are known.
    """

    lower: float
    upper: float
    is_continuous: bool
    values: dict[str, float]
    direction: int = 1

    def move(self, delta: float) -> None:
        """Change the position of the joint by `delta`: it moves back and forth between its limits, and a continuous
        joint goes around.
        """
        position = self.values["position"] + self.direction * delta
        if position > self.upper and self.is_continuous:
            position = self.lower
        elif not self.lower <= position <= self.upper:
            self.direction = 1 if position < self.lower else -1
            position = self.lower if position < self.lower else self.upper
        self.values["position"] = position


class JointStatePublisher:
    """ROS node `joint_state_publisher`; the first argument of its context may be the path of a URDF file.

    Raises:
        ParameterError: a parameter has another type.
        ProgramError: a parameter has an invalid value.
        DefinitionError: the robot description is invalid.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        self.node = node = Node(NAME, context=context, automatically_declare_parameters_from_overrides=True)
        fields = {kind: f"publish_default_{plural}" for kind, plural in _KINDS.items()}
        self._kinds = [kind for kind, name in fields.items() if self._parameter(name, bool, kind == "position")]
        self._use_mimic = self._parameter("use_mimic_tags", bool, True)
        self._use_soft_limits = self._parameter("use_smallest_joint_limits", bool, True)
        self._delta = self._parameter("delta", float, 0.0)
        rate = self._parameter("rate", float, 10)
        if not 0 < rate <= _MAX_RATE_HZ:
            raise ProgramError(f"parameter rate: got {rate:g}; expected more than 0 and at most {_MAX_RATE_HZ} Hz")
        sources = self._parameter("source_list", list[str], [""])
        self._zeros = {
            one: self._parameter(f"zeros.{one}", float, 0.0) for one in node.get_parameters_by_prefix("zeros")
        }
        self._dependent: dict[str, Mimic] = {}
        for name in node.get_parameters_by_prefix("dependent_joints"):
            joint, _, key = name.rpartition(".")
            group = f"dependent_joints.{joint}"
            if key not in ("parent", "factor", "offset") or not node.has_parameter(f"{group}.parent"):
                expected = "dependent_joints.<joint>.parent, and if needed .factor and .offset"
                raise ProgramError(f"parameter dependent_joints.{name}: expected {expected}")
            parent, factor = self._parameter(f"{group}.parent", str, ""), self._parameter(f"{group}.factor", float, 1.0)
            self._dependent[joint] = Mimic(parent, factor, self._parameter(f"{group}.offset", float, 0.0))
        self._refused_descriptions = 0
        self._joints: list[str] = []
        self._free: dict[str, _FreeJoint] = {}
        self._mimics: dict[str, Mimic] = {}
        self._message: Any = get_message("sensor_msgs/msg/JointState")
        description, arguments = self._parameter("robot_description", str, ""), node.context.arguments[1:]
        if arguments:
            self._use_description(read_description(arguments[0]), arguments[0])
        elif description:
            self._use_description(description)
        else:
            node.logger.info(f"waiting for a robot description on {node.resolve_topic_name('robot_description')}")
        node.create_subscription(get_message("std_msgs/msg/String"), "robot_description", self._on_description, LATCHED)
        for topic in filter(None, sources):
            node.create_subscription(self._message, topic, self._on_source, 10)
        self._publisher = node.create_publisher(self._message, "joint_states", 10)
        node.create_timer(1 / rate, self._publish)

    def _parameter(self, name: str, kind: type, default: Any) -> Any:
        """Return the value of a parameter, which is declared if necessary.

        Raises:
            ParameterError: the value has another type.
            ProgramError: the value is infinite or NaN.
        """
        if not self.node.has_parameter(name):
            self.node.declare_parameter(name, default)
        value: Any = self.node.get_parameter(name)
        if type(value) is float and not math.isfinite(value):
            raise ProgramError(f"parameter {name}: got {value}; expected a finite number")
        # A whole number has another type than a float, and an empty list another type than a list of texts.
        if (kind is float and type(value) is int) or (kind == list[str] and value == b""):
            return value
        return self.node.get_parameter(name, kind, default)

    def _on_description(self, message: Any) -> None:
        try:
            self._use_description(message.data)
        except (DefinitionError, ProgramError) as error:
            self._refused_descriptions += 1
            if is_logged(self._refused_descriptions):
                self.node.logger.error(f"robot description ignored: {error}")

    def _use_description(self, text: str, path: str = "<robot_description>") -> None:
        """Replace the published joints by the movable joints of a URDF.

        Raises `DefinitionError` for an invalid URDF, or `ProgramError` for invalid mimic relations, and changes nothing
        then.
        """
        movable = {name: joint for name, joint in parse_urdf(text, path).items() if joint.type in MOVABLE_TYPES}
        mimics = {name: mimic for name, mimic in self._dependent.items() if name in movable}
        if self._use_mimic:
            mimics |= {name: joint.mimic for name, joint in movable.items() if joint.mimic is not None}
        mimics, problems = resolve_mimics(mimics, movable)
        if problems:
            raise ProgramError("; ".join(problems))
        free = {name: self._free_joint(joint) for name, joint in movable.items() if name not in mimics}
        self._joints, self._free, self._mimics = list(movable), free, mimics

    def _free_joint(self, joint: Joint) -> _FreeJoint:
        lower, upper = (-math.pi, math.pi) if joint.limits is None or joint.type == "continuous" else joint.limits
        if self._use_soft_limits:
            lower, upper = max(lower, joint.soft_limits[0]), min(upper, joint.soft_limits[1])
        values = dict.fromkeys(self._kinds, 0.0)
        if "position" in values:
            values["position"] = self._zeros.get(joint.name, 0.0 if lower <= 0 <= upper else (lower + upper) / 2)
        return _FreeJoint(lower, upper, joint.type == "continuous", values)

    def _on_source(self, message: Any) -> None:
        names = message.name
        for kind in _KINDS:
            values = getattr(message, kind).tolist()
            if values and len(values) != len(names):
                counts = f"{pluralize(len(values), 'value')} for {pluralize(len(names), 'name')}"
                text = f"message of a source: {kind} ignored, which has {counts}"
                self.node.logger.warning(text, throttle_s=WARNING_INTERVAL_S)
                continue
            for name, value in zip(names, values, strict=False):
                if name in self._free:
                    self._free[name].values[kind] = value

    def _publish(self) -> None:
        if not self._joints:
            return
        states: dict[str, dict[str, float]] = {}
        for name, joint in self._free.items():
            if self._delta > 0 and "position" in joint.values:
                joint.move(self._delta)
            states[name] = joint.values
        for name, mimic in self._mimics.items():
            state = dict(states[mimic.joint])
            if "position" in state:
                state["position"] = state["position"] * mimic.multiplier + mimic.offset
            if "velocity" in state:
                state["velocity"] *= mimic.multiplier
            states[name] = state
        message = self._message(name=self._joints)
        set_stamp(message.header.stamp, self.node.clock.now().nanoseconds)
        for kind in _KINDS:
            if any(kind in state for state in states.values()):
                setattr(message, kind, [states[name].get(kind, 0.0) for name in self._joints])
        self._publisher.publish(message)


def main() -> int:
    """Run the node joint_state_publisher until SIGINT or SIGTERM; return the exit code."""
    return serve(NAME, JointStatePublisher)


def main_without_window() -> int:
    """Run the node for the executable joint_state_publisher_gui like `main`; the node logs that it has no window."""
    return serve(NAME, create_without_window)


def create_without_window(*, context: Context | None = None) -> JointStatePublisher:
    """Return a `JointStatePublisher` node, which logs that this package has no window for the executable
    joint_state_publisher_gui.
    """
    publisher = JointStatePublisher(context=context)
    publisher.node.logger.info(
        "joint_state_publisher_gui: rosidl-py-gen has no window with sliders; running joint_state_publisher instead, "
        "which takes positions from the parameter zeros and the topics of source_list"
    )
    return publisher
