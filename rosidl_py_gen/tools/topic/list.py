"""``topic list`` and ``topic find``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.names import is_hidden
from rosidl_py_gen.tools.session import Network, Session


async def run(
    network: Network,
    show_types: bool,
    verbose: bool,
    count: bool,
    hidden: bool,
    as_json: bool,
    type_name: str | None = None,
) -> int:
    """What the command does."""
    wanted = type_name and str(split_ros_name(type_name, "msg"))
    async with Session(network) as session:
        await session.wait_until_quiet()
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
        printing.names(found, count, show_types, as_json)
    return 0


def _show_ends(found: list[dict[str, Any]], heading: str, end: str) -> None:
    printing.line(f"{heading} topics:", "bold")
    for one in found:
        if number := one[f"{end}s"]:
            printing.line(f" * {one['name']} [{', '.join(one['types'])}] {number} {end}{'s' if number > 1 else ''}")
    printing.line()
