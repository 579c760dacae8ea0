"""Subscriptions of topics: the class `Subscription`, and the base class that it shares with asyncio nodes."""

from __future__ import annotations

import inspect
from enum import Enum
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any, Awaitable, Callable, Optional, TypedDict, TypeVar

from rclpy._classes import Subscriptable
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import EventHandler, SubscriptionEventCallbacks
from rclpy.handles import TopicEntity
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.subscription_content_filter_options import ContentFilterOptions
from rclpy.utilities import _IDENTIFIERS
from rosidl_py_gen.runtime._rclpy_support import tells_publisher_gid

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.handles import Handle
    from rclpy.impl.content_filter import FilteredMessages
    from rosidl_py_gen import runtime

MsgType = TypeVar("MsgType")
T = TypeVar("T")
_take_message = methodcaller("take")
_take_message_with_info = methodcaller("take_with_info")


class PublisherGID(TypedDict):
    """Bytes that identify a publisher, with the identifier of the middleware that defines them."""

    implementation_identifier: str
    data: bytes


class _MessageInfoOfJazzy(TypedDict):
    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None


class MessageInfo(_MessageInfoOfJazzy, total=False):
    """Second argument of a subscription's callback: times in nanoseconds and sequence numbers, None if unknown.

    The field `publisher_gid` exists with ``ROS_DISTRO=lyrical``, and for nodes of `rclpy.experimental`.
    """

    publisher_gid: PublisherGID | None


GenericSubscriptionCallback = Callable[[T], None] | Callable[[T, MessageInfo], None]
AsyncGenericSubscriptionCallback = Callable[[T], Awaitable[None]] | Callable[[T, MessageInfo], Awaitable[None]]
GenericSubscriptionCallbackUnion = GenericSubscriptionCallback[T] | AsyncGenericSubscriptionCallback[T]
SubscriptionCallbackUnion = GenericSubscriptionCallbackUnion[T] | GenericSubscriptionCallbackUnion[bytes]


class BaseSubscription(Subscriptable, TopicEntity["runtime.Subscription[Any]"]):
    """Subscription to a topic; base class of `Subscription` and `rclpy.experimental.AsyncSubscription`.

    Attributes:
        msg_type: class of the messages.
        topic: name of the topic as the program passed it.
        raw: True if messages stay bytes.
        event_handlers: waitables for events of the subscription.
    """

    _rosidl_tells_gid = True

    class CallbackType(Enum):
        """Kind of a subscription's callback, by the arguments that it takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    def __init__(
        self,
        subscription_impl: Handle[runtime.Subscription[Any]],
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile,
        raw: bool,
        *,
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(subscription_impl, msg_type, topic, qos_profile, [], on_destroy)
        self.rosidl_is_ready = subscription_impl.may_be_ready
        self._rosidl_filtered: FilteredMessages | None = None
        self.callback = callback
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

    @property
    def is_cft_supported(self) -> bool:
        """True, because the subscription itself evaluates content filters, on every middleware."""
        with self.handle:
            return True

    @property
    def is_cft_enabled(self) -> bool:
        """True if the subscription has a content filter."""
        with self.handle:
            return self._rosidl_filtered is not None and self._rosidl_filtered.filter is not None

    def set_content_filter(self, filter_expression: str, expression_parameters: list[str]) -> None:
        """Call the callback only for messages that fulfil an expression, such as ``x > %0 AND name = %1``.

        Args:
            filter_expression: condition in the SQL subset of DDS; an empty text removes the filter.
            expression_parameters: values of ``%0``, ``%1``, …: ``"5"``, ``"TRUE"``, ``"'text'"``.

        Raises:
            RCLError: the expression or a parameter is invalid, or does not fit the fields of the message.
        """
        from rclpy.impl.content_filter import ContentFilter, FilteredMessages

        new_filter = None
        if filter_expression:
            new_filter = ContentFilter(self.msg_type, filter_expression, expression_parameters)
        with self.handle as handle:
            if self._rosidl_filtered is None and new_filter is not None:
                qos = self.qos_profile
                depth = None if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)
                filtered = FilteredMessages(handle.entity, self.msg_type, raw=self.raw, depth=depth)
                self._rosidl_filtered = filtered
                handle.set_ready_check(filtered.is_ready)
                self.rosidl_is_ready = self._rosidl_has_filtered
            if self._rosidl_filtered is not None:
                self._rosidl_filtered.filter = new_filter

    def get_content_filter(self) -> ContentFilterOptions:
        """Return the content filter of the subscription; raise RCLError if there is none."""
        with self.handle:
            content_filter = None if self._rosidl_filtered is None else self._rosidl_filtered.filter
            if content_filter is None:
                raise RCLError("failed to get the content filter: the subscription has none")
            return ContentFilterOptions(content_filter.expression, list(content_filter.parameters))

    def _rosidl_has_filtered(self) -> bool:
        filtered = self._rosidl_filtered
        return filtered is not None and self._rosidl_handle.is_ready() and filtered.has_messages()

    def rosidl_take_arguments(self) -> tuple[Any, ...] | None:
        """Take the next message, and return the arguments of the callback for it; None if there is no message."""
        if self._rosidl_filtered is not None:
            filtered = self._rosidl_filtered
            item = self._rosidl_handle.take_from(lambda _: filtered.take())
            if item is None or self._callback_type is self.CallbackType.MessageOnly:
                return None if item is None else (item[0],)
            return item[0], self._rosidl_info_dict(item[1])
        if self._callback_type is self.CallbackType.MessageOnly:
            message = self._rosidl_handle.take_from(_take_message)
            return None if message is None else (message,)
        message_and_info = self._rosidl_handle.take_from(_take_message_with_info)
        if message_and_info is None:
            return None
        return message_and_info[0], self._rosidl_info_dict(message_and_info[1])

    def _rosidl_info_dict(self, info: runtime.MessageInfo) -> MessageInfo:
        found: MessageInfo = {
            "source_timestamp": info.source_timestamp_ns,
            "received_timestamp": info.received_timestamp_ns,
            "publication_sequence_number": info.publication_sequence_number,
            "reception_sequence_number": None,
        }
        if self._rosidl_tells_gid:
            identifier = _IDENTIFIERS[self._rosidl_handle.context.runtime.middleware.lower()]
            found["publisher_gid"] = {"implementation_identifier": identifier, "data": info.publisher_gid}
        return found


class Subscription(BaseSubscription):
    """Subscription of a topic, created by `Node.create_subscription`."""

    rosidl_take_method = "_take_subscription"

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
        super().__init__(subscription_impl, msg_type, topic, callback, qos_profile, raw)
        self.event_handlers = event_callbacks
        self.callback_group = callback_group
        self._executor_event = False
        self._rosidl_tells_gid = tells_publisher_gid()

    def rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        arguments = self.rosidl_take_arguments()
        return None if arguments is None else partial(self._callback, *arguments)
