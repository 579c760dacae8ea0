"""``service list`` and ``service find``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.tools import Job, printing
from rosidl_py_gen.tools.session import Network, Session
from rosidl_py_gen.tools.topic.list import is_hidden


def run(network: Network, **shown: Any) -> Job:
    """What the command does."""
    return Job(_list(network, **shown))


async def _list(
    network: Network, count: bool, hidden: bool, as_json: bool, show_types: bool = False, of_type: str = ""
) -> int:
    async with Session(network) as session:
        await session.settle()
        node = session.node
        found: list[dict[str, Any]] = [
            {"name": name, "types": types, "servers": node.count_services(name), "clients": node.count_clients(name)}
            for name, types in node.get_service_names_and_types()
            if (hidden or not is_hidden(name)) and (not of_type or is_one_of(of_type, types, "srv"))
        ]
    print_names(found, count, show_types, as_json)
    return 0


def is_one_of(wanted: str, types: list[str], kind: str) -> bool:
    """Whether a type, perhaps in the short form ``pkg/Name``, is among `types`.

    Raises:
        InvalidNameError: it is no name of a type.
    """
    from rosidl_py_gen.names import split_ros_name

    return str(split_ros_name(wanted, kind)) in types


def print_names(found: list[dict[str, Any]], count: bool, show_types: bool, as_json: bool) -> None:
    """What was found: each has a name and types, and what else belongs into the JSON."""
    if as_json:
        printing.document(found)
    elif count:
        printing.line(str(len(found)))
    else:
        for one in found:
            printing.line(f"{one['name']} [{', '.join(one['types'])}]" if show_types else one["name"])
