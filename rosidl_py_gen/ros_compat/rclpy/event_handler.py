"""Events of publishers and subscriptions, such as missed deadlines, and the waitables that call the program's functions
for them.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import TYPE_CHECKING, Any, List, Optional

from rclpy._rclpy_pybind11 import EnumOfC, UnsupportedEventTypeError, rmw_qos_policy_kind_t
from rclpy.callback_groups import CallbackGroup
from rclpy.handles import Destroyable
from rclpy.logging import get_logger
from rclpy.qos import qos_policy_name_from_kind
from rclpy.waitable import NumberOfEntities, Waitable
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy.handles import ContextHandle, Handle
    from rclpy.waitable import WaitSet


class rcl_publisher_event_type_t(EnumOfC):  # as in C
    """Kinds of events of publishers, with the numbers of rcl."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


QoSPublisherEventType = rcl_publisher_event_type_t


class rcl_subscription_event_type_t(EnumOfC):  # as in C
    """Kinds of events of subscriptions, with the numbers of rcl."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


QoSSubscriptionEventType = rcl_subscription_event_type_t


QoSRequestedDeadlineMissedInfo = runtime.CountStatus
QoSLivelinessChangedInfo = runtime.LivelinessStatus
QoSMessageLostInfo = runtime.CountStatus
QoSRequestedIncompatibleQoSInfo = runtime.IncompatibleStatus
QoSSubscriptionMatchedInfo = runtime.MatchedStatus
QoSOfferedDeadlineMissedInfo = runtime.CountStatus
QoSLivelinessLostInfo = runtime.CountStatus
QoSPublisherMatchedInfo = runtime.MatchedStatus
QoSOfferedIncompatibleQoSInfo = runtime.IncompatibleStatus
IncompatibleTypeInfo = runtime.IncompatibleStatus


class EventHandle(Destroyable):
    """Queue of the events of one kind that an endpoint has reported and no executor has taken yet."""

    def __init__(self, items: deque[Any]) -> None:
        super().__init__()
        self.items = items

    def is_ready(self) -> bool:
        return self.is_valid and bool(self.items)


class EventHandler(Waitable):
    """Waitable for one kind of event of a publisher or subscription, which calls a function for each event.

    Raises:
        UnsupportedEventTypeError: the endpoint was created without a callback for the event.
    """

    def __init__(
        self,
        *,
        callback_group: CallbackGroup,
        callback: Callable[[Any], Any],
        event_type: EnumOfC,
        parent_impl: Handle[Any],
    ) -> None:
        super().__init__(callback_group)
        self.event_type = event_type
        self.callback = callback
        with parent_impl:
            items = parent_impl.events.get(int(event_type))
            if items is None:
                raise UnsupportedEventTypeError(
                    f"event {event_type!r} is not recorded; pass event_callbacks when the endpoint is created"
                )
            self._rosidl_event = EventHandle(items)
        if type(self).is_ready is EventHandler.is_ready:
            self.rosidl_queue = items

    def is_ready(self, wait_set: WaitSet) -> bool:
        return self._rosidl_event.is_ready()

    def take_data(self) -> Any:
        with self._rosidl_event, suppress(IndexError):
            return self._rosidl_event.items.popleft()
        return None

    async def execute(self, taken_data: Any) -> None:
        if taken_data:
            import rclpy  # its `executors` is loaded, because one of them calls this method

            await rclpy.executors.await_or_execute(self.callback, taken_data)

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_events=1)

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        with self._rosidl_event:
            wait_set.add_event(self._rosidl_event)

    def destroy(self) -> None:
        """Stop waiting for events of this kind."""
        self._rosidl_event.destroy_when_not_in_use()


class QoSEventHandler(EventHandler):
    """Deprecated name of `EventHandler`."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        text = "QoSEventHandler foo is deprecated, use EventHandler instead."  # as in rclpy
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        super().__init_subclass__(**kwargs)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        text = "QoSEventHandler is deprecated, use EventHandler instead."
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        super().__init__(*args, **kwargs)


class _EventCallbacks:
    """Base class of the callbacks for events of an endpoint.

    The fields of subclasses have the event names of rosidl_py_gen.runtime.
    """

    _ROSIDL_EVENT_TYPES: dict[str, EnumOfC]
    _ROSIDL_QOS_WARNING: str
    _ROSIDL_RUNTIME_CLASS: type[Any]
    use_default_callbacks: bool

    def _rosidl_program_callbacks(self) -> dict[str, Callable[[Any], Any]]:
        return {name: getattr(self, name) for name in self._ROSIDL_EVENT_TYPES if getattr(self, name) is not None}

    def rosidl_queues(self, context: ContextHandle) -> tuple[dict[int, deque[Any]], Any]:
        """Return queues for the events that the program has requested, by rcl's event number, and callbacks that fill
        the queues.

        The callbacks are None if no event is requested.
        """
        defaults = ("incompatible_qos", "incompatible_type") if self.use_default_callbacks else ()
        queues = {name: deque[Any]() for name in (*defaults, *self._rosidl_program_callbacks())}

        def appender(queue: deque[Any]) -> Callable[[Any], None]:
            def append(status: Any) -> None:
                if isinstance(status, runtime.IncompatibleStatus):  # its policy is a member of the C enum in rclpy
                    policy: Any = rmw_qos_policy_kind_t(int(status.last_policy_kind))
                    status = replace(status, last_policy_kind=policy)
                queue.append(status)
                context.notify()

            return append

        by_number = {self._ROSIDL_EVENT_TYPES[name].value: queue for name, queue in queues.items()}
        functions = {name: appender(queue) for name, queue in queues.items()}
        return by_number, self._ROSIDL_RUNTIME_CLASS(**functions) if functions else None

    def _rosidl_handlers(self, callback_group: CallbackGroup, impl: Handle[Any], topic_name: str) -> list[EventHandler]:
        functions = self._rosidl_default_callbacks(impl, topic_name) | self._rosidl_program_callbacks()
        types = self._ROSIDL_EVENT_TYPES
        return [
            EventHandler(callback_group=callback_group, callback=function, event_type=types[name], parent_impl=impl)
            for name, function in functions.items()
        ]

    def _rosidl_default_callbacks(self, impl: Handle[Any], topic_name: str) -> dict[str, Callable[[Any], Any]]:
        """Return the default callbacks by event name, which log incompatible peers.

        The result is empty if default callbacks are switched off.
        """
        if not self.use_default_callbacks:
            return {}
        logger = get_logger(impl.logger_name)

        def log_qos(event: runtime.IncompatibleStatus) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            logger.warn(f"{self._ROSIDL_QOS_WARNING.format(topic_name)} Last incompatible policy: {policy}")

        def log_type(event: runtime.IncompatibleStatus) -> None:
            # Not rclpy's "no messages will be sent to it": messages with another definition may be delivered.
            logger.warn(f"Incompatible type on topic '{topic_name}': {event.reason}")

        return {"incompatible_qos": log_qos, "incompatible_type": log_type}


@dataclass(kw_only=True, eq=False)
class SubscriptionEventCallbacks(_EventCallbacks):
    """Callbacks for events of a subscription; each is called with a value such as `QoSSubscriptionMatchedInfo`."""

    _ROSIDL_RUNTIME_CLASS = runtime.SubscriptionEventCallbacks
    _ROSIDL_QOS_WARNING = (
        "New publisher discovered on topic '{}', offering incompatible QoS. No messages will be received from it."
    )
    _ROSIDL_EVENT_TYPES = {  # noqa: RUF012
        "deadline": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
        "incompatible_qos": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
        "liveliness": QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
        "message_lost": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
        "incompatible_type": QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
        "matched": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    }

    deadline: Callable[[runtime.CountStatus], Any] | None = None
    incompatible_qos: Callable[[runtime.IncompatibleStatus], Any] | None = None
    liveliness: Callable[[runtime.LivelinessStatus], Any] | None = None
    message_lost: Callable[[runtime.CountStatus], Any] | None = None
    incompatible_type: Callable[[runtime.IncompatibleStatus], Any] | None = None
    matched: Callable[[runtime.MatchedStatus], Any] | None = None
    use_default_callbacks: bool = True

    def create_event_handlers(
        self, callback_group: CallbackGroup, subscription: Handle[Any], topic_name: str
    ) -> list[EventHandler]:
        """Return a waitable for each callback of the program.

        With `use_default_callbacks`, the default callbacks get waitables, too.
        """
        return self._rosidl_handlers(callback_group, subscription, topic_name)


@dataclass(kw_only=True, eq=False)
class PublisherEventCallbacks(_EventCallbacks):
    """Callbacks for events of a publisher; each is called with a value such as `QoSPublisherMatchedInfo`."""

    _ROSIDL_RUNTIME_CLASS = runtime.PublisherEventCallbacks
    _ROSIDL_QOS_WARNING = (
        "New subscription discovered on topic '{}', requesting incompatible QoS. No messages will be sent to it."
    )
    _ROSIDL_EVENT_TYPES = {  # noqa: RUF012
        "deadline": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
        "liveliness": QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST,
        "incompatible_qos": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        "incompatible_type": QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        "matched": QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
    }

    deadline: Callable[[runtime.CountStatus], Any] | None = None
    liveliness: Callable[[runtime.CountStatus], Any] | None = None
    incompatible_qos: Callable[[runtime.IncompatibleStatus], Any] | None = None
    incompatible_type: Callable[[runtime.IncompatibleStatus], Any] | None = None
    matched: Callable[[runtime.MatchedStatus], Any] | None = None
    use_default_callbacks: bool = True

    def create_event_handlers(
        self, callback_group: CallbackGroup, publisher: Handle[Any], topic_name: str
    ) -> list[EventHandler]:
        """Return a waitable for each callback of the program.

        With `use_default_callbacks`, the default callbacks get waitables, too.
        """
        return self._rosidl_handlers(callback_group, publisher, topic_name)
