"""``lifecycle nodes``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.tools import options, printing, verb

if TYPE_CHECKING:
    from rosidl_py_gen.tools.session import Network


@click.command("nodes")
@click.option("-a", "--all", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@options.count("nodes")
@options.as_json
@options.node_options
@verb
async def nodes(network: Network, hidden: bool, count: bool, as_json: bool) -> int:
    """Print the lifecycle nodes there are.

    \b
    rosidl-py lifecycle nodes
    """
    from rosidl_py_gen.tools.lifecycle.remote import lifecycle_nodes
    from rosidl_py_gen.tools.session import Session

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
