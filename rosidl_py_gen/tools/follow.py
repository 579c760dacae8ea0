"""A subscription that follows its publishers.

Decides what a subscription asks for when the user says nothing: what all publishers of its type offer, so that it
connects to each of them. When one appears that offers less, it is made again.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools.session import now_s

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import MessageInfo, Node, Subscription, TopicEndpointInfo

_DEPTH = 100
"""More than the 5 of sensor data: printing is slower than receiving, and bursts shall not be cut."""


class Follow:
    """Messages of a topic. ``async with`` follows its publishers by itself; others call `look` when the graph changes.

    Args:
        callback: is called with messages; else `receive_with_info` waits for them.
        qos: what to ask for, whatever is offered.
        note: is told what the user should know of the choice, each time it is made.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        cls: type[Message],
        *,
        raw: bool = True,
        callback: Callable[[Any], object] | None = None,
        qos: QoSProfile | None = None,
        depth: int = _DEPTH,
        note: Callable[[str], object] = lambda text: None,
    ) -> None:
        self._node, self._topic, self._cls = node, topic, cls
        self._raw: Any = raw
        self._callback, self._given, self._depth, self._note = callback, qos, depth, note
        self._dropped = 0
        self._watching: asyncio.Task[None] | None = None
        self._subscription = self._subscribe()

    async def __aenter__(self) -> Self:
        self._watching = asyncio.ensure_future(self._watch())
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._watching is not None
        self._watching.cancel()
        self.close()

    async def _watch(self) -> None:
        self.look()  # something may have come before this task began
        async for _ in self._node.graph_changes():
            self.look()

    def _publishers(self) -> list[TopicEndpointInfo]:
        found = self._node.get_publishers_info_by_topic(self._topic)
        return [one for one in found if one.topic_type == self._cls._TYPE.name]

    def _subscribe(self) -> Subscription[Any]:
        profile = self._given
        if profile is None:
            profile, notes = _chosen(self._publishers(), self._depth)
            for text in notes:
                self._note(text)
        return self._node.create_subscription(self._cls, self._topic, self._callback, profile, raw=self._raw)

    def look(self) -> None:
        """Subscribe again if one of the publishers offers less by now."""
        if self._given is None and _is_too_much(self.qos, self._publishers()):
            self.renew()

    def renew(self) -> None:
        """Subscribe again; who keeps messages for those who come late sends them once more."""
        self.close()
        self._dropped += self._subscription.dropped
        self._subscription = self._subscribe()

    async def receive_with_info(self, timeout_s: float | None = None) -> tuple[Any, MessageInfo]:
        """The next message. Raises as `Subscription.receive_with_info`."""
        end_s = None if timeout_s is None else now_s() + timeout_s
        while True:
            subscription = self._subscription
            try:
                return await subscription.receive_with_info(None if end_s is None else max(0.0, end_s - now_s()))
            except ClosedError:
                if subscription is self._subscription:  # it was not made again
                    raise

    @property
    def qos(self) -> QoSProfile:
        """What is asked for now."""
        return self._subscription.qos

    @property
    def dropped(self) -> int:
        """Messages that were not taken in time."""
        return self._dropped + self._subscription.dropped

    def close(self) -> None:
        """End the subscription; whoever waits for a message gets `ClosedError`."""
        self._subscription.close()


def _chosen(publishers: Sequence[TopicEndpointInfo], depth: int) -> tuple[QoSProfile, list[str]]:
    """The profile of a subscription that connects to all of these publishers, and what the user should know of it."""
    profile = presets.SENSOR_DATA.keep_last(depth)
    notes = []
    reliable = [one.qos_profile.reliability is Reliability.RELIABLE for one in publishers]
    durable = [one.qos_profile.durability is Durability.TRANSIENT_LOCAL for one in publishers]
    if publishers and all(reliable):
        profile = profile.reliable()
    elif any(reliable):
        notes.append("some, but not all, publishers are reliable: receiving best effort, which connects to all of them")
    if publishers and all(durable):
        profile = profile.transient_local()
    elif any(durable):
        notes.append("some, but not all, publishers are transient local: receiving volatile, so nothing of before now")
    return profile, notes


def _is_too_much(profile: QoSProfile, publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether a chosen profile asks for more than one of the publishers offers by now."""
    now, _ = _chosen(publishers, 1)
    return bool(publishers) and (
        (profile.reliability is Reliability.RELIABLE is not now.reliability)
        or (profile.durability is Durability.TRANSIENT_LOCAL is not now.durability)
    )
