"""Names of ROS topics, services and types in DDS, and the texts that ROS puts into USER_DATA.

Zenoh uses the same type names.

A name without the form of ROS is an unmangled topic, never an error: DDS programs that do not use ROS may share the
domain.

Source: docs/internals/protocol.md 4, 5.2, 6.1.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal

from rosidl_py_gen.runtime.transport.api import TopicKey


def wire_type(ros_name: str) -> str:
    """Convert ``std_msgs/msg/String`` to ``std_msgs::msg::dds_::String_``; return any other text unchanged."""
    parts = ros_name.split("/")
    if len(parts) != 3:
        return ros_name
    package, kind, name = parts
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(wire_name: str) -> str:
    """Convert ``std_msgs::msg::dds_::String_`` to ``std_msgs/msg/String``; return any other text unchanged."""
    if "dds_::" not in wire_name or not wire_name.endswith("_"):
        return wire_name
    return wire_name.replace("dds_::", "")[:-1].replace("::", "/")


_AFFIXES: Mapping[Literal["topic", "request", "reply"], tuple[str, str]] = {
    "topic": ("rt", ""),
    "request": ("rq", "Request"),
    "reply": ("rr", "Reply"),
}
"""Prefix and suffix that a topic name has in DDS, by kind of topic."""
BUFFER_SUFFIX = "/_buf_cpu"
"""Suffix of the second topic, to which publishers of Lyrical send messages with unbounded arrays of bytes (buffers).

Source: docs/internals/dds.md 14, zenoh.md 9.2.
"""
_PAIR = re.compile(rb"([A-Za-z0-9]+)=([^;]*);")


def wire_name(topic_key: TopicKey) -> str:
    """Return the DDS name of a topic: ``rt/chatter`` for ``/chatter``, ``rq/addRequest`` for requests of ``/add``."""
    if topic_key.kind == "unmangled":
        return topic_key.name
    prefix, suffix = _AFFIXES[topic_key.kind]
    return f"{prefix}{topic_key.name}{suffix}"


def topic_key_of(dds_name: str) -> TopicKey:
    """Return the key of the topic that has a name in DDS: the inverse of `wire_name`."""
    for kind, (prefix, suffix) in _AFFIXES.items():
        if dds_name.startswith(f"{prefix}/") and dds_name.endswith(suffix):
            return TopicKey(kind, dds_name[len(prefix) : len(dds_name) - len(suffix)])
    return TopicKey("unmangled", dds_name)


def participant_user_data(enclave: str = "/") -> bytes:
    """Return the USER_DATA that marks a participant as one of ROS."""
    return f"enclave={enclave};".encode()


def endpoint_user_data(type_hash: str, *, client_id: str = "", service_id: str = "", service_hash: str = "") -> bytes:
    """Return the USER_DATA of an endpoint. Empty values are omitted, because peers warn about malformed hashes."""
    pairs = {"clientid": client_id, "serviceid": service_id, "typehash": type_hash, "sertypehash": service_hash}
    return "".join(f"{key}={value};" for key, value in pairs.items() if value).encode()


def parse_user_data(data: bytes) -> dict[str, str]:
    """Return the ``key=value;`` pairs of USER_DATA before the first malformed pair; trailing NULs are ignored.

    rmw reads nothing of a text with a malformed pair: an enclave with ``;`` would hide all nodes of its participant.
    """
    text = data.rstrip(b"\0")
    pairs: dict[str, str] = {}
    position = 0
    while pair := _PAIR.match(text, position):
        pairs[pair[1].decode()] = pair[2].decode(errors="replace")
        position = pair.end()
    return pairs


def entity_id(gid: bytes) -> str:
    """Return a GID as text for ``clientid`` or ``serviceid`` in USER_DATA: 16 bytes in hex, joined by dots.

    There are no leading zeros, but the first byte is padded to two columns by a space.
    """
    first, *rest = gid
    return ".".join([f"{first:2x}", *(f"{byte:x}" for byte in rest)])
