"""Functions that find the ready entities of nodes and execute them: take one item, and call the callback with it.

The search runs for each message, before and after an executor waits, so endpoints at which nothing has arrived are
skipped.
"""

from __future__ import annotations

import inspect
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.service import Service
from rclpy.waitable import WaitSet
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine, Iterable

    from rclpy.executors import Executor
    from rclpy.node import Node

    ReadyEntities = list[tuple[Any, Node]]

_KINDS = ("subscriptions", "guards", "clients", "services")
"""Kinds of entities in the order in which rclpy executes them, between timers and waitables."""


def find_ready_entities(
    nodes: Iterable[Node], can_execute: Callable[[Any], bool]
) -> tuple[ReadyEntities, float | None, bool]:
    """Return the ready entities that may run, except waitables, node by node in rclpy's order.

    Args:
        nodes: nodes to search.
        can_execute: returns True if the callback of an entity may run now.

    Returns:
        Three values: the entities with their nodes; the seconds until the next timer is due, or None if no timer will
            be due without another event; True if there are waitables.
    """
    ready: ReadyEntities = []
    min_wait_s: float | None = None
    has_waitables = False
    for node in nodes:
        entities, marked_kinds = node.rosidl_entity_lists, node.handle.marked_kinds
        for timer in tuple(entities["timers"]):
            if timer.rosidl_is_ready():
                if can_execute(timer):
                    ready.append((timer, node))
                continue
            wait_s = timer.handle.max_wait_s()
            if wait_s is not None and (min_wait_s is None or wait_s < min_wait_s) and can_execute(timer):
                min_wait_s = wait_s
        kinds = {"guards"} if entities["guards"] else set()
        # Popped one at a time, because other threads add kinds; entities that stay ready add theirs again.
        while marked_kinds:
            with suppress(KeyError):  # another thread was faster
                kinds.add(marked_kinds.pop())
        for kind in _KINDS if len(kinds) > 1 else kinds:
            if kind in kinds:
                for entity in tuple(entities[kind]):
                    if entity.rosidl_is_ready() and can_execute(entity):
                        ready.append((entity, node))
        if entities["waitables"]:
            has_waitables = True
    return ready, min_wait_s, has_waitables


def find_ready_waitables(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> ReadyEntities:
    """Return the ready waitables with their nodes; called once for each search, because the check may change them."""
    ready: ReadyEntities = []
    wait_set: WaitSet | None = None
    for node in nodes:
        for waitable in tuple(node.rosidl_entity_lists["waitables"]):
            queue = waitable.rosidl_queue
            if (queue is not None and not queue) or not can_execute(waitable):
                continue
            if wait_set is None:
                wait_set = WaitSet()
            try:
                with waitable:
                    waitable.add_to_wait_set(wait_set)
                    if waitable.is_ready(wait_set):
                        ready.append((waitable, node))
            except InvalidHandle:
                continue
    return ready


def execute_entity(executor: Executor, entity: Any, is_shutdown: bool) -> Coroutine[Any, Any, None] | None:
    """Take an item, such as a message, from a ready entity, and call the entity's callback with it.

    Returns:
        A coroutine that awaits an async callback, which occupies its callback group; None if the callback has ended.
    """
    group = entity.callback_group
    if is_shutdown or not group.beginning_execution(entity):
        entity._executor_event = False
        executor.wake()
        return None
    continuation: Coroutine[Any, Any, None] | None = None
    try:
        call: Callable[[], Any] | None
        take = executor.rosidl_replaced_take(entity)
        try:
            call = entity.rosidl_take(executor) if take is None else take(entity)
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
            and (take is not None or isinstance(entity, Service) or inspect.iscoroutinefunction(call))
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
    """Return True if the calling thread runs a callback that prevents the callback of `entity` from being called."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_code is execute_entity.__code__:
            running, executor = frame.f_locals["entity"], frame.f_locals["executor"]
            if running.callback_group is entity.callback_group:
                return executor.rosidl_has_one_thread or not entity.callback_group.can_execute(entity)
            if executor.rosidl_has_one_thread:
                return any(entity is client for node in executor.get_nodes() for client in node.clients)
    return False
