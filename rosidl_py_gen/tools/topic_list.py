"""``topic list``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.tools import printing, run_async
from rosidl_py_gen.tools.session import Network, Session


def run(network: Network, **shown: Any) -> int:
    """Returns the exit code."""
    return run_async(_list(network, **shown))


async def _list(network: Network, show_types: bool, verbose: bool, count: bool, hidden: bool, as_json: bool) -> int:
    async with Session(network) as session:
        await session.settle()
        node = session.node
        found: list[dict[str, Any]] = [
            {"name": name, "types": types, "publishers": node.count_publishers(name), "subscribers": subscribers}
            for name, types in node.get_topic_names_and_types()
            if hidden or not is_hidden(name)
            for subscribers in (node.count_subscribers(name),)
        ]
    if as_json:
        printing.document(found)
    elif count:
        printing.line(str(len(found)))
    elif verbose:
        rows = (
            [one["name"], ", ".join(one["types"]), str(one["publishers"]), str(one["subscribers"])] for one in found
        )
        printing.table(rows, "topic", "type", "publishers", "subscribers")
    else:
        for one in found:
            printing.line(f"{one['name']} [{', '.join(one['types'])}]" if show_types else one["name"])
    return 0


def is_hidden(name: str) -> bool:
    """Whether ROS tools leave the name out: one of its parts begins with an underscore."""
    return "/_" in name
