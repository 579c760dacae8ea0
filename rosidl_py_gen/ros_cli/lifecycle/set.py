"""``lifecycle set``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import ToolError, options, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.msgs.lifecycle_msgs.msg import Transition
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("set")
@options.node_argument()
@click.argument("transition")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def set_(network: NetworkOptions, node: str, transition: str, timeout_s: float, as_json: bool) -> int:
    """Change the state of a node; TRANSITION is a name or a number that `list` shows.

    \b
    rosidl-py lifecycle set /camera configure
    rosidl-py lifecycle set /camera 3
    """
    from rosidl_py_gen.ros_cli.lifecycle.remote import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        possible = [one.transition for one in await remote.transitions()]
        wanted = _wanted(possible, transition)
        if wanted is None:
            shown = ", ".join(f"{one.label} [{one.id}]" for one in possible) or "none"
            raise ToolError(f"{remote.name} cannot {transition!r} in its present state; possible now: {shown}")
        successful = await remote.change(wanted)
    if as_json:
        terminal_output.document({"successful": successful})
    elif not successful:
        raise ToolError("Transitioning failed")
    else:
        terminal_output.line("Transitioning successful")
    return 0 if successful else 1


def _wanted(possible: Sequence[Transition], text: str) -> Transition | None:
    """By name, else by number."""
    return {**{str(one.id): one for one in possible}, **{one.label: one for one in possible}}.get(text)
