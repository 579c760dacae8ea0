"""Filter whose messages wait until they can be transformed: the message filter of tf2_ros."""

from __future__ import annotations

import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.message_filters.filters import (
    MessageFilter,
    call_all,
    check_filters,
    slop_to_ns,
)
from rosidl_py_gen.tf.frame_tree import ExtrapolationError, InvalidTransformError, TransformError, without_slash

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable

    from rosidl_py_gen.tf.buffer import TransformBuffer


class _PendingMessage(NamedTuple):
    message: Any
    frame: str
    stamp: int


class TransformFilter(MessageFilter):
    """Filter that passes a message on when the buffer has its transforms to the target frames.

    Messages come out when they can be transformed, possibly in another order than they arrived. A message that is
    dropped from the full queue is passed to `on_drop`. Without `on_drop`, the node logs the 1st, 2nd, 4th, 8th dropped
    message and so on.

    Args:
        source: a filter, such as `rosidl_py_gen.message_filters.Subscriber`.
        buffer: buffer with the transforms.
        target: one or several frames, to all of which the message must be transformable.
        callback: plain or async function that is called with each message.
        queue_size: maximum number of waiting messages; one more drops the oldest.
        tolerance_s: time before and after the stamp of the message at which the transforms must be known as well.
        on_drop: called with a dropped message and the `TransformError` or `InvalidTransformError` that is the reason.

    Raises:
        StampError: the messages have no header.
    """

    def __init__(
        self,
        source: MessageFilter,
        buffer: TransformBuffer,
        target: str | Iterable[str],
        callback: Callable[[Any], object] | None = None,
        *,
        queue_size: int = 10,
        tolerance_s: float = 0.0,
        on_drop: Callable[[Any, RosidlError], object] | None = None,
    ) -> None:
        self._targets = (target,) if isinstance(target, str) else tuple(target)
        for frame in self._targets:
            if not isinstance(frame, str) or not frame or frame.startswith("/"):
                raise InvalidTransformError(f"expected a target frame, without / in front, got {frame!r:.100}")
        self._tolerance = slop_to_ns("tolerance_s", tolerance_s)
        self._buffer, self._on_drop = buffer, on_drop
        self._pending: deque[_PendingMessage] = deque()
        self._lock = threading.Lock()
        self._setup(callback, queue_size, check_filters("source", source))
        self._use_stamps(self.clear)
        self._links.append(buffer.register_callback(self._release_ready))
        self._links.append(source.register_callback(self.add))

    def add(self, message: Any) -> Coroutine[Any, Any, None] | None:
        """Process a message as if the filter's input had passed it on.

        Returns a coroutine of async callbacks to await, or None. Raises `StampError` for a message without header.
        """
        stamp = self._stamp_of(message)
        frame = message["header"]["frame_id"] if isinstance(message, dict) else message.header.frame_id
        pending = _PendingMessage(message, without_slash(frame), stamp)
        dropped: _PendingMessage | None = None
        with self._lock:
            reason = self._missing_transform(pending)
            if reason is not None and not pending.frame:
                dropped = pending  # no later transform gives it a frame
            elif reason is not None:
                self._pending.append(pending)
                if len(self._pending) > self._depth:
                    dropped = self._pending.popleft()
        if dropped is not None:
            self._drop(dropped)
        return self.signal_message(message) if reason is None else None

    def _release_ready(self) -> Coroutine[Any, Any, None] | None:
        if not self._pending:
            return None
        ready, pending = [], deque[_PendingMessage]()
        with self._lock:
            unconnected: set[str] = set()  # frames that have no transform at any time
            for one in self._pending:
                reason = None if one.frame in unconnected else self._missing_transform(one)
                if reason is None and one.frame not in unconnected:
                    ready.append(one.message)
                    continue
                pending.append(one)
                if not isinstance(reason, ExtrapolationError):
                    unconnected.add(one.frame)
            self._pending = pending
        return call_all([partial(self.signal_message, message) for message in ready])

    def _missing_transform(self, one: _PendingMessage) -> RosidlError | None:
        if not one.frame:
            return InvalidTransformError("the frame of the message is empty")
        around = (-self._tolerance, self._tolerance) if self._tolerance and one.stamp else (0,)
        try:
            for frame in self._targets:
                for offset in around:
                    self._buffer.lookup_transform(frame, one.frame, max(1, one.stamp + offset) if one.stamp else 0)
        except (TransformError, InvalidTransformError) as error:
            return error
        return None

    def _drop(self, one: _PendingMessage) -> None:
        self.dropped += 1
        reason = self._missing_transform(one) or TransformError("it has just become transformable")
        if self._on_drop is not None:
            self._on_drop(one.message, reason)
        elif self._nodes and not self.dropped & (self.dropped - 1):  # log drops 1, 2, 4, 8, …
            message = f'a message of frame "{printable(one.frame, 100)}" at {one.stamp / NS_PER_S:.9f}'
            text = f"dropped {message} that waited for its transform ({self.dropped} so far): {reason}"
            self._nodes[0].logger.warning(text)

    @property
    def waiting(self) -> int:
        """Number of messages that wait for their transforms."""
        return len(self._pending)

    def clear(self) -> None:
        """Discard the messages that wait for their transforms."""
        with self._lock:
            self._pending.clear()
