"""The configuration of Cyclone: docs/internals/protocol.md 10.6."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings
from rosidl_py_gen.runtime.transport.cyclone.config import DEFAULT_CONFIG, OPTIONAL_ELEMENTS, cyclone_xml

LOCALHOST, OFF = DiscoveryRange.LOCALHOST, DiscoveryRange.OFF


def test_subnet_sets_what_ros_peers_expect() -> None:
    assert cyclone_xml(DomainSettings(), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex>'
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><SPDPInterval>3s</SPDPInterval>"
        "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay></Discovery></Domain></CycloneDDS>"
    )


def test_localhost_has_no_multicast_binds_to_loopback_and_asks_localhost() -> None:
    assert cyclone_xml(DomainSettings(discovery_range=LOCALHOST), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/>'
        "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
        "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
    )


def test_system_default_says_nothing() -> None:
    assert cyclone_xml(DomainSettings(discovery_range=DiscoveryRange.SYSTEM_DEFAULT), process_id=1) == ""


INNER = '<General><Interfaces><NetworkInterface name="lo"/></Interfaces></General>'


@pytest.mark.parametrize(
    ("mode", "more", "unsupported", "is_bound"),
    [
        (LOCALHOST, {"static_peers": ("10.1.2.3",)}, (), False),
        (LOCALHOST, {"static_peers": ("127.0.0.1",)}, (), True),
        (LOCALHOST, {"cyclonedds_uri": f"<CycloneDDS><Domain>{INNER}</Domain></CycloneDDS>"}, (), False),
        (LOCALHOST, {}, ("IgnoreTypeInformation",), False),  # a library before 11
        (OFF, {}, ("IgnoreTypeInformation",), True),
        (OFF, {}, (), True),
    ],
)
def test_only_a_static_peer_elsewhere_chosen_interfaces_or_an_old_library_keep_us_from_binding(
    mode: DiscoveryRange, more: dict[str, Any], unsupported: tuple[str, ...], is_bound: bool
) -> None:
    text = cyclone_xml(DomainSettings(discovery_range=mode, **more), process_id=77, unsupported=unsupported)
    assert ('NetworkInterface address="127.0.0.1"' in text) is is_bound
    assert "<AllowMulticast>false</AllowMulticast>" in text
    assert ("<ParticipantIndex>none</ParticipantIndex><Tag>ros_discovery_off_77</Tag>" in text) is (mode is OFF)


def test_the_users_configuration_comes_after_ours_but_cannot_turn_multicast_on_in_localhost_mode() -> None:
    text = cyclone_xml(DomainSettings(discovery_range=LOCALHOST, cyclonedds_uri="file:///c.xml"), process_id=1)
    ours, theirs, last = text.split(",")
    assert "localhost" in ours and theirs == "file:///c.xml"
    assert last.endswith("<General><AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>")
    assert cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1).endswith(",<x/>")


def test_what_a_library_does_not_know_is_left_out() -> None:
    local = DomainSettings(discovery_range=LOCALHOST)
    last = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    text = cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last, unsupported=OPTIONAL_ELEMENTS)
    found = {element.tag for element in ElementTree.fromstring(text).iter()}
    assert not found & OPTIONAL_ELEMENTS and "ParticipantIndex" in found
    assert {
        one.tag for one in ElementTree.fromstring(cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last)).iter()
    } >= OPTIONAL_ELEMENTS


def test_shared_memory_is_switched_off_behind_the_users_configuration() -> None:
    text = cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1, last="<off/>")
    assert text.endswith(',<x/>,<CycloneDDS><Domain Id="any"><off/></Domain></CycloneDDS>')
    off = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    text = cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1, last=off, unsupported={"SharedMemory"})
    assert text.endswith(",<x/>")  # a library that was built without any would refuse the element


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1, max_size=8)))
def test_peers_never_break_the_xml(peers: list[str]) -> None:
    text = cyclone_xml(DomainSettings(static_peers=tuple(peers)), process_id=1)
    found = [element.get("address") for element in ElementTree.fromstring(text).iter("Peer")]
    assert found == peers
