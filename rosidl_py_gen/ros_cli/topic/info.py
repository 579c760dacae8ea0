"""Commands ``topic list``, ``find``, ``type`` and ``info``."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.graph_verbs import find_verb, graph_rows, type_verb

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Node, QoSProfile, TopicEndpointInfo

_hidden = click.option(
    "-a",
    "--include-hidden-topics",
    "--include-hidden",
    "hidden",
    is_flag=True,
    help="Include hidden topics: those with a part that begins with _.",
)


def _topics(node: Node) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "types": types,
            "publishers": node.count_publishers(name),
            "subscribers": node.count_subscribers(name),
        }
        for name, types in node.get_topic_names_and_types()
    ]


@click.command("list")
@options.show_types
@click.option("-v", "--verbose", is_flag=True, help="Show published and subscribed topics, and the numbers of each.")
@options.count("topics")
@_hidden
@options.as_json
@options.node_verb
async def list_(
    command_node: CommandNode, show_types: bool, verbose: bool, count: bool, hidden: bool, as_json: bool
) -> None:
    """Print the topics.

    \b
    rosidl-py topic list -t
    rosidl-py topic list --json | jq '.[].name'
    """
    rows = await graph_rows(command_node, _topics, hidden=hidden)
    if not verbose or as_json or count:
        terminal_output.names(rows, count, show_types, as_json)
        return
    for heading, kind in (("Published", "publisher"), ("Subscribed", "subscriber")):
        terminal_output.line(f"{heading} topics:", "bold")
        for row in rows:
            if number := row[f"{kind}s"]:
                terminal_output.line(f" * {row['name']} [{', '.join(row['types'])}] {pluralize(number, kind)}")
        terminal_output.line()


find = find_verb("topic", "msg", "sensor_msgs/msg/LaserScan", _topics, _hidden)
type_ = type_verb("topic", "rosidl-py interface show $(rosidl-py topic type /scan)", options.topic_timeout)


@click.command("info")
@options.topic_argument()
@click.option("-v", "--verbose", is_flag=True, help="Show node, type, GID and QoS of each publisher and subscription.")
@options.topic_timeout
@options.as_json
@options.node_verb
async def info(command_node: CommandNode, topic: str, timeout_s: float | None, verbose: bool, as_json: bool) -> None:
    """Print the type of a topic, and its publishers and subscriptions.

    \b
    rosidl-py topic info /scan -v
    """
    node = command_node.node
    name = await command_node.find("topic", topic, timeout_s)
    await (command_node.wait_for_node_names() if verbose or as_json else command_node.wait_for_discovery())
    types = dict(node.get_topic_names_and_types()).get(name, [])
    publishers = node.get_publishers_info_by_topic(name)
    subscriptions = node.get_subscriptions_info_by_topic(name)
    incompatible = [
        f"no messages from {one.writer.node_text} to {one.reader.node_text}: {one.reason}"
        for one in node.incompatible_endpoints_of_topic(name)
    ]
    if as_json:
        endpoints = {"publishers": [*map(_row, publishers)], "subscribers": [*map(_row, subscriptions)]}
        terminal_output.document({"name": name, "types": types, **endpoints, "mismatches": incompatible})
        return
    separator = [""] if verbose else []
    terminal_output.lines([f"Type: {types[0] if len(types) == 1 else types}", *separator])
    for heading, endpoints_of_kind in (("Publisher", publishers), ("Subscription", subscriptions)):
        terminal_output.line(f"{heading} count: {len(endpoints_of_kind)}", "bold" if verbose else "")
        terminal_output.lines(separator)
        for endpoint in endpoints_of_kind if verbose else ():
            terminal_output.lines([*_description(endpoint), ""])
    for text in incompatible if verbose else ():
        terminal_output.line(f"warning: {text}", "yellow")


def _description(endpoint: TopicEndpointInfo) -> list[str]:
    """Return lines about an endpoint in the form of rclpy's ``TopicEndpointInfo``."""
    return [
        f"Node name: {endpoint.node_name}",
        f"Node namespace: {endpoint.node_namespace}",
        f"Topic type: {endpoint.topic_type}",
        f"Topic type hash: {endpoint.topic_type_hash or 'INVALID'}",
        f"Endpoint type: {endpoint.endpoint_type.name}",
        f"GID: {endpoint.endpoint_gid.hex('.')}",
        "QoS profile:",
        *_profile_lines(endpoint.qos_profile),
    ]


def _profile_lines(qos: QoSProfile) -> Iterator[str]:
    from rosidl_py_gen.runtime import History
    from rosidl_py_gen.runtime import qos as presets

    depth = f" ({qos.depth})" if qos.history is History.KEEP_LAST else ""
    for policy in presets.POLICIES:
        value = getattr(qos, policy.field)
        if policy.enum is not None:
            yield f"  {policy.label}: {value.name}{depth if policy.field == 'history' else ''}"
        elif policy.is_period:
            yield f"  {policy.label}: {_period(value)}"
        elif policy.label:
            yield f"  {policy.label}: {value}"


def _row(endpoint: TopicEndpointInfo) -> dict[str, Any]:
    return {
        "node": endpoint.node_name,
        "namespace": endpoint.node_namespace,
        "type": endpoint.topic_type,
        "type_hash": endpoint.topic_type_hash,
        "gid": endpoint.endpoint_gid.hex("."),
        "qos": _qos_row(endpoint.qos_profile),
    }


def _qos_row(qos: QoSProfile) -> dict[str, Any]:
    from rosidl_py_gen.runtime import qos as presets

    # Discovery does not say whether a name has the prefix of ROS.
    named = {
        policy.field: getattr(qos, policy.field)
        for policy in presets.POLICIES
        if policy.label or policy.field == "depth"
    }
    return {field: value.name.lower() if isinstance(value, Enum) else value for field, value in named.items()}


def _period(period_ns: int) -> str:
    from rosidl_py_gen.runtime import qos as presets

    return "Infinite" if period_ns == presets.INFINITE_NS else f"{period_ns} nanoseconds"
