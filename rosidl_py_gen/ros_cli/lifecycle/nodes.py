"""``lifecycle nodes``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("nodes")
@click.option("-a", "--all", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@options.count("nodes")
@options.as_json
@options.node_options
@verb
async def nodes(network: NetworkOptions, hidden: bool, count: bool, as_json: bool) -> int:
    """Print the lifecycle nodes there are.

    \b
    rosidl-py lifecycle nodes
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.lifecycle.remote import lifecycle_nodes

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        found = lifecycle_nodes(session.node, hidden=hidden)
        session.note_if_alone()
    if as_json:
        terminal_output.document(found)
    elif count:
        terminal_output.line(str(len(found)))
    else:
        terminal_output.lines(found)
    return 0
