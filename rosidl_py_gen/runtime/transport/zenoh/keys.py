"""Key expressions of topics and services.

A key contains the type hash and is matched as a whole: two endpoints with different definitions exchange nothing, and
Zenoh reports nothing.

Source: docs/internals/zenoh.md 2 and 9 (rmw_zenoh_cpp, liveliness_utils.cpp, `TopicInfo`).
"""

from __future__ import annotations

import re

HASH_NOT_SUPPORTED = "TypeHashNotSupported"
"""Replaces the type hash in Humble, which has none, in its format, and where the hash is unknown."""
FORMAT_VARIABLE = "ROSIDL_PY_GEN_ZENOH_FORMAT"
"""Environment variable; with ``humble``, own keys and tokens have no hash."""
_TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")


def data_key(domain_id: int, name: str, type_name: str, type_hash: str) -> str:
    """Return the key of a topic's samples or of a service's requests.

    Args:
        name: resolved name, ``/robot1/chatter``.
        type_name: ``std_msgs::msg::dds_::String_``; of a service without ``Request_`` and ``Response_``.
        type_hash: of the message, or of the *service*; empty if unknown.
    """
    inner = name.removeprefix("/").removesuffix("/")
    return f"{domain_id}/{inner}/{type_name}/{type_hash or HASH_NOT_SUPPORTED}"


def valid_hash_or_empty(chunk: str) -> str:
    """Return the type hash of a key or token; empty if it is not a valid one, as in Humble."""
    return chunk if _TYPE_HASH.match(chunk) else ""


def cpu_buffer_key(key: str) -> str:
    """Return the key on which publishers of Lyrical and later send to endpoints with `CPU_BACKEND` in their tokens.

    They do so for messages with an unbounded array of bytes that are not transient local; other messages, and all of
    earlier distributions, are sent on the key itself (docs/internals/zenoh.md 9.2). Arrays in nested messages count
    from rosidl_typesupport_fastrtps 3.10.1 on, by its release notes.
    """
    return f"{key}/_buf_cpu"
