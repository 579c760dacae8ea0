"""Messages of several topics that belong together by their stamps, and a cache; over `rosidl_py_gen.message_filters`.

Callbacks are called by whoever spins: a subscription's callback hands its message on, and what that completes comes out
at once.
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

_HEADERLESS = (
    "can not use message filters {}messages without timestamp infomation when 'allow_headerless' is disabled. "
    "auto assign ROSTIME to headerless messages once enabling constructor option of 'allow_headerless'."
)


class SimpleFilter:
    """What has callbacks.

    Attributes:
        callbacks: each with the arguments it gets behind the message, by the number that `registerCallback` answered.
    """

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., object], *args: Any) -> int:
        """Call `cb` with what comes out and `args` behind it; answers its number."""
        number = len(self.callbacks)
        self.callbacks[number] = cb, args
        return number

    def signalMessage(self, *msg: Any) -> None:
        """Hand on."""
        for function, arguments in list(self.callbacks.values()):
            function(*msg, *arguments)


class Subscriber(SimpleFilter):
    """A subscription; the arguments are those of `Node.create_subscription` behind the node, without a callback.

    Attributes:
        sub: the subscription, whose attributes are those of this, too.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__()
        self.node, _, self.topic = args[:3]
        kwargs.setdefault("qos_profile", 10)
        self.sub = self.node.create_subscription(*args[1:], self.callback, **kwargs)

    def callback(self, msg: Any) -> None:
        """What the subscription calls."""
        self.signalMessage(msg)

    def getTopic(self) -> Any:
        """The topic as it was given."""
        return self.topic

    def __getattr__(self, key: str) -> Any:
        if key == "sub":  # not made yet
            raise AttributeError(key)
        return getattr(self.sub, key)


class Cache(SimpleFilter):
    """The last messages of a filter, in the order they came.

    Args:
        f: the filter.
        cache_size: how many are kept.
        allow_headerless: messages without a stamp count as of the time they come; otherwise they are left out.
    """

    def __init__(self, f: SimpleFilter, cache_size: int = 1, allow_headerless: bool = False) -> None:
        super().__init__()
        self.cache_size, self.allow_headerless = cache_size, allow_headerless
        self.cache_msgs: list[Any] = []
        self.cache_times: list[Time] = []
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:
        """Take the messages of a filter."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Take a message, and hand it on."""
        stamp = _stamp(msg, self.allow_headerless, "message_filters_cache", "")
        if stamp is None:
            return
        self.cache_times.append(stamp)
        self.cache_msgs.append(msg)
        if len(self.cache_msgs) > self.cache_size:
            del self.cache_msgs[0], self.cache_times[0]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:
        """The messages of these times and between them."""
        assert from_stamp <= to_stamp
        return [msg for msg, time in self._rosidl_both() if from_stamp <= time <= to_stamp]

    def getElemAfterTime(self, stamp: Time) -> Any:
        """The first message of this time or later; None if there is none."""
        return next((msg for msg, time in self._rosidl_both() if time >= stamp), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:
        """The last message of this time or earlier; None if there is none."""
        return next((msg for msg, time in reversed(self._rosidl_both()) if time <= stamp), None)

    def getLastestTime(self) -> Time | None:
        """The time of the message that came last; the name is that of message_filters."""
        return self.cache_times[-1] if self.cache_times else None

    def getOldestTime(self) -> Time | None:
        """The time of the message that came first."""
        return self.cache_times[0] if self.cache_times else None

    def getLast(self) -> Any:
        """The first message of the last time or later; None if there is none."""
        latest = self.getLastestTime()
        return None if latest is None else self.getElemAfterTime(latest)

    def _rosidl_both(self) -> list[tuple[Any, Time]]:
        return list(zip(self.cache_msgs, self.cache_times, strict=True))


class TimeSynchronizer(SimpleFilter):
    """Sets of messages with the same stamp, one of each filter; callbacks get them in the order of the filters.

    Args:
        fs: the filters.
        queue_size: how many messages of each wait for others.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:
        """Take the messages of these filters."""
        self._rosidl_synchronizer = self._rosidl_make([message_filters.MessageFilter() for _ in fs])
        self.input_connections = [f.registerCallback(self.add, number) for number, f in enumerate(fs)]

    def _rosidl_make(self, inputs: list[message_filters.MessageFilter]) -> message_filters.TimeSynchronizer:
        return message_filters.TimeSynchronizer(inputs, self._rosidl_found, queue_size=self.queue_size)

    def _rosidl_found(self, *messages: Any) -> None:
        self.signalMessage(*messages)

    def add(self, msg: Any, my_queue_index: int) -> None:
        """Take a message of one of the filters."""
        self._rosidl_synchronizer.add(my_queue_index, msg)


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Sets of messages whose stamps are less than `slop` seconds apart.

    Args:
        fs: the filters.
        queue_size: how many messages of each wait for others.
        slop: seconds.
        allow_headerless: messages without a stamp count as of the time they come; otherwise they are left out.
    """

    def __init__(
        self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False
    ) -> None:
        self.slop, self.allow_headerless = Duration(seconds=slop), allow_headerless
        super().__init__(fs, queue_size)

    def _rosidl_make(self, inputs: list[message_filters.MessageFilter]) -> message_filters.TimeSynchronizer:
        return message_filters.ApproximateTimeSynchronizer(
            inputs, self._rosidl_found, slop_s=self.slop.nanoseconds / 1e9, queue_size=self.queue_size
        )

    def add(self, msg: Any, my_queue_index: int) -> None:
        """Take a message of one of the filters."""
        stamp = _stamp(msg, self.allow_headerless, "message_filters_approx", "for ")
        if stamp is not None:
            self._rosidl_synchronizer.add(my_queue_index, _Stamped(msg, stamp))

    def _rosidl_found(self, *messages: Any) -> None:
        self.signalMessage(*(one.message for one in messages))


class _Stamped:
    """A message with the time it counts as."""

    def __init__(self, message: Any, stamp: Time) -> None:
        self.message = message
        self.header = self
        self.stamp = stamp.to_msg()


def _stamp(message: Any, allow_headerless: bool, logger: str, word: str) -> Time | None:
    """The time of a message; None, with a warning, when it has none and that is not allowed."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None:
        return stamp if hasattr(stamp, "nanoseconds") else Time.from_msg(stamp)
    if allow_headerless:
        return ROSClock().now()
    log = get_logger(logger)
    log.set_level(LoggingSeverity.INFO)
    log.warning(_HEADERLESS.format(word))
    return None
