"""Subscriptions."""

from __future__ import annotations

import inspect
from enum import Enum
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any, Callable, TypeVar  # noqa: UP035

from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.event_handler import EventHandler as EventHandler
from rclpy.event_handler import SubscriptionEventCallbacks as SubscriptionEventCallbacks
from rclpy.qos import QoSProfile as QoSProfile

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.handles import Handle
    from rosidl_py_gen import runtime

MsgType = TypeVar("MsgType")
_message = methodcaller("take")
_message_with_info = methodcaller("take_with_info")


class Subscription:
    """Made by `Node.create_subscription`.

    Attributes:
        msg_type: the class of the messages.
        topic: the name as it was written.
        raw: messages stay bytes.
        event_handlers: what waits for events of it.
    """

    class CallbackType(Enum):
        """What the callback takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    def __init__(
        self,
        subscription_impl: Handle[runtime.Subscription[Any]],
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
        raw: bool,
        event_callbacks: list[EventHandler],
    ) -> None:
        self._rosidl_subscription = subscription_impl
        self._rosidl_is_ready = subscription_impl.is_ready_marked
        self.msg_type = msg_type
        self.topic = topic
        self.callback = callback
        self.callback_group = callback_group
        self._executor_event = False
        self.qos_profile = qos_profile
        self.raw = raw
        self.event_handlers = event_callbacks

    def get_publisher_count(self) -> int:
        """How many publishers it is connected with."""
        with self.handle.in_use() as subscription:
            return subscription.publisher_count

    @property
    def handle(self) -> Handle[runtime.Subscription[Any]]:
        """What a wait set takes."""
        return self._rosidl_subscription

    def destroy(self) -> None:
        """End it; use `Node.destroy_subscription`."""
        for handler in self.event_handlers:
            handler.destroy()
        self.handle.destroy_when_not_in_use()

    @property
    def topic_name(self) -> str:
        """The name after expansion and remapping."""
        with self.handle.in_use() as subscription:
            return subscription.topic

    @property
    def callback(self) -> Callable[..., Any]:
        """Called with the message, or with the message and a dict of its times and numbers."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        self._callback = value
        for kind, count in ((self.CallbackType.MessageOnly, 1), (self.CallbackType.WithMessageInfo, 2)):
            try:
                inspect.signature(value).bind(*[object()] * count)
            except TypeError:
                continue
            self._callback_type = kind
            return
        raise RuntimeError(
            "Subscription.__init__(): callback should be either be callable with one argument"
            "(to get only the message) or two (to get message and message info)"
        )

    @property
    def logger_name(self) -> str:
        """The name of the node's logger."""
        with self.handle as handle:
            return handle.logger_name

    def _rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        if self._callback_type is self.CallbackType.MessageOnly:
            message = self._rosidl_subscription.take_from(_message)
            return None if message is None else self._rosidl_bound(message)
        found = self._rosidl_subscription.take_from(_message_with_info)
        if found is None:
            return None
        message, info = found
        told = {
            "source_timestamp": info.source_timestamp_ns,
            "received_timestamp": info.received_timestamp_ns,
            "publication_sequence_number": info.publication_sequence_number,
            "reception_sequence_number": None,
        }
        return self._rosidl_bound(message, told)

    def _rosidl_bound(self, *args: Any) -> Callable[[], Any]:
        """The callback as a function without arguments, which is async if the callback is."""
        return partial(self._callback, *args)
