"""``log``: what nodes log now, and what they keep of before.

Decides that what nodes kept is printed in the order of its times: it comes node by node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.runtime import AdaptiveSubscription, Durability, QoSProfile, Reliability, WaitTimeoutError
from rosidl_py_gen.tools import Job, printing
from rosidl_py_gen.tools.log.lines import Lines
from rosidl_py_gen.tools.session import Network, Session, now_s

_TOPIC, _DEPTH = "/rosout", 1000
_KEPT_S = 0.3
"""How long what was kept may take; nodes send it at once."""


def run(
    network: Network,
    level: str,
    nodes: Sequence[str],
    pattern: str | None,
    times: int | None,
    only_new: bool,
    verbose: bool,
    as_json: bool,
) -> Job:
    """What the command does."""
    lines = Lines(level, nodes, pattern, times=times, verbose=verbose, as_json=as_json)
    return Job(_follow(network, lines, only_new), endless=times is None)


async def _follow(network: Network, lines: Lines, only_new: bool) -> int:
    async with Session(network) as session:
        await session.wait_until_quiet()
        cls: Any = get_message("rcl_interfaces/msg/Log")
        qos = _profile(session, only_new)
        following: AdaptiveSubscription[Any] = AdaptiveSubscription(
            session.node, _TOPIC, cls, qos=qos, depth=_DEPTH, note=printing.note
        )
        async with following as messages:
            for message in await _kept(messages):
                lines.show(message)
            while not lines.is_done:
                message, _ = await messages.receive_with_info()
                lines.show(message)
    return 0


def _profile(session: Session, only_new: bool) -> QoSProfile | None:
    """What nodes offer, so that those that come later are heard from their first word; None if any offers less."""
    if only_new:
        return QoSProfile(depth=_DEPTH)
    for one in session.node.get_publishers_info_by_topic(_TOPIC):
        offered = one.qos_profile
        if (offered.reliability, offered.durability) != (Reliability.RELIABLE, Durability.TRANSIENT_LOCAL):
            return None
    return QoSProfile(depth=_DEPTH).transient_local()


async def _kept(messages: AdaptiveSubscription[Any]) -> list[Any]:
    found = []
    end_s = now_s() + _KEPT_S
    try:
        while (left_s := end_s - now_s()) > 0:
            found.append((await messages.receive_with_info(left_s))[0])
    except WaitTimeoutError:
        pass
    return sorted(found, key=lambda message: stamp_ns(message.stamp))
