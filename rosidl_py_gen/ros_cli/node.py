"""Commands of ``rosidl-py node``: list and info."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import CommandNode


@click.command("list")
@click.option("-a", "--all", "hidden", is_flag=True, help="Include hidden nodes, whose names begin with _.")
@options.count("nodes")
@options.as_json
@options.node_verb
async def list_(command_node: CommandNode, hidden: bool, count: bool, as_json: bool) -> None:
    """Print the nodes.

    \b
    rosidl-py node list
    rosidl-py node list --json | jq -r '.[].name'
    """
    await command_node.wait_for_node_names()
    command_node.note_if_alone()
    rows = [
        {"name": node.fully_qualified_name, "enclave": node.enclave}
        for node in sorted(command_node.node.get_nodes(), key=lambda one: one.fully_qualified_name)
        if hidden or not command_node.is_hidden_node(node.fully_qualified_name)
    ]
    names = [row["name"] for row in rows]
    terminal_output.names(rows, count, show_types=False, as_json=as_json)
    if duplicates := sorted({name for name in names if names.count(name) > 1}):
        terminal_output.note(f"several nodes have one name, so their services are mixed up: {', '.join(duplicates)}")


@click.command("info")
@options.node_argument()
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Include hidden topics, services and actions.")
@options.as_json
@options.node_verb
async def info(command_node: CommandNode, node: str, hidden: bool, as_json: bool) -> None:
    """Print the topics, services and actions of a node.

    \b
    rosidl-py node info /talker
    """
    full_name = await command_node.find("node", node)
    await command_node.wait_for_discovery()
    count = command_node.node.get_node_names().count(full_name)
    namespace, _, name = full_name.rpartition("/")
    identity = name, namespace or "/"
    subscribed = command_node.node.get_subscriber_names_and_types_by_node(*identity)
    published = command_node.node.get_publisher_names_and_types_by_node(*identity)
    entities = {
        "Subscribers": subscribed,
        "Publishers": published,
        "Service Servers": command_node.node.get_service_names_and_types_by_node(*identity),
        "Service Clients": command_node.node.get_client_names_and_types_by_node(*identity),
        "Action Servers": command_node.actions(published),
        "Action Clients": command_node.actions(subscribed),
    }
    if not hidden:
        entities = {
            kind: [one for one in found if not command_node.is_hidden(one[0])] for kind, found in entities.items()
        }
    if count > 1:
        terminal_output.note(f"{count} nodes have the name {full_name}; their entities are shown together")
    if as_json:
        rows = {kind.lower().replace(" ", "_"): dict(found) for kind, found in entities.items()}
        terminal_output.document({"name": full_name, **rows})
        return
    terminal_output.line(full_name, "bold cyan")
    for kind, found in entities.items():
        terminal_output.line(f"  {kind}:", "bold")
        terminal_output.lines([f"    {name}: {', '.join(types)}" for name, types in found] or [""])
