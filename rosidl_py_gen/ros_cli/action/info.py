"""``action info`` and ``action type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import Node


@click.command("info")
@options.action_argument()
@options.show_types
@click.option("-c", "--count", is_flag=True, help="Print only the numbers of clients and servers.")
@options.as_json
@options.node_options
@verb
async def info(network: options.NetworkOptions, action: str, show_types: bool, count: bool, as_json: bool) -> int:
    """Print the nodes with a server or a client of an action.

    \b
    rosidl-py action info /fibonacci -t
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import actions, find_action

    async with CommandNode(network) as command_node:
        node = command_node.node
        name = await find_action(command_node, action)
        await command_node.wait_for_node_names()
        types = dict(actions(node.get_topic_names_and_types())).get(name, [])
        clients = _nodes_with(name, node, node.get_subscriber_names_and_types_by_node)
        servers = _nodes_with(name, node, node.get_publisher_names_and_types_by_node)
    if as_json:
        terminal_output.document({"name": name, "types": types, "clients": clients, "servers": servers})
        return 0
    terminal_output.line(f"Action: {name}")
    for kind, users in (("clients", clients), ("servers", servers)):
        terminal_output.line(f"Action {kind}: {len(users)}")
        for user in () if count else users:
            suffix = f" [{', '.join(user['types'])}]" if show_types else ""
            terminal_output.line(f"    {user['node']}{suffix}")
    return 0


@click.command("type")
@options.action_argument()
@options.as_json
@options.node_options
@verb
async def type_(network: options.NetworkOptions, action: str, as_json: bool) -> int:
    """Print the type of an action.

    \b
    rosidl-py action type /fibonacci
    """
    from rosidl_py_gen.ros_cli.name_lookup import find_action
    from rosidl_py_gen.ros_cli.type_resolution import announced_types_of

    terminal_output.values(
        await announced_types_of(network, "action", lambda command_node: find_action(command_node, action)), as_json
    )
    return 0


def _nodes_with(
    action: str, node: Node, topics_of: Callable[[str, str], list[tuple[str, list[str]]]]
) -> list[dict[str, Any]]:
    """Return the nodes that have the topics of an action among `topics_of` them."""
    from rosidl_py_gen.ros_cli.name_lookup import actions

    return [
        {"node": one.fully_qualified_name, "types": types}
        for one in sorted(node.get_nodes(), key=lambda known: known.fully_qualified_name)
        for name, types in actions(topics_of(one.name, one.namespace))
        if name == action
    ]
