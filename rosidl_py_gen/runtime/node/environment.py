"""Environment variables of ROS 2 and Cyclone DDS: domain, discovery range, static peers, middleware, security.

Source: docs/internals/protocol.md 10.6. The functions read a mapping, not `os.environ`.
"""

from __future__ import annotations

from importlib.util import find_spec
from numbers import Integral
from typing import TYPE_CHECKING

from rosidl_py_gen.base.distributions import ENVIRONMENT_VARIABLE
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings
from rosidl_py_gen.runtime.transport.cyclone import library

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

MAX_DOMAIN_ID = 232
"""Highest id with valid UDP ports: 7400 + 250 * id + 11 + 2 * 32 must be less than 65536."""
MAX_PEER_LENGTH = 255
DDS, ZENOH = "dds", "zenoh"
_RMW_TO_TRANSPORT = {
    "rmw_connextdds": DDS,
    "rmw_cyclonedds_cpp": DDS,
    "rmw_fastrtps_cpp": DDS,
    "rmw_fastrtps_dynamic_cpp": DDS,
    "rmw_zenoh_cpp": ZENOH,
}
"""Transport for each RMW implementation; all DDS implementations are interoperable."""


class EnvironmentSettingError(RosidlError, ValueError):
    """An environment variable, or the argument of the same meaning, has an invalid value."""


def read_environment(
    environ: Mapping[str, str],
    *,
    domain_id: int | None = None,
    discovery: str | None = None,
    distro: str | None = None,
) -> DomainSettings:
    """Combine variables and arguments; an argument that is not None overrides its variables.

    Raises:
        EnvironmentSettingError: domain id or `discovery` is invalid.
    """
    warnings: list[str] = []
    peers = _static_peers(environ.get("ROS_STATIC_PEERS", ""), warnings)
    if discovery is not None:
        discovery_range = _parse_discovery_argument(discovery)
    elif _localhost_only(environ.get("ROS_LOCALHOST_ONLY", ""), warnings):
        discovery_range, peers = DiscoveryRange.LOCALHOST, ()
    else:
        discovery_range = _parse_range_variable(environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", ""), warnings)
    if discovery_range is DiscoveryRange.OFF:
        peers = ()
    if domain_id is None:
        text = environ.get("ROS_DOMAIN_ID", "")
        domain_id = _check_domain_id("ROS_DOMAIN_ID", _parse_unsigned(text), text)
    else:
        domain_id = _check_domain_id("domain_id", domain_id, domain_id)
    distro = environ.get(ENVIRONMENT_VARIABLE, "").strip().lower() if distro is None else distro
    return DomainSettings(domain_id, discovery_range, peers, environ.get("CYCLONEDDS_URI", ""), tuple(warnings), distro)


def middleware(environ: Mapping[str, str], warn: Callable[[str], None]) -> str:
    """Return ``"dds"`` or ``"zenoh"``, according to RMW_IMPLEMENTATION, else to what is installed."""
    name = environ.get("RMW_IMPLEMENTATION", "")
    if name in _RMW_TO_TRANSPORT:
        return _RMW_TO_TRANSPORT[name]
    if name:
        warn(f"RMW_IMPLEMENTATION={name!r:.100} ignored: unknown; expected one of {', '.join(_RMW_TO_TRANSPORT)}")
    return ZENOH if find_spec("zenoh") is not None and not library.is_found() else DDS


def check_security(environ: Mapping[str, str], warn: Callable[[str], None]) -> None:
    """Warn that nodes on a network are not secured as the environment requires; values are compared as in rcl.

    Raises:
        EnvironmentSettingError: ROS_SECURITY_STRATEGY forbids unsecured nodes.
    """
    if environ.get("ROS_SECURITY_ENABLE") != "true":
        return
    reason = "ROS_SECURITY_ENABLE=true: secured communication (SROS 2) is not supported"
    if environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
        raise EnvironmentSettingError(
            f"{reason}, and ROS_SECURITY_STRATEGY=Enforce forbids unsecured communication; unset ROS_SECURITY_ENABLE "
            "to communicate unencrypted"
        )
    warn(
        f"{reason}; this process communicates unencrypted, and does not find secured nodes. Unset it to silence this "
        "warning; with ROS_SECURITY_STRATEGY=Enforce it is an error"
    )


def _check_domain_id(origin: str, number: int | None, value: object) -> int:
    # NumPy's integers are accepted. An __index__ does not suffice: up to NumPy 2.2 its bools have one.
    if not isinstance(number, Integral) or isinstance(number, bool) or not 0 <= number <= MAX_DOMAIN_ID:
        raise EnvironmentSettingError(
            f"{origin} must be a whole number from 0 to {MAX_DOMAIN_ID} (higher ids need UDP ports above 65535), "
            f"got {value!r}"
        )
    return int(number)


def _parse_unsigned(text: str) -> int | None:
    """Parse like C's strtoul with base 0: decimal, 0x hexadecimal, leading 0 octal; None if invalid, 0 if empty."""
    digits = text.strip(" \t\n\v\f\r")
    if not digits:
        return 0 if not text else None
    if not digits.isascii() or "_" in digits:
        return None
    octal = len(digits) > 1 and digits[0] == "0" and digits.isdigit()
    try:
        return int(digits, 8 if octal else 16 if digits[:2].lower() == "0x" else 10)
    except ValueError:
        return None


def _parse_discovery_argument(discovery: str) -> DiscoveryRange:
    try:
        return DiscoveryRange(discovery.lower() if isinstance(discovery, str) else discovery)
    except ValueError:
        known = ", ".join(repr(item.value) for item in DiscoveryRange)
        raise EnvironmentSettingError(f"discovery must be one of {known}, got {discovery!r}") from None


def _parse_range_variable(value: str, warnings: list[str]) -> DiscoveryRange:
    if not value:
        return DiscoveryRange.SUBNET
    try:
        return DiscoveryRange[value.upper()]
    except KeyError:
        known = ", ".join(item.name for item in DiscoveryRange)
        warnings.append(f"ROS_AUTOMATIC_DISCOVERY_RANGE must be one of {known}, got {value!r}; using LOCALHOST")
        return DiscoveryRange.LOCALHOST


def _localhost_only(value: str, warnings: list[str]) -> bool:
    if not value:
        return False
    enabled = value.startswith("1")
    effect = "the range is LOCALHOST, static peers are ignored" if enabled else "this value has no effect"
    warnings.append(
        f"ROS_LOCALHOST_ONLY={value} is deprecated ({effect}); use ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS"
    )
    return enabled


def _static_peers(value: str, warnings: list[str]) -> tuple[str, ...]:
    peers = []
    for peer in map(str.strip, value.split(";")):
        if len(peer) > MAX_PEER_LENGTH:
            warnings.append(
                f"ROS_STATIC_PEERS: skipped a peer of {len(peer)} characters, at most {MAX_PEER_LENGTH} fit"
            )
        elif peer:
            peers.append(peer)
    return tuple(peers)
