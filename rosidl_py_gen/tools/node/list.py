"""``node list``; which nodes are hidden, which serve something, and finding one by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.tools import Job, printing
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

LIST_PARAMETERS = "/list_parameters", "rcl_interfaces/srv/ListParameters"
"""How the name of a service ends that every node with parameters has, and its type."""


def run(network: Network, **shown: Any) -> Job:
    """What the command does."""
    return Job(_list(network, **shown))


async def _list(network: Network, hidden: bool, count: bool, as_json: bool) -> int:
    async with Session(network) as session:
        await session.settle_names()
        nodes = session.node.get_nodes()
    found = [
        {"name": node.fully_qualified_name, "enclave": node.enclave}
        for node in sorted(nodes, key=lambda one: one.fully_qualified_name)
        if hidden or not is_hidden_node(node.fully_qualified_name)
    ]
    names = [one["name"] for one in found]
    if as_json:
        printing.document(found)
    elif count:
        printing.line(str(len(found)))
    elif found:
        printing.line("\n".join(names))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        printing.note(f"several nodes share one name, which confuses all who look for them: {', '.join(twice)}")
    return 0


def is_hidden_node(name: str) -> bool:
    """Whether ROS tools leave a node out, by its full name: they hide themselves like that."""
    return name.rpartition("/")[2].startswith("_")


def is_served(node: Node, service: str) -> bool:
    """Whether somebody serves it; never for a name that ROS refuses, which DDS programs may use."""
    try:
        return node.count_services(service) > 0
    except InvalidNameError:
        return False


def nodes_that_serve(node: Node, ending: str, type_name: str, *, hidden: bool) -> list[str]:
    """Full names, sorted, of the nodes with a service of that type below their own name; clients alone do not count."""
    found = [
        name.removesuffix(ending)
        for name, types in node.get_service_names_and_types()
        if name.endswith(ending) and type_name in types and is_served(node, name)
    ]
    return [name for name in found if hidden or not is_hidden_node(name)]


async def find_node(session: Session, node: str, timeout_s: float | None = None) -> str:
    """The full name; raises as `Session.find`."""
    return await session.find("node", node, session.node.get_node_names, timeout_s)
