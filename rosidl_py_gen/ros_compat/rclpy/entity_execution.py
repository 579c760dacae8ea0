"""Execution of a ready entity by an executor: one item is taken, and the callback called with it."""

from __future__ import annotations

import inspect
import sys
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine

    from rclpy.executors import Executor


def execute_entity(executor: Executor, entity: Any, is_shutdown: bool) -> Coroutine[Any, Any, None] | None:
    """Take an item and call the callback; return the continuation of an async callback, which occupies its group."""
    group = entity.callback_group
    if is_shutdown or not group.beginning_execution(entity):
        entity._executor_event = False
        executor.wake()
        return None
    continuation: Coroutine[Any, Any, None] | None = None
    try:
        call: Callable[[], Any] | None
        try:
            call = entity._rosidl_take(executor)
        except (InvalidHandle, runtime.ClosedError):  # another thread destroyed the entity
            call = None
        finally:
            entity._executor_event = False
            if type(group) is not MutuallyExclusiveCallbackGroup:  # such a group runs no other callback before the end
                executor.wake()
        if call is None:
            return None
        result = call()
        if (
            result is not None
            and inspect.isawaitable(result)  # as in rclpy, a coroutine that a plain callback returns is not awaited
            and (isinstance(entity, Service) or inspect.iscoroutinefunction(call))
        ):
            continuation = _await_and_end_execution(executor, entity, result)
        return continuation
    finally:
        if continuation is None:
            _end_execution(executor, entity)


async def _await_and_end_execution(executor: Executor, entity: Any, result: Awaitable[Any]) -> None:
    try:
        await result
    finally:
        _end_execution(executor, entity)


def _end_execution(executor: Executor, entity: Any) -> None:
    entity.callback_group.ending_execution(entity)
    executor.wake()


def is_in_callback_that_blocks(entity: Any) -> bool:
    """Return True if this thread runs a callback that keeps the callback of `entity` from being called."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_code is execute_entity.__code__:
            running, executor = frame.f_locals["entity"], frame.f_locals["executor"]
            if running.callback_group is entity.callback_group:
                return executor._rosidl_has_one_thread or not entity.callback_group.can_execute(entity)
            if executor._rosidl_has_one_thread:
                return any(entity is client for node in executor.get_nodes() for client in node.clients)
    return False
