"""Kinematic tree of a URDF: links and joints with origins, axes, limits and mimic tags. All else is ignored.

The rules are the same as in urdfdom (docs/internals/protocol.md 13.1); an error is raised where urdfdom would return an
incomplete tree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.errors import DefinitionError, Diagnostic, display_path
from rosidl_py_gen.runtime import get_logger
from rosidl_py_gen.tf import Pose

MAX_BYTES = 8 << 20  # URDFs of humanoids with all their meshes have about 500 kB
MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
"""Types of URDF joints that have one position."""
JOINT_TYPES = ("fixed", *MOVABLE_TYPES, "floating", "planar")
_MAX_LOGGED = 10
"""Maximum number of warnings about one robot description that are logged."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
"""Pattern of the numbers that urdfdom reads, which excludes infinity, NaN, hexadecimal digits and the decimal comma."""


@dataclass(frozen=True, slots=True)
class Mimic:
    """Dependence of a joint on another joint: the position of the joint `joint`, times `multiplier`, plus `offset`."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint between two links of a URDF.

    Attributes:
        type: one of `JOINT_TYPES`.
        origin: pose of the joint in the frame of the link `parent`, in metres.
        axis: unit vector in the frame of the joint, or zero.
        soft_limits: lower and upper position of the safety controller, infinite by default.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Pose
    axis: tuple[float, float, float]
    limits: tuple[float, float] | None
    soft_limits: tuple[float, float]
    mimic: Mimic | None
    element: XmlElement = field(compare=False, repr=False)

    def pose(self, position: float) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
        """Return translation and rotation of the link `child` in `parent` at a position in radians or metres."""
        if self.type == "prismatic":
            x, y, z = self.axis
            return self.origin.moved((x * position, y * position, z * position))
        return self.origin.turned(self.axis, position)


def read_description(path: str) -> str:
    """Return the text of a URDF file; raises `DefinitionError` if it cannot be read, is too large or not UTF-8."""
    try:
        return XmlElement.read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text = f"not UTF-8 at byte {error.start}; save as UTF-8"
        raise DefinitionError(Diagnostic(display_path(path), 0, 0, text)) from None


def parse_urdf(text: str, path: str = "<robot_description>") -> dict[str, Joint]:
    """Return the joints of a URDF by name, in the order of the URDF; `path` is for errors.

    Raises:
        DefinitionError: the text is not a URDF, or its links do not form a tree.
    """
    text = text.lstrip("\ufeff")
    if len(text) > MAX_BYTES or not text.lstrip().startswith("<"):
        found = f"more than {MAX_BYTES} characters" if len(text) > MAX_BYTES else f"found {text.strip()[:60]!r}"
        raise DefinitionError(Diagnostic(path, 0, 0, f"{found}; expected the text of a URDF, not its path"))
    document = XmlElement.parse_fragment(text, path)
    roots = [element for element in document.elements if element.tag == "robot"] or [*document.elements, document]
    root = roots[0]  # as urdfdom does; scripts that fill in names put others before it
    if root.tag != "robot" or root.attributes.get("version", "1.0") not in ("1.0", "1"):
        raise root.error(f"found <{root.tag}>; expected a URDF of version 1.0, whose root is <robot>")
    _attribute(root, "name", "robot")
    links: dict[str, XmlElement] = {}
    joints: dict[str, Joint] = {}
    warnings: list[Diagnostic] = []
    if xacro := next((element for element in root.elements if element.tag.startswith("xacro:")), None):
        text = f"<{xacro.tag}> ignored; expected the output of xacro, not its input"
        warnings.append(xacro.diagnostic(text))
    for element in root.elements:
        if element.tag in ("link", "joint"):
            same: dict[str, Any] = links if element.tag == "link" else joints
            name = _attribute(element, "name", element.tag)
            if name in same:
                raise element.error(f'second {element.tag} "{name}"; expected different names')
            same[name] = element if element.tag == "link" else _joint(name, element, warnings)
    _check_tree(root, links, joints)
    _log(warnings)
    return joints


def _log(warnings: list[Diagnostic]) -> None:
    logger = get_logger("robot_description")
    for warning in warnings[:_MAX_LOGGED]:
        logger.warning(str(warning))
    if (more := len(warnings) - _MAX_LOGGED) > 0:
        logger.warning(f"{more} further warnings about this robot description are not logged")


def resolve_mimics(mimics: Mapping[str, Mimic], joints: Collection[str]) -> tuple[dict[str, Mimic], list[str]]:
    """Return the mimic relations in an order in which they can be evaluated, and an error text for each cycle or
    unknown joint.
    """
    sorter = TopologicalSorter({name: (mimic.joint,) for name, mimic in mimics.items()})
    problems: list[str] = []
    try:
        sorter.prepare()
    except CycleError as error:
        problems.append(f"joints mimic themselves: {' -> '.join(error.args[1][:5])}; one of them must not mimic")
    order: list[str] = []
    while ready := sorter.get_ready():
        order += ready
        sorter.done(*ready)
    resolved = {name: mimics[name] for name in order if name in mimics}
    for name, mimic in resolved.items():
        if mimic.joint not in joints:
            hint = did_you_mean(mimic.joint, joints)
            problems.append(f'joint "{name}" mimics joint "{mimic.joint}", not a moving joint{hint}')
            break
    return resolved, problems


def _check_tree(root: XmlElement, links: dict[str, XmlElement], joints: dict[str, Joint]) -> None:
    """Raise `DefinitionError` unless the links form one tree, connected by the joints."""
    if not links:
        raise root.error("no links; expected at least one <link> directly below <robot>")
    parents: dict[str, Joint] = {}
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                hint = did_you_mean(link, links) or f'; add <link name="{link}"/> or remove the joint'
                raise joint.element.error(f'joint "{joint.name}": link "{link}" does not exist{hint}')
        other = parents.setdefault(joint.child, joint)
        if other is not joint:
            both = f'joint "{other.name}" and of joint "{joint.name}"'
            raise joint.element.error(f'link "{joint.child}" is the child of {both}; expected one parent')
    tops = [link for link in links if link not in parents]
    if len(tops) > 1:
        raise links[tops[1]].error(f'no parents of links "{tops[0]}", "{tops[1]}"; a joint must connect all but one')
    try:
        TopologicalSorter({link: (joint.parent,) for link, joint in parents.items()}).prepare()
    except CycleError as error:
        link = error.args[1][0]
        raise parents[link].element.error(f'link "{link}" is in a loop of joints; expected a tree') from None


def _joint(name: str, element: XmlElement, warnings: list[Diagnostic]) -> Joint:
    where = f'joint "{name}"'
    kind = _attribute(element, "type", where)
    if kind not in JOINT_TYPES:
        raise element.error(f"{where}: found type {kind!r}; expected {', '.join(JOINT_TYPES)}")
    children = {child.tag: child for child in reversed([*element.elements])}  # the first of each name
    for tag in ("parent", "child"):
        if tag not in children:
            raise element.error(f'{where}: no <{tag}>; expected <{tag} link="..."/>')
    axis = (1.0, 0.0, 0.0)
    if kind in MOVABLE_TYPES and "axis" in children:
        x, y, z = _numbers(children["axis"], "xyz", where, 0.0, 0.0, 0.0)
        length = math.hypot(x, y, z)
        is_usable = 1e-300 < length < math.inf
        axis = (x / length, y / length, z / length) if is_usable else (0.0, 0.0, 0.0)
        if not is_usable:
            text = f"{where} is not published: its axis has length {length}; expected one like 0 0 1"
            warnings.append(children["axis"].diagnostic(text))
    limits = None
    if (limit := children.get("limit")) is not None:
        limits = (_number(limit, "lower", where), _number(limit, "upper", where))
        for key in ("effort", "velocity"):
            _attribute(limit, key, where)
            _number(limit, key, where)
    elif kind in ("revolute", "prismatic"):
        raise element.error(f"{where}: a {kind} joint must have a <limit>; a continuous joint turns without one")
    origin, safety = (children.get(tag, XmlElement(tag)) for tag in ("origin", "safety_controller"))
    soft = (_number(safety, "soft_lower_limit", where, -math.inf), _number(safety, "soft_upper_limit", where, math.inf))
    mimic = None
    if (found := children.get("mimic")) is not None:
        factor, offset = _number(found, "multiplier", where, 1.0), _number(found, "offset", where)
        mimic = Mimic(_attribute(found, "joint", where), factor, offset)
    parent, child = (_attribute(children[tag], "link", where) for tag in ("parent", "child"))
    translation, angles = (_numbers(origin, key, where, 0.0, 0.0, 0.0) for key in ("xyz", "rpy"))
    pose = Pose.from_rpy(*angles, translation=translation)
    return Joint(name, kind, parent, child, pose, axis, limits, soft, mimic, element)


def parse_number(text: str) -> float:
    """Return the number in a text; NaN if the text is not a finite number."""
    value = float(text) if len(text) < 1000 and _NUMBER.fullmatch(text) else math.nan
    return value if math.isfinite(value) else math.nan


def _attribute(element: XmlElement, key: str, where: str) -> str:
    value = element.attributes.get(key)
    if not value:
        raise element.error(f'{where}: <{element.tag}> has no {key}; expected {key}="..."')
    return value


def _number(element: XmlElement, key: str, where: str, default: float = 0.0) -> float:
    return float(_numbers(element, key, where, default)[0])


def _numbers(element: XmlElement, key: str, where: str, *defaults: float) -> Any:
    """Return the numbers of an XML attribute.

    It must have as many numbers as `defaults`, which is returned if it is missing. Raises `DefinitionError` for other
    texts.
    """
    text = element.attributes.get(key)
    if text is None:
        return defaults
    values = [parse_number(word) for word in text.split(None, len(defaults))]
    if len(values) != len(defaults) or any(map(math.isnan, values)):
        expected = "three numbers such as 0 0 1.5" if len(defaults) > 1 else "a number such as 1.5"
        raise element.error(f"{where}: <{element.tag}> has {key}={text!r:.60}; expected {expected}")
    return tuple(values)
