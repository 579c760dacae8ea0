"""``node info``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions
    from rosidl_py_gen.runtime import Node


_HEADINGS = {
    "subscribers": "Subscribers",
    "publishers": "Publishers",
    "service_servers": "Service Servers",
    "service_clients": "Service Clients",
    "action_servers": "Action Servers",
    "action_clients": "Action Clients",
}


@click.command("info")
@options.node_argument()
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Show hidden topics, services and actions, too.")
@options.as_json
@options.node_options
@verb
async def info(network: NetworkOptions, node: str, hidden: bool, as_json: bool) -> int:
    """Print what a node subscribes to, publishes and serves.

    \b
    rosidl-py node info /talker
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import find_node, is_hidden

    async with CommandNode(network) as session:
        full_name = await find_node(session, node)
        await session.wait_for_discovery()
        count = session.node.get_node_names().count(full_name)
        found = _of_node(session.node, full_name)
    if not hidden:
        found = {
            kind: {name: types for name, types in names.items() if not is_hidden(name)} for kind, names in found.items()
        }
    if count > 1:
        terminal_output.note(f"{count} nodes are called {full_name}; this is what all of them have together")
    if as_json:
        terminal_output.document({"name": full_name, **found})
    else:
        terminal_output.line(full_name, "bold cyan")
        for kind, heading in _HEADINGS.items():
            terminal_output.line(f"  {heading}:", "bold")
            for name, types in found[kind].items():
                terminal_output.line(f"    {name}: {', '.join(types)}")
            if not found[kind]:
                terminal_output.line()
    return 0


def _of_node(node: Node, full_name: str) -> dict[str, dict[str, list[str]]]:
    """Names and types of everything a node has, by kind."""
    from rosidl_py_gen.ros_cli.name_lookup import actions

    namespace, _, name = full_name.rpartition("/")
    subscribed = node.get_subscriber_names_and_types_by_node(name, namespace or "/")
    published = node.get_publisher_names_and_types_by_node(name, namespace or "/")
    return {
        "subscribers": dict(subscribed),
        "publishers": dict(published),
        "service_servers": dict(node.get_service_names_and_types_by_node(name, namespace or "/")),
        "service_clients": dict(node.get_client_names_and_types_by_node(name, namespace or "/")),
        "action_servers": dict(actions(published)),
        "action_clients": dict(actions(subscribed)),
    }
