"""Incompatible peers by QoS or type: events for endpoints without callbacks of the program."""

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
    """Publisher or subscription whose incompatible peers are recorded.

    Attributes:
        node: node that reads the graph.
        endpoint: the publisher or subscription.
        queues: queues of events by kind of `runtime.Mismatch`, ``"qos"`` or ``"type"``; other kinds are not recorded.
    """

    node: runtime.Node
    endpoint: Any
    queues: dict[str, deque[Any]]
    _seen: set[bytes] = field(default_factory=set)
    _totals: dict[str, int] = field(default_factory=dict)

    @property
    def has_any(self) -> bool:
        return bool(self._seen)

    def poll(self) -> None:
        """Append an event for each new incompatible peer."""
        gid = self.endpoint.gid
        for mismatch in self.node.incompatible_endpoints_of_topic(self.endpoint.topic):
            writer, reader, kind = mismatch.writer, mismatch.reader, mismatch.kind
            pair = writer.endpoint_gid, reader.endpoint_gid
            if gid not in pair:
                continue
            other = pair[0] if pair[1] == gid else pair[1]
            if other in self._seen:
                continue
            self._seen.add(other)
            if kind not in self.queues:
                continue
            self._totals[kind] = total = self._totals.get(kind, 0) + 1
            policy = runtime.QoSPolicyKind.INVALID
            if kind == "qos":
                policy = next(iter(runtime.check_compatible(writer.qos_profile, reader.qos_profile).policies), policy)
            status = runtime.IncompatibleStatus(total, 1, mismatch.reason, policy)
            self.queues[kind].append(with_policy_of_c(status))


def with_policy_of_c(status: Any) -> Any:
    """Return an event as rclpy reports it: the policy of an incompatible peer is a member of the C enum."""
    if not isinstance(status, runtime.IncompatibleStatus):
        return status
    policy: Any = rmw_qos_policy_kind_t(int(status.last_policy_kind))
    return replace(status, last_policy_kind=policy)


class IncompatiblePeerWatcher:
    """Watched endpoints of a context, which are polled when the runtime finds an incompatible peer."""

    def __init__(self, context: runtime.Context, loop_runner: runtime.LoopRunner, notify: Callable[[], None]) -> None:
        self._loop_runner = loop_runner
        self._notify = notify
        self._watched: weakref.WeakSet[WatchedEndpoint] = weakref.WeakSet()
        self._texts: list[tuple[str, str]] = []
        context.on_incompatible_endpoint = self._record

    def watch(self, watched: WatchedEndpoint) -> None:
        """Add an endpoint, by a weak reference."""
        self._watched.add(watched)

    def _record(self, text: str, topic: str) -> None:
        self._texts.append((text, topic))
        self._loop_runner.loop.call_soon_threadsafe(self._poll)

    def _poll(self) -> None:
        """Record new incompatible peers, and log the texts of other topics, for example services. Thread: loop."""
        texts, self._texts = self._texts, []
        topics = set()
        for watched in list(self._watched):
            try:
                watched.poll()
                if watched.has_any:  # also from an earlier poll, as the runtime may report each side of a pair
                    topics.add(watched.endpoint.topic)
            except runtime.ClosedError:
                continue
        self._notify()
        for text, topic in texts:
            if topic not in topics:
                runtime.get_logger("rclpy").warning(text)
