"""``--qos-profile-overrides-path``: a YAML file with the quality of service of topics, in rosbag2's format.

    /scan:
      reliability: best_effort
      history: keep_last
      depth: 5
      deadline: {sec: 0, nsec: 500000000}

Decides what a profile is where a file says only a part of it: the rest is of ROS's default profile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.metadata import PERIODS
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli.bag.yaml_tree import entries, parse, read_text, text, wrong
from rosidl_py_gen.runtime import InvalidQoSError, QoSProfile, validate_full_name
from rosidl_py_gen.runtime.qos import INFINITE_NS, POLICIES

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.bag.yaml_tree import YamlNode, YamlScalar

_PERIOD_FIELDS = {key: name for name, key in PERIODS.items()}
_CONVENTIONS = "avoid_ros_namespace_conventions"
_KEYS = (*POLICIES, "depth", *_PERIOD_FIELDS, _CONVENTIONS)
_BOOLS = {"true": True, "false": False}


def read_qos_overrides(path: str | None) -> dict[str, QoSProfile]:
    """Full name of a topic -> its profile; none without a file.

    Raises:
        ToolError: it is wrong, with file, line and column. OSError: it cannot be read.
    """
    return {} if path is None else parse_qos_overrides(read_text(path, "profiles"), path)


def parse_qos_overrides(source: str, name: str = "<profiles>") -> dict[str, QoSProfile]:
    """The profiles of a text; `name` is shown in errors, which are those of `read_qos_overrides`."""
    root = parse(source, name, "profiles")
    if root is None:
        return {}
    found = {}
    for topic, policies in entries(root, name, "expected topics, and the policies of each below it"):
        try:
            validate_full_name(topic.value)
        except InvalidNameError as error:
            wrong(topic, name, f"expected the full name of a topic: {error}")
        values = dict(_policy(key, value, name) for key, value in entries(policies, name, _expected()))
        try:
            found[topic.value] = QoSProfile(**values)
        except InvalidQoSError as error:
            wrong(policies, name, f"{topic.value}: {error}")
    return found


def _expected() -> str:
    return f"expected policies, of {', '.join(_KEYS)}"


def _policy(key: YamlScalar, value: YamlNode, name: str) -> tuple[str, Any]:
    """A field of a profile, and what it becomes."""
    what: str = key.value
    if what in POLICIES:
        members = {one.name.lower(): one for one in POLICIES[what] if one.name != "UNKNOWN"}
        expected = f"{what}: expected one of {', '.join(members)}"
        word = text(value, name, expected).lower()
        if word not in members:
            wrong(value, name, f'{expected}; found "{word[:80]}"{did_you_mean(word, members)}')
        return what, members[word]
    if what in _PERIOD_FIELDS:
        return _PERIOD_FIELDS[what], _period(what, value, name)
    if what == "depth":
        return what, _number(value, name, "depth")
    if what == _CONVENTIONS:
        word = text(value, name, f"{what}: expected true or false").lower()
        if word not in _BOOLS:
            wrong(value, name, f'{what}: expected true or false, found "{word[:80]}"')
        return what, _BOOLS[word]
    wrong(key, name, f'{_expected()}; found "{what[:80]}"{did_you_mean(what, _KEYS)}')


def _period(what: str, node: YamlNode, name: str) -> int:
    """Nanoseconds; nothing, or null, is none in particular."""
    expected = f"{what}: expected sec: and nsec:"
    told = {}
    for key, value in entries(node, name, expected):
        if key.value not in ("sec", "nsec"):
            wrong(key, name, f'{expected}, found "{key.value[:80]}"')
        told[key.value] = _number(value, name, f"{what}: {key.value}")
    if len(told) == 1:
        wrong(node, name, f"{expected}, found only {next(iter(told))}:")
    return min(told.get("sec", 0) * NS_PER_S + told.get("nsec", 0), INFINITE_NS)


def _number(node: YamlNode, name: str, what: str) -> int:
    expected = f"{what}: expected a whole number, 0 or more"
    word = text(node, name, expected)
    if not (word.isascii() and word.isdecimal() and len(word) < 20):
        wrong(node, name, f'{expected}; found "{word[:80]}"')
    return int(word)
