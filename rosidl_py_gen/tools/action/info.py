"""``action info`` and ``action type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.names import actions, find_action
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import Node


async def run(
    network: Network, action: str, as_json: bool, only_type: bool = False, show_types: bool = False, count: bool = False
) -> int:
    """What the command does."""
    async with Session(network) as session:
        node = session.node
        name = await find_action(session, action)
        if not only_type:
            await session.wait_until_named()
        types = dict(actions(node.get_topic_names_and_types())).get(name, [])
        clients = _users(node, name, node.get_subscriber_names_and_types_by_node)
        servers = _users(node, name, node.get_publisher_names_and_types_by_node)
    if as_json:
        printing.document(
            types if only_type else {"name": name, "types": types, "clients": clients, "servers": servers}
        )
    elif only_type:
        printing.lines(types)
    else:
        printing.line(f"Action: {name}")
        for kind, users in (("clients", clients), ("servers", servers)):
            printing.line(f"Action {kind}: {len(users)}")
            for one in () if count else users:
                printing.line(f"    {one['node']} [{', '.join(one['types'])}]" if show_types else f"    {one['node']}")
    return 0


def _users(
    node: Node, action: str, topics_of: Callable[[str, str], list[tuple[str, list[str]]]]
) -> list[dict[str, Any]]:
    """The nodes among whose topics the action is."""
    return [
        {"node": one.fully_qualified_name, "types": types}
        for one in sorted(node.get_nodes(), key=lambda known: known.fully_qualified_name)
        for name, types in actions(topics_of(one.name, one.namespace))
        if name == action
    ]
