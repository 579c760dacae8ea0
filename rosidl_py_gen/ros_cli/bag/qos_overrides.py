"""Option ``--qos-profile-overrides-path``: a YAML file with QoS profiles of topics, in the format of rosbag2.

    /scan:
      reliability: best_effort
      history: keep_last
      depth: 5
      deadline: {sec: 0, nsec: 500000000}

Missing policies have the values of ROS's default profile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli.bag.yaml_tree import entries, parse, read_text, text, wrong
from rosidl_py_gen.runtime import InvalidQoSError, QoSProfile, validate_full_name
from rosidl_py_gen.runtime.qos import ENUMS, INFINITE_NS, PERIODS, POLICIES

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.bag.yaml_tree import YamlNode, YamlScalar

_PERIOD_FIELDS = {key: name for name, key in PERIODS.items()}
_CHOICES: dict[str, dict[str, Any]] = {
    **{key: {one.name.lower(): one for one in kind if one.name != "UNKNOWN"} for key, kind in ENUMS.items()},
    "avoid_ros_namespace_conventions": {"true": True, "false": False},
}
_KEYS = tuple(policy.rmw_name for policy in POLICIES)
_EXPECTED = f"expected policies, of {', '.join(_KEYS)}"


def read_qos_overrides(path: str | None) -> dict[str, QoSProfile]:
    """Read a file of QoS profiles by topic; {} without a file.

    Raises `CommandError` or OSError if it is invalid or missing.
    """
    return {} if path is None else parse_qos_overrides(read_text(path, "profiles"), path)


def parse_qos_overrides(source: str, name: str = "<profiles>") -> dict[str, QoSProfile]:
    """Parse a text with QoS profiles by full topic name; raises `CommandError` with `name` and line if invalid."""
    profiles = {}
    for topic, policies in entries(parse(source, name), name, "expected topics, and the policies of each below it"):
        try:
            validate_full_name(topic.value)
        except InvalidNameError as error:
            wrong(topic, name, f"expected the full name of a topic: {error}")
        values = dict(_policy(key, value, name) for key, value in entries(policies, name, _EXPECTED))
        try:
            profiles[topic.value] = QoSProfile(**values)
        except InvalidQoSError as error:
            wrong(policies, name, f"{topic.value}: {error}")
    return profiles


def _policy(key: YamlScalar, value: YamlNode, name: str) -> tuple[str, Any]:
    policy: str = key.value
    if choices := _CHOICES.get(policy):
        expected = f"{policy}: expected one of {', '.join(choices)}"
        word = text(value, name, expected).lower()
        if word not in choices:
            wrong(value, name, f'{expected}; found "{word[:80]}"{did_you_mean(word, choices)}')
        return policy, choices[word]
    if policy in _PERIOD_FIELDS:
        return _PERIOD_FIELDS[policy], _period(policy, value, name)
    if policy in _KEYS:
        return policy, _number(value, name, policy)
    wrong(key, name, f'{_EXPECTED}; found "{policy[:80]}"{did_you_mean(policy, _KEYS)}')


def _period(policy: str, node: YamlNode, name: str) -> int:
    expected = f"{policy}: expected sec: and nsec:"
    values = {}
    for key, value in entries(node, name, expected):
        if key.value not in ("sec", "nsec"):
            wrong(key, name, f'{expected}, found "{key.value[:80]}"')
        values[key.value] = _number(value, name, f"{policy}: {key.value}")
    if len(values) == 1:
        wrong(node, name, f"{expected}, found only {next(iter(values))}:")
    return min(values.get("sec", 0) * NS_PER_S + values.get("nsec", 0), INFINITE_NS)


def _number(node: YamlNode, name: str, policy: str) -> int:
    expected = f"{policy}: expected a whole number, 0 or more"
    word = text(node, name, expected)
    if not (word.isascii() and word.isdecimal() and len(word) < 20):
        wrong(node, name, f'{expected}; found "{word[:80]}"')
    return int(word)
