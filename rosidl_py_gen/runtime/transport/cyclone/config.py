"""Configuration of Cyclone DDS as XML text, made from the settings of a context.

Source: docs/internals/protocol.md 10.6, 11.6.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings

MAX_PARTICIPANT_INDEX = 32
IGNORE_TYPE_INFORMATION = "IgnoreTypeInformation"
"""Name of a configuration element that Cyclone has from 11 on."""
OPTIONAL_ELEMENTS = frozenset(
    {"SocketReceiveBufferSize", "HeartbeatInterval", "NackDelay", IGNORE_TYPE_INFORMATION, "SPDPInterval"}
    | {"InitialLocatorPruneDelay", "SharedMemory"}
)
"""Configuration elements that are omitted if the loaded library does not know them.

Cyclone 0.10 lacks two; a build without iceoryx lacks ``SharedMemory``.
"""
DEFAULT_CONFIG = (
    '<Internal><SocketReceiveBufferSize max="32MiB"/><HeartbeatInterval>20ms</HeartbeatInterval>'
    "<NackDelay>20ms</NackDelay></Internal><Compatibility><IgnoreTypeInformation>"
    f"{','.join(f'1.{vendor}' for vendor in range(2, 33))}</IgnoreTypeInformation></Compatibility>"
)
"""Configuration, as XML inside ``<Domain>``, of every domain; elements of the user's CYCLONEDDS_URI override it.

- Receive buffer: the kernel grants at most net.core.rmem_max. With Cyclone's default of 1 MiB a fifth of 6 MB images
  was lost on loopback, with 4 MiB none.
- Heartbeat interval and NACK delay 20 ms (Cyclone's default: 100 ms): with 10 % packet loss, messages of 200 kB take
  1.5 ms instead of 200 ms (median). The same holds for a first request that is sent before the client is discovered.
  Unanswered heartbeats become rare as with the default.
- Type information of peers of all vendors is ignored, because endpoints of this package have no type information to
  compare it with. Cyclone considers definitions of arrays and sequences of Kilted's Fast DDS invalid when it receives a
  peer's request for them, and then ignores all endpoints of these types.
"""
_LOOPBACK_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
_LOOPBACK_INTERFACE = '<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>'


def cyclone_xml(
    settings: DomainSettings, *, process_id: int, extra: str = "", last: str = "", unsupported: Collection[str] = ()
) -> str:
    """Return the configuration of a domain: this package's XML, then CYCLONEDDS_URI, whose elements override it.

    The result may be empty. `extra` and `last` are XML inside ``<Domain>`` before and after the user's XML.
    `unsupported` are the members of `OPTIONAL_ELEMENTS` to omit. In localhost and off mode multicast is disabled again
    at the end, so that a CYCLONEDDS_URI that was written for another mode cannot enable it.
    """
    fragments = []
    body = _domain_elements(settings, process_id, IGNORE_TYPE_INFORMATION not in unsupported) + extra
    # One element that the loaded library does not know makes the creation of the domain fail (docs/internals/dds.md 8).
    for name in unsupported:
        element = rf"<{name}\b[^>]*(/>|>.*?</{name}>)"
        body, last = re.sub(element, "", body), re.sub(element, "", last)
    if body:
        fragments.append(f'<CycloneDDS><Domain Id="any">{body}</Domain></CycloneDDS>')
    if settings.cyclonedds_uri:
        fragments.append(settings.cyclonedds_uri)
        if settings.discovery_range in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF):
            last = _general("") + last
        if last:
            fragments.append(f'<CycloneDDS><Domain Id="any">{last}</Domain></CycloneDDS>')
    return ",".join(fragments)


def _domain_elements(settings: DomainSettings, process_id: int, can_bind: bool) -> str:
    stays_on_host = "NetworkInterface" not in settings.cyclonedds_uri and _LOOPBACK_HOSTS.issuperset(
        settings.static_peers
    )
    match settings.discovery_range:
        case DiscoveryRange.SYSTEM_DEFAULT:
            return ""
        case DiscoveryRange.SUBNET:
            return _discovery(settings.static_peers)
        case DiscoveryRange.LOCALHOST:
            # Without multicast, discovery does not leave the host, but data may still go to an address that a peer
            # announces. A socket that is bound to 127.0.0.1 cannot send through another interface; rmw_cyclonedds of
            # Jazzy does not bind. ROS peers in LOCALHOST range bind to the first real interface, but are discovered:
            # their discovery packets go to `localhost`, Cyclone 11 replies through the interface of a packet, and
            # accepts loopback locators of a peer that announces no others.
            # Not with a static peer on another host or interfaces in CYCLONEDDS_URI, and not before Cyclone 11, which
            # replies through another interface and would not discover Fast DDS peers (docs/internals/dds.md 8).
            interfaces = _LOOPBACK_INTERFACE if stays_on_host and can_bind else ""
            return _general(interfaces) + _discovery(("localhost", *settings.static_peers))
        case DiscoveryRange.OFF:
            tag = f"ros_discovery_off_{process_id}"
            discovery = f"<Discovery><ParticipantIndex>none</ParticipantIndex><Tag>{tag}</Tag></Discovery>"
            return _general(_LOOPBACK_INTERFACE if stays_on_host else "") + discovery


def _general(interfaces: str) -> str:
    return f"<General>{interfaces}<AllowMulticast>false</AllowMulticast></General>"


def _attribute(text: str) -> str:
    # `xml.sax.saxutils.quoteattr` would import a web client.
    for char, entity in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ('"', "&quot;")):
        text = text.replace(char, entity)
    return f'"{text}"'


def _discovery(peers: tuple[str, ...]) -> str:
    """Return the ``<Discovery>`` element with the values that ROS peers expect, and with static `peers`.

    Cyclone 11 has other defaults than the Cyclone 0.10 of ROS.

    Cyclone announces a participant every 8 s to known participants, but to listed addresses without a known participant
    only once, at the start; after 30 s it removes them. A peer may start later and announce itself only by multicast,
    which is not received in localhost mode, and an announcement may be lost. So the interval is 3 s, as in Fast DDS.
    """
    elements = "".join(f"<Peer address={_attribute(peer)}/>" for peer in peers)
    return (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{MAX_PARTICIPANT_INDEX}</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        f"{f'<Peers>{elements}</Peers>' if elements else ''}</Discovery>"
    )
