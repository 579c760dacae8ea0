"""How ROS names appear in DDS, and the texts that ROS puts into USER_DATA.

Decides spelling only (docs/internals/protocol.md 4, 5.2, 6.1). A name that does not have the ROS shape is a bare one,
because DDS programs that know nothing of ROS share the same domain; they are never an error. Types are in
`type_names.py`.
"""

from __future__ import annotations

import re

from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

TOPIC_PREFIX = "rt"
REQUEST_PREFIX = "rq"
REPLY_PREFIX = "rr"

_PAIR = re.compile(rb"([A-Za-z0-9]+)=([^;]*);")


# ------------------------------------------------------------------------------------------------------------- names


def topic_name(fqn: str, *, prefix: bool = True) -> str:
    """``/chatter`` -> ``rt/chatter``; without `prefix` (avoid_ros_namespace_conventions) the name stays as it is."""
    return f"{TOPIC_PREFIX}{fqn}" if prefix else fqn


def request_name(fqn: str, *, prefix: bool = True) -> str:
    """``/add`` -> ``rq/addRequest``; the suffix stays without `prefix`."""
    return f"{REQUEST_PREFIX if prefix else ''}{fqn}Request"


def reply_name(fqn: str, *, prefix: bool = True) -> str:
    """``/add`` -> ``rr/addReply``; the suffix stays without `prefix`."""
    return f"{REPLY_PREFIX if prefix else ''}{fqn}Reply"


def wire_name(channel: TopicKey) -> str:
    """What DDS calls the topic of a channel."""
    match channel.kind:
        case "topic":
            return topic_name(channel.name)
        case "request":
            return request_name(channel.name)
        case "reply":
            return reply_name(channel.name)
        case "unmangled":
            return channel.name


def channel_of(dds_name: str) -> TopicKey:
    """``rt/chatter`` is a topic, ``rq/addRequest`` and ``rr/addReply`` are halves of a service; the rest is bare."""
    if dds_name.startswith("rt/"):
        return TopicKey("topic", dds_name[2:])
    if dds_name.startswith("rq/") and dds_name.endswith("Request"):
        return TopicKey("request", dds_name[2 : -len("Request")])
    if dds_name.startswith("rr/") and dds_name.endswith("Reply"):
        return TopicKey("reply", dds_name[2 : -len("Reply")])
    return TopicKey("unmangled", dds_name)


# --------------------------------------------------------------------------------------------------------- user data


def participant_user_data(enclave: str = "/") -> bytes:
    """What marks a participant as a ROS one."""
    return f"enclave={enclave};".encode()


def endpoint_user_data(type_hash: str, *, client_id: str = "", service_id: str = "") -> bytes:
    """USER_DATA of an endpoint; an empty hash is left out, since peers warn about malformed ones.

    Source: docs/internals/protocol.md 6.1.
    """
    text = ""
    if client_id:
        text += f"clientid={client_id};"
    if service_id:
        text += f"serviceid={service_id};"
    if type_hash:
        text += f"typehash={type_hash};"
    return text.encode()


def parse_user_data(data: bytes) -> dict[str, str]:
    """The pairs of ``key=value;`` text up to the first one that is malformed; trailing NULs are tolerated.

    rmw reads nothing of a text with a malformed pair: an enclave with ``;`` would hide all nodes of its participant.
    """
    text = data.rstrip(b"\0")
    found: dict[str, str] = {}
    position = 0
    while position < len(text):
        pair = _PAIR.match(text, position)
        if pair is None:
            break
        found[pair.group(1).decode()] = pair.group(2).decode(errors="replace")
        position = pair.end()
    return found


def entity_gid(text: str) -> bytes:
    """The 16 bytes behind an `entity_id`, which rmw_get_gid_for_client gives."""
    return bytes(int(part, 16) for part in text.split("."))


def entity_id(guid_prefix: bytes, counter: int) -> str:
    """The value of ``clientid`` and ``serviceid``: 16 bytes in hex, joined by dots.

    No leading zeros, except that the first byte takes two columns and is padded by a space
    (docs/internals/protocol.md 5.2).
    """
    first, *rest = guid_prefix[:12] + counter.to_bytes(4, "big")
    return ".".join([f"{first:2x}", *(f"{byte:x}" for byte in rest)])
