"""Synchronizers: filters with several inputs that pass sets of messages, one of each input."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.message_filters.filters import MessageFilter, check_filters, slop_to_ns
from rosidl_py_gen.message_filters.sync_policies import ApproximateMatcher, ExactMatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.message_filters.sync_policies import SyncPolicy
    from rosidl_py_gen.runtime import Clock


class TimeSynchronizer(MessageFilter):
    """Filter that passes sets of messages with equal ``header.stamp``, one of each input.

    A set is passed when its last message arrives. Of each input, the `queue_size` messages with the highest stamps wait
    for their set. If simulated time jumps back, they are removed.

    Args:
        inputs: filters, such as `Subscriber`; callbacks receive the messages in this order.
        callback: plain or async function with as many arguments as there are inputs.
        queue_size: maximum number of waiting messages of each input, and of sets that wait to be received.

    Raises:
        StampError: the messages of an input have no stamp.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        queue_size: int = 10,
    ) -> None:
        filters = _filters(inputs)
        self._setup(callback, queue_size, filters, len(filters))
        self._connect(ExactMatcher(len(filters), queue_size))

    def _connect(self, matcher: SyncPolicy, allow_headerless: bool = False, clock: Clock | None = None) -> None:
        self._matcher, self._lock = matcher, threading.Lock()
        self._use_stamps(self.clear, allow_headerless, clock)
        self._links += [one.register_callback(partial(self.add, index)) for index, one in enumerate(self._inputs)]

    def add(self, index: int, message: Any) -> Coroutine[Any, Any, None] | None:
        """Process a message as if an input had passed it; returns as `signal_message`. Raises `StampError`."""
        stamp = self._stamp_of(message, f"input {index} of ")
        with self._lock:
            messages = self._matcher.add(index, stamp, message)
        return None if messages is None else self.signal_message(*messages)

    def clear(self) -> None:
        """Remove the messages that wait for others."""
        with self._lock:
            self._matcher.clear()


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Filter that passes sets of messages whose stamps are less than `slop_s` apart, one of each input.

    A set is passed as soon as one exists with the arriving message: of each other input the message closest to it, or,
    if these are too far apart, the next ones. It does not wait for a better set. Otherwise as `TimeSynchronizer`.

    Args:
        inputs: filters, such as `Subscriber`; callbacks receive the messages in this order.
        callback: plain or async function with as many arguments as there are inputs.
        queue_size: maximum number of waiting messages of each input, and of sets that wait to be received.
        slop_s: seconds; stamps that are exactly this far apart do not match.
        allow_headerless: use the time of arrival for messages without a stamp; its delay is unknown.
        clock: clock for the time of arrival; None means that of the first input's node.

    Raises:
        StampError: the messages of an input have no stamp, and `allow_headerless` is False.
    """

    def __init__(
        self,
        inputs: Iterable[MessageFilter],
        callback: Callable[..., object] | None = None,
        *,
        slop_s: float,
        queue_size: int = 10,
        allow_headerless: bool = False,
        clock: Clock | None = None,
    ) -> None:
        filters = _filters(inputs)
        self._setup(callback, queue_size, filters, len(filters))
        matcher = ApproximateMatcher(len(filters), queue_size, slop_to_ns("slop_s", slop_s))
        self._connect(matcher, allow_headerless, clock)


def _filters(inputs: Iterable[MessageFilter]) -> tuple[MessageFilter, ...]:
    is_single = isinstance(inputs, MessageFilter) or not isinstance(inputs, Iterable)
    filters = check_filters("each input", *([inputs] if is_single else inputs))
    if not filters:
        raise ValueError("inputs must be at least one filter, got none")
    return filters
