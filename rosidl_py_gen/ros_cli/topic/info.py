"""``topic info`` and ``topic type``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions
    from rosidl_py_gen.runtime import QoSProfile, TopicEndpointInfo


async def _show_topic(
    network: NetworkOptions,
    topic: str,
    timeout_s: float | None,
    as_json: bool,
    verbose: bool = False,
    only_type: bool = False,
) -> int:
    """Print the type of a topic, or also who publishes and subscribes."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import find_topic

    async with CommandNode(network) as session:
        name = await find_topic(session, topic, timeout_s)
        await (session.wait_for_node_names() if verbose else session.wait_for_discovery())
        node = session.node
        types = dict(node.get_topic_names_and_types()).get(name, [])
        publishers = node.get_publishers_info_by_topic(name)
        subscribers = node.get_subscriptions_info_by_topic(name)
        apart = [
            f"no messages from {one.writer.node_text} to {one.reader.node_text}: {one.reason}"
            for one in node.incompatible_endpoints_of_topic(name)
        ]
    if only_type:
        if as_json:
            terminal_output.document(types)
        else:
            terminal_output.lines(types)
    elif as_json:
        ends = {"publishers": [*map(_plain, publishers)], "subscribers": [*map(_plain, subscribers)]}
        terminal_output.document({"name": name, "types": types, **ends, "mismatches": apart})
    else:
        _show(types, publishers, subscribers, verbose)
        for text in apart if verbose else ():
            terminal_output.line(f"warning: {text}", "yellow")
    return 0


@click.command("info")
@options.topic_argument()
@click.option("-v", "--verbose", is_flag=True, help="Show every publisher and subscription: node, type, GID, QoS.")
@options.topic_timeout
@options.as_json
@options.node_options
@verb
def info(**arguments: Any) -> Any:
    """Print the type of a topic, and who publishes and subscribes.

    \b
    rosidl-py topic info /scan -v
    """
    return _show_topic(**arguments)


@click.command("type")
@options.topic_argument()
@options.topic_timeout
@options.as_json
@options.node_options
@verb
def type_(**arguments: Any) -> Any:
    """Print the type of a topic.

    \b
    rosidl-py interface show $(rosidl-py topic type /scan)
    """
    return _show_topic(only_type=True, **arguments)


def _show(
    types: list[str], publishers: Sequence[TopicEndpointInfo], subscribers: Sequence[TopicEndpointInfo], verbose: bool
) -> None:
    end = [""] if verbose else []
    terminal_output.lines([f"Type: {types[0] if len(types) == 1 else types}", *end])
    for heading, infos in (("Publisher", publishers), ("Subscription", subscribers)):
        terminal_output.line(f"{heading} count: {len(infos)}", "bold" if verbose else "")
        terminal_output.lines(end)
        if verbose:
            for info in infos:
                terminal_output.lines([*_described(info), ""])


def _described(info: TopicEndpointInfo) -> list[str]:
    """An endpoint in the words of rclpy."""
    from rosidl_py_gen.runtime import History

    qos = info.qos_profile
    depth = f" ({qos.depth})" if qos.history is History.KEEP_LAST else ""
    return [
        f"Node name: {info.node_name}",
        f"Node namespace: {info.node_namespace}",
        f"Topic type: {info.topic_type}",
        f"Topic type hash: {info.topic_type_hash or 'INVALID'}",
        f"Endpoint type: {info.endpoint_type.name}",
        f"GID: {_gid(info)}",
        "QoS profile:",
        f"  Reliability: {qos.reliability.name}",
        f"  History (Depth): {qos.history.name}{depth}",
        f"  Durability: {qos.durability.name}",
        f"  Lifespan: {_period(qos.lifespan_ns)}",
        f"  Deadline: {_period(qos.deadline_ns)}",
        f"  Liveliness: {qos.liveliness.name}",
        f"  Liveliness lease duration: {_period(qos.liveliness_lease_ns)}",
    ]


def _plain(info: TopicEndpointInfo) -> dict[str, Any]:
    return {
        "node": info.node_name,
        "namespace": info.node_namespace,
        "type": info.topic_type,
        "type_hash": info.topic_type_hash,
        "gid": _gid(info),
        "qos": _plain_qos(info.qos_profile),
    }


def _plain_qos(qos: QoSProfile) -> dict[str, Any]:
    return {
        "reliability": qos.reliability.name.lower(),
        "history": qos.history.name.lower(),
        "depth": qos.depth,
        "durability": qos.durability.name.lower(),
        "lifespan_ns": qos.lifespan_ns,
        "deadline_ns": qos.deadline_ns,
        "liveliness": qos.liveliness.name.lower(),
        "liveliness_lease_ns": qos.liveliness_lease_ns,
    }


def _gid(info: TopicEndpointInfo) -> str:
    return info.endpoint_gid.hex(".")


def _period(period_ns: int) -> str:
    from rosidl_py_gen.runtime.qos import INFINITE_NS

    return "Infinite" if period_ns == INFINITE_NS else f"{period_ns} nanoseconds"
