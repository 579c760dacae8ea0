"""``service list`` and ``service find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

_hidden = click.option(
    "-a",
    "--include-hidden-services",
    "hidden",
    is_flag=True,
    help="Include hidden services: those of actions, and others with a part that begins with _.",
)


@click.command("list")
@options.show_types
@options.count("services")
@_hidden
@options.as_json
@options.node_options
@verb
async def list_(network: options.NetworkOptions, show_types: bool, count: bool, hidden: bool, as_json: bool) -> int:
    """Print the services.

    \b
    rosidl-py service list -t
    rosidl-py service list --json | jq '.[].name'
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    rows = await list_graph(network, _services, hidden=hidden)
    terminal_output.names(rows, count, show_types, as_json)
    return 0


@click.command("find")
@click.argument("type_name", metavar="TYPE", shell_complete=options.completion("service types"))
@options.count("services")
@_hidden
@options.as_json
@options.node_options
@verb
async def find(network: options.NetworkOptions, type_name: str, count: bool, hidden: bool, as_json: bool) -> int:
    """Print the services of a type.

    \b
    rosidl-py service find std_srvs/srv/Trigger
    """
    from rosidl_py_gen.ros_cli.command_node import list_graph

    rows = await list_graph(network, _services, hidden=hidden, type_name=split_ros_name(type_name, "srv"))
    terminal_output.names(rows, count, False, as_json)
    return 0


def _services(node: Node) -> list[dict[str, Any]]:
    return [
        {"name": name, "types": types, "servers": node.count_services(name), "clients": node.count_clients(name)}
        for name, types in node.get_service_names_and_types()
    ]
