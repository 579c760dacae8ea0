"""``service info`` and ``service type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
    from rosidl_py_gen.runtime import Node, TopicEndpointInfo


_PATIENCE_S = 1.0


async def _show(
    network: NetworkOptions, service: str, as_json: bool, only_type: bool = False, verbose: bool = False
) -> int:
    """Print the type of a service, or also who serves and uses it."""
    from rosidl_py_gen.ros_cli.command_node import CommandNode

    async with CommandNode(network) as session:
        node = session.node
        name = await find_service(session, service)
        if not only_type:
            await (session.wait_for_node_names() if verbose else session.wait_for_discovery())
            # A service is known by one of its two topics; both ends are counted by the other.
            await session.wait_for(lambda: node.count_services(name) or node.count_clients(name), _PATIENCE_S)
        types = dict(node.get_service_names_and_types()).get(name, [])
        found: dict[str, Any] = {
            "name": name,
            "types": types,
            "clients": node.count_clients(name),
            "servers": node.count_services(name),
        }
        if verbose:
            found["endpoints"] = _ends(node, name)
    if as_json:
        terminal_output.document(types if only_type else found)
    elif only_type:
        terminal_output.lines(types)
    else:
        _print(found)
    return 0


@click.command("info")
@options.service_argument()
@click.option("-v", "--verbose", is_flag=True, help="Show who they are, their GIDs and QoS, too.")
@options.as_json
@options.node_options
@verb
def info(**arguments: Any) -> Any:
    """Print the type of a service, and how many clients and servers it has.

    \b
    rosidl-py service info /add_two_ints -v
    """
    return _show(**arguments)


@click.command("type")
@options.service_argument()
@options.as_json
@options.node_options
@verb
def type_(**arguments: Any) -> Any:
    """Print the type of a service.

    \b
    rosidl-py service type /add_two_ints
    """
    return _show(only_type=True, **arguments)


async def find_service(session: CommandNode, service: str, timeout_s: float | None = None) -> str:
    """The full name; raises as `Session.find`."""
    return await session.find(
        "service", service, lambda: [name for name, _ in session.node.get_service_names_and_types()], timeout_s
    )


def _ends(node: Node, name: str) -> list[dict[str, Any]]:
    """Servers, then clients, by what each writes: a server its replies, a client its requests."""
    servers, clients = node.get_servers_info_by_service(name), node.get_clients_info_by_service(name)
    return [*(_end(one, "SERVER") for one in servers), *(_end(one, "CLIENT") for one in clients)]


def _end(one: TopicEndpointInfo, kind: str) -> dict[str, Any]:
    qos = one.qos_profile
    return {
        "node": one.node_text,
        "endpoint": kind,
        "gid": one.endpoint_gid.hex("."),
        "reliability": qos.reliability.name,
        "durability": qos.durability.name,
        "history": f"{qos.history.name} ({qos.depth})" if qos.depth else qos.history.name,
    }


def _print(found: dict[str, Any]) -> None:
    terminal_output.line(f"Type: {', '.join(found['types'])}")
    terminal_output.lines([f"Clients count: {found['clients']}", f"Services count: {found['servers']}"])
    for end in found.get("endpoints", ()):
        terminal_output.lines(
            [
                *("", f"Node: {end['node']}", f"Endpoint type: {end['endpoint']}", f"GID: {end['gid']}"),
                *("QoS profile:", f"  Reliability: {end['reliability']}", f"  History (Depth): {end['history']}"),
                f"  Durability: {end['durability']}",
            ]
        )
