"""Environment variables: docs/internals/protocol.md 10.6."""

from __future__ import annotations

from typing import Any

import pytest

from rosidl_py_gen.runtime.node.settings import EnvironmentSettingError, read_environment
from rosidl_py_gen.runtime.transport.api import DiscoveryRange


@pytest.mark.parametrize(
    ("text", "number"), [("", 0), ("0", 0), ("42", 42), (" 7", 7), ("0x10", 16), ("010", 8), ("232", 232), ("+5", 5)]
)
def test_ros_domain_id_is_parsed_like_strtoul(text: str, number: int) -> None:
    assert read_environment({"ROS_DOMAIN_ID": text}).domain_id == number


@pytest.mark.parametrize("text", ["junk", "1a", "-1", "233", "08", "0x", " ", "1_0", "٣", "1.0"])
def test_invalid_ros_domain_id_error_names_variable_and_range(text: str) -> None:
    with pytest.raises(EnvironmentSettingError, match="ROS_DOMAIN_ID must be a whole number from 0 to 232"):
        read_environment({"ROS_DOMAIN_ID": text})


def test_arguments_override_environment_variables() -> None:
    environ = {"ROS_DOMAIN_ID": "junk", "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_LOCALHOST_ONLY": "1"}
    settings = read_environment(environ, domain_id=3, discovery="subnet")
    assert (settings.domain_id, settings.discovery_range, settings.warnings) == (3, DiscoveryRange.SUBNET, ())


class BoolOfNumpy22:
    """Bool of NumPy up to version 2.2: usable as index, with a DeprecationWarning."""

    def __index__(self) -> int:
        return 1

    def __repr__(self) -> str:
        return "np.True_"


@pytest.mark.parametrize("bad", [-1, 233, True, "5", 1.0, BoolOfNumpy22()])
def test_invalid_domain_id_argument_is_refused(bad: Any) -> None:
    with pytest.raises(EnvironmentSettingError, match=f"^domain_id must be .*got {bad!r}$"):
        read_environment({}, domain_id=bad)


@pytest.mark.parametrize(
    ("value", "expected", "warned"),
    [
        ("", DiscoveryRange.SUBNET, False),
        ("SUBNET", DiscoveryRange.SUBNET, False),
        ("LOCALHOST", DiscoveryRange.LOCALHOST, False),
        ("OFF", DiscoveryRange.OFF, False),
        ("SYSTEM_DEFAULT", DiscoveryRange.SYSTEM_DEFAULT, False),
        ("everywhere", DiscoveryRange.LOCALHOST, True),
    ],
)
def test_discovery_range_is_read_from_environment(value: str, expected: DiscoveryRange, warned: bool) -> None:
    settings = read_environment({"ROS_AUTOMATIC_DISCOVERY_RANGE": value})
    assert (settings.discovery_range, bool(settings.warnings)) == (expected, warned)


def test_ros_localhost_only_is_deprecated_and_discards_static_peers() -> None:
    settings = read_environment({"ROS_LOCALHOST_ONLY": "1", "ROS_STATIC_PEERS": "a;b"})
    assert (settings.discovery_range, settings.static_peers) == (DiscoveryRange.LOCALHOST, ())
    assert "deprecated" in settings.warnings[0]
    other = read_environment({"ROS_LOCALHOST_ONLY": "0", "ROS_STATIC_PEERS": "a"})
    assert (other.discovery_range, other.static_peers) == (DiscoveryRange.SUBNET, ("a",))
    assert "no effect" in other.warnings[0]


def test_static_peers_are_split_and_overlong_ones_skipped() -> None:
    settings = read_environment({"ROS_STATIC_PEERS": f"10.0.0.1; host;;{'x' * 256}"})
    assert settings.static_peers == ("10.0.0.1", "host")
    assert "256 characters" in settings.warnings[0]
