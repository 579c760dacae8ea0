"""Messages of a topic whose quality of service is not known beforehand: methods of `Node`, and a subscription.

The subscription requests what all publishers of its type offer, so that it matches each of them. When one appears that
offers less, it is recreated.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, overload

from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.entities.message_types import DictMessage, message_type
from rosidl_py_gen.runtime.time.deadline import Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.transport.qos import SENSOR_DATA, Durability, Reliability

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.subscription import MessageInfo, Subscription
    from rosidl_py_gen.runtime.graph.graph import TopicEndpointInfo
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

T = TypeVar("T")
MessageT = TypeVar("MessageT", bound=Message)

_DEPTH = 100
"""More than the 5 of sensor data: a program may be slower than a burst, which shall not be cut."""


class AdaptiveSubscription(Generic[T]):
    """A subscription that adapts its quality of service to its publishers.

    It requests what all publishers of its type offer: reliable messages, and retained ones, where all of them have
    these. When a publisher appears that offers less, it subscribes again: automatically in ``async with``, otherwise
    when the program calls `refresh`.

    Args:
        node: owner of the subscription.
        msg_type: as in `Node.create_subscription`, like `raw` and `arrays`.
        callback: is called with each message; without one, `receive_with_info` returns them.
        qos: profile to request, whatever is offered; None adapts it.
        depth: number of messages that wait until they are taken, if `qos` is None.
        note: is called with a sentence about what is not received because of the choice, each time it is made.
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
        self._callback, self._given, self._depth, self._note = callback, qos, depth, note
        self._notes: list[str] = []
        """Sentences about the messages that the chosen profile does not receive."""
        self._dropped = 0
        self._had_publishers = False
        """When the profile was chosen."""
        self._is_untouched = True
        """No message was received yet."""
        self._rest: deque[tuple[T, MessageInfo]] = deque()
        """Messages that had arrived when it subscribed again."""
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
        try:
            self.refresh()  # something may have come before this task began
            async for _ in self._node.graph_changes():
                self.refresh()
        except Exception:
            self.close()
            raise

    def _publishers(self) -> list[TopicEndpointInfo]:
        found = self._node.get_publishers_info_by_topic(self._topic)
        return [one for one in found if one.topic_type == self._type_name]

    def _subscribe(self) -> Subscription[T]:
        profile = self._given
        if profile is None:
            publishers = self._publishers()
            self._had_publishers = bool(publishers)
            profile, self._notes = _chosen(publishers, self._depth)
            for text in self._notes:
                self._note(text)
        subscription: Subscription[T] = self._node.create_subscription(
            self._type, self._topic, self._callback, profile, **self._options
        )
        return subscription

    def refresh(self) -> None:
        """Subscribe again if a publisher now offers less than requested, or the first ones retain messages."""
        if self._given is not None:
            return
        publishers = self._publishers()
        if _is_too_much(self.qos, publishers) or (not self._had_publishers and self._is_too_little(publishers)):
            self.resubscribe()
        self._had_publishers |= bool(publishers)

    def _is_too_little(self, publishers: Sequence[TopicEndpointInfo]) -> bool:
        """Return True if publishers retain messages, which a subscription made before them would not receive.

        Nothing is lost or received twice then: they send to a new subscription what they retain.
        """
        wanted, _ = _chosen(publishers, 1)
        is_untouched = self._is_untouched and self._callback is None and not self._subscription._has_news()
        return is_untouched and wanted.durability is not self.qos.durability

    def resubscribe(self) -> None:
        """Subscribe again; publishers that retain messages send them again. Messages that had arrived are kept."""
        if self._callback is None:
            with suppress(ClosedError):
                while (found := self._subscription.take_with_info()) is not None:
                    self._rest.append(found)
        self._subscription.close()
        self._dropped += self._subscription.dropped
        self._subscription = self._subscribe()

    async def receive_with_info(self, timeout_s: float | None = None) -> tuple[T, MessageInfo]:
        """Return the next message; raises as `Subscription.receive_with_info`."""
        deadline = Deadline(timeout_s)
        while not self._rest:
            subscription = self._subscription
            try:
                found = await subscription.receive_with_info(deadline.remaining_s())
            except ClosedError:
                if subscription is self._subscription:  # it was not made again
                    self._raise_failure()
                    raise
            except WaitTimeoutError as error:
                reason = "; ".join(filter(None, [error.reason, *self._notes]))
                raise WaitTimeoutError(f"no message on {subscription.topic} in {timeout_s} s", reason) from None
            else:
                self._is_untouched = False
                return found
        self._is_untouched = False
        return self._rest.popleft()

    def _raise_failure(self) -> None:
        """Raise what ended the following of publishers, if something did."""
        if self._watching is not None and self._watching.done() and not self._watching.cancelled():
            self._watching.result()

    @property
    def qos(self) -> QoSProfile:
        """Profile that is requested now."""
        return self._subscription.qos

    @property
    def dropped(self) -> int:
        """Number of messages that were not taken in time."""
        return self._dropped + self._subscription.dropped

    def close(self) -> None:
        """End the subscription; a waiting `receive_with_info` raises `ClosedError`."""
        self._subscription.close()


def _chosen(publishers: Sequence[TopicEndpointInfo], depth: int) -> tuple[QoSProfile, list[str]]:
    """Return the profile of a subscription that matches all of these publishers, and notes for the user."""
    profile = SENSOR_DATA.keep_last(depth)
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
    """Return True if a chosen profile requests more than one of the publishers now offers."""
    now, _ = _chosen(publishers, 1)
    return bool(publishers) and (
        (profile.reliability is Reliability.RELIABLE is not now.reliability)
        or (profile.durability is Durability.TRANSIENT_LOCAL is not now.durability)
    )


class MessageMethods:
    """Methods of `Node` that receive one message."""

    _scope: EntityScope

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
        """Return the next message of a topic, or the latest that its publishers retain for late subscriptions.

        Args:
            timeout_s: None waits for ever.
            qos: None asks for what all publishers offer, those included that appear while it waits.
            raw: as in `create_subscription`, like `arrays`.

        Raises:
            WaitTimeoutError: none came in time; its `reason` says why not.
            InvalidNameError, InvalidQoSError, TypeNotFoundError, ClosedError: as they say.
        """
        subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
            self, topic, msg_type, qos=qos, depth=1, raw=raw, arrays=arrays
        )
        async with subscription as messages:
            return (await messages.receive_with_info(timeout_s))[0]

    @overload
    def wait_for_message_sync(
        self, msg_type: type[MessageT], topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[False] = ..., arrays: bool = ...,
    ) -> MessageT: ...  # fmt: skip
    @overload
    def wait_for_message_sync(
        self, msg_type: type[Message] | str, topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[True],
    ) -> bytes: ...  # fmt: skip
    @overload
    def wait_for_message_sync(
        self, msg_type: str, topic: str, timeout_s: float | None = ..., *, qos: QoSLike | None = ...,
        raw: Literal[False] = ...,
    ) -> DictMessage: ...  # fmt: skip
    def wait_for_message_sync(
        self,
        msg_type: type[Message] | str,
        topic: str,
        timeout_s: float | None = None,
        *,
        qos: QoSLike | None = None,
        raw: bool = False,
        arrays: bool = False,
    ) -> Any:
        """`wait_for_message` for plain code; raises `WouldDeadlockError` on the event loop's thread."""
        options: Any = {"qos": qos, "raw": raw, "arrays": arrays}
        waiting: Coroutine[Any, Any, Any] = self.wait_for_message(msg_type, topic, timeout_s, **options)
        return self._scope.run_blocking(
            waiting, f"wait_for_message_sync of {self!r}", "'await ...wait_for_message(...)'"
        )
