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
        entity: the publisher or subscription.
        queues: queues of events by kind of `runtime.Mismatch`, ``"qos"`` or ``"type"``; peer kinds are not recorded.
        known_peers: incompatible peers that were found, and their kinds of `runtime.Mismatch`.
    """

    node: runtime.Node
    entity: Any
    queues: dict[str, deque[Any]]
    known_peers: dict[bytes, str] = field(default_factory=dict)

    def poll(self) -> None:
        """Append an event for each new incompatible peer."""
        gid = self.entity.gid
        for mismatch in self.node.incompatible_endpoints_of_topic(self.entity.topic):
            writer, reader, kind = mismatch.writer, mismatch.reader, mismatch.kind
            gids = writer.endpoint_gid, reader.endpoint_gid
            peer = gids[0] if gids[1] == gid else gids[1]
            if gid not in gids or peer in self.known_peers:
                continue
            self.known_peers[peer] = kind
            if kind in self.queues:
                total = list(self.known_peers.values()).count(kind)
                policies = runtime.check_compatible(writer.qos_profile, reader.qos_profile).policies
                policy = policies[0] if kind == "qos" and policies else runtime.QoSPolicyKind.INVALID
                status = runtime.IncompatibleStatus(total, 1, mismatch.reason, policy)
                self.queues[kind].append(to_rclpy_status(status))


def to_rclpy_status(status: Any) -> Any:
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
        self._endpoints: weakref.WeakSet[WatchedEndpoint] = weakref.WeakSet()
        self._warnings: list[tuple[str, str]] = []
        context.on_incompatible_endpoint = self._record

    def watch(self, endpoint: WatchedEndpoint) -> None:
        """Add an endpoint, by a weak reference."""
        self._endpoints.add(endpoint)

    def _record(self, text: str, topic: str) -> None:
        self._warnings.append((text, topic))
        self._loop_runner.loop.call_soon_threadsafe(self._poll)

    def _poll(self) -> None:
        """Record new incompatible peers, and log the warnings of other topics, for example services. Thread: loop."""
        warnings, self._warnings = self._warnings, []
        topics = set()
        for endpoint in list(self._endpoints):
            try:
                endpoint.poll()
                # Also from an earlier poll, as the runtime may report each side of a pair.
                if endpoint.known_peers:
                    topics.add(endpoint.entity.topic)
            except runtime.ClosedError:
                continue
        self._notify()
        for text, topic in warnings:
            if topic not in topics:
                runtime.get_logger("rclpy").warning(text)
