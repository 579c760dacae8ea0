"""Bytes of the protocol: names, USER_DATA, the graph message."""

from __future__ import annotations

import pytest
from support.raw_endpoints import found

from rosidl_py_gen import type_hash
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.rmw_dds_common.msg import Gid, NodeEntitiesInfo, ParticipantEntitiesInfo
from rosidl_py_gen.runtime.graph import BARE_DDS_NODE, UNKNOWN_NODE, Graph
from rosidl_py_gen.runtime.transport.api import (
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
)
from rosidl_py_gen.runtime.transport.dds import discovery_info
from rosidl_py_gen.runtime.transport.dds import names as ddsnames
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
from rosidl_py_gen.runtime.transport.qos import DEFAULT

PREFIX = bytes.fromhex("0110f307 0a0b0c0d 01020304")
GUID = PREFIX + b"\0\0\1\xc1"


@pytest.mark.parametrize(
    ("dds", "kind", "name"),
    [
        ("rt/ns/t", "topic", "/ns/t"),
        ("rq/ns/sRequest", "request", "/ns/s"),
        ("rr/ns/sReply", "reply", "/ns/s"),
        ("rq/ns/sReply", "unmangled", "rq/ns/sReply"),
        ("ros_discovery_info", "unmangled", "ros_discovery_info"),
        ("/ns/t", "unmangled", "/ns/t"),
    ],
)
def test_dds_topic_names_convert_to_topic_keys_and_back(dds: str, kind: str, name: str) -> None:
    topic_key = ddsnames.topic_key_of(dds)
    assert topic_key == (kind, name) and ddsnames.wire_name(topic_key) == dds


def test_type_names_without_ros_mangling_stay_unchanged() -> None:
    assert [ddsnames.ros_type(name) for name in ("std_msgs::msg::dds_::String_", "HelloWorld")] == [
        "std_msgs/msg/String",
        "HelloWorld",
    ]


@pytest.mark.parametrize(
    ("type", "service"),
    [
        ("pkg::srv::dds_::X_Response_", "pkg/srv/X"),
        ("pkg::action::dds_::X_SendGoal_Request_", "pkg/action/X_SendGoal"),
        ("pkg::msg::dds_::X_", None),
        ("X_Request", None),
    ],
)
def test_service_type_is_derived_from_request_or_response_type(type: str, service: str | None) -> None:
    assert found(bytes(16), bytes(16), "rq/sRequest", type, DEFAULT).service_type == service


def test_user_data_of_participants_and_endpoints_is_formatted_like_ros() -> None:
    assert ddsnames.participant_user_data() == b"enclave=/;"
    assert ddsnames.endpoint_user_data("RIHS01_ab") == b"typehash=RIHS01_ab;"
    assert ddsnames.endpoint_user_data("RIHS01_ab", client_id=" 1.2") == b"clientid= 1.2;typehash=RIHS01_ab;"
    assert ddsnames.endpoint_user_data("", service_id="1.2") == b"serviceid=1.2;"
    both = ddsnames.endpoint_user_data("RIHS01_ab", service_hash="RIHS01_cd")
    assert both == b"typehash=RIHS01_ab;sertypehash=RIHS01_cd;"
    assert ddsnames.parse_user_data(both) == {"typehash": "RIHS01_ab", "sertypehash": "RIHS01_cd"}
    prefix = bytes.fromhex("0110f307000a000100000001")
    assert ddsnames.entity_id(prefix + b"\0\0\0\2") == " 1.10.f3.7.0.a.0.1.0.0.0.1.0.0.0.2"
    assert ddsnames.entity_id(b"\xab" + prefix[1:] + b"\0\0\1\2").startswith("ab.10.")
    assert ddsnames.entity_id(prefix + b"\0\0\1\2").endswith(".0.0.1.2")


@pytest.mark.parametrize(
    ("data", "pairs"),
    [
        (b"enclave=/;", {"enclave": "/"}),
        (b"typehash=x;serviceid= 1.2;\0\0", {"typehash": "x", "serviceid": " 1.2"}),
        (b"", {}),
        (b"broken", {}),
        (b"a=b;broken", {"a": "b"}),
        (b"enclave=/a;b;", {"enclave": "/a"}),
        (b"a_b=c;", {}),
        (b"typehash=x;bufbe=cpu=;", {"typehash": "x", "bufbe": "cpu="}),  # rmw_fastrtps of Lyrical, from 9.4.7 on
        (b"typehash=x;BUFBE:cpu=;", {"typehash": "x"}),  # 9.4.6
        (b"clientid= 1.2;typehash=x;sertypehash=y;", {"clientid": " 1.2", "typehash": "x", "sertypehash": "y"}),
    ],
)
def test_user_data_is_parsed_up_to_the_first_malformed_pair(data: bytes, pairs: dict[str, str]) -> None:
    assert ddsnames.parse_user_data(data) == pairs


def test_graph_message_equals_the_encoded_generated_class() -> None:
    reader, writer = PREFIX + b"\0\0\5\4", PREFIX + b"\0\0\6\3"
    data = discovery_info.encode_message(GUID, [NodeEntities("/ns", "n", frozenset([reader]), frozenset([writer]))])
    expected = ParticipantEntitiesInfo(
        gid=Gid(data=GUID),
        node_entities_info_seq=[
            NodeEntitiesInfo("/ns", "n", reader_gid_seq=[Gid(data=reader)], writer_gid_seq=[Gid(data=writer)])
        ],
    )
    assert data == expected.encode()
    assert type_hash(ParticipantEntitiesInfo) == HASHES["rmw_dds_common/msg/ParticipantEntitiesInfo"]
    assert discovery_info.decode_message(data, PREFIX).nodes[0].writer_gids == {writer}


def test_an_invalid_name_or_guid_hides_no_other_node_of_the_participant() -> None:
    good = NodeEntities("/", "good", frozenset(), frozenset())
    for name in ("", "a b", "a\0b", "\n\x1b[31m", "x" * 2_000_000):
        sent = (good, NodeEntities("no//ns", name, frozenset(), frozenset()), good)
        message = discovery_info.encode_message(PREFIX + b"\0\0\0\7", sent)
        assert discovery_info.decode_message(message, PREFIX) == NodesAnnounced(GUID, sent, False)


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\1\0\0" + GUID, b"\0\1\0\0" + GUID + b"\xff" * 30])
def test_malformed_graph_messages_raise_decode_error(data: bytes) -> None:
    with pytest.raises(DecodeError):
        discovery_info.decode_message(data, PREFIX)


def test_node_of_endpoint_is_its_node_or_a_placeholder() -> None:
    index = EndpointIndex()
    graph = Graph(index)
    writer = found(PREFIX + b"\0\0\6\3", GUID, "rt/t", "std_msgs::msg::dds_::String_", DEFAULT)
    index.apply([writer])
    assert graph.node_of(writer) == BARE_DDS_NODE
    index.apply([ParticipantDiscovered(GUID, "/")])
    assert graph.node_of(writer) == UNKNOWN_NODE
    stale = PREFIX + b"\0\0\7\3"
    index.set_nodes(GUID, [NodeEntities("/ns", "n", frozenset(), frozenset([writer.guid, stale]))])
    assert graph.node_of(writer) == ("/ns", "n")
    assert graph.of_node("n", "/ns", writers=True) == [("/t", ["std_msgs/msg/String"])]
    index.apply([EntityLost(writer.guid)])
    assert graph.of_node("n", "/ns", writers=True) == []
    index.apply([EntityLost(GUID)])
    assert graph.nodes() == []


def test_completeness_of_a_participant_does_not_depend_on_other_participants() -> None:
    index, other = EndpointIndex(), PREFIX[:-1] + b"\5\0\0\1\xc1"
    graph = Graph(index)
    writer = found(PREFIX + b"\0\0\6\3", GUID, "rt/t", "std_msgs::msg::dds_::String_", DEFAULT)
    late = found(other[:12] + b"\0\0\7\3", other, "rt/t", "std_msgs::msg::dds_::String_", DEFAULT)

    def known(of: bytes | None = None) -> tuple[bool, bool]:
        return graph.node_names_complete(of), graph.endpoints_complete(of)

    assert known(GUID) == (True, False)  # the participant itself is not known yet
    for one in (writer, ParticipantDiscovered(GUID, "/"), ParticipantDiscovered(other, "/")):
        index.apply([one])
    assert (known(GUID), known(other)) == ((False, True), (False, True))
    index.set_nodes(GUID, [NodeEntities("/", "n", frozenset(), frozenset([writer.guid]))])
    index.set_nodes(other, [NodeEntities("/", "o", frozenset(), frozenset([late.guid]))])
    assert (known(GUID), known(other), known()) == ((True, True), (True, False), (True, False))
    index.set_nodes(other, [NodeEntities("/", "o", frozenset(), frozenset())])
    index.apply([late])
    assert (known(GUID), known(other), known()) == ((True, True), (False, True), (False, True))
