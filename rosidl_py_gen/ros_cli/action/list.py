"""``action list`` and ``action find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


async def _list(
    network: NetworkOptions, count: bool, as_json: bool, show_types: bool = False, of_type: str = ""
) -> int:
    """Print the actions, all or those of a type."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import actions, is_one_of

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        found: list[dict[str, Any]] = [
            {"name": name, "types": types}
            for name, types in actions(session.node.get_topic_names_and_types())
            if not of_type or is_one_of(of_type, types, "action")
        ]
        session.note_if_alone()
    terminal_output.names(found, count, show_types, as_json)
    return 0


@click.command("list")
@options.show_types
@options.count("actions")
@options.as_json
@options.node_options
@verb
def list_(**arguments: Any) -> Any:
    """Print the actions there are.

    \b
    rosidl-py action list -t
    """
    return _list(**arguments)


@click.command("find")
@click.argument("of_type", metavar="TYPE", shell_complete=options.completion("action types"))
@options.count("actions")
@options.as_json
@options.node_options
@verb
def find(**arguments: Any) -> Any:
    """Print the actions of a type.

    \b
    rosidl-py action find example_interfaces/action/Fibonacci
    """
    return _list(**arguments)
