"""Waiting for a topic that a command was told the name of."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from rosidl_py_gen.tools import printing

if TYPE_CHECKING:
    from rosidl_py_gen.tools.session import Session

_SILENT_S = 2.0
"""Fast DDS robots are found within 1.2 s."""


async def found(session: Session, topic: str, timeout_s: float | None) -> str:
    """The full name of a topic that somebody publishes or subscribes to; waits for it, and says so after 2 s.

    Raises:
        ToolError: it did not appear. InvalidNameError.
    """
    waiting = asyncio.get_running_loop().call_later(
        _SILENT_S, printing.note, f"topic {topic} does not appear to be published yet; waiting for it"
    )
    try:
        return await session.find("topic", topic, lambda: topic_names(session), timeout_s)
    finally:
        waiting.cancel()


def full_name(session: Session, topic: str) -> str:
    """The full name of a topic that need not be there. Raises `InvalidNameError`."""
    return session.node.resolve_topic_name(topic if topic.startswith("/") else f"/{topic}")


def topic_names(session: Session) -> list[str]:
    """All topics there are now."""
    return [name for name, _ in session.node.get_topic_names_and_types()]
