"""``node info``."""

from __future__ import annotations

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb


@click.command("info")
@options.node_argument()
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Include hidden topics, services and actions.")
@options.as_json
@options.node_options
@verb
async def info(network: options.NetworkOptions, node: str, hidden: bool, as_json: bool) -> int:
    """Print the topics, services and actions of a node.

    \b
    rosidl-py node info /talker
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import actions, find_node, is_hidden

    async with CommandNode(network) as command_node:
        full_name = await find_node(command_node, node)
        await command_node.wait_for_discovery()
        count = command_node.node.get_node_names().count(full_name)
        namespace, _, name = full_name.rpartition("/")
        identity = name, namespace or "/"
        subscribed = command_node.node.get_subscriber_names_and_types_by_node(*identity)
        published = command_node.node.get_publisher_names_and_types_by_node(*identity)
        entities = {
            "Subscribers": subscribed,
            "Publishers": published,
            "Service Servers": command_node.node.get_service_names_and_types_by_node(*identity),
            "Service Clients": command_node.node.get_client_names_and_types_by_node(*identity),
            "Action Servers": actions(published),
            "Action Clients": actions(subscribed),
        }
    if not hidden:
        entities = {kind: [one for one in found if not is_hidden(one[0])] for kind, found in entities.items()}
    if count > 1:
        terminal_output.note(f"{count} nodes have the name {full_name}; their entities are shown together")
    if as_json:
        rows = {kind.lower().replace(" ", "_"): dict(found) for kind, found in entities.items()}
        terminal_output.document({"name": full_name, **rows})
        return 0
    terminal_output.line(full_name, "bold cyan")
    for kind, found in entities.items():
        terminal_output.line(f"  {kind}:", "bold")
        terminal_output.lines(f"    {name}: {', '.join(types)}" for name, types in found)
        if not found:
            terminal_output.line()
    return 0
