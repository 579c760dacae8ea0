"""Synchronizers: filters with several inputs that let sets through, one message of each input."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.message_filters.filters import DEPTH, MessageFilter, require_stamps, slop_to_ns
from rosidl_py_gen.message_filters.stamps import StampError, header_stamp
from rosidl_py_gen.message_filters.sync_policies import ApproximateMatcher, ExactMatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.message_filters.sync_policies import SyncPolicy
    from rosidl_py_gen.runtime import Clock


class TimeSynchronizer(MessageFilter):
    """Sets of messages with the same ``header.stamp``, one of each input.

    A set comes out when its last message comes in. Of each input the `queue_size` messages with the highest stamps
    wait for their set. When simulated time jumps back, what waits is forgotten.

    Args:
        inputs: filters, such as `Subscriber`; callbacks get the messages in this order.
        callback: plain or async, with as many arguments as there are inputs.
        queue_size: messages of each input that wait, and sets that wait for who receives.

    Raises:
        StampError: the messages of an input have no stamp.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        queue_size: int = DEPTH,
    ) -> None:
        given = _filters(inputs)
        self._setup(callback, len(given), queue_size, given)
        self._begin(given, ExactMatcher(len(given), queue_size), None, False)

    def _begin(
        self, given: tuple[MessageFilter, ...], matcher: SyncPolicy, clock: Clock | None, headerless: bool
    ) -> None:
        self._matcher, self._lock = matcher, threading.Lock()
        self._now = (clock or self._clock()) if headerless else None
        if headerless and self._now is None:
            raise StampError("allow_headerless goes by a clock, and no input has a node: give clock=...")
        for one in () if headerless else given:
            require_stamps(one)
        self._links += [one.register_callback(self._input(number)) for number, one in enumerate(given)]
        self._clear_on_time_jump(self.clear)

    def _input(self, index: int) -> Callable[[Any], Coroutine[Any, Any, None] | None]:
        return lambda message: self.add(index, message)

    def add(self, index: int, message: Any) -> Coroutine[Any, Any, None] | None:
        """Take a message of an input in, as if it had come from there; answers as `signal`.

        Raises:
            StampError: it has none.
        """
        stamp = header_stamp(message)
        if stamp is None:
            if self._now is None:
                raise StampError(f"input {index} got a message without header.stamp: {type(message).__name__}")
            stamp = self._now.now().nanoseconds
        with self._lock:
            found = self._matcher.add(index, stamp, message)
        return None if found is None else self.signal_message(*found)

    def clear(self) -> None:
        """Forget the messages that wait for others."""
        with self._lock:
            self._matcher.clear()


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Sets of messages whose stamps are less than `slop_s` apart, one of each input.

    A set comes out as soon as there is one with the message that came in: of each other input the message closest to
    that one, or, where these are too far from each other, the next ones. A better one that comes later is not waited
    for. Otherwise as `TimeSynchronizer`.

    Args:
        inputs: filters, such as `Subscriber`; callbacks get the messages in this order.
        callback: plain or async, with as many arguments as there are inputs.
        queue_size: messages of each input that wait, and sets that wait for who receives.
        slop_s: seconds; stamps that are just so far apart do not match any more.
        allow_headerless: messages without a stamp count as of the time they come. How late that is nobody knows.
        clock: tells that time; None means that of the first input's node.

    Raises:
        StampError: the messages of an input have no stamp, and nothing was said of that.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        slop_s: float,
        queue_size: int = DEPTH,
        allow_headerless: bool = False,
        clock: Clock | None = None,
    ) -> None:
        given = _filters(inputs)
        self._setup(callback, len(given), queue_size, given)
        self._begin(
            given, ApproximateMatcher(len(given), queue_size, slop_to_ns("slop_s", slop_s)), clock, allow_headerless
        )


def _filters(inputs: Iterable[MessageFilter]) -> tuple[MessageFilter, ...]:
    given = tuple(inputs) if isinstance(inputs, Iterable) and not isinstance(inputs, MessageFilter) else (inputs,)
    for one in given:
        if not isinstance(one, MessageFilter):
            raise TypeError(f"inputs must be filters, such as Subscriber(node, type, topic), got {one!r:.100}")
    if not given:
        raise ValueError("inputs must be at least one filter, got none")
    return given
