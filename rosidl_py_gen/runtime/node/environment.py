"""What the ROS and Cyclone environment variables mean, and the Cyclone configuration that follows from them.

Decides domain id, discovery range, static peers and the XML text (protocol.md 10.6, 11.6). It reads a mapping, never
`os.environ` or a file, so that every case is a value in a test.

Why localhost mode binds to the loopback interface, which rmw_cyclonedds (Jazzy) does not do: turning multicast off
stops discovery from leaving the host, but not data to a locator that some discovered peer announces. A transmit socket
bound to 127.0.0.1 cannot leave at all, the kernel refuses to route that source address through another interface. It
stays compatible with ROS peers in LOCALHOST range, although they bind to the first real interface:

- their discovery packets go to `localhost`, so we get them over loopback; Cyclone 11 then answers through the interface
  a packet came in on, and a packet from 127.0.0.1 to the host's own address is delivered over loopback;
- we announce only 127.0.0.1, and Cyclone accepts loopback locators from a peer that announces nothing else.

A static peer on another host is an explicit wish to leave the host: then we do not bind. Neither do we when
CYCLONEDDS_URI chooses interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from numbers import Integral
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_DOMAIN_ID = 232
"""The highest id whose UDP ports fit: 7400 + 250 * id + 11 + 2 * 32 must stay below 65536."""
MAX_PARTICIPANT_INDEX = 32
MAX_PEER_LENGTH = 255
_LOOPBACK_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})


class EnvironmentSettingError(RosidlError, ValueError):
    """An environment variable or its argument twin has a value that cannot be used."""


class DiscoveryRange(Enum):
    """How far discovery looks for peers."""

    SUBNET = "subnet"
    LOCALHOST = "localhost"
    OFF = "off"
    SYSTEM_DEFAULT = "system_default"


@dataclass(frozen=True, slots=True)
class DomainSettings:
    """What a context needs to know before it creates a participant.

    Attributes:
        static_peers: hosts or addresses to contact directly, in the order given.
        cyclonedds_uri: the user's own configuration, XML or ``file://`` names separated by commas; may be empty.
        warnings: sentences to log once.
    """

    domain_id: int = 0
    discovery: DiscoveryRange = DiscoveryRange.SUBNET
    static_peers: tuple[str, ...] = ()
    cyclonedds_uri: str = ""
    warnings: tuple[str, ...] = ()


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


def cyclone_xml(settings: DomainSettings, *, process_id: int, extra: str = "") -> str:
    """The configuration text for Cyclone: ours, then CYCLONEDDS_URI, whose elements win.

    `extra` is XML below ``<Domain>`` that our transport wants to add (tuning); it comes before the user's. In
    localhost and off mode multicast is turned off once more at the end, so that a CYCLONEDDS_URI written for another
    mode cannot turn it on. Empty when there is nothing to say.

    Source: protocol.md 10.6, 11.6.
    """
    fragments = []
    body = _domain_elements(settings, process_id) + extra
    if body:
        fragments.append(f'<CycloneDDS><Domain Id="any">{body}</Domain></CycloneDDS>')
    if settings.cyclonedds_uri:
        fragments.append(settings.cyclonedds_uri)
        if settings.discovery in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF):
            fragments.append(f'<CycloneDDS><Domain Id="any">{_general("")}</Domain></CycloneDDS>')
    return ",".join(fragments)


def _domain_elements(settings: DomainSettings, process_id: int) -> str:
    interfaces = _LOOPBACK_INTERFACE if _binds_to_loopback(settings) else ""
    match settings.discovery:
        case DiscoveryRange.SYSTEM_DEFAULT:
            return ""
        case DiscoveryRange.SUBNET:
            return _discovery(settings.static_peers)
        case DiscoveryRange.LOCALHOST:
            return _general(interfaces) + _discovery(("localhost", *settings.static_peers))
        case DiscoveryRange.OFF:
            tag = f"ros_discovery_off_{process_id}"
            discovery = f"<Discovery><ParticipantIndex>none</ParticipantIndex><Tag>{tag}</Tag></Discovery>"
            return _general(interfaces) + discovery


_LOOPBACK_INTERFACE = '<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>'


def _binds_to_loopback(settings: DomainSettings) -> bool:
    if settings.discovery not in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF):
        return False
    if "NetworkInterface" in settings.cyclonedds_uri:
        return False
    return all(peer in _LOOPBACK_HOSTS for peer in settings.static_peers)


def _general(interfaces: str) -> str:
    return f"<General>{interfaces}<AllowMulticast>false</AllowMulticast></General>"


def _attribute(text: str) -> str:
    """A quoted XML attribute value; the standard library's helper would load a web client with it."""
    for char, entity in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ('"', "&quot;")):
        text = text.replace(char, entity)
    return f'"{text}"'


def _discovery(peers: tuple[str, ...]) -> str:
    """Set explicitly what ROS peers expect; Cyclone 11 has other defaults than the 0.10 of ROS."""
    listed = "".join(f"<Peer address={_attribute(peer)}/>" for peer in peers)
    return (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{MAX_PARTICIPANT_INDEX}</MaxAutoParticipantIndex>"
        f"{f'<Peers>{listed}</Peers>' if listed else ''}</Discovery>"
    )
