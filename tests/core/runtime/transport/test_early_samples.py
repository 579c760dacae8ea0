"""Requests for samples sent before the first heartbeat; real peers: `interop_rclpy/test_services.py`."""

from __future__ import annotations

import ctypes as ct
import socket
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String
from support.inner_state import participant_of

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsSupport
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.peers import (
    EarlySampleReaders,
    acknack_packet,
    parse_locators,
    request_endpoints,
    request_samples,
)

if TYPE_CHECKING:
    from support.worlds import World

    from rosidl_py_gen.runtime import Node

SUPPORT = cyclone.FAST_DDS_SUPPORT
OURS, THEIRS = bytes.fromhex("01100102030405060708090a000001c1"), bytes.fromhex("010f1112131415161718191a000001c1")
UDP4, UDP6 = socket.AF_INET, socket.AF_INET6


def test_acknack_packet_bytes_name_both_participants_and_start_at_zero() -> None:
    assert acknack_packet(OURS, THEIRS).hex(" ", 4) == (
        "52545053 02010110 01100102 03040506 0708090a "  # RTPS 2.1, Cyclone DDS, our prefix
        "0e010c00 010f1112 13141516 1718191a "  # INFO_DST: their prefix
        "06011800 000003c7 000003c2 00000000 00000000 00000000 00000000 "  # ACKNACK of publications: base, bits, count
        "06011800 000004c7 000004c2 00000000 00000000 00000000 00000000"
    )


@pytest.mark.parametrize(
    ("text", "locators"),
    [
        ("udp/127.0.0.1:7412@1", [(UDP4, "127.0.0.1", 7412)]),
        ("udp/10.0.0.5:7410@2,udp/239.255.0.1:7400@2", [(UDP4, "10.0.0.5", 7410)]),
        ("udp6/[fe80::1]:7410@3,udp/10.0.0.5:7410", [(UDP6, "fe80::1", 7410), (UDP4, "10.0.0.5", 7410)]),
        ("udp6/[ff02::1]:7400@3", []),
        ("tcp/10.0.0.5:7410@2", []),
        ("udp/10.0.0.5:0", []),
        ("udp/10.0.0.5:65536", []),
        ("udp/10.0.0.500:7410", []),
        ("localprocess", []),
        ("", []),
        (
            ",".join(f"udp/10.0.0.{number}:7410" for number in range(1, 100)),
            [(UDP4, f"10.0.0.{n}", 7410) for n in range(1, 9)],
        ),
    ],
)
def test_parse_locators_returns_at_most_eight_unicast_addresses(
    text: str, locators: list[tuple[int, str, int]]
) -> None:
    assert parse_locators(text) == locators


def test_endpoint_request_is_sent_only_to_loopback_in_local_mode() -> None:
    with socket.socket(UDP4, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        port = receiver.getsockname()[1]
        request_endpoints(OURS, THEIRS, f"udp/192.0.2.1:{port}@1,udp/127.0.0.1:{port}@1", is_local=True)
        data, sender = receiver.recvfrom(200)
    assert data == acknack_packet(OURS, THEIRS)
    assert sender[0] == "127.0.0.1"


def test_sample_requests_are_sent_to_the_port_after_discovery_in_limited_packets() -> None:
    reader, writer = OURS[:12] + b"\0\0\x0a\x04", THEIRS[:12] + b"\0\0\x14\x03"
    with socket.socket(UDP4, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        addresses = f"udp/127.0.0.1:{receiver.getsockname()[1] - 1}@1"
        request_samples([(reader, writer)], addresses, is_local=True)
        assert receiver.recv(200).hex(" ", 4) == (
            "52545053 02010110 01100102 03040506 0708090a 0e010c00 010f1112 13141516 1718191a "
            "06011800 00000a04 00001403 00000000 00000000 00000000 00000000"
        )
        request_samples([(reader, writer)] * 1000, addresses, is_local=True)
        counts = [(len(receiver.recv(9000)) - 36) / 28 for _ in range(8)]
        receiver.setblocking(False)
        with pytest.raises(BlockingIOError):
            receiver.recv(9000)
    assert counts == [40] * 8


ALL = 2
KINDS = [
    pytest.param(QoSProfile(depth=5), True, id="reliable, volatile"),
    pytest.param(QoSProfile(depth=5).transient_local(), True, id="reliable, transient local"),
    pytest.param(QoSProfile(depth=5).best_effort(), False, id="best effort"),
]


def flags_of(entity: int) -> int:
    """Return the flags of a reader in Cyclone."""
    offsets = SUPPORT.reader_offsets
    assert offsets is not None
    with cyclone.API.locked_entity(entity) as address:
        reader = ct.c_uint64.from_address(address + offsets.entity).value
        return ct.c_ubyte.from_address(reader + offsets.flags).value


def newest_reader(node: Node) -> Any:
    participant = participant_of(node)
    return list(participant.readers.values())[-1]


@pytest.mark.parametrize(("qos", "wants_all"), KINDS)
def test_reliable_readers_request_existing_samples(dds: World, qos: QoSProfile, wants_all: bool) -> None:
    node = dds.node()
    node.create_subscription(String, "topic", qos=qos)
    flags = flags_of(newest_reader(node).entity)
    assert (flags & 1, bool(flags & ALL)) == (wants_all, wants_all)


def test_history_flag_is_set_before_the_first_writer_is_matched(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    node = dds.node()
    node.create_publisher(String, "topic")
    request = private_layout.set_requests_history
    # Only the listener, which does not know the profile, sets the flag here, not the code after the creation.
    monkeypatch.setattr(private_layout, "set_requests_history", lambda *a: None if a[-1] is not None else request(*a))
    node.create_subscription(String, "topic")
    assert flags_of(newest_reader(node).entity) & ALL
    node.create_subscription(String, "nobody_writes_here")
    assert not flags_of(newest_reader(node).entity) & ALL


def test_readers_are_not_modified_if_their_layout_is_unknown(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    unknown, participant = FastDdsSupport(cyclone.API), participant_of(dds.node())
    early = EarlySampleReaders(unknown, listener := cyclone.API.create_listener(None))
    monkeypatch.setattr(private_layout, "probe_reader_offsets", lambda *_: None)
    early.probe_layout(participant.discovery.entities[0])
    reason = unknown.capabilities()["first samples of nodes on Fast DDS"]
    assert reason == "the layout of readers is unknown in this library"
    listeners: list[int] = []
    assert early.create_reader(lambda listener: (listeners.append(listener), 7)[1], is_reliable=True) == 7
    assert listeners == [listener]
    early.close()
    cyclone.API.delete_listener(listener)


def test_reader_of_unexpected_layout_is_not_modified_and_disables_the_feature(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, known = dds.node(), SUPPORT.reader_offsets
    assert known is not None
    monkeypatch.setattr(SUPPORT, "early_refusal", "")  # restored at the end
    with monkeypatch.context() as patch:
        patch.setattr(SUPPORT, "reader_offsets", known._replace(entity=known.entity - 16))  # another pointer
        node.create_subscription(String, "topic")
    assert "a reader, " in SUPPORT.early_refusal
    assert not flags_of(newest_reader(node).entity) & ALL
