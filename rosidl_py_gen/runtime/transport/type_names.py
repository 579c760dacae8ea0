"""Conversion of type names between ROS and the wire, where DDS and Zenoh use the same ones.

Source: docs/internals/protocol.md 4.
"""

from __future__ import annotations


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
