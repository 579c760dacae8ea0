"""``node list``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("list")
@click.option("-a", "--all", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@options.count("nodes")
@options.as_json
@options.node_options
@verb
async def list_(network: NetworkOptions, hidden: bool, count: bool, as_json: bool) -> int:
    """Print the nodes there are.

    \b
    rosidl-py node list
    rosidl-py node list --json | jq -r '.[].name'
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import is_hidden_node

    async with CommandNode(network) as session:
        await session.wait_for_node_names()
        nodes = session.node.get_nodes()
        session.note_if_alone()
    found = [
        {"name": node.fully_qualified_name, "enclave": node.enclave}
        for node in sorted(nodes, key=lambda one: one.fully_qualified_name)
        if hidden or not is_hidden_node(node.fully_qualified_name)
    ]
    names = [one["name"] for one in found]
    terminal_output.names(found, count, show_types=False, as_json=as_json)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        terminal_output.note(f"several nodes share one name, which confuses all who look for them: {', '.join(twice)}")
    return 0
