"""``action list`` and ``action find``; what counts as an action.

An action is known by its feedback topic, as for ``ros2 action``: servers publish it, clients subscribe to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.tools import Job
from rosidl_py_gen.tools.service.list import is_one_of, print_names
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from collections.abc import Iterable

_TOPIC, _TYPE, _SERVICE = "/_action/feedback", "_FeedbackMessage", "/_action/send_goal"


def run(network: Network, **shown: Any) -> Job:
    """What the command does."""
    return Job(_list(network, **shown))


async def _list(network: Network, count: bool, as_json: bool, show_types: bool = False, of_type: str = "") -> int:
    async with Session(network) as session:
        await session.settle()
        found: list[dict[str, Any]] = [
            {"name": name, "types": types}
            for name, types in actions(session.node.get_topic_names_and_types())
            if not of_type or is_one_of(of_type, types, "action")
        ]
    print_names(found, count, show_types, as_json)
    return 0


def actions(topics: Iterable[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
    """The actions among topics and their types."""
    return [
        (name.removesuffix(_TOPIC), [one.removesuffix(_TYPE) for one in types if one.endswith(_TYPE)])
        for name, types in topics
        if name.endswith(_TOPIC)
    ]


async def find_action(session: Session, action: str, timeout_s: float | None = None) -> str:
    """The full name, once its services are known, too; raises as `Session.find`."""
    node = session.node

    def known() -> list[str]:
        services = {name for name, _ in node.get_service_names_and_types()}
        return [name for name, _ in actions(node.get_topic_names_and_types()) if name + _SERVICE in services]

    return await session.find("action", action, known, timeout_s)
