"""``service info`` and ``service type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node, TopicEndpointInfo

_PATIENCE_S = 1.0


async def run(network: Network, service: str, as_json: bool, only_type: bool = False, verbose: bool = False) -> int:
    """What the command does."""
    async with Session(network) as session:
        node = session.node
        name = await find_service(session, service)
        if not only_type:
            await (session.wait_until_named() if verbose else session.wait_until_quiet())
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
        printing.document(types if only_type else found)
    elif only_type:
        printing.lines(types)
    else:
        _print(found)
    return 0


async def find_service(session: Session, service: str, timeout_s: float | None = None) -> str:
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
        "node": one.node,
        "endpoint": kind,
        "gid": one.endpoint_gid.hex("."),
        "reliability": qos.reliability.name,
        "durability": qos.durability.name,
        "history": f"{qos.history.name} ({qos.depth})" if qos.depth else qos.history.name,
    }


def _print(found: dict[str, Any]) -> None:
    printing.line(f"Type: {', '.join(found['types'])}")
    printing.lines([f"Clients count: {found['clients']}", f"Services count: {found['servers']}"])
    for end in found.get("endpoints", ()):
        printing.lines(
            [
                *("", f"Node: {end['node']}", f"Endpoint type: {end['endpoint']}", f"GID: {end['gid']}"),
                *("QoS profile:", f"  Reliability: {end['reliability']}", f"  History (Depth): {end['history']}"),
                f"  Durability: {end['durability']}",
            ]
        )
