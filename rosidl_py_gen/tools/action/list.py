"""``action list`` and ``action find``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.names import actions, is_one_of
from rosidl_py_gen.tools.session import Network, Session


async def run(network: Network, count: bool, as_json: bool, show_types: bool = False, of_type: str = "") -> int:
    """What the command does."""
    async with Session(network) as session:
        await session.wait_until_quiet()
        found: list[dict[str, Any]] = [
            {"name": name, "types": types}
            for name, types in actions(session.node.get_topic_names_and_types())
            if not of_type or is_one_of(of_type, types, "action")
        ]
        session.note_if_alone()
    printing.names(found, count, show_types, as_json)
    return 0
