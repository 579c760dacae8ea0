"""Buffer of the transforms that a node receives or a program inserts, usable from any thread; broadcasters; and the
filter of tf2_ros whose messages wait until they can be transformed.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from rosidl_py_gen import encode, get_message
from rosidl_py_gen.base.callbacks import Registration, RegistrationSet
from rosidl_py_gen.base.stamps import NS_PER_S, nanoseconds
from rosidl_py_gen.base.waiters import Waiters, blocking
from rosidl_py_gen.errors import ClosedError, RosidlError, printable
from rosidl_py_gen.message_filters import MessageFilter, NoNodeScope, call_all
from rosidl_py_gen.runtime import Durability, Duration, QoSProfile
from rosidl_py_gen.tf.frame_tree import (
    ExtrapolationError,
    FrameInfo,
    FrameTree,
    InvalidTransformError,
    Link,
    TransformError,
    TransformTimeoutError,
    without_slash,
)
from rosidl_py_gen.tf.transform import Transform, frame_and_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime import Node, Subscription

_DEPTH = 100
_UNLIMITED_QUEUE = 1 << 31
"""Maximum number of concurrent calls of a subscription's callback, so large that it never limits: an async callback of
a filter may wait for a transform of a later message."""
T = TypeVar("T")


class TransformBuffer:
    """Buffer of the transforms of the last seconds, and of all static transforms.

    Methods that do not wait use the transforms that have arrived. Without a running event loop, as in a script, they
    first insert the received transforms, so a script may also sleep and then look up.

    Example:
        ``buffer = TransformBuffer(node)``, then ``await buffer.wait_for_transform("map", "base_link")``; in a plain
        script ``buffer.wait_for_transform_sync("map", "base_link")``.

    Args:
        node: subscribes to ``/tf`` and ``/tf_static``; with None, `set_transform` is the only source. If the node's
            clock jumps back, for example when a bag is played again, all transforms that are not static are removed.
        cache_time_s: age in seconds beyond which transforms are removed.
    """

    def __init__(self, node: Node | None = None, *, cache_time_s: float = 10.0) -> None:
        self._tree = FrameTree(round(cache_time_s * NS_PER_S))
        self._lock = threading.Lock()
        self._waiters = Waiters()
        self._callbacks: RegistrationSet[Callable[[], Coroutine[Any, Any, None] | None]] = RegistrationSet()
        self._tasks: set[asyncio.Future[None]] = set()  # async callbacks that `set_transform` started
        self._subscriptions: tuple[Subscription[Any], ...] = ()
        self._node = node
        self._scope = NoNodeScope() if node is None else node._scope
        if node is not None:
            self._subscribe(node)

    def _subscribe(self, node: Node) -> None:
        def insert_all(message: Any, is_static: bool) -> Coroutine[Any, Any, None] | None:
            for transform in message.transforms:
                try:
                    self._insert(transform, is_static)
                except InvalidTransformError as error:
                    node.logger.warning(f"ignored a transform: {error}", throttle_s=1.0)
            return self._run_callbacks()

        cls: Any = get_message("tf2_msgs/msg/TFMessage")
        latched = QoSProfile(depth=_DEPTH, durability=Durability.TRANSIENT_LOCAL)
        self._subscriptions = tuple(
            node.create_subscription(
                cls, topic, partial(insert_all, is_static=is_static), qos, concurrency=_UNLIMITED_QUEUE
            )
            for topic, is_static, qos in (("/tf", False, _DEPTH), ("/tf_static", True, latched))
        )
        node._scope.register(Registration(self._waiters.wake))
        node.clock.create_jump_callback(
            post=lambda _: self.clear(), on_clock_change=True, min_backward=Duration(nanoseconds=-1)
        )

    def _receive(self) -> None:
        """Insert the transforms that the subscriptions have received, unless a running event loop inserts them."""
        for subscription in self._subscriptions:
            subscription._deliver_without_loop()

    def __repr__(self) -> str:
        with self._lock:
            frames = len(self._tree.frames())
        return f"<TransformBuffer of {frames} frames>"

    # ---------------------------------------------------------------------------------------------------- feeding

    def set_transform(self, transform: Any, *, static: bool = False) -> None:
        """Insert a ``geometry_msgs/msg/TransformStamped`` or a `Transform` into the buffer.

        Args:
            static: the transform is valid at all times.

        Raises:
            InvalidTransformError: the value is neither; frames are empty or equal; values are not finite; the length of
                the quaternion is not 1; or the transform is older than the cache time.
        """
        self._insert(transform.to_message() if isinstance(transform, Transform) else transform, static)
        coroutine = self._run_callbacks()
        if coroutine is not None:
            task = asyncio.ensure_future(coroutine)
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _insert(self, message: Any, is_static: bool) -> None:
        try:
            child, stamp = message.child_frame_id, nanoseconds(message.header.stamp)
            xyz, turn = message.transform.translation, message.transform.rotation
            link = Link(message.header.frame_id, (xyz.x, xyz.y, xyz.z), (turn.x, turn.y, turn.z, turn.w))
        except (AttributeError, TypeError) as error:
            expected = "a geometry_msgs/msg/TransformStamped or a Transform"
            raise InvalidTransformError(f"expected {expected}, got {type(message).__name__}: {error!s:.200}") from error
        with self._lock:
            self._tree.insert(child, stamp, link, is_static=is_static)

    def register_callback(self, callback: Callable[[], Coroutine[Any, Any, None] | None]) -> Registration:
        """Register a function that is called after each arrival of transforms, on the thread where they arrive.

        Closing the returned registration ends the calls.
        """
        return self._callbacks.add(callback)

    def _run_callbacks(self) -> Coroutine[Any, Any, None] | None:
        self._waiters.wake()
        return call_all(self._callbacks)

    def clear(self) -> None:
        """Remove all transforms that are not static; static ones stay, because they are not sent again."""
        with self._lock:
            self._tree.clear()

    # ----------------------------------------------------------------------------------------------------- lookups

    def lookup_transform(self, target: str, source: str, time: Any = None) -> Transform:
        """Return the transform of coordinates in `source` to coordinates in `target`.

        Args:
            time: a `Time`, a Time message or nanoseconds; None or 0 means the latest time at which all transforms
                between the frames are known. Between two transforms the result is interpolated.

        Raises:
            UnknownFrameError, ConnectivityError, ExtrapolationError: the transform is not known; all are
                `TransformError`.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        self._receive()
        with self._lock:
            stamp, translation, rotation = self._tree.lookup(target, source, 0 if time is None else nanoseconds(time))
        return Transform(target, source, stamp, np.array(translation), np.array(rotation))

    def lookup_transform_full(
        self, target: str, target_time: Any, source: str, source_time: Any, fixed: str
    ) -> Transform:
        """Return the transform from `source` at one time to `target` at another, by way of the unmoving frame `fixed`.

        The result has the stamp of the lookup at `target_time`. Errors are as for `lookup_transform`.
        """
        self._receive()
        with self._lock:
            self._tree.require(target=target, source=source, fixed=fixed)
        before = self.lookup_transform(fixed, source, source_time)
        return self.lookup_transform(target, fixed, target_time) @ before

    def transform(self, message: T, target: str) -> T:
        """Return a copy of a message transformed to the frame `target`, at the time of the message.

        Raises:
            ConversionError: the message has no header, or cannot be transformed.
            TransformError: the transform is not known at that time.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        return self.lookup_transform(target, *frame_and_stamp(message)).transform(message)

    def transform_at(self, message: T, target: str, target_time: Any, fixed: str) -> T:
        """Return a copy of a message transformed to `target` at another time, by way of the unmoving frame `fixed`.

        Raises:
            ConversionError: the message has no header, or cannot be transformed.
            TransformError: a transform is not known at its time.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        return self.lookup_transform_full(target, target_time, *frame_and_stamp(message), fixed).transform(message)

    async def wait_and_transform(self, message: T, target: str, *, timeout_s: float | None = None) -> T:
        """Wait until the transform of a message to the frame `target` is known, and return a transformed copy.

        Raises:
            ConversionError: the message has no header, or cannot be transformed.
            TransformTimeoutError: the transform was not known within `timeout_s`; the text has the last reason.
            InvalidTransformError: a frame is empty or begins with ``/``.
            ClosedError: the node is closed, also while waiting.
        """
        transform = await self.wait_for_transform(target, *frame_and_stamp(message), timeout_s=timeout_s)
        return transform.transform(message)

    wait_and_transform_sync = blocking(wait_and_transform)

    def can_transform(self, target: str, source: str, time: Any = None) -> bool:
        """Return True if `lookup_transform` with the same arguments would return a transform and not raise an error."""
        try:
            self.lookup_transform(target, source, time)
        except (TransformError, InvalidTransformError):
            return False
        return True

    async def wait_for_transform(
        self, target: str, source: str, time: Any = None, *, timeout_s: float | None = None
    ) -> Transform:
        """Wait until a transform is known, and return the result of `lookup_transform`.

        Raises:
            TransformTimeoutError: the transform was not known within `timeout_s`; the text has the last reason.
            InvalidTransformError: a frame is empty or begins with ``/``.
            ClosedError: the node is closed, also while waiting.
        """
        scope = None if self._node is None else self._node._scope
        transform: Transform | None = None
        reason = ""

        def has_transform() -> bool:
            nonlocal transform, reason
            try:
                transform = self.lookup_transform(target, source, time)
            except TransformError as error:
                reason = str(error)
                if scope is not None and scope.closed:
                    raise ClosedError(f"node {scope.node_name} of the transform buffer is closed") from error
            return transform is not None

        if scope is not None:
            scope.adopt_running_loop()
        await self._waiters.wait(has_transform, timeout_s)
        if transform is None:
            raise TransformTimeoutError(f"after {timeout_s:.6g} s: {reason}")
        return transform

    wait_for_transform_sync = blocking(wait_for_transform)

    def frames(self) -> dict[str, FrameInfo]:
        """Return information about all known frames by name: parent, time range and number of transforms."""
        self._receive()
        with self._lock:
            return self._tree.frames()


# -------------------------------------------------------------------------------------------------------- broadcasters


class TransformBroadcaster:
    """Publisher of changing transforms on ``/tf``."""

    def __init__(self, node: Node) -> None:
        self._cls: Any = get_message("tf2_msgs/msg/TFMessage")
        self._publisher = node.create_publisher(self._cls, "/tf", _DEPTH)

    def send(self, transforms: Any) -> None:
        """Publish one or several TransformStamped messages or `Transform` objects.

        Raises `EncodeError` for other values.
        """
        self._publisher.publish(self._cls(transforms=_to_messages(transforms)))


class StaticTransformBroadcaster:
    """Publisher of constant transforms on ``/tf_static``; later subscribers receive them as well."""

    def __init__(self, node: Node) -> None:
        self._cls: Any = get_message("tf2_msgs/msg/TFMessage")
        latched = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
        self._publisher = node.create_publisher(self._cls, "/tf_static", latched)
        self._sent: dict[str, Any] = {}

    def send(self, transforms: Any) -> None:
        """Publish one or several static transforms together with all that were sent before.

        A new transform replaces an earlier transform of the same child frame.

        Raises:
            EncodeError: a value is neither a TransformStamped message nor a `Transform`.
        """
        new = _to_messages(transforms)
        encode(self._cls(transforms=new))  # raises if one is not a transform
        sent = self._sent | {without_slash(message.child_frame_id): message for message in new}
        self._publisher.publish(self._cls(transforms=list(sent.values())))
        self._sent = sent


def _to_messages(transforms: Any) -> list[Any]:
    several = transforms if isinstance(transforms, Iterable) else (transforms,)
    return [one.to_message() if isinstance(one, Transform) else one for one in several]


# --------------------------------------------------------------------------------------------------------------- filter


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
        self._tolerance = self._tolerance_ns("tolerance_s", tolerance_s)
        self._buffer, self._on_drop = buffer, on_drop
        self._pending: deque[_PendingMessage] = deque()
        self._lock = threading.Lock()
        self._setup(callback, queue_size, self._check_inputs("source", source))
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
