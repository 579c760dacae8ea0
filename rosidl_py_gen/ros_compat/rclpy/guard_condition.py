"""Guard conditions: entities whose callback runs after the program has triggered them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.exceptions import NotInitializedException
from rclpy.handles import ContextHandle, Destroyable
from rclpy.utilities import get_default_context, resolve_context

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import CallbackGroup
    from rclpy.context import Context
    from rclpy.executors import Executor


class GuardConditionHandle(Destroyable):
    """Handle of a guard condition, which remembers that the condition was triggered."""

    def __init__(self, context: ContextHandle) -> None:
        super().__init__()
        self._context = context
        self._is_triggered = False

    def trigger_guard_condition(self) -> None:
        """Record the trigger and wake up executors."""
        self._is_triggered = True
        self._context.notify()

    def is_ready(self) -> bool:
        return self._is_triggered

    def take_trigger(self) -> None:
        self._is_triggered = False


class GuardCondition:
    """Entity whose callback runs once after one or several calls of `trigger`."""

    rosidl_take_method = "_take_guard_condition"

    def __init__(
        self,
        callback: Callable[[], Any] | None,
        callback_group: CallbackGroup | None,
        context: Context | None = None,
    ) -> None:
        self._context = resolve_context(context)
        handle = self._context.handle
        if handle is None:
            raise NotInitializedException("cannot create guard condition")
        with handle:
            self._rosidl_guard_handle = GuardConditionHandle(handle)
        self.callback = callback
        self.callback_group = callback_group
        self._executor_event = False

    def trigger(self) -> None:
        """Schedule the callback of the guard condition; raise InvalidHandle after `destroy`. Thread: any."""
        with self._rosidl_guard_handle:
            self._rosidl_guard_handle.trigger_guard_condition()

    @property
    def handle(self) -> GuardConditionHandle:
        return self._rosidl_guard_handle

    def destroy(self) -> None:
        """Destroy the guard condition; use `Node.destroy_guard_condition` for guard conditions of nodes."""
        self.handle.destroy_when_not_in_use()

    def rosidl_is_ready(self) -> bool:
        return self._rosidl_guard_handle.is_ready()

    def rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        self._rosidl_guard_handle.take_trigger()
        return self.callback
