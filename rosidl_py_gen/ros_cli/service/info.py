"""``service info`` and ``service type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.runtime import TopicEndpointInfo

_ENDPOINTS_TIMEOUT_S = 1.0
"""A service is found by one of its two topics; its endpoints are counted by the other one, which may follow."""


@click.command("info")
@options.service_argument()
@click.option("-v", "--verbose", is_flag=True, help="Include the GID and QoS of each client and server.")
@options.as_json
@options.node_options
@verb
async def info(network: options.NetworkOptions, service: str, verbose: bool, as_json: bool) -> int:
    """Print the type of a service, and its numbers of clients and servers.

    \b
    rosidl-py service info /add_two_ints -v
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode

    async with CommandNode(network) as command_node:
        node = command_node.node
        name = await find_service(command_node, service)
        await (command_node.wait_for_node_names() if verbose else command_node.wait_for_discovery())
        await command_node.wait_for(lambda: node.count_services(name) or node.count_clients(name), _ENDPOINTS_TIMEOUT_S)
        row: dict[str, Any] = {
            "name": name,
            "types": dict(node.get_service_names_and_types()).get(name, []),
            "clients": node.count_clients(name),
            "servers": node.count_services(name),
        }
        if verbose:
            row["endpoints"] = [
                *(_endpoint(one, "SERVER") for one in node.get_servers_info_by_service(name)),
                *(_endpoint(one, "CLIENT") for one in node.get_clients_info_by_service(name)),
            ]
    if as_json:
        terminal_output.document(row)
        return 0
    terminal_output.line(f"Type: {', '.join(row['types'])}")
    terminal_output.lines([f"Clients count: {row['clients']}", f"Services count: {row['servers']}"])
    for one in row.get("endpoints", ()):
        terminal_output.lines(
            [
                *("", f"Node: {one['node']}", f"Endpoint type: {one['endpoint']}", f"GID: {one['gid']}"),
                *("QoS profile:", f"  Reliability: {one['reliability']}", f"  History (Depth): {one['history']}"),
                f"  Durability: {one['durability']}",
            ]
        )
    return 0


@click.command("type")
@options.service_argument()
@options.as_json
@options.node_options
@verb
async def type_(network: options.NetworkOptions, service: str, as_json: bool) -> int:
    """Print the type of a service.

    \b
    rosidl-py service type /add_two_ints
    """
    from rosidl_py_gen.ros_cli.type_resolution import announced_types_of

    terminal_output.values(
        await announced_types_of(network, "service", lambda command_node: find_service(command_node, service)), as_json
    )
    return 0


async def find_service(command_node: CommandNode, service: str, timeout_s: float | None = None) -> str:
    """Wait for a service and return its full name; raises as `CommandNode.find`."""
    return await command_node.find(
        "service", service, lambda: [name for name, _ in command_node.node.get_service_names_and_types()], timeout_s
    )


def _endpoint(endpoint: TopicEndpointInfo, kind: str) -> dict[str, Any]:
    qos = endpoint.qos_profile
    return {
        "node": endpoint.node_text,
        "endpoint": kind,
        "gid": endpoint.endpoint_gid.hex("."),
        "reliability": qos.reliability.name,
        "durability": qos.durability.name,
        "history": f"{qos.history.name} ({qos.depth})" if qos.depth else qos.history.name,
    }
