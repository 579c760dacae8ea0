"""``action list`` and ``action find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node


@click.command("list")
@options.show_types
@options.count("actions")
@options.as_json
@options.node_options
@verb
async def list_(network: options.NetworkOptions, show_types: bool, count: bool, as_json: bool) -> int:
    """Print the actions.

    \b
    rosidl-py action list -t
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    terminal_output.names(await list_graph(network, _actions), count, show_types, as_json)
    return 0


@click.command("find")
@click.argument("type_name", metavar="TYPE", shell_complete=options.completion("action types"))
@options.count("actions")
@options.as_json
@options.node_options
@verb
async def find(network: options.NetworkOptions, type_name: str, count: bool, as_json: bool) -> int:
    """Print the actions of a type.

    \b
    rosidl-py action find example_interfaces/action/Fibonacci
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    rows = await list_graph(network, _actions, type_name=split_ros_name(type_name, "action"))
    terminal_output.names(rows, count, False, as_json)
    return 0


def _actions(node: Node) -> list[dict[str, Any]]:
    from rosidl_py_gen.ros_cli.name_lookup import actions

    return [{"name": name, "types": types} for name, types in actions(node.get_topic_names_and_types())]
