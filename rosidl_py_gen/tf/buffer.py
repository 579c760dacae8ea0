"""The buffer a program asks: fed by hand or by a node, from any thread."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.stamps import nanoseconds as nanoseconds_of
from rosidl_py_gen.base.waiting import Waiters
from rosidl_py_gen.runtime import Durability, Duration, QoSProfile
from rosidl_py_gen.tf.errors import InvalidTransformError, TransformError, TransformTimeoutError
from rosidl_py_gen.tf.transform import Transform
from rosidl_py_gen.tf.tree import FrameInfo, FrameTree, Link

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node, TimeJump

DEPTH = 100


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
        self._logger = None if node is None else node.logger
        if node is not None:
            self._listen(node)

    def _listen(self, node: Node) -> None:
        cls: Any = get_message("tf2_msgs/msg/TFMessage")
        node.create_subscription(cls, "/tf", lambda message: self._take(message, False), DEPTH)
        latched = QoSProfile(depth=DEPTH, durability=Durability.TRANSIENT_LOCAL)
        node.create_subscription(cls, "/tf_static", lambda message: self._take(message, True), latched)

        def forget(_: TimeJump) -> None:
            self.clear()

        node.clock.create_jump_callback(post=forget, on_clock_change=True, min_backward=Duration(nanoseconds=-1))

    def _take(self, message: Any, is_static: bool) -> None:
        for transform in message.transforms:
            try:
                self._insert(transform, is_static)
            except InvalidTransformError as error:
                if self._logger is not None:
                    self._logger.warning(f"ignored a transform: {error}", throttle_s=1.0)
        self._waiters.wake()

    # ---------------------------------------------------------------------------------------------------- feeding

    def set_transform(self, transform: Any, *, static: bool = False) -> None:
        """Take in a ``geometry_msgs/msg/TransformStamped``, or a `Transform`.

        Raises:
            InvalidTransformError: frames are empty or equal, values are not finite, the quaternion's length is not 1,
                or the transform is older than what is kept.
        """
        self._insert(transform.to_message() if isinstance(transform, Transform) else transform, static)
        self._waiters.wake()

    def _insert(self, message: Any, is_static: bool) -> None:
        stamp = message.header.stamp
        move, turn = message.transform.translation, message.transform.rotation
        link = Link(message.header.frame_id, (move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w))
        with self._lock:
            self._tree.insert(message.child_frame_id, nanoseconds(stamp), link, is_static=is_static)

    def clear(self) -> None:
        """Forget what moves; static transforms stay, because nobody sends them again."""
        with self._lock:
            self._tree.clear()

    # ------------------------------------------------------------------------------------------------------ asking

    def lookup(self, target: str, source: str, time: Any = None) -> Transform:
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

    def lookup_at(self, target: str, target_time: Any, source: str, source_time: Any, fixed: str) -> Transform:
        """Where something that `source` saw at one time is in `target` at another, as `fixed` did not move in between.

        Its stamp is that of `target`. Errors as `lookup`.
        """
        with self._lock:
            self._tree.require(target=target, source=source, fixed=fixed)
        before, after = self.lookup(fixed, source, source_time), self.lookup(target, fixed, target_time)
        return after @ before

    def can_transform(self, target: str, source: str, time: Any = None) -> bool:
        """Whether `lookup` would give something."""
        try:
            self.lookup(target, source, time)
        except (TransformError, InvalidTransformError):
            return False
        return True

    async def wait_for(
        self, target: str, source: str, time: Any = None, *, timeout_s: float | None = None
    ) -> Transform:
        """Wait until `lookup` gives a transform.

        Raises:
            TransformTimeoutError: what was missing to the end.
            InvalidTransformError: a frame is empty or begins with ``/``.
        """
        found: list[Transform] = []
        reason = [""]

        def is_there() -> bool:
            try:
                found.append(self.lookup(target, source, time))
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
