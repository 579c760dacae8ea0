"""How ROS names appear in DDS, and the texts that ROS puts into USER_DATA.

Decides spelling only (protocol.md 4, 5.2, 6.1). A name that does not have the ROS shape demangles to None, because
DDS programs that know nothing of ROS share the same domain; they are never an error.
"""

from __future__ import annotations

import re

TOPIC_PREFIX = "rt"
REQUEST_PREFIX = "rq"
REPLY_PREFIX = "rr"
DISCOVERY_TOPIC = "ros_discovery_info"
DISCOVERY_TYPE = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"

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


def type_name(ros_name: str) -> str:
    """``std_msgs/msg/String`` -> ``std_msgs::msg::dds_::String_``."""
    package, kind, name = ros_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def demangle_topic(dds_name: str) -> str | None:
    """``rt/chatter`` -> ``/chatter``; None when it is not a ROS topic."""
    return dds_name[2:] if dds_name.startswith("rt/") else None


def demangle_service(dds_name: str) -> str | None:
    """``rq/addRequest`` or ``rr/addReply`` -> ``/add``; None when it is neither."""
    for prefix, suffix in (("rq/", "Request"), ("rr/", "Reply")):
        if dds_name.startswith(prefix) and dds_name.endswith(suffix):
            return dds_name[2 : -len(suffix)]
    return None


def demangle_type(dds_name: str) -> str | None:
    """``std_msgs::msg::dds_::String_`` -> ``std_msgs/msg/String``; None when it has another shape."""
    if "dds_::" not in dds_name or not dds_name.endswith("_"):
        return None
    return dds_name.replace("dds_::", "")[:-1].replace("::", "/")


def demangle_service_type(dds_name: str) -> str | None:
    """``p::srv::dds_::X_Request_`` -> ``p/srv/X``; None when it is not half of a service."""
    name = demangle_type(dds_name)
    for suffix in ("_Request", "_Response"):
        if name is not None and name.endswith(suffix):
            return name[: -len(suffix)]
    return None


# --------------------------------------------------------------------------------------------------------- user data


def participant_user_data(enclave: str = "/") -> bytes:
    """What marks a participant as a ROS one."""
    return f"enclave={enclave};".encode()


def endpoint_user_data(type_hash: str, *, client_id: str = "", service_id: str = "") -> bytes:
    """USER_DATA of an endpoint; an empty hash is left out, since peers warn about malformed ones (protocol.md 6.1)."""
    text = ""
    if client_id:
        text += f"clientid={client_id};"
    if service_id:
        text += f"serviceid={service_id};"
    if type_hash:
        text += f"typehash={type_hash};"
    return text.encode()


def parse_user_data(data: bytes) -> dict[str, str]:
    """The pairs of ``key=value;`` text; anything malformed yields an empty dict, trailing NULs are tolerated."""
    text = data.rstrip(b"\0")
    found: dict[str, str] = {}
    position = 0
    while position < len(text):
        pair = _PAIR.match(text, position)
        if pair is None:
            return {}
        found[pair.group(1).decode()] = pair.group(2).decode(errors="replace")
        position = pair.end()
    return found


def entity_gid(text: str) -> bytes:
    """The 16 bytes behind an `entity_id`, which rmw_get_gid_for_client gives."""
    return bytes(int(part, 16) for part in text.split("."))


def entity_id(guid_prefix: bytes, counter: int) -> str:
    """The value of ``clientid`` and ``serviceid``: 16 bytes in hex, joined by dots.

    No leading zeros, except that the first byte takes two columns and is padded by a space (protocol.md 5.2).
    """
    first, *rest = guid_prefix[:12] + counter.to_bytes(4, "big")
    return ".".join([f"{first:2x}", *(f"{byte:x}" for byte in rest)])
