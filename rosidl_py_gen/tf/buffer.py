"""The buffer a program asks: fed by hand or by a node, from any thread."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.registration import Registration, RegistrationSet
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.stamps import nanoseconds as nanoseconds_of
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.message_filters.filters import call_all
from rosidl_py_gen.runtime import Durability, Duration, QoSProfile
from rosidl_py_gen.tf.errors import InvalidTransformError, TransformError, TransformTimeoutError
from rosidl_py_gen.tf.frame_tree import FrameTree
from rosidl_py_gen.tf.history import FrameInfo, Link
from rosidl_py_gen.tf.message_transforms import frame_and_stamp
from rosidl_py_gen.tf.transform import Transform

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime import Node, TimeJump

DEPTH = 100
_UNLIMITED_QUEUE = 1 << 31
"""Of calls under way: an async callback of a filter may itself wait for a transform, which must come in meanwhile."""
T = TypeVar("T")


class TransformBuffer:
    """Transforms of the last seconds, and the static ones.

    Example:
        ``buffer = TransformBuffer(node)``, then ``await buffer.wait_for("map", "base_link")``.

    Args:
        node: subscribes to ``/tf`` and ``/tf_static``; None leaves feeding to `set_transform`. When the time of its
            clock jumps back, as simulated time does when a bag is played again, what moves is forgotten.
        cache_time_s: how long transforms are kept.
    """

    def __init__(self, node: Node | None = None, *, cache_time_s: float = 10.0) -> None:
        self._tree = FrameTree(round(cache_time_s * NS_PER_S))
        self._lock = threading.Lock()
        self._waiters = Waiters()
        self._callbacks: RegistrationSet[Callable[[], Coroutine[Any, Any, None] | None]] = RegistrationSet()
        self._tasks: set[asyncio.Future[None]] = set()
        """What async callbacks of filters do, where transforms are given by hand."""
        self._logger = None if node is None else node.logger
        if node is not None:
            self._listen(node)

    def _listen(self, node: Node) -> None:
        cls: Any = get_message("tf2_msgs/msg/TFMessage")
        node.create_subscription(
            cls, "/tf", lambda message: self._take(message, False), DEPTH, concurrency=_UNLIMITED_QUEUE
        )
        latched = QoSProfile(depth=DEPTH, durability=Durability.TRANSIENT_LOCAL)
        node.create_subscription(
            cls, "/tf_static", lambda message: self._take(message, True), latched, concurrency=_UNLIMITED_QUEUE
        )

        def forget(_: TimeJump) -> None:
            self.clear()

        node.clock.create_jump_callback(post=forget, on_clock_change=True, min_backward=Duration(nanoseconds=-1))

    def _take(self, message: Any, is_static: bool) -> Coroutine[Any, Any, None] | None:
        for transform in message.transforms:
            try:
                self._insert(transform, is_static)
            except InvalidTransformError as error:
                if self._logger is not None:
                    self._logger.warning(f"ignored a transform: {error}", throttle_s=1.0)
        return self._run_callbacks()

    # ---------------------------------------------------------------------------------------------------- feeding

    def set_transform(self, transform: Any, *, static: bool = False) -> None:
        """Take in a ``geometry_msgs/msg/TransformStamped``, or a `Transform`.

        Raises:
            InvalidTransformError: something else, frames are empty or equal, values are not finite, the quaternion's
                length is not 1, or the transform is older than what is kept.
        """
        self._insert(transform.to_message() if isinstance(transform, Transform) else transform, static)
        answer = self._run_callbacks()
        if answer is not None:
            task = asyncio.ensure_future(answer)
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _insert(self, message: Any, is_static: bool) -> None:
        try:
            child, stamp = message.child_frame_id, nanoseconds(message.header.stamp)
            move, turn = message.transform.translation, message.transform.rotation
            link = Link(message.header.frame_id, (move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w))
        except (AttributeError, TypeError) as error:
            expected = "a geometry_msgs/msg/TransformStamped or a Transform"
            raise InvalidTransformError(f"expected {expected}, got {type(message).__name__}: {error!s:.200}") from error
        with self._lock:
            self._tree.insert(child, stamp, link, is_static=is_static)

    def register_callback(self, callback: Callable[[], Coroutine[Any, Any, None] | None]) -> Registration:
        """Call it behind each arrival of transforms, on the thread where they come, until the answer is closed."""
        return self._callbacks.add(callback)

    def _run_callbacks(self) -> Coroutine[Any, Any, None] | None:
        self._waiters.wake()
        return call_all(self._callbacks)

    def clear(self) -> None:
        """Forget what moves; static transforms stay, because nobody sends them again."""
        with self._lock:
            self._tree.clear()

    # ------------------------------------------------------------------------------------------------------ asking

    def lookup_transform(self, target: str, source: str, time: Any = None) -> Transform:
        """How coordinates in `source` become coordinates in `target`.

        Args:
            time: a `Time`, a Time message or nanoseconds; None or 0 takes the newest that is known of all frames
                in between. Between two transforms it is interpolated.

        Raises:
            UnknownFrameError, ConnectivityError, ExtrapolationError: as their names say, all of them `TransformError`.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        with self._lock:
            stamp, translation, rotation = self._tree.lookup(target, source, nanoseconds(time))
        return Transform(target, source, stamp, np.array(translation), np.array(rotation))

    def lookup_transform_full(
        self, target: str, target_time: Any, source: str, source_time: Any, fixed: str
    ) -> Transform:
        """Where something that `source` saw at one time is in `target` at another, as `fixed` did not move in between.

        Its stamp is that of `target`. Errors as `lookup_transform`.
        """
        with self._lock:
            self._tree.require(target=target, source=source, fixed=fixed)
        before, after = (
            self.lookup_transform(fixed, source, source_time),
            self.lookup_transform(target, fixed, target_time),
        )
        return after @ before

    def transform(self, message: T, target: str) -> T:
        """A message in another frame, by the transform of its own time; see `Transform.transform`.

        Raises:
            ConversionError: no message with a frame, or one that cannot be transformed. Others as `lookup_transform`.
        """
        return self.lookup_transform(target, *frame_and_stamp(message)).transform(message)

    def transform_at(self, message: T, target: str, target_time: Any, fixed: str) -> T:
        """As `transform`, to where the message is in `target` at another time, as `fixed` does not move in between."""
        return self.lookup_transform_full(target, target_time, *frame_and_stamp(message), fixed).transform(message)

    async def wait_and_transform(self, message: T, target: str, *, timeout_s: float | None = None) -> T:
        """As `transform`, once that is possible; raises `TransformTimeoutError` as `wait_for_transform`."""
        found = await self.wait_for_transform(target, *frame_and_stamp(message), timeout_s=timeout_s)
        return found.transform(message)

    def can_transform(self, target: str, source: str, time: Any = None) -> bool:
        """Whether `lookup_transform` would give something."""
        try:
            self.lookup_transform(target, source, time)
        except (TransformError, InvalidTransformError):
            return False
        return True

    async def wait_for_transform(
        self, target: str, source: str, time: Any = None, *, timeout_s: float | None = None
    ) -> Transform:
        """Wait until `lookup_transform` gives a transform.

        Raises:
            TransformTimeoutError: what was missing to the end.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        found: list[Transform] = []
        reason = [""]

        def is_there() -> bool:
            try:
                found.append(self.lookup_transform(target, source, time))
            except TransformError as error:
                reason[0] = str(error)
            return bool(found)

        if await self._waiters.wait(is_there, timeout_s):
            return found[0]
        raise TransformTimeoutError(f"after {timeout_s:.6g} s: {reason[0]}")

    def frames(self) -> dict[str, FrameInfo]:
        """Every frame that was ever named, with parent, times and how many transforms are kept."""
        with self._lock:
            return self._tree.frames()


def nanoseconds(time: Any) -> int:
    """The nanoseconds of None (0), a number, a `Time` or a message."""
    return 0 if time is None else nanoseconds_of(time)
