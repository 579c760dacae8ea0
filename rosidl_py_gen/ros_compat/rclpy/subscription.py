"""Subscriptions."""

from __future__ import annotations

import inspect
from enum import Enum
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any, Callable, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import EventHandler, SubscriptionEventCallbacks
from rclpy.impl.entities import TopicEntity
from rclpy.qos import QoSProfile

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.handles import Handle
    from rosidl_py_gen import runtime

MsgType = TypeVar("MsgType")
_take_message = methodcaller("take")
_take_message_with_info = methodcaller("take_with_info")


class Subscription(TopicEntity["runtime.Subscription[Any]"]):
    """Subscription of a topic, created by `Node.create_subscription`.

    Attributes:
        msg_type: class of the messages.
        topic: name as it was passed.
        raw: True if messages stay bytes.
        event_handlers: waitables for its events.
    """

    _rosidl_take_method = "_take_subscription"

    class CallbackType(Enum):
        """Arguments of the callback."""

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
        super().__init__(subscription_impl, msg_type, topic, qos_profile, event_callbacks)
        self._rosidl_is_ready = subscription_impl.may_be_ready
        self.callback = callback
        self.callback_group = callback_group
        self._executor_event = False
        self.raw = raw

    def get_publisher_count(self) -> int:
        """Return the number of matched publishers."""
        with self.handle.in_use(require_ok=False) as subscription:
            return subscription.publisher_count

    @property
    def callback(self) -> Callable[..., Any]:
        """Function that takes the message, or the message and a dict of its times and sequence numbers."""
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

    def _rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        arguments = self._rosidl_take_arguments()
        return None if arguments is None else partial(self._callback, *arguments)

    def _rosidl_take_arguments(self) -> tuple[Any, ...] | None:
        """Return the arguments of the callback for the next message."""
        if self._callback_type is self.CallbackType.MessageOnly:
            message = self._rosidl_handle.take_from(_take_message)
            return None if message is None else (message,)
        message_and_info = self._rosidl_handle.take_from(_take_message_with_info)
        if message_and_info is None:
            return None
        message, info = message_and_info
        info_dict = {
            "source_timestamp": info.source_timestamp_ns,
            "received_timestamp": info.received_timestamp_ns,
            "publication_sequence_number": info.publication_sequence_number,
            "reception_sequence_number": None,
        }
        return message, info_dict
