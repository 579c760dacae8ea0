"""Publishers of topics: the class `Publisher`, and the base class that it shares with asyncio nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, Union

from rclpy._classes import Subscriptable
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import EventHandler, PublisherEventCallbacks
from rclpy.handles import TopicEntity
from rclpy.qos import QoSProfile
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.handles import Handle

MsgType = TypeVar("MsgType")


class BasePublisher(Subscriptable, TopicEntity[runtime.Publisher[Any]]):
    """Publisher of a topic; base class of `Publisher` and `rclpy.experimental.AsyncPublisher`.

    Attributes:
        msg_type: class of the messages.
        topic: name of the topic as the program passed it.
        event_handlers: waitables for events of the publisher.
    """

    def __init__(
        self,
        publisher_impl: Handle[runtime.Publisher[Any]],
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile,
        *,
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(publisher_impl, msg_type, topic, qos_profile, [], on_destroy)

    def publish(self, msg: Any) -> None:
        """Publish a message, or the bytes of a serialized message. Thread: any.

        Raises:
            TypeError: the message is of another class.
            InvalidHandle: the publisher was destroyed.
            RCLError: the context was shut down.
            rosidl_py_gen.runtime.EncodeError: a field does not fit its type.
        """
        with self._rosidl_handle as handle:
            handle.context.require_ok()
            try:
                if isinstance(msg, self.msg_type):
                    handle.entity.publish(msg)
                elif isinstance(msg, bytes):
                    handle.entity.publish_raw(msg)
                else:
                    raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
            except runtime.ClosedError as error:
                raise RCLError(str(error)) from error

    def get_subscription_count(self) -> int:
        """Return the number of matched subscriptions."""
        with self.handle.in_use() as publisher:
            return publisher.subscription_count

    def assert_liveliness(self) -> None:
        """Announce that the publisher is alive; necessary with manual liveliness while it publishes nothing."""
        with self.handle.in_use() as publisher:
            publisher.assert_liveliness()


class Publisher(BasePublisher):
    """Publisher of a topic, created by `Node.create_publisher`."""

    def __init__(
        self,
        publisher_impl: Handle[runtime.Publisher[Any]],
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile,
        event_callbacks: list[EventHandler],
        callback_group: CallbackGroup,
    ) -> None:
        super().__init__(publisher_impl, msg_type, topic, qos_profile)
        self.event_handlers = event_callbacks

    def wait_for_all_acked(self, timeout: Duration = Duration(seconds=-1)) -> bool:  # noqa: B008  as in rclpy
        """Wait until all reliable subscriptions have acknowledged all messages; return False if `timeout` is over.

        A negative timeout is unlimited.
        """
        seconds = timeout.nanoseconds / 1e9
        with self.handle.in_use() as publisher:
            try:
                acknowledgement = publisher.wait_for_acknowledged(None if seconds < 0 else seconds)
                return bool(self.handle.context.loop_runner.run(acknowledgement))
            except runtime.WaitTimeoutError:
                return False
