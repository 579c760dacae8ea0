"""Publishers and subscriptions whose program gave no callback for mismatches: rclpy logs them, so a handler is told."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from rclpy._rclpy_pybind11 import rmw_qos_policy_kind_t
from rosidl_py_gen import runtime


@dataclass(eq=False)
class WatchedEndpoint:
    """One endpoint.

    Attributes:
        node: where the graph is asked.
        endpoint: the publisher or subscription.
        queues: what a mismatch is put into, by the kind of `runtime.Mismatch`: ``"qos"``, ``"type"``; of kinds that are
            missing the program hears by itself, or does not want to.
    """

    node: runtime.Node
    endpoint: Any
    queues: dict[str, deque[Any]]
    _seen: set[bytes] = field(default_factory=set)
    _totals: dict[str, int] = field(default_factory=dict)

    @property
    def has_any(self) -> bool:
        """Whether it ever had one."""
        return bool(self._seen)

    def poll(self) -> None:
        """Tell of those that are new."""
        gid = self.endpoint.gid
        for one in self.node.incompatible_endpoints_of_topic(self.endpoint.topic):
            pair = one.writer.endpoint_gid, one.reader.endpoint_gid
            if gid not in pair:
                continue
            other = pair[0] if pair[1] == gid else pair[1]
            if other in self._seen:
                continue
            self._seen.add(other)
            if one.kind not in self.queues:
                continue
            self._totals[one.kind] = total = self._totals.get(one.kind, 0) + 1
            policies = runtime.check_compatible(one.writer.qos_profile, one.reader.qos_profile).policies
            policy = next(iter(policies), runtime.QoSPolicyKind.INVALID) if one.kind == "qos" else None
            status = runtime.IncompatibleStatus(total, 1, one.reason, policy or runtime.QoSPolicyKind.INVALID)
            self.queues[one.kind].append(with_policy_of_c(status))


def with_policy_of_c(status: Any) -> Any:
    """Return what the runtime tells of an event as rclpy does: the policy of an incompatible peer is an enum of C."""
    if not isinstance(status, runtime.IncompatibleStatus):
        return status
    policy: Any = rmw_qos_policy_kind_t(int(status.last_policy_kind))
    return replace(status, last_policy_kind=policy)


class Mismatches:
    """Looks at the endpoints of a context when the runtime notices a mismatch, and at no other time."""

    def __init__(self, context: runtime.Context, driver: runtime.LoopRunner, arrived: Callable[[], None]) -> None:
        self._driver = driver
        self._arrived = arrived
        self._watched: weakref.WeakSet[WatchedEndpoint] = weakref.WeakSet()
        self._texts: list[tuple[str, str]] = []
        context.on_incompatible_endpoint = self._record

    def watch(self, watched: WatchedEndpoint) -> None:
        """Look at an endpoint, too, as long as somebody holds `watched`."""
        self._watched.add(watched)

    def _record(self, text: str, topic: str) -> None:
        self._texts.append((text, topic))
        self._driver.loop.call_soon_threadsafe(self._look)

    def _look(self) -> None:
        """On the loop. What is of no watched endpoint is logged as it came: services, and definitions of one type."""
        texts, self._texts = self._texts, []
        told = set()
        for one in list(self._watched):
            try:
                one.poll()
                if one.has_any:  # be it before: the runtime may notice a mismatch from either end
                    told.add(one.endpoint.topic)
            except runtime.ClosedError:
                continue
        self._arrived()
        for text, topic in texts:
            if topic not in told:
                runtime.get_logger("rclpy").warning(text)
