"""Buffer of transforms between frames, which transform listeners fill."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_msgs.srv import FrameGraph
from tf2_py import BufferCore, TransformException

from tf2_ros.buffer_interface import NO_TIME, BufferInterface


class Buffer(BufferCore, BufferInterface):
    """Buffer of the transforms of the last seconds, and of static transforms.

    Methods with `timeout` wait until a listener receives the transform. They wait in vain in a callback that prevents
    the listener's callback from running.

    Args:
        cache_time: time for which transforms are stored. [default: 10 s]
        node: node that serves ``tf2_frames``. The buffer is cleared when the node's clock jumps back by 1 s or more, or
            when its source of time changes.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._rosidl_condition = threading.Condition()
        self._new_data_callbacks: list[Callable[[], None]] = []
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._rosidl_on_frame_graph_request)
        self.clock = Clock() if node is None else node.get_clock()
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True)
        self.jump_handle = self.clock.create_jump_callback(threshold, post_callback=self.time_jump_callback)

    def _rosidl_on_frame_graph_request(self, request: Any, response: Any) -> Any:
        return FrameGraph.Response(frame_yaml=self.all_frames_as_yaml())

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Clear the buffer, because the clock has jumped back or changed its source of time; called by the clock."""
        get_logger("tf2_buffer").warning("Detected jump back in time. Clearing tf buffer.")
        self.clear()

    def _rosidl_set(self, transform: TransformStamped, authority: str, is_static: bool) -> None:
        super()._rosidl_set(transform, authority, is_static)
        with self._rosidl_condition:
            self._rosidl_condition.notify_all()
            callbacks = list(self._new_data_callbacks)
        for callback in callbacks:
            callback()

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """Return the transform from `source_frame` to `target_frame` at a time; time 0 means the latest.

        Raises:
            LookupException: a frame is unknown.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the frames are connected, but not at this time.
            InvalidArgumentException: the name of a frame is invalid.
        """
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Any:
        """Wait until the transform from `source_frame` to `target_frame` is available, and return it."""
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """Return the transform from `source_frame` at one time to `target_frame` at another time.

        The frame `fixed_frame` is assumed not to move between the times.
        """
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        self.can_transform_full(*arguments, timeout)
        return self.lookup_transform_full_core(*arguments)

    async def lookup_transform_full_async(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> Any:
        """Wait until the transform of `lookup_transform_full` with the same arguments is available, and return it."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return await self.wait_for_transform_full_async(*arguments)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = NO_TIME,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Return True if `lookup_transform` would succeed; with `return_debug_tuple` a tuple with the reason."""
        result = self._rosidl_wait(partial(self.can_transform_core, target_frame, source_frame, time), timeout)
        return result if return_debug_tuple else result[0]

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
        """Return True if `lookup_transform_full` would succeed; with `return_debug_tuple` a tuple with the reason."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        result = self._rosidl_wait(lambda: self.can_transform_full_core(*arguments), timeout)
        return result if return_debug_tuple else result[0]

    def _rosidl_wait(self, check: Callable[[], tuple[bool, str]], timeout: Duration) -> tuple[bool, str]:
        if timeout.nanoseconds > 0:
            with self._rosidl_condition:
                self._rosidl_condition.wait_for(lambda: check()[0], timeout.nanoseconds / 1e9)
        return check()

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Future[Any]:
        """Return a future that is done when the transform is available; arguments as for `lookup_transform`."""
        return self._rosidl_future(self.lookup_transform_core, target_frame, source_frame, time)

    def wait_for_transform_full_async(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> Future[Any]:
        """Return a future that is done when the transform is available; arguments as for `lookup_transform_full`."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return self._rosidl_future(self.lookup_transform_full_core, *arguments)

    def _rosidl_future(self, look_up: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()

        def try_lookup() -> None:
            if future.done() or future.cancelled():
                return
            try:
                transform = look_up(*arguments)
            except TransformException:
                return  # not available yet
            except Exception as error:
                future.set_exception(error)
            else:
                future.set_result(transform)

        def remove_callback(_: Future[Any]) -> None:
            with self._rosidl_condition:
                if try_lookup in self._new_data_callbacks:
                    self._new_data_callbacks.remove(try_lookup)

        with self._rosidl_condition:
            self._new_data_callbacks.append(try_lookup)
        future.add_done_callback(remove_callback)
        try_lookup()
        return future
