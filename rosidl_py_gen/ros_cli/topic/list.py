"""``topic list`` and ``topic find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions

_hidden = click.option(
    "-a",
    "--include-hidden-topics",
    "--include-hidden",
    "hidden",
    is_flag=True,
    help="Show hidden ones, which begin with _, too.",
)


async def _list(
    network: NetworkOptions,
    show_types: bool,
    verbose: bool,
    count: bool,
    hidden: bool,
    as_json: bool,
    type_name: str | None = None,
) -> int:
    """Print the topics, all or those of a type."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import is_hidden

    wanted = type_name and str(split_ros_name(type_name, "msg"))
    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        node = session.node
        found: list[dict[str, Any]] = [
            {"name": name, "types": types, "publishers": node.count_publishers(name), "subscribers": subscribers}
            for name, types in node.get_topic_names_and_types()
            if (hidden or not is_hidden(name)) and (wanted is None or wanted in types)
            for subscribers in (node.count_subscribers(name),)
        ]
        session.note_if_alone()
    if verbose and not (as_json or count):
        _show_ends(found, "Published", "publisher")
        _show_ends(found, "Subscribed", "subscriber")
    else:
        terminal_output.names(found, count, show_types, as_json)
    return 0


@click.command("list")
@options.show_types
@click.option("-v", "--verbose", is_flag=True, help="Show what is published and subscribed, and by how many.")
@options.count("topics")
@_hidden
@options.as_json
@options.node_options
@verb
def list_(**arguments: Any) -> Any:
    """Print the topics there are.

    \b
    rosidl-py topic list -t
    rosidl-py topic list --json | jq '.[].name'
    """
    return _list(**arguments)


@click.command("find")
@click.argument("type_name", metavar="TYPE", shell_complete=options.completion("types"))
@options.count("topics")
@_hidden
@options.as_json
@options.node_options
@verb
def find(**arguments: Any) -> Any:
    """Print the topics of a type.

    \b
    rosidl-py topic find sensor_msgs/msg/LaserScan
    """
    return _list(show_types=False, verbose=False, **arguments)


def _show_ends(found: list[dict[str, Any]], heading: str, end: str) -> None:
    terminal_output.line(f"{heading} topics:", "bold")
    for one in found:
        if number := one[f"{end}s"]:
            terminal_output.line(
                f" * {one['name']} [{', '.join(one['types'])}] {number} {end}{'s' if number > 1 else ''}"
            )
    terminal_output.line()
