"""``action info`` and ``action type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.ros_cli.command_node import NetworkOptions
    from rosidl_py_gen.runtime import Node


async def _show(
    network: NetworkOptions,
    action: str,
    as_json: bool,
    only_type: bool = False,
    show_types: bool = False,
    count: bool = False,
) -> int:
    """Print the type of an action, or also who serves and uses it."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import actions, find_action

    async with CommandNode(network) as session:
        node = session.node
        name = await find_action(session, action)
        if not only_type:
            await session.wait_for_node_names()
        types = dict(actions(node.get_topic_names_and_types())).get(name, [])
        clients = _users(node, name, node.get_subscriber_names_and_types_by_node)
        servers = _users(node, name, node.get_publisher_names_and_types_by_node)
    if as_json:
        terminal_output.document(
            types if only_type else {"name": name, "types": types, "clients": clients, "servers": servers}
        )
    elif only_type:
        terminal_output.lines(types)
    else:
        terminal_output.line(f"Action: {name}")
        for kind, users in (("clients", clients), ("servers", servers)):
            terminal_output.line(f"Action {kind}: {len(users)}")
            for one in () if count else users:
                terminal_output.line(
                    f"    {one['node']} [{', '.join(one['types'])}]" if show_types else f"    {one['node']}"
                )
    return 0


@click.command("info")
@options.action_argument()
@options.show_types
@click.option("-c", "--count", is_flag=True, help="Print only how many clients and servers there are.")
@options.as_json
@options.node_options
@verb
def info(**arguments: Any) -> Any:
    """Print which nodes serve an action, and which have clients of it.

    \b
    rosidl-py action info /fibonacci -t
    """
    return _show(**arguments)


@click.command("type")
@options.action_argument()
@options.as_json
@options.node_options
@verb
def type_(**arguments: Any) -> Any:
    """Print the type of an action.

    \b
    rosidl-py action type /fibonacci
    """
    return _show(only_type=True, **arguments)


def _users(
    node: Node, action: str, topics_of: Callable[[str, str], list[tuple[str, list[str]]]]
) -> list[dict[str, Any]]:
    """The nodes among whose topics the action is."""
    from rosidl_py_gen.ros_cli.name_lookup import actions

    return [
        {"node": one.fully_qualified_name, "types": types}
        for one in sorted(node.get_nodes(), key=lambda known: known.fully_qualified_name)
        for name, types in actions(topics_of(one.name, one.namespace))
        if name == action
    ]
