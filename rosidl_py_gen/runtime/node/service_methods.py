"""Service methods of a node: names and defaults as in rclpy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.message_types import DictMessage, service_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.node.node_base import NodeBase
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSLike

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class ServiceMethods(NodeBase):
    """Service methods of `Node`."""

    @overload
    def create_service(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None = None, qos: QoSLike = 10, *,
        arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_service(
        self, srv_type: str, name: str,
        handler: Callable[[DictMessage], DictMessage | Awaitable[DictMessage]] | None = None, qos: QoSLike = 10, *,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[DictMessage, DictMessage]: ...  # fmt: skip
    def create_service(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        handler: Callable[[Any], Any] | None = None,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[Any, Any]:
        """Create a server of a service.

        Args:
            srv_type: service class, or its name such as ``"std_srvs/srv/Trigger"``: then messages are dicts.
            name: service name, which is expanded and remapped.
            handler: plain or async function that gets the request and returns the response; None to iterate or `take`.
            qos: profile, or depth.
            arrays: decode sequences of fixed-size messages as structured arrays; not with a type name.
            type_hash_check: like that of `Node`.

        Raises as `create_publisher`.
        """
        self._require_open()
        server: ServiceServer[Any, Any] = ServiceServer(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            handler,
            as_profile(qos),
            type_hash_check=type_hash_check,
        )
        if handler is not None:
            self._scope.with_callbacks[id(server)] = server
        return server

    @overload
    def create_client(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str, qos: QoSLike = 10, *, arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_client(
        self, srv_type: str, name: str, qos: QoSLike = 10, *, type_hash_check: TypeCheck | None = None
    ) -> Client[DictMessage, DictMessage]: ...
    def create_client(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[Any, Any]:
        """Create a client of a service; parameters and exceptions as for `create_service`."""
        self._require_open()
        return Client(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            as_profile(qos),
            type_hash_check=type_hash_check,
        )
