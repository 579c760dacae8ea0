"""Forward kinematics computed from the text of a URDF, with matrices, and random robots: an oracle that shares no code
with the package.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
from hypothesis import strategies as st

Array = np.ndarray[Any, np.dtype[np.float64]]


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _turned(axis: Array, angle: float) -> Array:
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)


def _placed(rotation: Array, translation: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def link_poses(urdf: str, positions: dict[str, float]) -> dict[str, Array]:
    """Matrices of all links in the frame of the root, except those below a floating joint or a joint without position.

    A mimic joint that has no position follows its joint, also over several others.
    """
    robot = ElementTree.fromstring(urdf)
    joints = {joint.attrib["name"]: joint for joint in robot.findall("joint")}
    below: dict[str, list[ElementTree.Element]] = {}
    for joint in joints.values():
        below.setdefault(joint.find("parent").attrib["link"], []).append(joint)  # type: ignore[union-attr]
    children = {joint.find("child").attrib["link"] for joint in joints.values()}  # type: ignore[union-attr]
    (root,) = {link.attrib["name"] for link in robot.findall("link")} - children

    def position(name: str) -> float | None:
        mimic = joints[name].find("mimic")
        if name in positions or mimic is None:
            return positions.get(name)
        value = position(mimic.attrib["joint"])
        if value is None:
            return None
        return value * float(mimic.get("multiplier", "1")) + float(mimic.get("offset", "0"))

    poses = {root: np.eye(4)}
    waiting = [root]
    while waiting:
        link = waiting.pop()
        for joint in below.get(link, []):
            origin, axis, kind = joint.find("origin"), joint.find("axis"), joint.attrib["type"]
            xyz, rpy = (_numbers("0 0 0" if origin is None else origin.get(key, "0 0 0")) for key in ("xyz", "rpy"))
            roll, pitch, yaw = (_turned(np.eye(3)[k], rpy[k]) for k in range(3))
            pose = _placed(yaw @ pitch @ roll, xyz)
            if kind == "floating":
                continue
            if kind in ("revolute", "continuous", "prismatic"):
                value = position(joint.attrib["name"])
                if value is None:
                    continue
                direction = np.array([1.0, 0, 0]) if axis is None else _numbers(axis.attrib["xyz"])
                if kind == "prismatic":
                    pose = pose @ _placed(np.eye(3), direction / np.linalg.norm(direction) * value)
                else:
                    pose = pose @ _placed(_turned(direction, value), np.zeros(3))
            child = joint.find("child").attrib["link"]  # type: ignore[union-attr]
            poses[child] = poses[link] @ pose
            waiting.append(child)
    return poses


_FLOATS = st.floats(-10, 10).map(lambda value: round(value, 6))
_VECTORS = st.tuples(_FLOATS, _FLOATS, _FLOATS).map(lambda values: " ".join(map(str, values)))
_AXES = (
    st.tuples(_FLOATS, _FLOATS, _FLOATS).filter(lambda v: math.hypot(*v) > 1e-3).map(lambda v: " ".join(map(str, v)))
)


@st.composite
def robots(draw: Any) -> tuple[str, dict[str, float]]:
    """Draw the URDF of a random tree, and positions of its movable joints that do not mimic another joint."""
    count = draw(st.integers(0, 12))
    elements = [f'<link name="link{number}"/>' for number in range(count + 1)]
    movable: list[str] = []
    positions: dict[str, float] = {}
    for number in range(1, count + 1):
        kind = draw(st.sampled_from(["fixed", "revolute", "continuous", "prismatic", "planar", "floating"]))
        name = f"{draw(st.sampled_from('abc'))}{number}"  # mimic joints before and after theirs in alphabetical order
        parts = [f'<parent link="link{draw(st.integers(0, number - 1))}"/><child link="link{number}"/>']
        if draw(st.booleans()):
            parts.append(f'<origin xyz="{draw(_VECTORS)}" rpy="{draw(_VECTORS)}"/>')
        if draw(st.booleans()):
            parts.append(f'<axis xyz="{draw(_AXES)}"/>')
        if kind in ("revolute", "prismatic"):
            parts.append('<limit lower="-1" upper="1" effort="1" velocity="1"/>')
        if kind in ("revolute", "continuous", "prismatic"):
            if movable and draw(st.booleans()):
                values = f'multiplier="{draw(_FLOATS)}" offset="{draw(_FLOATS)}"' if draw(st.booleans()) else ""
                parts.append(f'<mimic joint="{draw(st.sampled_from(movable))}" {values}/>')
            else:
                positions[name] = draw(_FLOATS)
            movable.append(name)
        elements.append(f'<joint name="{name}" type="{kind}">{"".join(draw(st.permutations(parts)))}</joint>')
    text = "\n".join(draw(st.permutations(elements)))
    return f'<?xml version="1.0"?>\n<robot name="random">\n{text}\n</robot>', positions
