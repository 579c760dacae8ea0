"""``node info``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.tools import options, printing, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node
    from rosidl_py_gen.tools.session import Network


_HEADINGS = {
    "subscribers": "Subscribers",
    "publishers": "Publishers",
    "service_servers": "Service Servers",
    "service_clients": "Service Clients",
    "action_servers": "Action Servers",
    "action_clients": "Action Clients",
}


@click.command("info")
@options.node_argument()
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Show hidden topics, services and actions, too.")
@options.as_json
@options.node_options
@verb
async def info(network: Network, node: str, hidden: bool, as_json: bool) -> int:
    """Print what a node subscribes to, publishes and serves.

    \b
    rosidl-py node info /talker
    """
    from rosidl_py_gen.tools.names import find_node, is_hidden
    from rosidl_py_gen.tools.session import Session

    async with Session(network) as session:
        full_name = await find_node(session, node)
        await session.wait_until_quiet()
        count = session.node.get_node_names().count(full_name)
        found = _of_node(session.node, full_name)
    if not hidden:
        found = {
            kind: {name: types for name, types in names.items() if not is_hidden(name)} for kind, names in found.items()
        }
    if count > 1:
        printing.note(f"{count} nodes are called {full_name}; this is what all of them have together")
    if as_json:
        printing.document({"name": full_name, **found})
    else:
        printing.line(full_name, "bold cyan")
        for kind, heading in _HEADINGS.items():
            printing.line(f"  {heading}:", "bold")
            for name, types in found[kind].items():
                printing.line(f"    {name}: {', '.join(types)}")
            if not found[kind]:
                printing.line()
    return 0


def _of_node(node: Node, full_name: str) -> dict[str, dict[str, list[str]]]:
    """Names and types of everything a node has, by kind."""
    from rosidl_py_gen.tools.names import actions

    namespace, _, name = full_name.rpartition("/")
    subscribed = node.get_subscriber_names_and_types_by_node(name, namespace or "/")
    published = node.get_publisher_names_and_types_by_node(name, namespace or "/")
    return {
        "subscribers": dict(subscribed),
        "publishers": dict(published),
        "service_servers": dict(node.get_service_names_and_types_by_node(name, namespace or "/")),
        "service_clients": dict(node.get_client_names_and_types_by_node(name, namespace or "/")),
        "action_servers": dict(actions(published)),
        "action_clients": dict(actions(subscribed)),
    }
