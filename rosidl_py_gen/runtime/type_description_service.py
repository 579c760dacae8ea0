"""``~/get_type_description``: telling others how a type this node uses is defined, and asking them.

Decides which types count (those of the node's publishers, subscriptions, services, clients, actions) and the failure
texts of protocol.md 9.8. Sources are looked for in the bundled interfaces and below AMENT_PREFIX_PATH; a type whose
file is not there is answered with empty contents.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.type_description_interfaces import msg, srv
from rosidl_py_gen.resources import interfaces_dir
from rosidl_py_gen.runtime.client import Client
from rosidl_py_gen.runtime.late_types import late_service_type
from rosidl_py_gen.runtime.parameter_values import ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.service import ServiceServer
from rosidl_py_gen.typesupport import type_description, type_hash

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

    from rosidl_py_gen.runtime.parameters import ParameterStore
    from rosidl_py_gen.runtime.remap_rules import NodeNames
    from rosidl_py_gen.runtime.scope import Scope

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
PARAMETER = "start_type_description_service"
_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")
_PARTS = {"service_type": ("Request", "Response"), "action_type": ("SendGoal", "GetResult", "FeedbackMessage")}
_GETTERS = {"message_type": "get_message", "service_type": "get_service", "action_type": "get_action"}


class TypeDescriptionError(RosidlError, LookupError):
    """The remote node cannot describe the type; the text is its reason."""


class TypeDescriptionService:
    """The service of one node."""

    def __init__(self, scope: Scope, names: NodeNames) -> None:
        self._scope = scope
        self._service: ServiceServer[Any, Any] = ServiceServer(
            scope,
            late_service_type(SERVICE),
            names.resolve_service("~/get_type_description"),
            self._answer,
            SERVICES_DEFAULT,
        )

    @property
    def endpoints(self) -> list[ServiceServer[Any, Any]]:
        """What the node's types in use are found in."""
        return [self._service]

    @classmethod
    def start(cls, scope: Scope, names: NodeNames, store: ParameterStore) -> None:
        """Declare the parameter that can switch it off, and serve unless it does."""
        descriptor = ParameterDescriptor(
            PARAMETER,
            ParameterType.BOOL,
            "If enabled, start the ~/get_type_description service.",
            read_only=True,
        )
        if not store.has(PARAMETER):
            store.declare(PARAMETER, parameter_value(True), descriptor)
        if store.get(PARAMETER).value is True:
            scope.own(cls(scope, names))

    def _answer(self, request: srv.GetTypeDescription_Request) -> srv.GetTypeDescription_Response:
        response = srv.GetTypeDescription_Response(successful=False)
        if not _HASH.match(request.type_hash):
            response.failure_reason = "Failed to parse type hash"
            return response
        found = next((used for used in self._types_in_use() if type_hash(used) == request.type_hash), None)
        if found is None:
            response.failure_reason = "Type not currently in use by this node"
            return response
        from rosidl_py_gen import from_dict

        description = type_description(found)
        response.type_description = from_dict(msg.TypeDescription, description)
        if request.include_type_sources:
            names = [description["type_description"]["type_name"]]
            names += sorted(item["type_name"] for item in description["referenced_type_descriptions"])
            response.type_sources = [type_source(name) for name in names]
        response.successful = True
        return response

    def _types_in_use(self) -> Iterator[Any]:
        import rosidl_py_gen

        for owned in list(self._scope.owned.values()):
            for endpoint in (owned, *getattr(owned, "endpoints", ())):
                for attribute, getter in _GETTERS.items():
                    name = getattr(endpoint, attribute, None)
                    if isinstance(name, str):
                        cls = getattr(rosidl_py_gen, getter)(name)
                        yield cls
                        yield from (getattr(cls, part) for part in _PARTS.get(attribute, ()))

    def close(self) -> None:
        """May be called twice."""
        self._service.close()


def type_source(name: str) -> msg.TypeSource:
    """The definition of ``pkg/msg/Name`` as it is written in its file; derived types have none."""
    package, kind, stem = name.split("/")
    for folder in _interface_folders(package):
        for suffix in (kind, "idl"):
            path = folder / kind / f"{stem}.{suffix}"
            if path.is_file():
                text = path.read_bytes().decode("utf-8", "replace")
                return msg.TypeSource(type_name=name, encoding=suffix, raw_file_contents=text)
    # X_Request and A_SendGoal come from the file of X and A.
    return msg.TypeSource(type_name=name, encoding="implicit" if "_" in stem else kind)


def _interface_folders(package: str) -> Iterator[Path]:
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / package
    yield interfaces_dir() / package


async def ask_type_description(
    scope: Scope,
    run: Callable[[Coroutine[Any, Any, Any]], Any],
    service: str,
    type_name: str,
    wanted_hash: str,
    include_sources: bool,
    timeout_s: float | None,
) -> srv.GetTypeDescription_Response:
    """Call ``get_type_description`` of a node; raises `TypeDescriptionError` with the node's reason."""
    client: Client[srv.GetTypeDescription_Request, srv.GetTypeDescription_Response] = Client(
        scope, late_service_type(SERVICE), service, SERVICES_DEFAULT, run
    )
    scope.own(client)
    try:
        request = srv.GetTypeDescription_Request(
            type_name=type_name, type_hash=wanted_hash, include_type_sources=include_sources
        )
        response = await client.call(request, timeout_s)
    finally:
        client.close()
    if not response.successful:
        raise TypeDescriptionError(f"{service}: {response.failure_reason}")
    return response
