"""What happens to an endpoint beside messages, told to callbacks as in rclpy: matches, mismatches, deadlines.

Decides how it is noticed: an endpoint that has such callbacks looks every 50 ms at what the graph and the middleware
know of it. Nothing announces some of this, and endpoints without such callbacks cost nothing.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.transport.qos import QoSPolicyKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.registration import Registration
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.transport.api import Reader, Writer

_POLL_INTERVAL_S = 0.05


class UnsupportedEventError(RosidlError, ValueError):
    """The caller asks for an event that this middleware does not tell."""


@dataclass(frozen=True, slots=True)
class MatchedStatus:
    """Endpoints were connected, or not any more.

    Attributes:
        total_count: how many were connected since the endpoint was made.
        total_count_change: of these, how many since the event before.
        current_count: how many are connected now.
        current_count_change: how many more than at the event before; negative when there are fewer.
    """

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


@dataclass(frozen=True, slots=True)
class IncompatibleStatus:
    """Others have another type, or a quality of service that cannot match.

    Attributes:
        total_count: how many since the endpoint was made.
        total_count_change: of these, how many since the event before.
        reason: about the last one, in words.
        last_policy_kind: the first policy that stands against the last one; INVALID where the type does, or what is no
            policy.
    """

    total_count: int
    total_count_change: int
    reason: str
    last_policy_kind: QoSPolicyKind = QoSPolicyKind.INVALID


@dataclass(frozen=True, slots=True)
class CountStatus:
    """Deadlines that passed, messages that were lost, or leases of liveliness that ended.

    Attributes:
        total_count: how many since the endpoint was made.
        total_count_change: of these, how many since the event before.
    """

    total_count: int
    total_count_change: int


@dataclass(frozen=True, slots=True)
class LivelinessStatus:
    """Publishers that say they are alive, and those that did not say so in time.

    Attributes:
        alive_count: how many are alive now.
        not_alive_count: how many are connected and did not say so.
        alive_count_change: how many more than at the event before; negative when there are fewer.
        not_alive_count_change: the same of those that did not.
    """

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


@dataclass(frozen=True, slots=True)
class SubscriptionEventCallbacks:
    """Functions, plain or async, that get what happened to a subscription.

    Attributes:
        deadline: a publisher was silent for longer than the deadline; DDS only, as the next one.
        liveliness: a publisher is alive, or did not say so within its lease.
        message_lost: messages did not arrive, as DDS and Zenoh tell; what keep-last dropped here is in
            `Subscription.dropped`.
        incompatible_type: a publisher has another type, or another definition of it.
        incompatible_qos: a publisher offers what is not asked for.
        matched: publishers were connected, or not any more.
    """

    deadline: Callable[[CountStatus], object] | None = None
    liveliness: Callable[[LivelinessStatus], object] | None = None
    message_lost: Callable[[CountStatus], object] | None = None
    incompatible_type: Callable[[IncompatibleStatus], object] | None = None
    incompatible_qos: Callable[[IncompatibleStatus], object] | None = None
    matched: Callable[[MatchedStatus], object] | None = None


@dataclass(frozen=True, slots=True)
class PublisherEventCallbacks:
    """Functions, plain or async, that get what happened to a publisher.

    Attributes:
        deadline: nothing was published for longer than the deadline; DDS only, as the next one.
        liveliness: it did not say within its lease that it is alive.
        incompatible_type: a subscription has another type, or another definition of it.
        incompatible_qos: a subscription asks for more than is offered.
        matched: subscriptions were connected, or not any more.
    """

    deadline: Callable[[CountStatus], object] | None = None
    liveliness: Callable[[CountStatus], object] | None = None
    incompatible_type: Callable[[IncompatibleStatus], object] | None = None
    incompatible_qos: Callable[[IncompatibleStatus], object] | None = None
    matched: Callable[[MatchedStatus], object] | None = None


def watch_events(
    scope: EntityScope,
    end: Reader | Writer,
    matched: Callable[[], list[bytes]],
    callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks | None,
    what: str,
) -> EndpointEventPoller | None:
    """`EndpointEventPoller`, where there are callbacks; when they are refused, the endpoint is closed."""
    if callbacks is None:
        return None
    try:
        return EndpointEventPoller(scope, end, matched, callbacks, what)
    except BaseException:
        end.close()
        raise


class EndpointEventPoller:
    """Looks after the events of one reader or writer. Close it before these.

    Args:
        matched: gives the GUIDs of those it is connected with.
        callbacks: as the user gave them.
        what: names the endpoint in errors: "the subscription on /chatter".

    Raises:
        UnsupportedEventError: the middleware does not tell one of them. CallbackSignatureError, TypeError: a callback
            cannot be called.
    """

    def __init__(
        self,
        scope: EntityScope,
        end: Reader | Writer,
        matched: Callable[[], list[bytes]],
        callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks,
        what: str,
    ) -> None:
        self._bridge = scope.bridge
        self._discovery = scope.discovery
        self._end = end
        self._matched = matched
        self._peers: set[bytes] = set()
        self._apart: set[bytes] = set()
        self._totals = {"matched": 0, "incompatible_type": 0, "incompatible_qos": 0}
        self._counts: dict[str, tuple[int, ...]] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._closed = False
        self._functions: dict[str, UserCallback] = {}
        for one in fields(callbacks):
            function = getattr(callbacks, one.name)
            if function is None:
                continue
            require_signature(function, f"the {one.name} callback of {what}", "the status")
            self._functions[one.name] = UserCallback(scope, function, f"the {one.name} callback of {what}")
            if one.name not in self._totals:
                counts = end.event_counts(one.name)
                if counts is None:
                    raise UnsupportedEventError(f"{what}: this middleware does not tell of {one.name}; DDS does")
                self._counts[one.name] = counts
        self._start: Registration = scope.bridge.on_start(self._schedule_poll)

    def _schedule_poll(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        loop = self._bridge.loop
        if not self._closed and loop is not None and not loop.is_closed():
            self._timer = loop.call_later(_POLL_INTERVAL_S, self._poll)

    def _poll(self) -> None:
        if self._closed:
            return
        if "matched" in self._functions:
            self._poll_matched_peers()
        if {"incompatible_type", "incompatible_qos"} & self._functions.keys():
            self._poll_other_endpoints()
        for name in self._counts:
            self._poll_counts(name)
        self._schedule_poll()

    def _poll_matched_peers(self) -> None:
        before = self._totals["matched"], len(self._peers)
        peers = set(self._matched())
        counts = self._end.event_counts("matched")  # which knows of those, too, that came and went since the last look
        total = before[0] + len(peers - self._peers) if counts is None else max(counts[0], before[0])
        if peers != self._peers or total != before[0]:
            self._totals["matched"], self._peers = total, peers
            self._tell("matched", MatchedStatus(total, total - before[0], len(peers), len(peers) - before[1]))

    def _poll_other_endpoints(self) -> None:
        graph = self._discovery.graph
        mine = graph.endpoints.get(self._end.guid)
        if mine is None:
            return
        others = graph.endpoints_on(mine.channel, writers=not mine.is_writer)
        self._apart &= {one.guid for one in others}
        found: dict[str, list[tuple[str, QoSPolicyKind]]] = {}
        for other in others:
            if other.guid in self._apart:
                continue
            differ = self._discovery.incompatibility(*((mine, other) if mine.is_writer else (other, mine)))
            if differ is not None:
                self._apart.add(other.guid)
                name = "incompatible_qos" if differ.mismatch_kind == "qos" else "incompatible_type"
                found.setdefault(name, []).append((differ.reason, next(iter(differ.policies), QoSPolicyKind.INVALID)))
        for name, items in found.items():
            self._totals[name] += len(items)
            self._tell(name, IncompatibleStatus(self._totals[name], len(items), *items[-1]))

    def _poll_counts(self, name: str) -> None:
        before, now = self._counts[name], self._end.event_counts(name)
        if now is None or now == before:
            return
        self._counts[name] = now
        changes = [new - old for new, old in zip(now, before, strict=True)]
        self._tell(name, LivelinessStatus(*now, *changes) if len(now) > 1 else CountStatus(now[0], changes[0]))

    def _tell(self, name: str, status: Any) -> None:
        function = self._functions.get(name)
        if function is not None:
            function.call(status)

    def close(self) -> None:
        """Look no more; may be called twice, from any thread."""
        self._closed = True
        self._start.close()
        for function in self._functions.values():
            function.close()
