"""``lifecycle list``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("list")
@options.node_argument()
@click.option("-a", "--all", "show_all", is_flag=True, help="Show all transitions there are, in any state.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def list_(network: NetworkOptions, node: str, show_all: bool, timeout_s: float, as_json: bool) -> int:
    """Print the transitions that are possible in the state a node has.

    \b
    rosidl-py lifecycle list /camera
    """
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.ros_cli.lifecycle.remote import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        found = await remote.transitions(every=show_all)
    if as_json:
        terminal_output.document([to_dict(one) for one in found])
    else:
        for one in found:
            transition = f"- {one.transition.label} [{one.transition.id}]"
            terminal_output.lines(
                [transition, f"    Start: {one.start_state.label}", f"    Goal: {one.goal_state.label}"]
            )
    return 0
