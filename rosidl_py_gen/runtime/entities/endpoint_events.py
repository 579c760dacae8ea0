"""Events of publishers and subscriptions for callbacks as in rclpy: matches, incompatible endpoints, deadlines.

Incompatible endpoints are searched whenever the graph changes. For other events an endpoint polls the transport every
50 ms, because the transport does not notify of some events. Endpoints without callbacks cost nothing.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.callbacks import require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.loop.callbacks import UserCallback
from rosidl_py_gen.runtime.transport.qos import QoSPolicyKind

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.base.callbacks import Registration
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.transport.api import Reader, TopicKey, Writer

_POLL_INTERVAL_S = 0.05
_INCOMPATIBLE = {"incompatible_type", "incompatible_qos"}


class UnsupportedEventError(RosidlError, ValueError):
    """Raised if the transport does not report an event for which a callback was passed."""


@dataclass(frozen=True, slots=True)
class MatchedStatus:
    """Change of the endpoints that are matched with a publisher or subscription.

    Attributes:
        total_count: number of endpoints that were matched since the publisher or subscription was created.
        total_count_change: difference of `total_count` to the previous event.
        current_count: number of endpoints that are matched now.
        current_count_change: difference of `current_count` to the previous event, negative if endpoints have left.
    """

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


@dataclass(frozen=True, slots=True)
class IncompatibleStatus:
    """Endpoints that do not match a publisher or subscription because of type or QoS.

    Attributes:
        total_count: number of such endpoints since the publisher or subscription was created.
        total_count_change: difference of `total_count` to the previous event.
        reason: text about the last of these endpoints.
        last_policy_kind: first incompatible QoS policy of the last endpoint; INVALID if QoS is not the reason.
    """

    total_count: int
    total_count_change: int
    reason: str
    last_policy_kind: QoSPolicyKind = QoSPolicyKind.INVALID


@dataclass(frozen=True, slots=True)
class CountStatus:
    """Number of missed deadlines, lost messages, or expired liveliness leases, depending on the event.

    Attributes:
        total_count: number since the publisher or subscription was created.
        total_count_change: difference of `total_count` to the previous event.
    """

    total_count: int
    total_count_change: int


@dataclass(frozen=True, slots=True)
class LivelinessStatus:
    """Change of the liveliness of the publishers that are matched with a subscription.

    Attributes:
        alive_count: number of matched publishers that are alive.
        not_alive_count: number of matched publishers whose lease has expired.
        alive_count_change: difference of `alive_count` to the previous event.
        not_alive_count_change: difference of `not_alive_count` to the previous event.
    """

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


@dataclass(frozen=True, slots=True)
class SubscriptionEventCallbacks:
    """Callbacks, plain or async, for the events of a subscription.

    Attributes:
        deadline: a publisher has sent nothing within the deadline; only on DDS.
        liveliness: the liveliness of a publisher has changed; only on DDS.
        message_lost: DDS or Zenoh has lost messages. `Subscription.dropped` counts messages that the queue has dropped.
        incompatible_type: a publisher has another type, or another definition of it.
        incompatible_qos: a publisher offers less than the subscription requests.
        matched: publishers were matched or have left.
    """

    deadline: Callable[[CountStatus], object] | None = None
    liveliness: Callable[[LivelinessStatus], object] | None = None
    message_lost: Callable[[CountStatus], object] | None = None
    incompatible_type: Callable[[IncompatibleStatus], object] | None = None
    incompatible_qos: Callable[[IncompatibleStatus], object] | None = None
    matched: Callable[[MatchedStatus], object] | None = None


@dataclass(frozen=True, slots=True)
class PublisherEventCallbacks:
    """Callbacks, plain or async, for the events of a publisher.

    Attributes:
        deadline: the publisher has sent nothing within the deadline; only on DDS.
        liveliness: the publisher's liveliness lease has expired; only on DDS.
        incompatible_type: a subscription has another type, or another definition of it.
        incompatible_qos: a subscription requests more than the publisher offers.
        matched: subscriptions were matched or have left.
    """

    deadline: Callable[[CountStatus], object] | None = None
    liveliness: Callable[[CountStatus], object] | None = None
    incompatible_type: Callable[[IncompatibleStatus], object] | None = None
    incompatible_qos: Callable[[IncompatibleStatus], object] | None = None
    matched: Callable[[MatchedStatus], object] | None = None


def watch_events(
    scope: EntityScope,
    endpoint: Reader | Writer,
    matched: Callable[[], list[bytes]],
    callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks | None,
    subject: str,
) -> EndpointEventPoller | None:
    """Return an object that polls an endpoint and calls its event callbacks.

    Returns None if the program has passed no callbacks. If a callback is invalid or its event unsupported, the endpoint
    is closed, and the error of `EndpointEventPoller` is raised.
    """
    if callbacks is None:
        return None
    try:
        return EndpointEventPoller(scope, endpoint, matched, callbacks, subject)
    except BaseException:
        endpoint.close()
        raise


class EndpointEventPoller:
    """Poller that calls the event callbacks of one reader or writer; must be closed before the endpoint.

    Args:
        matched: returns the GUIDs of the endpoints that are matched with `endpoint`.
        subject: name of the endpoint in errors: "the subscription on /chatter".

    Raises:
        UnsupportedEventError: the transport does not report one of the events.
        CallbackSignatureError, TypeError: a callback cannot be called.
    """

    def __init__(
        self,
        scope: EntityScope,
        endpoint: Reader | Writer,
        matched: Callable[[], list[bytes]],
        callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks,
        subject: str,
    ) -> None:
        self._loop_binding = scope.loop_binding
        self._discovery = scope.discovery
        self._endpoint = endpoint
        self._matched = matched
        self._peers: set[bytes] = set()
        self._compared: set[bytes] = set()
        """GUIDs of the endpoints in opposite direction on the topic whose compatibility has been checked already."""
        self._totals = {"matched": 0, "incompatible_type": 0, "incompatible_qos": 0}
        self._counts: dict[str, tuple[int, ...]] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._closed = False
        self._callbacks: dict[str, UserCallback] = {}
        for name in (field.name for field in fields(callbacks)):
            function = getattr(callbacks, name)
            if function is None:
                continue
            require_signature(function, f"the {name} callback of {subject}", "the status")
            self._callbacks[name] = UserCallback(scope, function, f"the {name} callback of {subject}")
            if name not in self._totals:
                counts = endpoint.event_counts(name)
                if counts is None:
                    raise UnsupportedEventError(f"{subject}: this middleware does not report {name} events; DDS does")
                self._counts[name] = counts
        self._registrations: list[Registration] = [scope.loop_binding.on_bind(self._start)]
        if _INCOMPATIBLE & self._callbacks.keys():
            self._registrations.append(scope.discovery.on_change.add(self._on_change))

    def _start(self) -> None:
        self._loop_binding.call_soon(self._schedule_poll)  # another thread may run the loop

    def _schedule_poll(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        loop = self._loop_binding.loop
        if not self._closed and loop is not None and not loop.is_closed():
            self._timer = loop.call_later(_POLL_INTERVAL_S, self._poll)

    def _poll(self) -> None:
        if self._closed:
            return
        if "matched" in self._callbacks:
            self._poll_matched_peers()
        if _INCOMPATIBLE & self._callbacks.keys():
            self._compare_endpoints()
        for name in self._counts:
            self._poll_counts(name)
        if self._callbacks.keys() - _INCOMPATIBLE:
            self._schedule_poll()

    def _on_change(self, topics: Collection[TopicKey]) -> None:
        own = self._discovery.graph.endpoints.get(self._endpoint.guid)
        if own is not None and own.topic_key in topics:
            self._loop_binding.call_soon(self._compare_endpoints)  # without a loop, the next one compares

    def _poll_matched_peers(self) -> None:
        """Report changes of the matched endpoints since the previous poll to the callback, in up to three calls.

        The first call is about endpoints that have left, the second about new endpoints, the third about new endpoints
        that have left already. Fast DDS also reports them separately. A single call would report a change of 0 after an
        endpoint was replaced.
        """
        total, count = self._totals["matched"], len(self._peers)
        # The transport's count includes endpoints that were matched and have left since the previous poll.
        while True:
            counts = self._endpoint.event_counts("matched")
            peers = set(self._matched())
            if self._endpoint.event_counts("matched") == counts:  # no endpoint was matched between the calls
                break
        added = len(peers - self._peers) if counts is None else max(counts[0] - total, 0)
        removed = len(self._peers - peers)
        self._totals["matched"], self._peers = total + added, peers
        for total_change, change in ((0, -removed), (added, added), (0, len(peers) - (count - removed + added))):
            if change:
                total, count = total + total_change, count + change
                self._report("matched", MatchedStatus(total, total_change, count, change))

    def _compare_endpoints(self) -> None:
        graph = self._discovery.graph
        own = graph.endpoints.get(self._endpoint.guid)
        if own is None or self._closed:
            return
        others = graph.endpoints_on(own.topic_key, writers=not own.is_writer)
        self._compared &= {other.guid for other in others}
        events: dict[str, list[tuple[str, QoSPolicyKind]]] = {}
        for other in others:
            if other.guid in self._compared:
                continue
            self._compared.add(other.guid)
            pair = (own, other) if own.is_writer else (other, own)
            result = self._discovery.incompatibility(*pair)
            if result is not None:
                name = "incompatible_qos" if result.mismatch_kind == "qos" else "incompatible_type"
                events.setdefault(name, []).append((result.reason, next(iter(result.policies), QoSPolicyKind.INVALID)))
        for name, items in events.items():
            self._totals[name] += len(items)
            self._report(name, IncompatibleStatus(self._totals[name], len(items), *items[-1]))

    def _poll_counts(self, name: str) -> None:
        previous, counts = self._counts[name], self._endpoint.event_counts(name)
        if counts is None or counts == previous:
            return
        self._counts[name] = counts
        changes = [new - old for new, old in zip(counts, previous, strict=True)]
        self._report(name, LivelinessStatus(*counts, *changes) if len(counts) > 1 else CountStatus(*counts, *changes))

    def _report(self, name: str, status: Any) -> None:
        if name in self._callbacks:
            self._callbacks[name].call(status)

    def close(self) -> None:
        """Stop calling the callbacks. May be called from any thread, and twice."""
        self._closed = True
        for registration in self._registrations:
            registration.close()
        for callback in self._callbacks.values():
            callback.close()
