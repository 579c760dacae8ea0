"""Subscriptions of asyncio nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.executors import await_or_execute
from rclpy.impl.async_entities import Arrivals, EntityTask, call_for_each
from rclpy.subscription import BaseSubscription

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.handles import Handle
    from rclpy.qos import QoSProfile
    from rosidl_py_gen import runtime


class AsyncSubscription(BaseSubscription):
    """Subscription of a topic, created by `AsyncNode.create_subscription`."""

    def __init__(
        self,
        subscription_impl: Handle[runtime.Subscription[Any]],
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile,
        on_destroy: Callable[[AsyncSubscription], None],
        raw: bool = False,
        concurrent: bool = False,
        tg: Any = None,
    ) -> None:
        super().__init__(subscription_impl, msg_type, topic, callback, qos_profile, raw, on_destroy=on_destroy)
        self._rosidl_is_concurrent = concurrent
        self._rosidl_arrivals = Arrivals(subscription_impl, self.rosidl_take_arguments)
        self.rosidl_task = EntityTask(self._rosidl_run, self.destroy, tg)

    def destroy(self) -> None:
        """Destroy the subscription, and cancel the running callback."""
        self.rosidl_task.cancel()
        super().destroy()

    async def _rosidl_run(self) -> None:
        await call_for_each(self._rosidl_arrivals.items(), self._rosidl_call, concurrent=self._rosidl_is_concurrent)

    async def _rosidl_call(self, arguments: tuple[Any, ...]) -> None:
        await await_or_execute(self.callback, *arguments)
