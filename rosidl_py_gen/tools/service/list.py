"""``service list`` and ``service find``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.names import is_hidden, is_one_of
from rosidl_py_gen.tools.session import Network, Session


async def run(
    network: Network, count: bool, hidden: bool, as_json: bool, show_types: bool = False, of_type: str = ""
) -> int:
    """What the command does."""
    async with Session(network) as session:
        await session.wait_until_quiet()
        node = session.node
        found: list[dict[str, Any]] = [
            {"name": name, "types": types, "servers": node.count_services(name), "clients": node.count_clients(name)}
            for name, types in node.get_service_names_and_types()
            if (hidden or not is_hidden(name)) and (not of_type or is_one_of(of_type, types, "srv"))
        ]
        session.note_if_alone()
    printing.names(found, count, show_types, as_json)
    return 0
