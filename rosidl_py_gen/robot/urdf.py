"""Kinematic tree of a URDF: links and joints with origins, axes, limits and mimic tags.

Meshes, inertia and all else are ignored. The rules are those of urdfdom, docs/internals/protocol.md 11.1; where it
builds half a tree, an error is raised.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.xml_reader import MAX_FILE_BYTES, XmlElement, XmlSource, parse_xml, read_file
from rosidl_py_gen.errors import DefinitionError, display_path
from rosidl_py_gen.tf.quaternion_math import IDENTITY, ORIGIN, normalized, product

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from rosidl_py_gen.tf.quaternion_math import Quaternion, Vector

MAX_BYTES = 8 * MAX_FILE_BYTES
"""Maximum size of a description. Those of humanoids with all their meshes have some 500 kB."""
MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
JOINT_TYPES = ("fixed", *MOVABLE_TYPES, "floating", "planar")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
"""What urdfdom reads as a number: no infinity, NaN, hexadecimal digits or decimal comma."""


@dataclass(frozen=True, slots=True)
class Mimic:
    """Dependence of a joint: its position is that of `joint` times `multiplier` plus `offset`."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint between two links.

    Attributes:
        name: unique name.
        type: one of `JOINT_TYPES`.
        parent: name of the parent link.
        child: name of the child link.
        translation: origin of the joint in the frame of the parent link, in metres.
        rotation: orientation of the joint in that frame.
        axis: unit vector in the frame of the joint.
        limits: lower and upper position, or None.
        soft_limits: those of the safety controller; each may be None.
        mimic: the joint that this one follows, or None.
        element: the element, for errors.
    """

    name: str
    type: str
    parent: str
    child: str
    translation: Vector
    rotation: Quaternion
    axis: Vector
    limits: tuple[float, float] | None
    soft_limits: tuple[float | None, float | None]
    mimic: Mimic | None
    element: XmlElement = field(compare=False, repr=False)

    @property
    def is_movable(self) -> bool:
        """True for a joint with one position."""
        return self.type in MOVABLE_TYPES


def read_description(path: str) -> str:
    """Return the text of a file; raises `DefinitionError`."""
    try:
        return read_file(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        source = XmlSource(display_path(path))
        raise DefinitionError(source.diagnostic(0, 0, f"not UTF-8 at byte {error.start}; save as UTF-8")) from None


def parse_urdf(text: str, path: str = "<robot_description>") -> dict[str, Joint]:
    """Return the joints of a URDF by name, in the order of the text; `path` is for errors.

    Raises:
        DefinitionError: the text is too large, not URDF, or its joints do not form a tree.
    """
    text = text.lstrip("\ufeff")
    if len(text) > MAX_BYTES or not text.lstrip().startswith("<"):
        found = f"more than {MAX_BYTES} characters" if len(text) > MAX_BYTES else f"found {text.strip()[:60]!r}"
        raise DefinitionError(XmlSource(path).diagnostic(0, 0, f"{found}; expected the text of a URDF, not its path"))
    root = parse_xml(text, path)
    if root.tag != "robot" or root.attributes.get("version", "1.0") not in ("1.0", "1"):
        raise root.error(f"found <{root.tag}>; expected a URDF of version 1.0, whose root is <robot>")
    _attribute(root, "name", "robot")
    links: dict[str, XmlElement] = {}
    joints: dict[str, Joint] = {}
    for element in root.elements:
        if element.tag.startswith("xacro:"):
            raise element.error(f"found <{element.tag}>; expected the output of xacro, not its input")
        if element.tag not in ("link", "joint"):
            continue
        name = _attribute(element, "name", element.tag)
        other = links.get(name) if element.tag == "link" else name in joints and joints[name].element
        if other:
            raise element.error(f'second {element.tag} "{name}", the first is in line {other.line}; names must differ')
        if element.tag == "link":
            links[name] = element
        else:
            joints[name] = _joint(name, element)
    _check_tree(root, links, joints)
    return joints


def resolve_mimics(mimics: Mapping[str, Mimic], joints: Collection[str]) -> tuple[list[str], dict[str, str]]:
    """Return the names of `mimics` so that each follows the joint it depends on, and the reasons that exclude others.

    Args:
        mimics: dependences by name of the dependent joint.
        joints: names of all joints.
    """
    order: dict[str, None] = {}
    problems: dict[str, str] = {}
    for name in mimics:
        chain: dict[str, None] = {}
        current = name
        while current in mimics and not (current in order or current in problems or current in chain):
            chain[current] = None
            current = mimics[current].joint
        reason = problems.get(current)
        if current in chain:
            reason = f'joint "{current}" mimics itself, by "{mimics[current].joint}"; one of them must not mimic'
        elif current not in joints:
            hint = did_you_mean(current, joints)
            reason = f'joint "{[*chain][-1]}" mimics joint "{current}", which does not exist{hint}'
        if reason is None:
            order.update(dict.fromkeys(reversed(chain)))
        else:
            problems.update(dict.fromkeys(chain, reason))
    return list(order), problems


def _check_tree(root: XmlElement, links: dict[str, XmlElement], joints: dict[str, Joint]) -> None:
    """Raise `DefinitionError` unless all links hang from one."""
    parents: dict[str, Joint] = {}
    children: dict[str, list[str]] = {}
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                hint = did_you_mean(link, links) or f'; add <link name="{link}"/> or remove the joint'
                raise joint.element.error(f'joint "{joint.name}": link "{link}" does not exist{hint}')
        other = parents.setdefault(joint.child, joint)
        if other is not joint:
            both = f'joint "{other.name}" and of joint "{joint.name}"'
            raise joint.element.error(f'link "{joint.child}" is the child of {both}; expected one parent')
        children.setdefault(joint.parent, []).append(joint.child)
    tops = [link for link in links if link not in parents]
    if len(tops) > 1:
        names = ", ".join(f'"{link}"' for link in tops[:5])
        raise links[tops[1]].error(f"{len(tops)} links without a parent: {names}; a joint must connect all but one")
    waiting, reached = list(tops), set(tops)
    while waiting:
        new = children.get(waiting.pop(), [])
        reached.update(new)
        waiting.extend(new)
    if loop := next((link for link in links if link not in reached), None):
        raise parents[loop].element.error(f'link "{loop}" is in a loop of joints, or below one; expected a tree')
    if not links:
        raise root.error("no links; expected at least one <link> directly below <robot>")


def _joint(name: str, element: XmlElement) -> Joint:
    where = f'joint "{name}"'
    kind = _attribute(element, "type", where)
    if kind not in JOINT_TYPES:
        raise element.error(f"{where}: found type {kind!r}; expected {', '.join(JOINT_TYPES)}")
    translation, rotation = ORIGIN, IDENTITY
    if (origin := _child(element, "origin")) is not None:
        translation = _vector(origin, "xyz", where) or ORIGIN
        rotation = quaternion_from_rpy(*(_vector(origin, "rpy", where) or ORIGIN))
    axis: Vector = (1.0, 0.0, 0.0)
    if kind in MOVABLE_TYPES and (found := _child(element, "axis")) is not None:
        axis = _vector(found, "xyz", where) or ORIGIN
        length = math.hypot(*axis)
        if not 1e-300 < length < math.inf:
            raise found.error(f"{where}: the axis has length {length:g}; expected a direction such as 0 0 1")
        axis = (axis[0] / length, axis[1] / length, axis[2] / length)
    limit = _child(element, "limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise element.error(f"{where}: a {kind} joint must have a <limit>; a continuous joint turns without one")
    limits = None
    if limit is not None:
        limits = (_number(limit, "lower", where, 0.0), _number(limit, "upper", where, 0.0))
        for required in ("effort", "velocity"):
            _number(limit, required, where)
    safety = _child(element, "safety_controller")
    soft: list[float | None] = [
        _number(safety, key, where) if safety is not None and key in safety.attributes else None
        for key in ("soft_lower_limit", "soft_upper_limit")
    ]
    mimic = None
    if (found := _child(element, "mimic")) is not None:
        mimic = Mimic(
            _attribute(found, "joint", where),
            _number(found, "multiplier", where, 1.0),
            _number(found, "offset", where, 0.0),
        )
    parent, child = (_link(element, tag, where) for tag in ("parent", "child"))
    return Joint(name, kind, parent, child, translation, rotation, axis, limits, (soft[0], soft[1]), mimic, element)


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation by `roll` about x, then by `pitch` about y, then by `yaw` about z, all fixed axes."""
    x, y, z = (
        (math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2)),
        (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)),
        (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
    )
    return normalized(product(z, product(y, x)))


def parse_number(text: str) -> float | None:
    """Return a finite number, or None."""
    text = text.strip()
    value = float(text) if len(text) < 1000 and _NUMBER.fullmatch(text) else math.inf
    return value if math.isfinite(value) else None


def _child(element: XmlElement, tag: str) -> XmlElement | None:
    return next((child for child in element.elements if child.tag == tag), None)


def _attribute(element: XmlElement, key: str, where: str) -> str:
    value = element.attributes.get(key)
    if not value:
        raise element.error(f'{where}: <{element.tag}> has no {key}; expected {key}="..."')
    return value


def _link(element: XmlElement, tag: str, where: str) -> str:
    found = _child(element, tag)
    if found is None:
        raise element.error(f'{where}: no <{tag}>; expected <{tag} link="..."/>')
    return _attribute(found, "link", where)


def _number(element: XmlElement, key: str, where: str, default: float | None = None) -> float:
    text = element.attributes.get(key)
    if text is None and default is not None:
        return default
    value = None if text is None else parse_number(text)
    if value is None:
        found = f"has no {key}" if text is None else f"has {key}={text[:60]!r}"
        raise element.error(f"{where}: <{element.tag}> {found}; expected a number such as 1.5")
    return value


def _vector(element: XmlElement, key: str, where: str) -> Vector | None:
    text = element.attributes.get(key)
    if text is None:
        return None
    values = [parse_number(word) for word in text.split(None, 3)]
    if len(values) != 3 or None in values:
        raise element.error(f"{where}: <{element.tag}> has {key}={text[:60]!r}; expected three numbers such as 0 0 1.5")
    x, y, z = (value for value in values if value is not None)
    return (x, y, z)
