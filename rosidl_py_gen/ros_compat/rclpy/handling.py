"""What an executor does with an entity that is ready: take one item, and call back."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine

    from rclpy.executors import Executor


def handle_entity(executor: Executor, entity: Any, is_shutdown: bool) -> Coroutine[Any, Any, None] | None:
    """Do it, and answer what is left to do where the callback is async: until then its group is held."""
    group = entity.callback_group
    if is_shutdown or not group.beginning_execution(entity):
        entity._executor_event = False
        executor.wake()
        return None
    rest: Coroutine[Any, Any, None] | None = None
    try:
        call: Callable[[], Any] | None
        try:
            call = entity._rosidl_take(executor)
        except (InvalidHandle, runtime.ClosedError):  # destroyed meanwhile
            call = None
        finally:
            entity._executor_event = False
            if type(group) is not MutuallyExclusiveCallbackGroup:  # there nothing is to be seen before the end
                executor.wake()
        if call is None:
            return None
        answer = call()
        if (
            answer is not None
            and inspect.isawaitable(answer)  # a plain callback that answers a coroutine is left alone, as in rclpy
            and (isinstance(entity, Service) or inspect.iscoroutinefunction(call))
        ):
            rest = _finish(executor, entity, answer)
        return rest
    finally:
        if rest is None:
            _end(executor, entity)


async def _finish(executor: Executor, entity: Any, answer: Awaitable[Any]) -> None:
    try:
        await answer
    finally:
        _end(executor, entity)


def _end(executor: Executor, entity: Any) -> None:
    entity.callback_group.ending_execution(entity)
    executor.wake()
