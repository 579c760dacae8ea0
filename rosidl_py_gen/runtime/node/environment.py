"""What the ROS and Cyclone environment variables mean.

Decides domain id, discovery range and static peers (docs/internals/protocol.md 10.6), which middleware is meant, and
that nothing starts unsecured where security is enforced. It reads a mapping, never `os.environ` or a file, so that
every case is a value in a test.
"""

from __future__ import annotations

from importlib.util import find_spec
from numbers import Integral
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings
from rosidl_py_gen.runtime.transport.cyclone import library

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

MAX_DOMAIN_ID = 232
"""The highest id whose UDP ports fit: 7400 + 250 * id + 11 + 2 * 32 must stay below 65536."""
MAX_PEER_LENGTH = 255
DDS, ZENOH = "dds", "zenoh"
_RMW_TO_TRANSPORT = {
    "rmw_connextdds": DDS,
    "rmw_cyclonedds_cpp": DDS,
    "rmw_fastrtps_cpp": DDS,
    "rmw_fastrtps_dynamic_cpp": DDS,
    "rmw_zenoh_cpp": ZENOH,
}
"""All that speak DDS understand each other, so any of them means DDS."""


class EnvironmentSettingError(RosidlError, ValueError):
    """An environment variable or its argument twin has a value that cannot be used."""


def read_environment(
    environ: Mapping[str, str], *, domain_id: int | None = None, discovery: str | None = None
) -> DomainSettings:
    """Combine variables and arguments; an argument that is not None wins over its variables.

    Raises `EnvironmentSettingError` for a domain id or a `discovery` argument that cannot be used.
    """
    warnings: list[str] = []
    peers = _static_peers(environ.get("ROS_STATIC_PEERS", ""), warnings)
    if discovery is not None:
        chosen = _range_argument(discovery)
    elif _localhost_only(environ.get("ROS_LOCALHOST_ONLY", ""), warnings):
        chosen, peers = DiscoveryRange.LOCALHOST, ()
    else:
        chosen = _range_variable(environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", ""), warnings)
    if chosen is DiscoveryRange.OFF:
        peers = ()
    return DomainSettings(
        _domain_variable(environ.get("ROS_DOMAIN_ID", "")) if domain_id is None else _domain_id("domain_id", domain_id),
        chosen,
        peers,
        environ.get("CYCLONEDDS_URI", ""),
        tuple(warnings),
    )


def middleware(environ: Mapping[str, str], warn: Callable[[str], None]) -> str:
    """``"dds"`` or ``"zenoh"``: what RMW_IMPLEMENTATION means, else what is installed."""
    wanted = environ.get("RMW_IMPLEMENTATION", "")
    if wanted in _RMW_TO_TRANSPORT:
        return _RMW_TO_TRANSPORT[wanted]
    if wanted:
        warn(
            f"RMW_IMPLEMENTATION={wanted!r:.100} is not known and has no effect; "
            f"known are {', '.join(_RMW_TO_TRANSPORT)}"
        )
    return ZENOH if find_spec("zenoh") is not None and not library.is_found() else DDS


def check_security(environ: Mapping[str, str], warn: Callable[[str], None]) -> None:
    """Warn that a node on a network would not be secured as the environment wants; both values count as rcl reads them.

    Raises:
        EnvironmentSettingError: ROS_SECURITY_STRATEGY forbids unsecured nodes.
    """
    if environ.get("ROS_SECURITY_ENABLE") != "true":
        return
    found = "ROS_SECURITY_ENABLE=true: secured communication (SROS 2) is not supported"
    if environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
        raise EnvironmentSettingError(
            f"{found}, and ROS_SECURITY_STRATEGY=Enforce forbids any other; unset ROS_SECURITY_ENABLE to communicate "
            "unencrypted"
        )
    warn(
        f"{found}; this process communicates unencrypted, and does not find secured nodes. Unset it to silence this "
        "warning; with ROS_SECURITY_STRATEGY=Enforce it is an error"
    )


def _domain_variable(text: str) -> int:
    return _domain_id("ROS_DOMAIN_ID", _parse_unsigned(text), text)


def _domain_id(where: str, number: int | None, found: object = None) -> int:
    # NumPy's integers are as good as Python's. What else has an __index__ is not: up to NumPy 2.2 its bools have one.
    if not isinstance(number, Integral) or isinstance(number, bool) or not 0 <= number <= MAX_DOMAIN_ID:
        raise EnvironmentSettingError(
            f"{where} must be a whole number from 0 to {MAX_DOMAIN_ID} (higher ids need UDP ports above 65535), "
            f"got {number if found is None else found!r}"
        )
    return int(number)


def _parse_unsigned(text: str) -> int | None:
    """Like C's strtoul with base 0: decimal, 0x hexadecimal, leading 0 octal. None for junk; empty is 0."""
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


def _range_argument(discovery: str) -> DiscoveryRange:
    try:
        return DiscoveryRange(discovery.lower() if isinstance(discovery, str) else discovery)
    except ValueError:
        known = ", ".join(repr(item.value) for item in DiscoveryRange)
        raise EnvironmentSettingError(f"discovery must be one of {known}, got {discovery!r}") from None


def _range_variable(value: str, warnings: list[str]) -> DiscoveryRange:
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
    effect = "it sets the range to LOCALHOST and static peers are ignored" if enabled else "this value has no effect"
    warnings.append(
        f"ROS_LOCALHOST_ONLY={value} is deprecated ({effect}); use ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS"
    )
    return enabled


def _static_peers(value: str, warnings: list[str]) -> tuple[str, ...]:
    peers = []
    for peer in (part.strip() for part in value.split(";")):
        if len(peer) > MAX_PEER_LENGTH:
            warnings.append(
                f"ROS_STATIC_PEERS: skipped a peer of {len(peer)} characters, at most {MAX_PEER_LENGTH} fit"
            )
        elif peer:
            peers.append(peer)
    return tuple(peers)
