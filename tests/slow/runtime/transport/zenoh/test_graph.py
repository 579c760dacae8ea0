"""Graph of liveliness tokens, including tokens that no ROS node declares."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EntityLost, NodesAnnounced, ParticipantDiscovered
from rosidl_py_gen.runtime.transport.qos import DEFAULT
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    EndpointToken,
    EntityKind,
    NodeToken,
    TokenGraph,
    endpoints_of,
    gid_of,
    participant_guid,
    read_token,
)

ODD = [
    "@ros2_lv/0/1a/5/5/NN/%/%/a",
    "@ros2_lv/0/1a/5/6/NN/%/%/b",
    "@ros2_lv/0/1a/05/5/NN/%/%/a",
    "@ros2_lv/0/1a/5/5/NN/%/%/a/later",
    "@ros2_lv/0/01a/5/5/NN/%/%/a",
    "@ros2_lv/0/1a/5/7/MP/%/%/a/%t/T/H/::,10:,:,:,,",
    "@ros2_lv/0/1a/05/7/MS/%/%/b/%t/T/H/::,10:,:,:,,",
    "@ros2_lv/0/1a/6/7/SC/%/%/c/%s/T/H/::,10:,:,:,,",
    "@ros2_lv/0/1a/6/7/SS/%/%/c/%s/T/H/::,10:,:,:,,",
    "@ros2_lv/0/2b/5/5/NN/%/%/a",
    "@ros2_lv/0/ff/5/5/NN/%/%/ours",
    "stray",
]


def present_guids(graph: TokenGraph) -> set[bytes]:
    """Return the GUIDs that were discovered and not lost."""
    guids: set[bytes] = set()
    for event in graph.events():
        if isinstance(event, ParticipantDiscovered | DiscoveredEndpoint):
            guids.add(event.guid)
        elif isinstance(event, EntityLost):
            guids.remove(event.guid)
    return guids


@given(st.lists(st.tuples(st.booleans(), st.sampled_from(ODD), st.booleans())))
def test_liveliness_tokens_in_any_order_raise_no_error_and_leave_no_entity(
    changes: list[tuple[bool, str, bool]],
) -> None:
    graph = TokenGraph("ff", "/")
    for is_declared, text, is_read in changes:
        graph.on_token(is_declared, text)
        if is_read:
            graph.read()
    for text in ODD:
        graph.on_token(False, text)
        graph.read()
    assert present_guids(graph) == {participant_guid("ff")}


def test_participant_exists_until_its_last_node_token_is_removed() -> None:
    graph = TokenGraph("ff", "/")
    for text in ODD[:2]:
        graph.on_token(True, text)
    graph.events()
    graph.on_token(False, ODD[0])
    assert [type(event) for event in graph.events()] == [NodesAnnounced]
    graph.on_token(False, ODD[1])
    assert graph.events() == [EntityLost(participant_guid("1a"))]


def test_endpoint_whose_token_reappears_is_matched_again() -> None:
    graph = TokenGraph("ff", "/")
    node = NodeToken(0, "1a", 1, "m")
    tokens = [str(node), str(EndpointToken(node, 2, EntityKind.PUBLISHER, "/t", "p::msg::dds_::X_", "", DEFAULT))]
    mine = EndpointToken(NodeToken(0, "ff", 1, "n"), 2, EntityKind.SUBSCRIPTION, "/t", "p::msg::dds_::X_", "", DEFAULT)
    (reader,) = endpoints_of(mine, gid_of(str(mine)))
    known = []
    for is_declared in (True, False, True, True, False):
        for token in tokens:
            graph.on_token(is_declared, token)
        known.append(len(graph.connected(reader)))
    assert known == [1, 0, 1, 1, 0]


def test_services_without_hash_match_regardless_of_message_hashes() -> None:
    graph = TokenGraph("ff", "/")
    token = EndpointToken(NodeToken(0, "ff", 1, "n"), 2, EntityKind.CLIENT, "/s", "p::srv::dds_::X_", "", DEFAULT)
    replies = replace(endpoints_of(token, gid_of(str(token)))[0], type_hash="RIHS01_" + 64 * "0")
    server = str(EndpointToken(NodeToken(0, "1a", 1, "m"), 2, EntityKind.SERVER, "/s", "p::srv::dds_::X_", "", DEFAULT))
    assert read_token(server) is not None
    graph.on_token(True, server)
    assert [one.participant_guid for one in graph.connected(replies).values()] == [participant_guid("1a")]
