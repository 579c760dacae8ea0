"""Messages that wait until they can be transformed: the message filter of tf2_ros."""

from __future__ import annotations

import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.message_filters.filters import (
    DEPTH,
    MessageFilter,
    call_all,
    check_queue_size,
    require_stamps,
    slop_to_ns,
)
from rosidl_py_gen.message_filters.stamps import StampError, header_stamp
from rosidl_py_gen.tf.errors import ExtrapolationError, InvalidTransformError, TransformError
from rosidl_py_gen.tf.frame_tree import without_slash

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable

    from rosidl_py_gen.tf.buffer import TransformBuffer


class _PendingMessage(NamedTuple):
    message: Any
    frame: str
    stamp: int


class TransformFilter(MessageFilter):
    """Lets a message through once the buffer has the transforms from its frame, at its time, to the target frames.

    Messages come out when they can be transformed, which may be in another order than they came in. Those that fall out
    of the queue are told to `on_drop`, or else to the log of the node: the 1st, 2nd, 4th, 8th and so on.

    Args:
        source: a filter, such as `rosidl_py_gen.message_filters.Subscriber`.
        buffer: tells what is known.
        target: a frame, or several, all of which are waited for.
        callback: see `rosidl_py_gen.message_filters.MessageFilter`.
        queue_size: how many wait; when another one comes, the oldest is dropped.
        tolerance_s: the transforms have to be there so long before and after the time of the message, too.
        on_drop: is called with a message and the `TransformError`, or `InvalidTransformError`, that says why it could
            not be transformed so far.

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
        queue_size: int = DEPTH,
        tolerance_s: float = 0.0,
        on_drop: Callable[[Any, RosidlError], object] | None = None,
    ) -> None:
        if not isinstance(source, MessageFilter):
            raise TypeError(f"source must be a filter, such as Subscriber(node, type, topic), got {source!r:.100}")
        self._targets = (target,) if isinstance(target, str) else tuple(target)
        for frame in self._targets:
            if not isinstance(frame, str) or not frame or frame.startswith("/"):
                raise InvalidTransformError(f"expected a target frame, without / in front, got {frame!r:.100}")
        self._size, self._tolerance = check_queue_size("queue_size", queue_size), slop_to_ns("tolerance_s", tolerance_s)
        self._buffer, self._on_drop = buffer, on_drop
        self._held: deque[_PendingMessage] = deque()
        self._lock = threading.Lock()
        self._setup(callback, 1, queue_size, (source,))
        require_stamps(source)
        self._links.append(buffer.register_callback(self._release_ready))
        self._links.append(source.register_callback(self.add))
        self._clear_on_time_jump(self.clear)

    def add(self, message: Any) -> Coroutine[Any, Any, None] | None:
        """Take a message in, as if it had come from the input; answers as `signal`.

        Raises:
            StampError: it has no header.
        """
        stamp = header_stamp(message)
        if stamp is None:
            raise StampError(f"a message without header.stamp: {type(message).__name__}")
        header: Any = message["header"] if isinstance(message, dict) else message.header
        frame = header["frame_id"] if isinstance(message, dict) else header.frame_id
        one = _PendingMessage(message, without_slash(frame), stamp)
        dropped: list[_PendingMessage] = []
        with self._lock:
            reason = self._missing_transform(one)
            if reason is not None and not one.frame:
                dropped.append(one)  # nothing that comes gives it a frame
            elif reason is not None:
                self._held.append(one)
                while len(self._held) > self._size:
                    dropped.append(self._held.popleft())
        for lost in dropped:
            self._drop(lost)
        return self.signal_message(message) if reason is None else None

    def _release_ready(self) -> Coroutine[Any, Any, None] | None:
        """Let those through that can be transformed by now."""
        if not self._held:
            return None
        ready, held = [], []
        with self._lock:
            apart: set[str] = set()  # frames that no time would help
            for one in self._held:
                reason = None if one.frame in apart else self._missing_transform(one)
                if reason is None and one.frame not in apart:
                    ready.append(one.message)
                    continue
                held.append(one)
                if not isinstance(reason, ExtrapolationError):
                    apart.add(one.frame)
            self._held = deque(held)
        return call_all([partial(self.signal_message, message) for message in ready])

    def _missing_transform(self, one: _PendingMessage) -> RosidlError | None:
        """Why a message cannot be transformed now."""
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
        reason = self._missing_transform(one) or TransformError("it can be transformed just now")
        if self._on_drop is not None:
            self._on_drop(one.message, reason)
        elif self._nodes and not self.dropped & (self.dropped - 1):  # now and then, by itself and not by the clock
            what = f'of frame "{printable(one.frame, 100)}" at {one.stamp / NS_PER_S:.9f}'
            text = f"dropped a message {what} that waited for its transform ({self.dropped} so far): {reason}"
            self._nodes[0].logger.warning(text)

    @property
    def waiting(self) -> int:
        """How many messages wait for their transforms."""
        return len(self._held)

    def clear(self) -> None:
        """Forget the messages that wait for their transforms."""
        with self._lock:
            self._held.clear()
