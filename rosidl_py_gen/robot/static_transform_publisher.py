"""Node that publishes one transform on ``/tf_static``, from its command line.

Arguments, parameters and rules are those of tf2_ros, docs/internals/protocol.md 11.4.
"""

from __future__ import annotations

import math
import secrets
import string
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.robot.node_program import ProgramError, serve, transform_message
from rosidl_py_gen.robot.urdf import quaternion_from_rpy
from rosidl_py_gen.runtime import Context, Node, ParameterDescriptor, get_logger
from rosidl_py_gen.tf import StaticTransformBroadcaster
from rosidl_py_gen.tf.quaternion_math import IDENTITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.tf.quaternion_math import Quaternion, Vector

NAME = "static_transform_publisher"
USAGE = """usage: static_transform_publisher [--x X] [--y Y] [--z Z]
           [--roll ROLL] [--pitch PITCH] [--yaw YAW] | [--qx QX] [--qy QY] [--qz QZ] [--qw QW]
           --frame-id PARENT --child-frame-id CHILD

Publish the position and orientation of the frame CHILD in the frame PARENT until Ctrl-C.

  --x, --y, --z            translation in metres [default: 0]
  --roll, --pitch, --yaw   rotation about x, y and z in radians [default: 0]
  --qx, --qy, --qz, --qw   rotation as a quaternion of length 1 [default: 0 0 0 1]

Deprecated: X Y Z YAW PITCH ROLL PARENT CHILD, and X Y Z QX QY QZ QW PARENT CHILD.
"""
_TRANSLATION = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
_QUATERNION = ("qx", "qy", "qz", "qw")
_FRAMES = ("frame-id", "child-frame-id")
_OLD_FORMS = {
    8: (*_TRANSLATION, "yaw", "pitch", "roll", *_FRAMES),
    9: (*_TRANSLATION, *_QUATERNION, *_FRAMES),
}
"""Names of positional arguments, by their number."""
_MAX_DENORMALIZED = 0.01
"""Largest difference between 1 and the square of a quaternion's length at which tf2 accepts it."""


@dataclass(frozen=True, slots=True)
class StaticTransform:
    """Transform of a command line; `warnings` are about the arguments."""

    translation: Vector
    rotation: Quaternion
    parent: str
    child: str
    warnings: tuple[str, ...] = ()


def parse_transform(arguments: Sequence[str]) -> StaticTransform | None:
    """Return the transform of arguments without those of ROS; None if they request help.

    Raises:
        ProgramError: the arguments are invalid.
    """
    names = (*_TRANSLATION, *_ANGLES, *_QUATERNION, *_FRAMES)
    found: dict[str, str] = {}
    positional: list[str] = []
    words = iter(arguments)
    for word in words:
        if word in ("-h", "--help"):
            return None
        if word.startswith("--") and word[2:] in names:
            value = next(words, None)
            if value is None:
                raise ProgramError(f"{word} needs a value after it")
            found[word[2:]] = value
        else:
            positional.append(word)
    warnings: list[str] = []
    if len(positional) in _OLD_FORMS:
        if found:
            options = ", ".join(f"--{name}" for name in found)
            raise ProgramError(f"found {len(positional)} arguments without option and {options}; expected options only")
        found = dict(zip(_OLD_FORMS[len(positional)], positional, strict=True))
        warnings.append("arguments without options are deprecated; use --x, ..., --frame-id and --child-frame-id")
    elif positional:
        raise ProgramError(
            f"found {len(positional)} arguments without option, such as {positional[0]!r:.60}; expected none, "
            "8 (x y z yaw pitch roll parent child) or 9 (x y z qx qy qz qw parent child)"
        )
    angles, quaternion = ([name for name in group if name in found] for group in (_ANGLES, _QUATERNION))
    if angles and quaternion:
        raise ProgramError(f"found --{angles[0]} and --{quaternion[0]}; expected angles or a quaternion")
    parent, child = (_frame(found, name) for name in _FRAMES)
    if parent == child:
        raise ProgramError(f"--frame-id and --child-frame-id are both {parent!r:.100}; expected two frames")
    values = {name: _number(name, text) for name, text in found.items() if name not in _FRAMES}
    x, y, z = (values.get(name, 0.0) for name in _TRANSLATION)
    rotation = IDENTITY
    if angles:
        rotation = quaternion_from_rpy(*(values.get(name, 0.0) for name in _ANGLES))
    elif quaternion:
        qx, qy, qz = (values.get(name, 0.0) for name in _QUATERNION[:3])
        rotation = (qx, qy, qz, values.get("qw", 1.0))
        length = math.hypot(*rotation)
        if abs(length * length - 1) > _MAX_DENORMALIZED:
            warnings.append(f"the quaternion has length {length:.3g}; expected 1; tf2 ignores such transforms")
    return StaticTransform((x, y, z), rotation, parent, child, tuple(warnings))


def _frame(found: dict[str, str], name: str) -> str:
    if not found.get(name):
        raise ProgramError(f"no --{name}; expected --{name} and the name of a frame")
    return found[name]


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ProgramError(f"--{name}: got {text!r:.60}; expected a number such as 1.5")
    return value


class StaticTransformPublisher:
    """Node ``static_transform_publisher_`` and 16 random characters; its read-only parameters are the transform."""

    def __init__(self, transform: StaticTransform, *, context: Context | None = None) -> None:
        suffix = "".join(secrets.choice(string.ascii_letters + string.digits) for _ in range(16))
        values: dict[str, float | str] = {
            **{f"translation.{key}": value for key, value in zip("xyz", transform.translation, strict=True)},
            **{f"rotation.{key}": value for key, value in zip("xyzw", transform.rotation, strict=True)},
            "frame_id": transform.parent,
            "child_frame_id": transform.child,
        }
        self.node = Node(f"{NAME}_{suffix}", context=context, parameter_overrides=values)
        for name, value in values.items():
            self.node.declare_parameter(name, value, ParameterDescriptor(read_only=True))
        for warning in transform.warnings:
            self.node.logger.warning(warning)
        message = transform_message(transform.parent, transform.child, transform.translation, transform.rotation)
        set_stamp(message.header.stamp, self.node.clock.now().nanoseconds)
        StaticTransformBroadcaster(self.node).send(message)
        self.node.logger.info(
            f"publishing the transform of {transform.child!r} in {transform.parent!r} until Ctrl-C: "
            f"translation {transform.translation}, rotation {transform.rotation}"
        )


def main() -> int:
    """Run the node; return the exit code."""
    from rosidl_py_gen.runtime import RosArgumentError

    try:
        context = Context.default()
    except RosArgumentError as error:
        raise SystemExit(f"error: {error}") from None
    try:
        transform = parse_transform(context.arguments[1:])
    except ProgramError as error:
        get_logger(NAME).error(str(error))
        transform = None
        code = 1
    else:
        code = 0
    if transform is None:
        print(USAGE, end="")
        context.close()
        return code
    return serve(NAME, lambda: StaticTransformPublisher(transform))
