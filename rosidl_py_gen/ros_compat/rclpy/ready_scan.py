"""Search for the ready entities of nodes, before and after an executor waits.

It runs for each message, so endpoints without an arrival are skipped.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.exceptions import InvalidHandle
from rclpy.waitable import WaitSet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.client import Client
    from rclpy.guard_condition import GuardCondition
    from rclpy.handles import Handle
    from rclpy.node import Node
    from rclpy.service import Service
    from rclpy.subscription import Subscription
    from rclpy.timer import Timer
    from rclpy.waitable import Waitable

    ReadyEntities = list[tuple[Any, Node]]

SUBSCRIPTIONS, GUARDS, CLIENTS, SERVICES = 2, 3, 4, 5
"""Indices in `NodeEntityLists`."""


class NodeEntityLists(NamedTuple):
    """Entities of a node in rclpy's order; the lists are the node's own."""

    handle: Handle[Any]
    timers: list[Timer]
    subscriptions: list[Subscription]
    guards: list[GuardCondition]
    clients: list[Client]
    services: list[Service]
    waitables: list[Waitable]


def find_ready_entities(
    nodes: Iterable[Node], can_execute: Callable[[Any], bool]
) -> tuple[ReadyEntities, float | None, bool]:
    """Return the ready entities that may run, except waitables, node by node in rclpy's order.

    Returns:
        The entities; the seconds until the next timer, None if no timer will be due without another event; and True if
            there are waitables.
    """
    ready: ReadyEntities = []
    min_wait_s: float | None = None
    has_waitables = False
    for node in nodes:
        entity_lists = node._rosidl_entity_lists
        handle, timers, _, guards, _, _, waitables = entity_lists
        if timers:
            for timer in tuple(timers):
                if timer._rosidl_is_ready():
                    if can_execute(timer):
                        ready.append((timer, node))
                    continue
                wait_s = timer.handle.max_wait_s()
                if wait_s is not None and (min_wait_s is None or wait_s < min_wait_s) and can_execute(timer):
                    min_wait_s = wait_s
        if handle.marked_kinds:
            kinds = set()
            # Popped one at a time, because other threads add kinds; entities that stay ready add theirs again.
            while handle.marked_kinds:
                kinds.add(handle.marked_kinds.pop())
            for kind in (SUBSCRIPTIONS, GUARDS, CLIENTS, SERVICES) if guards or len(kinds) > 1 else kinds:
                if kind in kinds or kind == GUARDS:
                    entities: list[Any] = entity_lists[kind]  # type: ignore[assignment]
                    for entity in tuple(entities):
                        if entity._rosidl_is_ready() and can_execute(entity):
                            ready.append((entity, node))
        elif guards:
            ready += [(guard, node) for guard in tuple(guards) if guard._rosidl_is_ready() and can_execute(guard)]
        if waitables:
            has_waitables = True
    return ready, min_wait_s, has_waitables


def find_ready_waitables(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> ReadyEntities:
    """Return the ready waitables; called once for each scan, because the check may change them."""
    ready: ReadyEntities = []
    wait_set: WaitSet | None = None
    for node in nodes:
        for waitable in tuple(node._rosidl_entity_lists.waitables):
            queue = waitable._rosidl_queue
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
