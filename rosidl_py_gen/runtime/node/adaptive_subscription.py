"""Subscription that adapts its QoS profile to all publishers of its topic, and `Node` methods based on it."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, overload

from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.entities.message_types import DictMessage, message_type
from rosidl_py_gen.runtime.node.context import NodeBase
from rosidl_py_gen.runtime.time_values import Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.transport.qos import SENSOR_DATA, Durability, Reliability

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.entities.topics import MessageInfo, Subscription
    from rosidl_py_gen.runtime.graph import TopicEndpointInfo
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

T = TypeVar("T")
MessageT = TypeVar("MessageT", bound=Message)

_DEPTH = 100
"""Default queue depth of an adaptive subscription; larger than the 5 of the sensor data profile, because a program may
be slower than a burst."""


class AdaptiveSubscription(Generic[T]):
    """Subscription that adapts its QoS profile to its publishers.

    The subscription requests reliability and durability if all publishers of its type offer them. When a publisher
    appears that offers less, the subscription is recreated: automatically in ``async with``, otherwise when the program
    calls `refresh`.

    Args:
        node: owner of the subscription.
        topic: topic name, which is expanded and remapped.
        msg_type: as in `Node.create_subscription`, like `raw` and `arrays`.
        callback: called with each message; without a callback, `receive_with_info` returns the messages.
        qos: profile to request, even if publishers offer less; None adapts the profile.
        depth: queue depth, if `qos` is None.
        note: called, whenever a profile is chosen, with a sentence for each kind of messages that it does not receive.
    """

    def __init__(
        self,
        node: MessageMethods,
        topic: str,
        msg_type: type[Message] | str,
        callback: Callable[[T], object] | None = None,
        *,
        qos: QoSLike | None = None,
        depth: int = _DEPTH,
        raw: bool = False,
        arrays: bool = False,
        note: Callable[[str], object] = lambda text: None,
    ) -> None:
        self._node: Any = node
        self._topic, self._type, self._type_name = topic, msg_type, message_type(msg_type).ros_name
        self._options: dict[str, Any] = {"raw": raw, "arrays": arrays}
        self._callback, self._fixed_qos, self._depth, self._note = callback, qos, depth, note
        self._notes: list[str] = []
        """Sentences for the user about messages that the chosen QoS profile does not receive."""
        self._dropped = self._incompatible_dropped = 0
        self._had_publishers = False
        """True if the topic had publishers when the QoS profile was chosen."""
        self._has_received = False
        self._rest: deque[tuple[T, MessageInfo]] = deque()
        """Messages that previous subscriptions received and that `receive_with_info` has not returned yet."""
        self._watch_task: asyncio.Task[None] | None = None
        self._subscription = self._subscribe()

    async def __aenter__(self) -> Self:
        self._watch_task = asyncio.ensure_future(self._watch())
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._watch_task is not None
        self._watch_task.cancel()
        self.close()

    async def _watch(self) -> None:
        try:
            self.refresh()  # the graph may have changed before this task has started
            async for _ in self._node.graph_changes():
                self.refresh()
        except Exception:
            self.close()
            raise

    def _publishers(self) -> list[TopicEndpointInfo]:
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return [info for info in infos if info.topic_type == self._type_name]

    def _subscribe(self) -> Subscription[T]:
        profile = self._fixed_qos
        if profile is None:
            publishers = self._publishers()
            self._had_publishers = bool(publishers)
            profile, self._notes = _choose_profile(publishers, self._depth)
            for text in self._notes:
                self._note(text)
        subscription: Subscription[T] = self._node.create_subscription(
            self._type, self._topic, self._callback, profile, **self._options
        )
        return subscription

    def refresh(self) -> None:
        """Subscribe again if the profile no longer fits the publishers; has no effect if the user set the profile.

        The profile does not fit if a publisher offers less than requested, or if the first publishers retain messages,
        which a volatile subscription does not request, and no message was received yet.
        """
        publishers = self._publishers()
        if self._fixed_qos is not None or not publishers:
            return
        current, (chosen, _) = self.qos, _choose_profile(publishers, 1)
        requests_too_much = (current.reliability is Reliability.RELIABLE is not chosen.reliability) or (
            current.durability is Durability.TRANSIENT_LOCAL is not chosen.durability
        )
        # Only if no message was received yet, so that none is received twice.
        has_messages = self._has_received or self._callback is not None or self._subscription._has_news()
        may_request_more = not (self._had_publishers or has_messages)
        if requests_too_much or (may_request_more and chosen.durability is not current.durability):
            self.resubscribe()
        self._had_publishers = True

    def resubscribe(self) -> None:
        """Subscribe again, so that publishers send retained messages again; messages received before are not lost."""
        if self._callback is None:
            with suppress(ClosedError):
                while (taken := self._subscription.take_with_info()) is not None:
                    self._rest.append(taken)
        self._subscription.close()
        self._dropped += self._subscription.dropped
        self._incompatible_dropped += self._subscription.incompatible_dropped
        self._subscription = self._subscribe()

    def set_definition(self, msg_type: type[Message]) -> None:
        """Set the definition of raw messages if it was not known at creation.

        Messages of other definitions are dropped from now on, including messages that were received, but not returned
        yet.

        Args:
            msg_type: class with the name of the topic's type.
        """
        self._type = msg_type
        self._subscription._set_definition(message_type(msg_type), self._rest)

    async def receive_with_info(self, timeout_s: float | None = None) -> tuple[T, MessageInfo]:
        """Return the next message with its `MessageInfo`; raises like `Subscription.receive_with_info`.

        There is no blocking form, because a task on the event loop watches the publishers; a script can use
        `Node.wait_for_message_sync`.
        """
        deadline = Deadline(timeout_s)
        while not self._rest:
            subscription = self._subscription
            try:
                result = await subscription.receive_with_info(deadline.remaining_s())
            except ClosedError:
                if subscription is self._subscription:  # not replaced by `resubscribe`
                    if self._watch_task is not None and self._watch_task.done() and not self._watch_task.cancelled():
                        self._watch_task.result()  # raises the exception that has ended it
                    raise
            except WaitTimeoutError as error:
                reason = "; ".join(filter(None, [error.reason, *self._notes]))
                raise WaitTimeoutError(f"no message on {subscription.topic} in {timeout_s} s", reason) from None
            else:
                self._has_received = True
                return result
        self._has_received = True
        return self._rest.popleft()

    @property
    def qos(self) -> QoSProfile:
        """QoS profile of the current subscription."""
        return self._subscription.qos

    @property
    def dropped(self) -> int:
        """Number of received messages that were dropped because the queue was full."""
        return self._dropped + self._subscription.dropped

    @property
    def incompatible_dropped(self) -> int:
        """Number of messages dropped because their publisher has another definition of the type."""
        return self._incompatible_dropped + self._subscription.incompatible_dropped

    def close(self) -> None:
        """Stop receiving; a waiting `receive_with_info` raises `ClosedError`."""
        self._subscription.close()


def _choose_profile(publishers: Sequence[TopicEndpointInfo], depth: int) -> tuple[QoSProfile, list[str]]:
    """Return a QoS profile that matches all publishers, and sentences about the messages that a subscription with it
    does not receive.
    """
    profile = SENSOR_DATA.keep_last(depth)
    notes = []
    reliable = [publisher.qos_profile.reliability is Reliability.RELIABLE for publisher in publishers]
    durable = [publisher.qos_profile.durability is Durability.TRANSIENT_LOCAL for publisher in publishers]
    if publishers and all(reliable):
        profile = profile.reliable()
    elif any(reliable):
        notes.append("some, but not all, publishers are reliable: receiving best effort, which matches all of them")
    if publishers and all(durable):
        profile = profile.transient_local()
    elif any(durable):
        notes.append("some, but not all, publishers are transient local: receiving volatile, without earlier messages")
    return profile, notes


class MessageMethods(NodeBase):
    """Methods of `Node` that receive one message."""

    @overload
    async def wait_for_message(
        self, msg_type: type[MessageT], topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[False] = ..., arrays: bool = ...,
    ) -> MessageT: ...  # fmt: skip
    @overload
    async def wait_for_message(
        self, msg_type: type[Message] | str, topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[True],
    ) -> bytes: ...  # fmt: skip
    @overload
    async def wait_for_message(
        self, msg_type: str, topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[False] = ...,
    ) -> DictMessage: ...  # fmt: skip
    async def wait_for_message(
        self,
        msg_type: type[Message] | str,
        topic: str,
        timeout_s: float | None = None,
        *,
        qos: QoSLike | None = None,
        raw: bool = False,
        arrays: bool = False,
    ) -> Any:
        """Return the next message of a topic, or the latest message that its publishers retain for late subscriptions.

        Args:
            msg_type: as in `create_subscription`, like `topic`, `raw` and `arrays`.
            timeout_s: None waits forever.
            qos: profile to request. None requests what all publishers offer, including publishers that appear while the
                method waits.

        Raises:
            WaitTimeoutError: no message arrived within `timeout_s`; its attribute `reason` says why, if that is known.
            InvalidNameError, InvalidQoSError, TypeNotFoundError: topic, profile or type is invalid or unknown.
            TypeError, ValueError: another argument is invalid.
            ClosedError: the node is closed, also while waiting.
        """
        subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
            self, topic, msg_type, qos=qos, depth=1, raw=raw, arrays=arrays
        )
        async with subscription as messages:
            return (await messages.receive_with_info(timeout_s))[0]

    wait_for_message_sync = blocking(wait_for_message)
