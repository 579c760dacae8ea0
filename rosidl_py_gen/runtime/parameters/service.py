"""What makes the parameters of a node visible to others: six services and ``/parameter_events``.

Decides which message answers which question; what the answer is, is `store.py`'s. Source: protocol.md 9.1 to 9.5.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
from rosidl_py_gen.runtime.endpoints.late_types import late_message_type, late_service_type
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.server import ServiceServer
from rosidl_py_gen.runtime.parameters.messages import (
    descriptor_to_message,
    event_to_message,
    value_to_message,
)
from rosidl_py_gen.runtime.parameters.store import CallbackAnswerError, SetResult
from rosidl_py_gen.runtime.parameters.values import UnreadableParameter
from rosidl_py_gen.runtime.parameters.wire import SETTING, set_service_type
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.names.remap import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterEvent, ParameterStore
    from rosidl_py_gen.runtime.parameters.values import Parameter
    from rosidl_py_gen.runtime.time.clock import Clock


class ParameterEventPublisher:
    """Publishes one ParameterEvent for each atomic set; nothing for a declaration without a value.

    Events of what a service request changes are sent right after its answer, with the time of the change: their
    publication would be a fifth of the time that the client waits.
    """

    def __init__(self, scope: Scope, names: NodeNames, clock: Clock) -> None:
        self._scope = scope
        self._bridge = scope.bridge
        self._lock = threading.RLock()
        self._waiting: deque[tuple[ParameterEvent, int]] = deque()
        self._held = 0
        self._node = names.fully_qualified_name
        self._clock = clock
        self._publisher: Publisher[msg.ParameterEvent] = Publisher(
            scope,
            late_message_type("rcl_interfaces/msg/ParameterEvent"),
            names.resolve_topic("/parameter_events"),
            PARAMETER_EVENTS,
        )
        self._closed = False

    @property
    def endpoints(self) -> list[Publisher[msg.ParameterEvent]]:
        """What the node's types in use are found in."""
        return [self._publisher]

    def publish(self, event: ParameterEvent) -> None:
        """Tell the world, unless nobody listens: who comes later does not get it (the topic is volatile)."""
        if self._closed or not event or not self._publisher.has_subscriptions:
            return
        self._waiting.append((event, self._clock.now_ns()))
        if not self._held:
            self._send()

    def hold(self) -> None:
        """Let events wait for `let_go`: the answer comes first. On the loop's thread."""
        self._held += 1

    def let_go(self) -> None:
        """Send what waited when the loop comes round."""
        self._held -= 1
        if self._waiting:
            self._bridge.call_soon(self._send)

    def _send(self) -> None:
        with self._lock:  # from the first to the last, whatever thread comes
            while self._waiting:
                event, stamp_ns = self._waiting.popleft()
                try:
                    self._publisher.publish(event_to_message(event, self._node, stamp_ns))
                except Exception:
                    self._scope.report_failure("publishing a parameter event")

    def close(self) -> None:
        """Send what waits; may be called twice."""
        if not self._closed:
            self._closed = True
            self._send()
        self._publisher.close()


class ParameterServices:
    """The six services of one node."""

    def __init__(self, scope: Scope, names: NodeNames, store: ParameterStore, events: ParameterEventPublisher) -> None:
        self._scope = scope
        self._events = events
        self._store = store
        table: list[tuple[str, str, Callable[[Any], Any]]] = [
            ("describe_parameters", "DescribeParameters", self._describe),
            ("get_parameters", "GetParameters", self._get),
            ("get_parameter_types", "GetParameterTypes", self._types),
            ("list_parameters", "ListParameters", self._list),
            ("set_parameters", "SetParameters", self._set),
            ("set_parameters_atomically", "SetParametersAtomically", self._set_atomically),
        ]
        self._services: list[ServiceServer[Any, Any]] = [
            ServiceServer(
                scope,
                set_service_type(title) if title in SETTING else late_service_type(f"rcl_interfaces/srv/{title}"),
                names.resolve_service(f"~/{name}"),
                handler,
                PARAMETERS,
            )
            for name, title, handler in table
        ]

    def _describe(self, request: srv.DescribeParameters_Request) -> srv.DescribeParameters_Response:
        found = self._store.describe_all(request.names)
        return srv.DescribeParameters_Response(descriptors=[descriptor_to_message(item) for item in found])

    def _get(self, request: srv.GetParameters_Request) -> srv.GetParameters_Response:
        return srv.GetParameters_Response(
            values=[value_to_message(item) for item in self._store.get_all(request.names)]
        )

    def _types(self, request: srv.GetParameterTypes_Request) -> srv.GetParameterTypes_Response:
        return srv.GetParameterTypes_Response(types=bytes(self._store.types(request.names)))

    def _list(self, request: srv.ListParameters_Request) -> srv.ListParameters_Response:
        found = self._store.listing(request.prefixes, request.depth)
        result = msg.ListParametersResult(names=list(found.names), prefixes=list(found.prefixes))
        return srv.ListParameters_Response(result=result)

    def _set(self, parameters: Sequence[Parameter]) -> list[SetResult]:
        self._events.hold()
        try:
            return [self._answer((item,)) for item in parameters]
        finally:
            self._events.let_go()

    def _set_atomically(self, parameters: Sequence[Parameter]) -> list[SetResult]:
        self._events.hold()
        try:
            return [self._answer(parameters)]
        finally:
            self._events.let_go()

    def _answer(self, parameters: Sequence[Parameter]) -> SetResult:
        """Always an answer: whoever asks must not wait for a callback's mistake."""
        for parameter in parameters:
            if isinstance(parameter, UnreadableParameter):
                return SetResult(False, parameter.reason)
        try:
            return self._store.set_atomically(parameters)
        except Exception as error:
            self._scope.report_failure("setting a parameter for another node")
            text = str(error) if isinstance(error, CallbackAnswerError) else f"{type(error).__name__}: {error}"
            return SetResult(False, text)

    @property
    def endpoints(self) -> list[ServiceServer[Any, Any]]:
        """What the node's types in use are found in."""
        return self._services

    def close(self) -> None:
        """May be called twice."""
        for service in self._services:
            service.close()
