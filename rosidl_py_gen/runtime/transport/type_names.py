"""How types are called on the wire, by DDS and by Zenoh, which took it over (docs/internals/protocol.md 4)."""

from __future__ import annotations


def wire_type(ros_name: str) -> str:
    """``std_msgs/msg/String`` -> ``std_msgs::msg::dds_::String_``; what is no name of ROS stays as it is."""
    parts = ros_name.split("/")
    if len(parts) != 3:
        return ros_name
    package, kind, name = parts
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(wire_name: str) -> str:
    """``std_msgs::msg::dds_::String_`` -> ``std_msgs/msg/String``; what has another shape stays as it is."""
    if "dds_::" not in wire_name or not wire_name.endswith("_"):
        return wire_name
    return wire_name.replace("dds_::", "")[:-1].replace("::", "/")
