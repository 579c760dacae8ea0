"""``lifecycle set``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.tools import ToolError, printing
from rosidl_py_gen.tools.lifecycle.remote import lifecycle_of
from rosidl_py_gen.tools.session import Network

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.msgs.lifecycle_msgs.msg import Transition


async def run(network: Network, node: str, transition: str, timeout_s: float, as_json: bool) -> int:
    """What the command does."""
    async with lifecycle_of(network, node, timeout_s) as remote:
        possible = [one.transition for one in await remote.transitions()]
        wanted = _wanted(possible, transition)
        if wanted is None:
            shown = ", ".join(f"{one.label} [{one.id}]" for one in possible) or "none"
            raise ToolError(f"{remote.name} cannot {transition!r} in its present state; possible now: {shown}")
        successful = await remote.change(wanted)
    if as_json:
        printing.document({"successful": successful})
    elif not successful:
        raise ToolError("Transitioning failed")
    else:
        printing.line("Transitioning successful")
    return 0 if successful else 1


def _wanted(possible: Sequence[Transition], text: str) -> Transition | None:
    """By name, else by number."""
    return {**{str(one.id): one for one in possible}, **{one.label: one for one in possible}}.get(text)
