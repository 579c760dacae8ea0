"""What of some nodes is ready: looked at by executors, before and after they wait."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.waitable import WaitSet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node

    Found = list[tuple[Any, Node]]


def ready_entities(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> Found:
    """What is ready and may run, but waitables; node by node, in rclpy's order."""
    found: Found = []
    for node in nodes:
        for entities in (node.timers, node.subscriptions, node.guards, node.clients, node.services):
            found += [(one, node) for one in entities if one._is_ready() and can_execute(one)]
    return found


def ready_waitables(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> Found:
    """Asked once a pass, because that may change them."""
    found: Found = []
    wait_set = WaitSet()
    for node in nodes:
        for waitable in [one for one in node.waitables if can_execute(one)]:
            try:
                with waitable:
                    waitable.add_to_wait_set(wait_set)
                    if waitable.is_ready(wait_set):
                        found.append((waitable, node))
            except InvalidHandle:
                continue
    return found


def seconds_to_timer(nodes: Iterable[Node], can_execute: Callable[[Any], bool]) -> float | None:
    """How long until a timer is due; None while none will be by itself."""
    left = [timer.handle.seconds_left() for node in nodes for timer in node.timers if can_execute(timer)]
    return min((one for one in left if one is not None), default=None)
