"""Node that publishes one transform on ``/tf_static``, from its command line.

Arguments, parameters and rules are those of tf2_ros, docs/internals/protocol.md 13.4.
"""

from __future__ import annotations

import math
import secrets
import string
from collections.abc import Mapping, Sequence
from typing import Any

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.robot.node_program import ProgramError, serve, transform_message
from rosidl_py_gen.robot.urdf import parse_number, quaternion_from_rpy
from rosidl_py_gen.runtime import Context, Node, ParameterDescriptor, RosArgumentError, get_logger
from rosidl_py_gen.tf import StaticTransformBroadcaster

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
"""Names of arguments without options, by their number."""
_MAX_DENORMALIZED = 0.01
"""Largest difference between 1 and the square of a quaternion's length at which tf2 accepts it."""


def parse_transform(arguments: Sequence[str]) -> tuple[dict[str, Any], list[str]] | None:
    """Return the transform of arguments without those of ROS, as parameters, and warnings; None to print the usage.

    Raises:
        ProgramError: the arguments are invalid.
    """
    found: dict[str, str] = {}
    rest: list[str] = []
    words = iter(arguments)
    for word in words:
        if word in ("-h", "--help"):
            return None
        if not (word.startswith("--") and word[2:] in _OPTIONS):
            rest.append(word)
        elif (value := next(words, None)) is not None:
            found[word[2:]] = value
        else:
            raise ProgramError(f"{word} needs a value after it")
    warnings: list[str] = []
    if len(rest) in _OLD_FORMS and not found:
        found = dict(zip(_OLD_FORMS[len(rest)], rest, strict=True))
        warnings.append("arguments without options are deprecated; use --x, ..., --frame-id and --child-frame-id")
    elif rest:
        raise ProgramError(
            f"found {len(rest)} arguments without option, such as {rest[0]!r:.60}; expected options only, "
            "or only x y z yaw pitch roll parent child, or only x y z qx qy qz qw parent child"
        )
    for name in _FRAMES:
        if not found.get(name):
            raise ProgramError(f"no --{name}; expected --{name} and the name of a frame")
    parent, child = (found.pop(name) for name in _FRAMES)
    if parent == child:
        raise ProgramError(f"--frame-id and --child-frame-id are both {parent!r:.100}; expected two frames")
    numbers: dict[str, float] = {}
    for name, text in found.items():
        number = parse_number(text)
        if number is None:
            raise ProgramError(f"--{name}: got {text!r:.60}; expected a number such as 1.5")
        numbers[name] = number
    if any(name in found for name in _ANGLES):
        if any(name in found for name in _QUATERNION):
            raise ProgramError(f"found {', '.join(f'--{name}' for name in found)}; expected angles or a quaternion")
        rotation = quaternion_from_rpy(*(numbers.get(name, 0.0) for name in _ANGLES))
    else:
        x, y, z, w = (numbers.get(name, default) for name, default in _QUATERNION.items())
        rotation = (x, y, z, w)
    length = math.hypot(*rotation)
    if abs(length * length - 1) > _MAX_DENORMALIZED:
        warnings.append(f"the quaternion has length {length:.3g}; expected 1; tf2 ignores such transforms")
    parameters: dict[str, Any] = {f"translation.{key}": numbers.get(key, 0.0) for key in "xyz"}
    parameters |= {f"rotation.{key}": value for key, value in zip("xyzw", rotation, strict=True)}
    return parameters | {"frame_id": parent, "child_frame_id": child}, warnings


class StaticTransformPublisher:
    """Node ``static_transform_publisher_`` and 16 random characters; its read-only parameters are the transform."""

    def __init__(self, parameters: Mapping[str, Any], *, context: Context | None = None) -> None:
        suffix = "".join(secrets.choice(string.ascii_letters + string.digits) for _ in range(16))
        self.node = Node(f"{NAME}_{suffix}", context=context, parameter_overrides=parameters)
        for name, value in parameters.items():
            self.node.declare_parameter(name, value, ParameterDescriptor(read_only=True))
        *values, parent, child = parameters.values()
        message = transform_message(parent, child, values[:3], values[3:])
        set_stamp(message.header.stamp, self.node.clock.now().nanoseconds)
        StaticTransformBroadcaster(self.node).send(message)
        text = ", ".join(f"{name} {value}" for name, value in parameters.items())
        self.node.logger.info(f"publishing a transform until Ctrl-C: {text}")


def main() -> int:
    """Run the node; return the exit code."""
    parsed, code = None, 0
    try:
        parsed = parse_transform(Context.default().arguments[1:])
    except (ProgramError, RosArgumentError) as error:
        get_logger(NAME).error(str(error))
        code = 1
    if parsed is None:
        print(USAGE, end="")
        Context.close_default()
        return code
    parameters, warnings = parsed
    for warning in warnings:
        get_logger(NAME).warning(warning)
    return serve(NAME, lambda: StaticTransformPublisher(parameters))
