"""The buffer that listeners fill and programs ask."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_msgs.srv import FrameGraph
from tf2_py import BufferCore

from tf2_ros.buffer_interface import NO_TIME, BufferInterface


class Buffer(BufferCore, BufferInterface):
    """Transforms of the last seconds, and static ones.

    A `timeout` waits for what a listener brings: in a callback that is in the way of the listener's, it passes in vain.

    Args:
        cache_time: how long transforms are kept: ten seconds.
        node: has the service ``tf2_frames``, and the clock whose jumps back empty the buffer.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._rosidl_arrived = threading.Condition()
        self._new_data_callbacks: list[Callable[[], None]] = []
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._rosidl_frames)
        self.clock = Clock() if node is None else node.get_clock()
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True)
        self.jump_handle = self.clock.create_jump_callback(threshold, post_callback=self.time_jump_callback)

    def _rosidl_frames(self, request: Any, response: Any) -> Any:
        return FrameGraph.Response(frame_yaml=self.all_frames_as_yaml())

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Empty the buffer; the clock calls it."""
        get_logger("tf2_buffer").warning("Detected jump back in time. Clearing tf buffer.")
        self.clear()

    def set_transform(self, transform: Any, authority: str) -> None:
        """Take a transform in, and tell who waits."""
        super().set_transform(transform, authority)
        self._rosidl_tell()

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Take in one that holds at all times, and tell who waits."""
        super().set_transform_static(transform, authority)
        self._rosidl_tell()

    def _rosidl_tell(self) -> None:
        with self._rosidl_arrived:
            self._rosidl_arrived.notify_all()
            waiting = list(self._new_data_callbacks)
        for callback in waiting:
            callback()

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """How coordinates in `source_frame` become coordinates in `target_frame`; time 0 takes the newest.

        Raises:
            LookupException, ConnectivityException, ExtrapolationException, InvalidArgumentException: as they say.
        """
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Any:
        """The same as soon as it is known."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self.lookup_transform_core(target_frame, source_frame, time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """The same between two times, as `fixed_frame` did not move in between."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        self.can_transform_full(*asked, timeout)
        return self.lookup_transform_full_core(*asked)

    async def lookup_transform_full_async(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> Any:
        """The same as soon as it is known."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        await self.wait_for_transform_full_async(*asked)
        return self.lookup_transform_full_core(*asked)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = NO_TIME,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether `lookup_transform` would give something; with `return_debug_tuple` also what is wrong."""
        answer = self._rosidl_waited(lambda: self.can_transform_core(target_frame, source_frame, time), timeout)
        return answer if return_debug_tuple else answer[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether `lookup_transform_full` would give something; with `return_debug_tuple` also what is wrong."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        answer = self._rosidl_waited(lambda: self.can_transform_full_core(*asked), timeout)
        return answer if return_debug_tuple else answer[0]

    def _rosidl_waited(self, look: Callable[[], tuple[bool, str]], timeout: Duration) -> tuple[bool, str]:
        """What `look` answers when it is yes, or at the end of the time."""
        if timeout.nanoseconds > 0:
            with self._rosidl_arrived:
                self._rosidl_arrived.wait_for(lambda: look()[0], timeout.nanoseconds / 1e9)
        return look()

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Future[Any]:
        """A future of the transform."""
        asked = target_frame, source_frame, time
        return self._rosidl_future(
            partial(self.can_transform_core, *asked), partial(self.lookup_transform_core, *asked)
        )

    def wait_for_transform_full_async(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> Future[Any]:
        """A future of the transform between two times."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        can, look_up = self.can_transform_full_core, self.lookup_transform_full_core
        return self._rosidl_future(partial(can, *asked), partial(look_up, *asked))

    def _rosidl_future(self, can: Callable[[], tuple[bool, str]], look_up: Callable[[], Any]) -> Future[Any]:
        future: Future[Any] = Future()

        def look() -> None:
            if future.done() or future.cancelled():
                return
            try:
                if can()[0]:
                    future.set_result(look_up())
            except Exception as error:
                future.set_exception(error)

        def forget(_: Future[Any]) -> None:
            with self._rosidl_arrived:
                if look in self._new_data_callbacks:
                    self._new_data_callbacks.remove(look)

        with self._rosidl_arrived:
            self._new_data_callbacks.append(look)
        future.add_done_callback(forget)
        look()
        return future
