"""``node list``."""

from __future__ import annotations

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb


@click.command("list")
@click.option("-a", "--all", "hidden", is_flag=True, help="Include hidden nodes, whose names begin with _.")
@options.count("nodes")
@options.as_json
@options.node_options
@verb
async def list_(network: options.NetworkOptions, hidden: bool, count: bool, as_json: bool) -> int:
    """Print the nodes.

    \b
    rosidl-py node list
    rosidl-py node list --json | jq -r '.[].name'
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import is_hidden_node

    async with CommandNode(network) as command_node:
        await command_node.wait_for_node_names()
        nodes = command_node.node.get_nodes()
        command_node.note_if_alone()
    rows = [
        {"name": node.fully_qualified_name, "enclave": node.enclave}
        for node in sorted(nodes, key=lambda one: one.fully_qualified_name)
        if hidden or not is_hidden_node(node.fully_qualified_name)
    ]
    names = [row["name"] for row in rows]
    terminal_output.names(rows, count, show_types=False, as_json=as_json)
    if duplicates := sorted({name for name in names if names.count(name) > 1}):
        terminal_output.note(f"several nodes have one name, so their services are mixed up: {', '.join(duplicates)}")
    return 0
