"""``lifecycle nodes``."""

from __future__ import annotations

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.lifecycle.remote import lifecycle_nodes
from rosidl_py_gen.tools.session import Network, Session


async def run(network: Network, hidden: bool, count: bool, as_json: bool) -> int:
    """What the command does."""
    async with Session(network) as session:
        await session.wait_until_quiet()
        found = lifecycle_nodes(session.node, hidden=hidden)
        session.note_if_alone()
    if as_json:
        printing.document(found)
    elif count:
        printing.line(str(len(found)))
    else:
        printing.lines(found)
    return 0
