"""The key expressions that topics and services have in Zenoh.

Decides how a ROS name, a type and its hash become a key, for topics and services alike; names are resolved and valid
before they come here, types are the DDS ones. A key is matched as a whole: another hash is another key, so that two
ends whose definitions differ never exchange anything, and are not told.

Source: docs/internals/zenoh.md 2 and 9 (rmw_zenoh_cpp, liveliness_utils.cpp, `TopicInfo`).
"""

from __future__ import annotations

import re

HASH_NOT_SUPPORTED = "TypeHashNotSupported"
"""Stands where a type hash would: Humble has none. So have ours in its format, and where a type came without a hash."""

FORMAT_VARIABLE = "ROSIDL_PY_GEN_ZENOH_FORMAT"
"""Of the environment: with ``humble`` no key or token of ours has a hash."""

_SERVICE_HALVES = ("Request_", "Response_")
_TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")


def data_key(domain_id: int, name: str, type_name: str, type_hash: str) -> str:
    """The key of a topic's samples, or of a service's requests.

    Args:
        name: fully qualified, ``/robot1/chatter``.
        type_name: ``std_msgs::msg::dds_::String_``; of a service as `service_type` gives it.
        type_hash: of the message, or of the *service*; empty where none is known.
    """
    inner = name.removeprefix("/").removesuffix("/")
    return f"{domain_id}/{inner}/{type_name}/{type_hash or HASH_NOT_SUPPORTED}"


def service_type(half: str) -> str:
    """``p::srv::dds_::X_Request_`` and ``p::srv::dds_::X_Response_`` -> ``p::srv::dds_::X_``; others stay."""
    for ending in _SERVICE_HALVES:
        if half.endswith("_" + ending):
            return half.removesuffix(ending)
    return half


def valid_hash_or_empty(chunk: str) -> str:
    """The type hash that a key or a token carries; empty when it is none, as Humble's."""
    return chunk if _TYPE_HASH.match(chunk) else ""


def cpu_buffer_key(key: str) -> str:
    """Where publishers of Lyrical and later send some messages to those whose token says `tokens.CPU_BACKEND`.

    That is done for messages with an unbounded array of bytes that are not transient local; others, and publishers of
    earlier distributions, use the key itself (docs/internals/zenoh.md 9.2). Arrays inside nested messages count since
    3.10.1 of rosidl_typesupport_fastrtps, by its release notes.
    """
    return f"{key}/_buf_cpu"
