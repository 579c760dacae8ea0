"""Filters that synchronize messages of several topics by their stamps, and a cache, based on
`rosidl_py_gen.message_filters`.

The callback of a subscription passes each message on, so all callbacks run in the thread that spins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger
from rclpy.time import Time

from rosidl_py_gen import message_filters

_HEADERLESS_WARNING = (
    "can not use message filters {}messages without timestamp infomation when 'allow_headerless' is disabled. "
    "auto assign ROSTIME to headerless messages once enabling constructor option of 'allow_headerless'."
)


class SimpleFilter:
    """Base class of filters, which calls registered callbacks with each output of the filter.

    Attributes:
        callbacks: callbacks with their additional arguments, by the number that `registerCallback` returned.
    """

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., object], *args: Any) -> int:
        """Register the function `cb`, which is called with each output of the filter, followed by `args`.

        Returns the number of the registration.
        """
        number = len(self.callbacks)
        self.callbacks[number] = cb, args
        return number

    def signalMessage(self, *msg: Any) -> None:
        """Call all registered callbacks with an output of the filter."""
        for function, arguments in list(self.callbacks.values()):
            function(*msg, *arguments)


class Subscriber(SimpleFilter):
    """Filter whose outputs are the messages of a subscription.

    The arguments are the node, then the arguments of `Node.create_subscription` without callback.

    Attributes:
        sub: the subscription; this object has all of its attributes, too.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__()
        self.node, _, self.topic = args[:3]
        kwargs.setdefault("qos_profile", 10)
        self.sub = self.node.create_subscription(*args[1:], self.callback, **kwargs)

    def callback(self, msg: Any) -> None:
        self.signalMessage(msg)

    def getTopic(self) -> Any:
        """Return the name of the topic as the program passed it."""
        return self.topic

    def __getattr__(self, key: str) -> Any:
        if key == "sub":  # not created yet
            raise AttributeError(key)
        return getattr(self.sub, key)


class Cache(SimpleFilter):
    """Filter that stores the last messages of another filter, in the order of their arrival.

    Args:
        f: other filter.
        cache_size: maximum number of messages.
        allow_headerless: use the time of arrival for messages without a stamp, which are ignored otherwise.
    """

    def __init__(self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False) -> None:
        super().__init__()
        self.cache_size, self.allow_headerless = cache_size, allow_headerless
        self.cache_msgs: list[Any] = []
        self.cache_times: list[Time] = []
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Store a message, and pass it on to the callbacks."""
        stamp = _find_stamp(msg, self.allow_headerless, "message_filters_cache", "")
        if stamp is None:
            return
        self.cache_times.append(stamp)
        self.cache_msgs.append(msg)
        if len(self.cache_msgs) > self.cache_size:
            del self.cache_msgs[0], self.cache_times[0]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:
        """Return the stored messages with stamps from `from_stamp` to `to_stamp`."""
        assert from_stamp <= to_stamp
        return [msg for msg, time in self._rosidl_messages_and_times() if from_stamp <= time <= to_stamp]

    def getElemAfterTime(self, stamp: Time) -> Any:
        """Return the first stored message with this stamp or a later one; None if there is none."""
        return next((msg for msg, time in self._rosidl_messages_and_times() if time >= stamp), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """Return the last stored message with this stamp or an earlier one; None if there is none."""
        return next((msg for msg, time in reversed(self._rosidl_messages_and_times()) if time <= stamp), None)

    def getLastestTime(self) -> Time | None:
        """Return the stamp of the last stored message, None without messages; message_filters has this spelling."""
        return self.cache_times[-1] if self.cache_times else None

    def getOldestTime(self) -> Time | None:
        """Return the stamp of the first stored message; None without messages."""
        return self.cache_times[0] if self.cache_times else None

    def getLast(self) -> Any:
        """Return the first stored message whose stamp is not lower than the stamp of the last stored message.

        Returns None without messages.
        """
        latest = self.getLastestTime()
        return None if latest is None else self.getElemAfterTime(latest)

    def _rosidl_messages_and_times(self) -> list[tuple[Any, Time]]:
        return list(zip(self.cache_msgs, self.cache_times, strict=True))


class TimeSynchronizer(SimpleFilter):
    """Filter whose outputs are sets of messages with equal stamps, one message of each input filter.

    Callbacks get the messages in the order of the input filters.

    Args:
        fs: input filters.
        queue_size: maximum number of messages of each input filter that wait for messages of the others.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:
        self._rosidl_synchronizer = self._rosidl_create_synchronizer([message_filters.MessageFilter() for _ in fs])
        self.input_connections = [f.registerCallback(self.add, number) for number, f in enumerate(fs)]

    def _rosidl_create_synchronizer(
        self, inputs: list[message_filters.MessageFilter]
    ) -> message_filters.TimeSynchronizer:
        return message_filters.TimeSynchronizer(inputs, self._rosidl_on_messages, queue_size=self.queue_size)

    def _rosidl_on_messages(self, *messages: Any) -> None:
        self.signalMessage(*messages)

    def add(self, msg: Any, my_queue_index: int) -> None:
        """Process a message as if the input filter with this index had passed it on."""
        self._rosidl_synchronizer.add(my_queue_index, msg)


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Filter whose outputs are sets of messages, one of each input filter, with stamps less than `slop` seconds apart.

    Args:
        fs: input filters.
        queue_size: maximum number of messages of each input filter that wait for messages of the others.
        slop: maximum difference in seconds.
        allow_headerless: use the time of arrival for messages without a stamp, which are ignored otherwise.
    """

    def __init__(
        self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False
    ) -> None:
        self.slop, self.allow_headerless = Duration(seconds=slop), allow_headerless
        super().__init__(fs, queue_size)

    def _rosidl_create_synchronizer(
        self, inputs: list[message_filters.MessageFilter]
    ) -> message_filters.TimeSynchronizer:
        return message_filters.ApproximateTimeSynchronizer(
            inputs, self._rosidl_on_messages, slop_s=self.slop.nanoseconds / 1e9, queue_size=self.queue_size
        )

    def add(self, msg: Any, my_queue_index: int) -> None:
        stamp = _find_stamp(msg, self.allow_headerless, "message_filters_approx", "for ")
        if stamp is not None:
            self._rosidl_synchronizer.add(my_queue_index, _Stamped(msg, stamp))

    def _rosidl_on_messages(self, *messages: Any) -> None:
        self.signalMessage(*(item.message for item in messages))


class _Stamped:
    """Message together with the stamp by which it is synchronized."""

    def __init__(self, message: Any, stamp: Time) -> None:
        self.message = message
        self.header = self
        self.stamp = stamp.to_msg()


def _find_stamp(message: Any, allow_headerless: bool, logger: str, preposition: str) -> Time | None:
    """Return the stamp of a message.

    For a message without stamp, return the current time if that is allowed; otherwise log a warning and return None.
    """
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None:
        return stamp if hasattr(stamp, "nanoseconds") else Time.from_msg(stamp)
    if allow_headerless:
        return ROSClock().now()
    log = get_logger(logger)
    log.set_level(LoggingSeverity.INFO)
    log.warning(_HEADERLESS_WARNING.format(preposition))
    return None
