"""``~/get_type_description``: telling others how a type this node uses is defined, and asking them.

Decides which types count (those of the node's endpoints, the services and actions these are parts of) and the failure
texts of docs/internals/protocol.md 9.8; whatever goes wrong is such a failure, never silence. Sources are looked for in
the bundled interfaces and below AMENT_PREFIX_PATH; a type whose file is not there, or says something else, is answered
with empty contents. Whoever asks without a hash takes the one that the node itself announces, never one of a definition
here.
"""

from __future__ import annotations

import os
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.codec import encode
from rosidl_py_gen.descriptions import rihs01
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.importable import READY_MADE
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.type_description_interfaces import msg, srv
from rosidl_py_gen.names import split_ros_name
from rosidl_py_gen.resources import interfaces_dir
from rosidl_py_gen.runtime.endpoints.client import Client
from rosidl_py_gen.runtime.endpoints.late_types import late_service_type
from rosidl_py_gen.runtime.endpoints.server import ServiceServer
from rosidl_py_gen.runtime.endpoints.service_parts import CallTimeoutError
from rosidl_py_gen.runtime.endpoints.types import class_of, raw_type
from rosidl_py_gen.runtime.graph.announced import TYPE_HASH, some
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.typesupport import referenced_classes, type_description, type_hash, type_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.names.remap import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
PARAMETER = "start_type_description_service"
_ENDPOINTS_PATIENCE_S = 1.0
"""A node's endpoints are usually known some milliseconds after its name, or before it."""
_PARTS = {
    "srv": "; a service is announced as its messages: ask for its _Request or _Response, or give the type_hash",
    "action": "; an action is announced as its messages: ask for its _SendGoal_Request, _GetResult_Response or "
    "_FeedbackMessage, or give the type_hash",
}
_BUNDLED = "rosidl_py_gen.msgs"
_MEMORY = "rosidl_py_gen_memory."
"""Where `dynamic.py` puts classes that it compiles."""
_GETTERS = {"msg": "get_message", "srv": "get_service", "action": "get_action"}


class TypeDescriptionError(RosidlError, LookupError):
    """The remote node cannot describe the type; the text is its reason, or why it could not be asked."""


def start_type_descriptions(scope: Scope, names: NodeNames, store: ParameterStore) -> None:
    """Declare the parameter that can switch the service off, and serve until the node closes unless it does."""
    if not store.has(PARAMETER):
        what = "If enabled, start the ~/get_type_description service."
        descriptor = ParameterDescriptor(PARAMETER, ParameterType.BOOL, what, read_only=True)
        store.declare(PARAMETER, parameter_value(True), descriptor)
    if store.get(PARAMETER).value is True:
        name, describe = names.resolve_service("~/get_type_description"), _Describer(scope).answer
        ServiceServer(scope, late_service_type(SERVICE), name, describe, SERVICES_DEFAULT)


class _Describer:
    """Answers for one node."""

    def __init__(self, scope: Scope) -> None:
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
    if cls is None or not cls.__module__.startswith((f"{_BUNDLED}.", READY_MADE)):
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


async def announced_hash(scope: Scope, node: str, type_name: str, timeout_s: float | None) -> tuple[str, float | None]:
    """The one hash that ``/ns/node`` announces for its endpoints of a type, and what is left of `timeout_s`.

    Raises:
        TypeDescriptionError: there is none, or more than one.
        CallTimeoutError: no such node. InvalidNameError: the type has no ROS name.
    """
    split_ros_name(type_name)
    namespace, _, name = node.rpartition("/")
    namespace = namespace or "/"
    graph, deadline = scope.graph, Deadline(timeout_s)

    def is_there() -> bool:
        return any(one.fully_qualified_name == node for one in graph.nodes())

    if not await scope.wait_until(is_there, timeout_s, lambda: scope.closed):
        raise CallTimeoutError(f"no node {node} appeared in {timeout_s} s")

    def known() -> bool:
        return bool(graph.announced_hashes(name, namespace, type_name))

    await scope.wait_until(known, deadline.left_s(_ENDPOINTS_PATIENCE_S), lambda: scope.closed)
    return _only_hash(node, type_name, graph.announced_hashes(name, namespace, type_name)), deadline.left_s()


def _only_hash(node: str, type_name: str, found: dict[str, set[str]]) -> str:
    told = {text: topics for text, topics in found.items() if TYPE_HASH.match(text)}
    if len(told) == 1:
        return next(iter(told))
    if told:
        listed = [f"{text} ({some(sorted(topics))})" for text, topics in sorted(told.items())]
        raise TypeDescriptionError(
            f"{node} announces {len(told)} type hashes for {type_name}: {some(listed)}; say which by type_hash"
        )
    if found:
        where = some(sorted(set().union(*found.values())))
        raise TypeDescriptionError(
            f"{node} announces no type hash for {type_name} ({where}), as nodes of ROS 2 Humble do; give the type_hash"
        )
    raise TypeDescriptionError(f"{node} announces no endpoint of {type_name}{_PARTS.get(type_name.split('/')[1], '')}")


async def ask_type_description(
    scope: Scope,
    service: str,
    type_name: str,
    wanted_hash: str,
    include_sources: bool,
    timeout_s: float | None,
) -> bytes:
    """Call ``get_type_description`` of a node; the answer is left encoded, as it may be large.

    Raises:
        CallTimeoutError, ForeignServiceError, InvalidNameError: as their names say.
    """
    known = late_service_type(SERVICE)
    client: Client[srv.GetTypeDescription_Request, bytes] = Client(
        scope, replace(known, response=raw_type(known.response)), service, SERVICES_DEFAULT
    )
    try:
        request = srv.GetTypeDescription_Request(
            type_name=type_name, type_hash=wanted_hash, include_type_sources=include_sources
        )
        return await client.call(request, timeout_s)
    finally:
        client.close()


def described_by(who: str, answer: bytes) -> srv.GetTypeDescription_Response:
    """Decode what `ask_type_description` gives; raises `TypeDescriptionError` with the reason of the node, `who`."""
    response = srv.GetTypeDescription_Response.decode(answer)
    if not response.successful:
        raise TypeDescriptionError(f"{who}: {printable(response.failure_reason[:500])}")
    return response
