"""The configuration of Cyclone that follows from a context's settings, as XML text
(docs/internals/protocol.md 10.6, 11.6). What the loaded library does not know is left out, as it would end the domain.

Why localhost mode binds to the loopback interface, which rmw_cyclonedds (Jazzy) does not do: turning multicast off
stops discovery from leaving the host, but not data to a locator that some discovered peer announces. A transmit socket
bound to 127.0.0.1 cannot leave at all, the kernel refuses to route that source address through another interface. It
stays compatible with ROS peers in LOCALHOST range, although they bind to the first real interface:

- their discovery packets go to `localhost`, so we get them over loopback; Cyclone 11 then answers through the interface
  a packet came in on, and a packet from 127.0.0.1 to the host's own address is delivered over loopback;
- we announce only 127.0.0.1, and Cyclone accepts loopback locators from a peer that announces nothing else.

A static peer on another host is an explicit wish to leave the host: then we do not bind. Neither do we when
CYCLONEDDS_URI chooses interfaces, nor with Cyclone before 11, which does not answer so and would not find peers on
Fast DDS: there data may go to whatever address a discovered peer announces (docs/internals/dds.md 8).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings

if TYPE_CHECKING:
    from collections.abc import Collection

MAX_PARTICIPANT_INDEX = 32
IGNORE_TYPE_INFORMATION = "IgnoreTypeInformation"
"""An element of Cyclone from 11 on."""
ELEMENTS = frozenset(
    {"SocketReceiveBufferSize", "HeartbeatInterval", "NackDelay", IGNORE_TYPE_INFORMATION, "SPDPInterval"}
    | {"InitialLocatorPruneDelay", "SharedMemory"}
)
"""Elements of ours that a library may do without: 0.10 does not know two, one built without iceoryx not the last."""
DEFAULT_CONFIG = (
    '<Internal><SocketReceiveBufferSize max="32MiB"/><HeartbeatInterval>20ms</HeartbeatInterval>'
    "<NackDelay>20ms</NackDelay></Internal><Compatibility><IgnoreTypeInformation>"
    f"{','.join(f'1.{vendor}' for vendor in range(2, 33))}</IgnoreTypeInformation></Compatibility>"
)
"""XML below ``<Domain>`` for every domain of ours; the user's CYCLONEDDS_URI wins over it.

- The kernel grants at most net.core.rmem_max. With Cyclone's own 1 MiB a fifth of 6 MB images was lost on loopback,
  with 4 MiB none.
- Cyclone waits 100 ms before it speaks of what was not acknowledged, and as long between two requests for what is
  missing. Where every tenth packet is lost half of all messages of 200 kB took 0.2 s and more, with 20 ms 1.5 ms.
  It is the same with a first request that is faster than the news of its client. Heartbeats without an answer become
  rare in the same way as before.
- Type information of peers, of all vendors that Cyclone can name here: ours have none to compare it with. Cyclone
  takes definitions of arrays and sequences of Kilted's Fast DDS for invalid when it hears one peer ask another for
  them, and from then on ignores all endpoints of these types.
"""
_LOOPBACK_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})


def cyclone_xml(
    settings: DomainSettings, *, process_id: int, extra: str = "", last: str = "", lacks: Collection[str] = ()
) -> str:
    """The configuration text for Cyclone: ours, then CYCLONEDDS_URI, whose elements win.

    In localhost and off mode multicast is turned off once more at the end, so that a CYCLONEDDS_URI written for another
    mode cannot turn it on. Empty when there is nothing to say.

    Args:
        extra: XML below ``<Domain>`` that our transport wants to add (tuning); it comes before the user's.
        last: the same, behind the user's.
        lacks: elements that the library does not know, of those in `ELEMENTS`.

    Source: docs/internals/protocol.md 10.6, 11.6.
    """
    fragments = []
    body = _domain_elements(settings, process_id, IGNORE_TYPE_INFORMATION not in lacks) + extra
    for name in lacks:
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
    is_bound = _binds_to_loopback(settings) and (can_bind or settings.discovery_range is DiscoveryRange.OFF)
    interfaces = _LOOPBACK_INTERFACE if is_bound else ""
    match settings.discovery_range:
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
    if settings.discovery_range not in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF):
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
    """Set explicitly what ROS peers expect; Cyclone 11 has other defaults than the 0.10 of ROS.

    It announces a participant every 8 s to those it knows, but once, at the start, to listed addresses where nobody is
    known: the next time would come after 30 s, when it gives them up. A peer may come later and announce itself only by
    multicast, to which nobody listens in localhost mode; and an announcement may be lost. Fast DDS has 3 s, too.
    """
    listed = "".join(f"<Peer address={_attribute(peer)}/>" for peer in peers)
    return (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{MAX_PARTICIPANT_INDEX}</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        f"{f'<Peers>{listed}</Peers>' if listed else ''}</Discovery>"
    )
