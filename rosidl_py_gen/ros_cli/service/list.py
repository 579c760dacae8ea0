"""``service list`` and ``service find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions

_hidden = click.option(
    "-a",
    "--include-hidden-services",
    "hidden",
    is_flag=True,
    help="Show hidden ones, too: those of actions, and others that begin with _.",
)


async def _list(
    network: NetworkOptions, count: bool, hidden: bool, as_json: bool, show_types: bool = False, of_type: str = ""
) -> int:
    """Print the services, all or those of a type."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import is_hidden, is_one_of

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        node = session.node
        found: list[dict[str, Any]] = [
            {"name": name, "types": types, "servers": node.count_services(name), "clients": node.count_clients(name)}
            for name, types in node.get_service_names_and_types()
            if (hidden or not is_hidden(name)) and (not of_type or is_one_of(of_type, types, "srv"))
        ]
        session.note_if_alone()
    terminal_output.names(found, count, show_types, as_json)
    return 0


@click.command("list")
@options.show_types
@options.count("services")
@_hidden
@options.as_json
@options.node_options
@verb
def list_(**arguments: Any) -> Any:
    """Print the services there are.

    \b
    rosidl-py service list -t
    rosidl-py service list --json | jq '.[].name'
    """
    return _list(**arguments)


@click.command("find")
@click.argument("of_type", metavar="TYPE", shell_complete=options.completion("service types"))
@options.count("services")
@_hidden
@options.as_json
@options.node_options
@verb
def find(**arguments: Any) -> Any:
    """Print the services of a type.

    \b
    rosidl-py service find std_srvs/srv/Trigger
    """
    return _list(**arguments)
