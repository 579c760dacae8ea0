"""Node that publishes one transform on ``/tf_static``, from its command line.

Arguments, parameters and rules are the same as in tf2_ros, docs/internals/protocol.md 13.4.
"""

from __future__ import annotations

import math
import secrets
import sys
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

from rosidl_py_gen.robot.node_program import ProgramError, serve
from rosidl_py_gen.robot.urdf import parse_number
from rosidl_py_gen.runtime import Context, Node, ParameterDescriptor, get_logger
from rosidl_py_gen.tf import Pose, StaticTransformBroadcaster, Transform

NAME = "static_transform_publisher"
USAGE = """usage: static_transform_publisher --frame-id PARENT --child-frame-id CHILD [OPTIONS]

Publish the position and orientation of the frame CHILD in the frame PARENT until Ctrl-C.

  --x, --y, --z            translation in metres [default: 0]
  --roll, --pitch, --yaw   rotation about x, y and z in radians [default: 0]
  --qx, --qy, --qz, --qw   rotation as a quaternion of length 1 [default: 0 0 0 1]

Deprecated: X Y Z YAW PITCH ROLL PARENT CHILD, and X Y Z QX QY QZ QW PARENT CHILD.
"""
_FRAMES = ("frame-id", "child-frame-id")
_ANGLES = ("roll", "pitch", "yaw")
_QUATERNION = {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
_OPTIONS = ("x", "y", "z", *_ANGLES, *_QUATERNION, *_FRAMES)
_OLD_FORMS = {8: ("x", "y", "z", *reversed(_ANGLES), *_FRAMES), 9: ("x", "y", "z", *_QUATERNION, *_FRAMES)}
"""Names of the values in a command line of static_transform_publisher without options, by the number of values."""


def parse_transform(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the transform of a command line (without ROS arguments) as node parameters.

    Raises:
        ProgramError: an argument is missing, unknown or has an invalid value.
    """
    found: dict[str, str] = {}
    warn = get_logger(NAME).warning
    if len(arguments) in _OLD_FORMS and not any(word.startswith("--") for word in arguments):
        found = dict(zip(_OLD_FORMS[len(arguments)], arguments, strict=True))
        warn("arguments without options are deprecated; use --x, ..., --frame-id and --child-frame-id")
    else:
        for option, value in zip_longest(arguments[::2], arguments[1::2]):
            if option[:2] != "--" or option[2:] not in _OPTIONS:
                raise ProgramError(
                    f"found {option!r:.60} of {len(arguments)} arguments; expected options as in --help, "
                    "or only x y z yaw pitch roll parent child, or only x y z qx qy qz qw parent child"
                )
            if value is None:
                raise ProgramError(f"{option} needs a value after it")
            found[option[2:]] = value
    for name in _FRAMES:
        if not found.get(name):
            raise ProgramError(f"no --{name}; expected --{name} and the name of a frame")
    parent, child = (found.pop(name) for name in _FRAMES)
    if parent == child:
        raise ProgramError(f"--frame-id and --child-frame-id are both {parent!r:.100}; expected two frames")
    numbers = {name: parse_number(text) for name, text in found.items()}
    for name, number in numbers.items():
        if math.isnan(number):
            raise ProgramError(f"--{name}: got {found[name]!r:.60}; expected a number such as 1.5")
    rotation = [numbers.get(name, default) for name, default in _QUATERNION.items()]
    if not numbers.keys().isdisjoint(_ANGLES):
        if not numbers.keys().isdisjoint(_QUATERNION):
            raise ProgramError(f"found {', '.join(f'--{name}' for name in found)}; expected angles or a quaternion")
        rotation = [*Pose.from_rpy(*(numbers.get(name, 0.0) for name in _ANGLES)).rotation]
    length = math.hypot(*rotation)
    if abs(length * length - 1) > 0.01:
        warn(f"the quaternion has length {length:.3g}; expected 1; tf2 ignores such transforms")
    parameters: dict[str, Any] = {f"translation.{key}": numbers.get(key, 0.0) for key in "xyz"}
    parameters |= {f"rotation.{key}": value for key, value in zip("xyzw", rotation, strict=True)}
    return parameters | {"frame_id": parent, "child_frame_id": child}


class StaticTransformPublisher:
    """ROS node that publishes the transform given in the arguments of its context, and has it as read-only parameters.

    Raises:
        ProgramError: an argument is missing, unknown or has an invalid value.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        context = context or Context.default()
        parameters = parse_transform(context.arguments[1:])
        self.node = Node(f"{NAME}_{secrets.token_hex(8)}", context=context, parameter_overrides=parameters)
        for name, value in parameters.items():
            self.node.declare_parameter(name, value, ParameterDescriptor(read_only=True))
        *values, parent, child = parameters.values()
        now = self.node.clock.now().nanoseconds
        transform = Transform(parent, child, now, np.array(values[:3]), np.array(values[3:]))
        StaticTransformBroadcaster(self.node).send(transform)
        text = ", ".join(f"{name} {value}" for name, value in parameters.items())
        self.node.logger.info(f"publishing a transform until Ctrl-C: {text}")


def main() -> int:
    """Run the node static_transform_publisher until SIGINT or SIGTERM, or print its usage; return the exit code."""
    if not {"-h", "--help"}.isdisjoint(sys.argv[1:]):
        print(USAGE, end="")
        return 0
    return serve(NAME, StaticTransformPublisher)
