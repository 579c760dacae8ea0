"""Parameter services of a node, and its ``/parameter_events``.

Source: docs/internals/protocol.md 9.1 to 9.5.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.message_types import lazy_message_type, lazy_service_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.loop.send_queue import DeferredSender
from rosidl_py_gen.runtime.parameters.callbacks import CallbackAnswerError
from rosidl_py_gen.runtime.parameters.messages import (
    descriptor_to_message,
    event_to_message,
    requested_parameter,
    result_to_message,
    value_to_message,
)
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError, SetResult
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.cdr import Service
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import ParameterEvent
    from rosidl_py_gen.runtime.time.clock import Clock


class ParameterEventPublisher(Publisher[msg.ParameterEvent]):
    """Publisher of one ParameterEvent for each atomic set and each declaration with a value.

    The event has the time of the change, and is sent after the reply to the request that caused the change: publishing
    the event first would make up a fifth of the time that the client waits.
    """

    def __init__(self, scope: EntityScope, names: NodeNames, clock: Clock) -> None:
        self._node = names.fully_qualified_name
        self._clock = clock
        self._sender = DeferredSender(scope.loop_binding, self._send)
        message_type = lazy_message_type("rcl_interfaces/msg/ParameterEvent")
        super().__init__(scope, message_type, names.resolve_topic("/parameter_events"), PARAMETER_EVENTS)
        scope.register(self._sender)

    def publish_event(self, event: ParameterEvent) -> None:
        """Publish an event if subscriptions exist; later subscriptions do not receive it (the topic is volatile)."""
        if event and self.has_subscriptions:
            self._sender.add((event, self._clock.now_ns()))

    def _send(self, item: tuple[ParameterEvent, int]) -> None:
        event, stamp_ns = item
        try:
            self.publish(event_to_message(event, self._node, stamp_ns))
        except Exception:
            self._scope.report_failure("publishing a parameter event")


class ParameterService(NamedTuple):
    """Parameter service of a node as a function, for a program that serves it; from `Node.parameter_services`.

    Attributes:
        name: name such as ``get_parameters``; the node itself serves ``~/get_parameters``.
        srv_type: class of the service.
        handler: takes a request and returns the response, in any thread. Exceptions of parameter callbacks refuse the
            set and are logged. Raises `ClosedError` if the node is closed.
    """

    name: str
    srv_type: type[Service[Any, Any]]
    handler: Callable[[Any], Any]


class ParameterServices:
    """Handlers of the six parameter services of one node.

    Args:
        on_listed: called on the thread of the event loop after a peer has requested the list of parameters.
    """

    def __init__(self, scope: EntityScope, store: ParameterStore, on_listed: Callable[[ParameterStore], None]) -> None:
        self._on_listed = on_listed
        self._scope = scope
        self._store = store
        self._table: list[tuple[str, str, Callable[[Any], Any]]] = [
            ("describe_parameters", "DescribeParameters", self._describe),
            ("get_parameters", "GetParameters", self._get),
            ("get_parameter_types", "GetParameterTypes", self._types),
            ("list_parameters", "ListParameters", self._list),
            ("set_parameters", "SetParameters", self._set),
            ("set_parameters_atomically", "SetParametersAtomically", self._set_atomically),
        ]

    def serve(self, names: NodeNames) -> None:
        """Serve the six services until the node closes, which owns them."""
        for name, title, handler in self._table:
            service_type = lazy_service_type(f"rcl_interfaces/srv/{title}")
            ServiceServer(self._scope, service_type, names.resolve_service(f"~/{name}"), handler, PARAMETERS)

    def handlers(self) -> list[ParameterService]:
        """Return the six services as functions, for programs that serve them."""
        return [
            ParameterService(name, getattr(srv, title), self._while_open(handler))
            for name, title, handler in self._table
        ]

    def _while_open(self, handler: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def handle(request: Any) -> Any:
            self._scope.require_open(False, "the node")
            return handler(request)

        return handle

    def _describe(self, request: srv.DescribeParameters_Request) -> srv.DescribeParameters_Response:
        descriptors = self._store.describe_all(request.names)
        return srv.DescribeParameters_Response(descriptors=[descriptor_to_message(item) for item in descriptors])

    def _get(self, request: srv.GetParameters_Request) -> srv.GetParameters_Response:
        return srv.GetParameters_Response(
            values=[value_to_message(item) for item in self._store.get_all(request.names)]
        )

    def _types(self, request: srv.GetParameterTypes_Request) -> srv.GetParameterTypes_Response:
        return srv.GetParameterTypes_Response(types=bytes(self._store.types(request.names)))

    def _list(self, request: srv.ListParameters_Request) -> srv.ListParameters_Response:
        self._scope.loop_binding.call_soon(partial(self._on_listed, self._store))
        listing = self._store.listing(request.prefixes, request.depth)
        result = msg.ListParametersResult(names=list(listing.names), prefixes=list(listing.prefixes))
        return srv.ListParameters_Response(result=result)

    def _set(self, request: srv.SetParameters_Request) -> srv.SetParameters_Response:
        return srv.SetParameters_Response(results=[self._set_all([item]) for item in request.parameters])

    def _set_atomically(self, request: srv.SetParametersAtomically_Request) -> srv.SetParametersAtomically_Response:
        return srv.SetParametersAtomically_Response(result=self._set_all(request.parameters))

    def _set_all(self, parameters: Sequence[msg.Parameter]) -> msg.SetParametersResult:
        """Set all parameters of a request or none.

        If a callback raises, refuse the request, so that the client gets a reply.
        """
        try:
            return result_to_message(self._store.set_atomically([requested_parameter(item) for item in parameters]))
        except InvalidParameterValueError as error:
            return result_to_message(SetResult(False, str(error)))
        except Exception as error:
            self._scope.report_failure("setting a parameter for another node")
            text = str(error) if isinstance(error, CallbackAnswerError) else f"{type(error).__name__}: {error}"
            return result_to_message(SetResult(False, text))
