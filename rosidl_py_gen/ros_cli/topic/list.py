"""``topic list`` and ``topic find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

_hidden = click.option(
    "-a",
    "--include-hidden-topics",
    "--include-hidden",
    "hidden",
    is_flag=True,
    help="Include hidden topics: those with a part that begins with _.",
)


@click.command("list")
@options.show_types
@click.option("-v", "--verbose", is_flag=True, help="Show published and subscribed topics, and the numbers of each.")
@options.count("topics")
@_hidden
@options.as_json
@options.node_options
@verb
async def list_(
    network: options.NetworkOptions, show_types: bool, verbose: bool, count: bool, hidden: bool, as_json: bool
) -> int:
    """Print the topics.

    \b
    rosidl-py topic list -t
    rosidl-py topic list --json | jq '.[].name'
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    rows = await list_graph(network, _topics, hidden=hidden)
    if not verbose or as_json or count:
        terminal_output.names(rows, count, show_types, as_json)
        return 0
    for heading, kind in (("Published", "publisher"), ("Subscribed", "subscriber")):
        terminal_output.line(f"{heading} topics:", "bold")
        for row in rows:
            if number := row[f"{kind}s"]:
                plural = "s" if number > 1 else ""
                terminal_output.line(f" * {row['name']} [{', '.join(row['types'])}] {number} {kind}{plural}")
        terminal_output.line()
    return 0


@click.command("find")
@click.argument("type_name", metavar="TYPE", shell_complete=options.completion("types"))
@options.count("topics")
@_hidden
@options.as_json
@options.node_options
@verb
async def find(network: options.NetworkOptions, type_name: str, count: bool, hidden: bool, as_json: bool) -> int:
    """Print the topics of a type.

    \b
    rosidl-py topic find sensor_msgs/msg/LaserScan
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    rows = await list_graph(network, _topics, hidden=hidden, type_name=split_ros_name(type_name, "msg"))
    terminal_output.names(rows, count, False, as_json)
    return 0


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
