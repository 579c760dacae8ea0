"""Configuration of Cyclone DDS: docs/internals/protocol.md 10.6."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings
from rosidl_py_gen.runtime.transport.cyclone.library import DEFAULT_CONFIG, OPTIONAL_ELEMENTS, cyclone_xml

LOCALHOST, OFF = DiscoveryRange.LOCALHOST, DiscoveryRange.OFF


def test_subnet_configuration_matches_rmw_cyclonedds() -> None:
    assert cyclone_xml(DomainSettings(), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex>'
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><SPDPInterval>3s</SPDPInterval>"
        "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay></Discovery></Domain></CycloneDDS>"
    )


def test_localhost_configuration_binds_to_loopback_without_multicast() -> None:
    assert cyclone_xml(DomainSettings(discovery_range=LOCALHOST), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/>'
        "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
        "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
    )


def test_system_default_configuration_is_empty() -> None:
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
def test_loopback_binding_is_skipped_for_remote_peers_own_interfaces_or_old_library(
    mode: DiscoveryRange, more: dict[str, Any], unsupported: tuple[str, ...], is_bound: bool
) -> None:
    text = cyclone_xml(DomainSettings(discovery_range=mode, **more), process_id=77, unsupported=unsupported)
    assert ('NetworkInterface address="127.0.0.1"' in text) is is_bound
    assert "<AllowMulticast>false</AllowMulticast>" in text
    assert ("<ParticipantIndex>none</ParticipantIndex><Tag>ros_discovery_off_77</Tag>" in text) is (mode is OFF)


def test_user_configuration_cannot_enable_multicast_in_localhost_mode() -> None:
    text = cyclone_xml(DomainSettings(discovery_range=LOCALHOST, cyclonedds_uri="file:///c.xml"), process_id=1)
    ours, theirs, last = text.split(",")
    assert "localhost" in ours and theirs == "file:///c.xml"
    assert last.endswith("<General><AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>")
    assert cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1).endswith(",<x/>")


def test_elements_unsupported_by_the_library_are_omitted() -> None:
    local = DomainSettings(discovery_range=LOCALHOST)
    last = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    text = cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last, unsupported=OPTIONAL_ELEMENTS)
    found = {element.tag for element in ElementTree.fromstring(text).iter()}
    assert not found & OPTIONAL_ELEMENTS and "ParticipantIndex" in found
    assert {
        one.tag for one in ElementTree.fromstring(cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last)).iter()
    } >= OPTIONAL_ELEMENTS


def test_shared_memory_is_disabled_after_the_user_configuration() -> None:
    text = cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1, last="<off/>")
    assert text.endswith(',<x/>,<CycloneDDS><Domain Id="any"><off/></Domain></CycloneDDS>')
    off = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    text = cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1, last=off, unsupported={"SharedMemory"})
    assert text.endswith(",<x/>")  # a library that was built without any would refuse the element


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1, max_size=8)))
def test_any_static_peer_text_is_escaped_in_the_xml(peers: list[str]) -> None:
    text = cyclone_xml(DomainSettings(static_peers=tuple(peers)), process_id=1)
    found = [element.get("address") for element in ElementTree.fromstring(text).iter("Peer")]
    assert found == peers
