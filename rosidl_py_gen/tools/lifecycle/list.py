"""``lifecycle list``."""

from __future__ import annotations

from rosidl_py_gen import to_dict
from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.lifecycle.remote import lifecycle_of
from rosidl_py_gen.tools.session import Network


async def run(network: Network, node: str, show_all: bool, timeout_s: float, as_json: bool) -> int:
    """What the command does."""
    async with lifecycle_of(network, node, timeout_s) as remote:
        found = await remote.transitions(every=show_all)
    if as_json:
        printing.document([to_dict(one) for one in found])
    else:
        for one in found:
            transition = f"- {one.transition.label} [{one.transition.id}]"
            printing.lines([transition, f"    Start: {one.start_state.label}", f"    Goal: {one.goal_state.label}"])
    return 0
