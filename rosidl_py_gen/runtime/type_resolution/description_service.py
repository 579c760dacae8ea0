"""``~/get_type_description``: telling others how a type this node uses is defined.

Decides which types count (those of the node's endpoints, the services and actions these are parts of) and the failure
texts of docs/internals/protocol.md 9.8; whatever goes wrong is such a failure, never silence. Sources are looked for in
the bundled interfaces and below AMENT_PREFIX_PATH; a type whose file is not there, or says something else, is answered
with empty contents.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import rihs01
from rosidl_py_gen.base.installed_classes import PREGENERATED_PACKAGE
from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.cdr.typesupport import referenced_classes, type_description, type_hash, type_name
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.type_description_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.lazy_types import late_service_type
from rosidl_py_gen.runtime.entities.message_types import class_of
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.type_resolution.announcements import TYPE_HASH
from rosidl_py_gen.runtime.type_resolution.description_client import SERVICE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

PARAMETER = "start_type_description_service"
_BUNDLED = "rosidl_py_gen.msgs"
_MEMORY = "rosidl_py_gen_memory."
"""Where `dynamic.py` puts classes that it compiles."""
_GETTERS = {"msg": "get_message", "srv": "get_service", "action": "get_action"}


def start_type_descriptions(scope: EntityScope, names: NodeNames, store: ParameterStore) -> None:
    """Declare the parameter that can switch the service off, and serve until the node closes unless it does."""
    if not store.has(PARAMETER):
        what = "If enabled, start the ~/get_type_description service."
        descriptor = ParameterDescriptor(PARAMETER, ParameterType.BOOL, what, read_only=True)
        store.declare(PARAMETER, parameter_value(True), descriptor)
    if store.get(PARAMETER).value is True:
        name, describe = names.resolve_service("~/get_type_description"), _DescriptionService(scope).answer
        ServiceServer(scope, late_service_type(SERVICE), name, describe, SERVICES_DEFAULT)


class _DescriptionService:
    """Answers for one node."""

    def __init__(self, scope: EntityScope) -> None:
        self._scope = scope

    def answer(self, request: srv.GetTypeDescription_Request) -> srv.GetTypeDescription_Response:
        if not TYPE_HASH.match(request.type_hash):
            return _failure("Failed to parse type hash")
        reason = "Failed to populate TypeDescription to response."
        try:
            found = self._find(request.type_hash)
            if (
                found is None or rihs01(type_description(found)) != request.type_hash
            ):  # whoever leaves bytes as they are
                return _failure("Type not currently in use by this node")
            response = srv.GetTypeDescription_Response(successful=True, type_description=_described(found))
            encode(response)  # what does not fit a message, such as names of over 255 characters, must be told as well
            if request.include_type_sources:
                reason = "Failed to populate TypeSource_Sequence to response."
                response.type_sources = _sources(found)
                encode(response)
        except Exception:
            self._scope.report_failure(f"describing the type {request.type_name} {request.type_hash}")
            return _failure(reason)
        return response

    def _find(self, wanted: str) -> type[Any] | None:
        """The class of a type in use; raises `TypeNotFoundError` when it is in use and there is no class."""
        for name, announced in self._endpoint_types():
            if announced == wanted:
                return _class(name, wanted)
            whole = name.removesuffix("_Request")
            if whole != name:
                service: Any = class_of(whole, wanted)
                if service is not None and type_hash(service.Request) == announced:
                    return _class(whole, wanted)
                if (HASHES.get(whole), HASHES.get(name)) == (wanted, announced):
                    return _class(whole, wanted)
        actions: Iterator[Any] = (getattr(owned, "action_class", None) for owned in self._scope.owned.values())
        return next((cls for cls in actions if cls is not None and type_hash(cls) == wanted), None)

    def _endpoint_types(self) -> Iterator[tuple[str, str]]:
        """Name and hash of the message type of each endpoint of this node, as it announces them."""
        discovery, graph = self._scope.discovery, self._scope.graph
        discovery.refresh()
        for guid in discovery.endpoints_of(self._scope.number):
            endpoint = graph.endpoints.get(guid)
            if endpoint is not None and "/" in endpoint.type:
                yield endpoint.type, endpoint.type_hash


def _failure(reason: str) -> srv.GetTypeDescription_Response:
    return srv.GetTypeDescription_Response(successful=False, failure_reason=reason)


def _class(name: str, wanted: str) -> type[Any]:
    found = class_of(name, wanted)
    if found is None:  # a bundled type that no message needed yet
        package, kind, stem = name.split("/")
        found = getattr(import_module(f"{_BUNDLED}.{package}.{kind}"), stem)
        if type_hash(found) != wanted:
            raise TypeNotFoundError(f"{name} with the hash {wanted} is announced, but has no class here")
    return found


def _described(cls: type[Any]) -> msg.TypeDescription:
    from rosidl_py_gen import from_dict

    return from_dict(msg.TypeDescription, type_description(cls))


def _sources(cls: type[Any]) -> list[msg.TypeSource]:
    """The type's own source, then those of the types it leads to, sorted by name."""
    top = type_name(cls)
    classes = referenced_classes(cls)
    return [type_source(name, classes[name]) for name in (top, *sorted(set(classes) - {top}))]


def type_source(name: str, cls: type[Any] | None = None) -> msg.TypeSource:
    """The definition of ``pkg/msg/Name`` as it is written in its file; derived types have none.

    `cls` tells which of several definitions of that name is meant.
    """
    package, kind, stem = name.split("/")
    for folder in _interface_folders(package, cls):
        for suffix in (kind, "idl"):
            path = folder / kind / f"{stem}.{suffix}"
            if path.is_file() and _is_of_file(name, cls):
                text = path.read_bytes().decode("utf-8", "replace")
                return msg.TypeSource(type_name=name, encoding=suffix, raw_file_contents=text)
    # X_Request and A_SendGoal come from the file of X and A.
    return msg.TypeSource(type_name=name, encoding="implicit" if "_" in stem else kind)


def _interface_folders(package: str, cls: type[Any] | None) -> Iterator[Path]:
    if cls is None or not cls.__module__.startswith((f"{_BUNDLED}.", PREGENERATED_PACKAGE)):
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if prefix:
                yield Path(prefix) / "share" / package
    yield interfaces_dir() / package


def _is_of_file(name: str, cls: type[Any] | None) -> bool:
    """False when a class was compiled from a text that says something else than the file of the same name."""
    if cls is None or not cls.__module__.startswith(_MEMORY):
        return True
    import rosidl_py_gen

    get: Callable[[str], type[Any]] = getattr(rosidl_py_gen, _GETTERS[name.split("/")[1]])
    return type_hash(get(name)) == type_hash(cls)
