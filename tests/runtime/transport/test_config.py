"""The configuration of Cyclone: docs/internals/protocol.md 10.6."""

from __future__ import annotations

from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings
from rosidl_py_gen.runtime.transport.cyclone.config import DEFAULT_CONFIG, OPTIONAL_ELEMENTS, cyclone_xml


def test_subnet_sets_what_ros_peers_expect() -> None:
    assert cyclone_xml(DomainSettings(), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex>'
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><SPDPInterval>3s</SPDPInterval>"
        "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay></Discovery></Domain></CycloneDDS>"
    )


def test_localhost_has_no_multicast_binds_to_loopback_and_asks_localhost() -> None:
    assert cyclone_xml(DomainSettings(discovery_range=DiscoveryRange.LOCALHOST), process_id=1) == (
        '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/>'
        "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
        "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
    )


def test_off_has_a_tag_of_its_own() -> None:
    text = cyclone_xml(DomainSettings(discovery_range=DiscoveryRange.OFF), process_id=77)
    assert "<ParticipantIndex>none</ParticipantIndex><Tag>ros_discovery_off_77</Tag>" in text
    assert "<AllowMulticast>false</AllowMulticast>" in text and 'address="127.0.0.1"' in text


def test_system_default_says_nothing() -> None:
    assert cyclone_xml(DomainSettings(discovery_range=DiscoveryRange.SYSTEM_DEFAULT), process_id=1) == ""


def test_a_static_peer_elsewhere_or_chosen_interfaces_keep_us_from_binding() -> None:
    away = DomainSettings(discovery_range=DiscoveryRange.LOCALHOST, static_peers=("10.1.2.3",))
    assert "127.0.0.1" not in cyclone_xml(away, process_id=1)
    home = DomainSettings(discovery_range=DiscoveryRange.LOCALHOST, static_peers=("127.0.0.1",))
    assert 'NetworkInterface address="127.0.0.1"' in cyclone_xml(home, process_id=1)
    inner = '<General><Interfaces><NetworkInterface name="lo"/></Interfaces></General>'
    uri = f"<CycloneDDS><Domain>{inner}</Domain></CycloneDDS>"
    chosen = DomainSettings(discovery_range=DiscoveryRange.LOCALHOST, cyclonedds_uri=uri)
    assert "127.0.0.1" not in cyclone_xml(chosen, process_id=1)


def test_the_users_configuration_comes_after_ours_but_cannot_turn_multicast_on_in_localhost_mode() -> None:
    text = cyclone_xml(
        DomainSettings(discovery_range=DiscoveryRange.LOCALHOST, cyclonedds_uri="file:///c.xml"), process_id=1
    )
    ours, theirs, last = text.split(",")
    assert "localhost" in ours and theirs == "file:///c.xml"
    assert last.endswith("<General><AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>")
    assert cyclone_xml(DomainSettings(cyclonedds_uri="<x/>"), process_id=1).endswith(",<x/>")


def test_extra_elements_are_placed_in_the_domain() -> None:
    text = cyclone_xml(DomainSettings(), process_id=1, extra="<Internal/>")
    assert "</Discovery><Internal/></Domain>" in text


def test_what_a_library_does_not_know_is_left_out() -> None:
    local = DomainSettings(discovery_range=DiscoveryRange.LOCALHOST)
    last = "<SharedMemory><Enable>false</Enable></SharedMemory>"
    text = cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last, unsupported=OPTIONAL_ELEMENTS)
    found = {element.tag for element in ElementTree.fromstring(text).iter()}
    assert not found & OPTIONAL_ELEMENTS and "ParticipantIndex" in found
    assert {
        one.tag for one in ElementTree.fromstring(cyclone_xml(local, process_id=1, extra=DEFAULT_CONFIG + last)).iter()
    } >= OPTIONAL_ELEMENTS


def test_a_library_before_11_is_bound_to_loopback_only_where_nobody_shall_be_found() -> None:
    for mode, is_bound in ((DiscoveryRange.LOCALHOST, False), (DiscoveryRange.OFF, True)):
        text = cyclone_xml(DomainSettings(discovery_range=mode), process_id=1, unsupported={"IgnoreTypeInformation"})
        assert ("127.0.0.1" in text) is is_bound and "<AllowMulticast>false</AllowMulticast>" in text


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
