"""ACKNACK packets for Fast DDS participants; replies of real ones: `interop_rclpy/test_graph.py`."""

from __future__ import annotations

import socket

import pytest

from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.early_samples import (
    acknack_packet,
    parse_locators,
    request_endpoints,
    request_samples,
)

OURS, THEIRS = bytes.fromhex("01100102030405060708090a000001c1"), bytes.fromhex("010f1112131415161718191a000001c1")
UDP4, UDP6 = socket.AF_INET, socket.AF_INET6


def test_the_question_names_both_and_begins_with_number_zero() -> None:
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
def test_only_a_few_unicast_addresses_count(text: str, locators: list[tuple[int, str, int]]) -> None:
    assert parse_locators(text) == locators


def test_it_is_sent_to_this_machine_only_when_nothing_may_leave_it() -> None:
    with socket.socket(UDP4, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        port = receiver.getsockname()[1]
        request_endpoints(OURS, THEIRS, f"udp/192.0.2.1:{port}@1,udp/127.0.0.1:{port}@1", is_local=True)
        data, sender = receiver.recvfrom(200)
    assert data == acknack_packet(OURS, THEIRS)
    assert sender[0] == "127.0.0.1"


def test_writers_are_asked_at_the_port_behind_that_of_discovery() -> None:
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
