"""What of some nodes is ready: looked at by executors, before and after they wait.

Both run for each message, so that they ask no more than they must: endpoints that nothing arrived for are passed over.
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

    ReadyCallback = list[tuple[Any, Node]]

SUBSCRIPTIONS, GUARDS, CLIENTS, SERVICES = 2, 3, 4, 5
"""Where they are in `ServedEntity`."""


class ServedEntity(NamedTuple):
    """What executors serve of a node, in rclpy's order; the lists are the node's own."""

    handle: Handle[Any]
    timers: list[Timer]
    subscriptions: list[Subscription]
    guards: list[GuardCondition]
    clients: list[Client]
    services: list[Service]
    waitables: list[Waitable]


def ready_entities(
    nodes: Iterable[Node], can_execute: Callable[[Any], bool]
) -> tuple[ReadyCallback, float | None, bool]:
    """What is ready and may run, but waitables; node by node, in rclpy's order. Then how many seconds it is to the next
    timer, None while none will be due by itself; and whether there are waitables.
    """
    found: ReadyCallback = []
    least: float | None = None
    has_waitables = False
    for node in nodes:
        served = node._rosidl_what_is_served()
        handle, timers, _, guards, _, _, waitables = served
        if timers:
            for timer in tuple(timers):
                if timer._rosidl_is_ready():
                    if can_execute(timer):
                        found.append((timer, node))
                    continue
                left = timer.handle.seconds_left()
                if left is not None and (least is None or left < least) and can_execute(timer):
                    least = left
        if handle.marked:
            kinds = set()
            while handle.marked:  # one by one, as another thread may add to it; what stays ready marks it again
                kinds.add(handle.marked.pop())
            for kind in (SUBSCRIPTIONS, GUARDS, CLIENTS, SERVICES) if guards or len(kinds) > 1 else kinds:
                if kind in kinds or kind == GUARDS:
                    entities: list[Any] = served[kind]  # type: ignore[assignment]
                    for one in tuple(entities):
                        if one._rosidl_is_ready() and can_execute(one):
                            found.append((one, node))
        elif guards:
            found += [(one, node) for one in tuple(guards) if one._rosidl_is_ready() and can_execute(one)]
        if waitables:
            has_waitables = True
    return found, least, has_waitables


def ready_waitables(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> ReadyCallback:
    """Asked once a pass, because that may change them."""
    found: ReadyCallback = []
    wait_set: WaitSet | None = None
    for node in nodes:
        for waitable in tuple(node._rosidl_what_is_served().waitables):
            queue = waitable._rosidl_queue
            if (queue is not None and not queue) or not can_execute(waitable):
                continue
            if wait_set is None:
                wait_set = WaitSet()
            try:
                with waitable:
                    waitable.add_to_wait_set(wait_set)
                    if waitable.is_ready(wait_set):
                        found.append((waitable, node))
            except InvalidHandle:
                continue
    return found
