"""Key expressions of topics and services: docs/internals/zenoh.md 2, 7 and 9."""

from __future__ import annotations

import pytest

from rosidl_py_gen.runtime.transport.zenoh.wire_formats import cpu_buffer_key, data_key, valid_hash_or_empty

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING = "std_msgs::msg::dds_::String_"


@pytest.mark.parametrize(
    ("domain_id", "name", "type_name", "type_hash", "key"),
    [
        (0, "/chatter", STRING, HASH, f"0/chatter/{STRING}/{HASH}"),
        (0, "/robot1/chatter", STRING, HASH, f"0/robot1/chatter/{STRING}/{HASH}"),
        (232, "/chatter/", STRING, HASH, f"232/chatter/{STRING}/{HASH}"),
        (0, "chatter", STRING, HASH, f"0/chatter/{STRING}/{HASH}"),  # avoid_ros_namespace_conventions
        (7, "/chatter", STRING, "", f"7/chatter/{STRING}/TypeHashNotSupported"),
        (
            0,
            "/fibonacci/_action/send_goal",
            "example_interfaces::action::dds_::Fibonacci_SendGoal_",
            HASH,
            f"0/fibonacci/_action/send_goal/example_interfaces::action::dds_::Fibonacci_SendGoal_/{HASH}",
        ),
    ],
)
def test_a_key_is_made_of_domain_name_type_and_hash(
    domain_id: int, name: str, type_name: str, type_hash: str, key: str
) -> None:
    assert data_key(domain_id, name, type_name, type_hash) == key


@pytest.mark.parametrize(
    "chunk", ["", "TypeHashNotSupported", HASH[:-1], HASH + "0", HASH.upper(), HASH + "\n", HASH.replace("01_", "02_")]
)
def test_only_a_whole_hash_counts_as_one(chunk: str) -> None:
    assert valid_hash_or_empty(HASH) == HASH
    assert valid_hash_or_empty(chunk) == ""


def test_the_channel_of_buffers_lies_below_the_key() -> None:
    assert cpu_buffer_key(f"0/chatter/{STRING}/{HASH}") == f"0/chatter/{STRING}/{HASH}/_buf_cpu"
