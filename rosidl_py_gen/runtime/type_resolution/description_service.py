"""Service ``~/get_type_description``, with which a node describes the types of its endpoints, services and actions.

The server reports each failure with one of the texts of docs/internals/protocol.md 9.8. The server searches for the
sources of types (definition files) in the bundled interfaces and below AMENT_PREFIX_PATH; a source is empty if there is
no file, or if the file has another definition. A client without hash uses the hash that the node itself announces,
never the hash of a local definition.
"""

from __future__ import annotations

import asyncio
import os
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import rihs01
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.base.resources import PREGENERATED_PACKAGE, interfaces_dir
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.cdr.type_queries import referenced_classes, type_description, type_hash, type_name
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.type_description_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.message_types import class_of, lazy_service_type, raw_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.time.values import Deadline
from rosidl_py_gen.runtime.transport.api import SecurityError
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.type_resolution.announcements import TYPE_HASH, join_truncated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
ENDPOINTS_TIMEOUT_S = 1.0
"""Maximum time in seconds to wait for the endpoints of a discovered node; they usually arrive some milliseconds after
its name."""
_RETRY_DELAY_S = 1.0
"""Time in seconds without a reply after which a request for a type description is repeated."""
_SENT_POLL_INTERVAL_S = 0.02
_HINTS = {
    "srv": "; a service is announced as its messages: ask for its _Request or _Response, or give the type_hash",
    "action": "; an action is announced as its messages: ask for its _SendGoal_Request, _GetResult_Response or "
    "_FeedbackMessage, or give the type_hash",
}


class TypeDescriptionError(RosidlError, LookupError):
    """Raised if a remote node does not describe a type, or could not be asked; the text contains the reason."""


async def announced_hash(
    scope: EntityScope, node: str, type_name: str, timeout_s: float | None
) -> tuple[str, float | None]:
    """Return the type hash that a node announces for a type, and the time that is left of `timeout_s`.

    Args:
        scope: owner of the entities of the calling node.
        node: fully qualified name of the other node.
        type_name: message type of endpoints, such as ``std_msgs/msg/String``.
        timeout_s: time to wait for the node; None waits forever.

    Raises:
        TypeDescriptionError: the node announces no hash, or several.
        CallTimeoutError: there is no such node.
        InvalidNameError: `type_name` is not a ROS name.
    """
    split_ros_name(type_name)
    namespace, _, name = node.rpartition("/")
    graph, deadline = scope.graph, Deadline(timeout_s)

    def node_exists() -> bool:
        return any(info.fully_qualified_name == node for info in graph.nodes())

    def names_by_hash() -> dict[str, set[str]]:
        return graph.announced_hashes(name, namespace or "/", type_name)

    if not await scope.wait_until(node_exists, timeout_s):
        raise CallTimeoutError(f"no node {node} appeared in {timeout_s} s")
    await scope.wait_until(names_by_hash, deadline.remaining_s(ENDPOINTS_TIMEOUT_S))
    return _only_hash(node, type_name, names_by_hash()), deadline.remaining_s()


def _only_hash(node: str, type_name: str, names_by_hash: dict[str, set[str]]) -> str:
    valid = {text: names for text, names in names_by_hash.items() if TYPE_HASH.match(text)}
    if len(valid) == 1:
        return next(iter(valid))
    if valid:
        items = [f"{text} ({join_truncated(sorted(names))})" for text, names in sorted(valid.items())]
        raise TypeDescriptionError(
            f"{node} announces {len(valid)} type hashes for {type_name}: {join_truncated(items)}; pass type_hash"
        )
    if names_by_hash:
        names = join_truncated(sorted(set().union(*names_by_hash.values())))
        raise TypeDescriptionError(
            f"{node} announces no type hash for {type_name} ({names}), as nodes of ROS 2 Humble do; pass type_hash"
        )
    raise TypeDescriptionError(f"{node} announces no endpoint of {type_name}{_HINTS.get(type_name.split('/')[1], '')}")


async def request_type_description(
    scope: EntityScope,
    service: str,
    type_name: str,
    type_hash: str,
    include_sources: bool,
    timeout_s: float | None,
) -> bytes:
    """Call ``get_type_description`` of a node, and return the encoded response, which may be large.

    Raises:
        CallTimeoutError: the service does not exist, or did not reply in time.
        IncompatibleServiceError: the node uses Fast DDS, and the installed Cyclone DDS cannot call it.
    """
    service_type = lazy_service_type(SERVICE)
    client: Client[srv.GetTypeDescription_Request, bytes] = Client(
        scope, replace(service_type, response=raw_type(service_type.response)), service, SERVICES_DEFAULT
    )
    try:
        request = srv.GetTypeDescription_Request(
            type_name=type_name, type_hash=type_hash, include_type_sources=include_sources
        )
        return await _call_with_retry(scope, client, request, timeout_s)
    finally:
        client.close()


async def _call_with_retry(
    scope: EntityScope, client: Client[srv.GetTypeDescription_Request, bytes], request: Any, timeout_s: float | None
) -> bytes:
    """Call a service, repeat the call if no response arrives, and return the first response.

    Fast DDS drops the response to a client that it does not know yet (docs/internals/parity.md).
    """
    calls = [asyncio.ensure_future(client.call(request, timeout_s))]

    def is_sent() -> bool:
        return client.in_flight_count > 0 or calls[0].done()

    try:
        await scope.wait_until(is_sent, timeout_s, poll_s=_SENT_POLL_INTERVAL_S)
        if not (await asyncio.wait(calls, timeout=_RETRY_DELAY_S))[0]:
            calls.append(asyncio.ensure_future(client.call(request, timeout_s)))
        done, _ = await asyncio.wait(calls, return_when=asyncio.FIRST_COMPLETED)
        return min(done, key=lambda call: call.exception() is not None).result()
    finally:
        for call in calls:
            call.cancel()
        await asyncio.gather(*calls, return_exceptions=True)


def decode_description(node: str, data: bytes) -> srv.GetTypeDescription_Response:
    """Decode a response of `request_type_description`.

    Raises:
        TypeDescriptionError: the node reports that it cannot describe the type; the text contains the node's reason.
    """
    response = srv.GetTypeDescription_Response.decode(data)
    if not response.successful:
        raise TypeDescriptionError(f"{node}: {printable(response.failure_reason[:500])}")
    return response


PARAMETER = "start_type_description_service"
_BUNDLED = "rosidl_py_gen.msgs"
_MAX_NAME_CHARS = 200
"""Maximum length of a type name that a log entry quotes from a request; names of DDS have at most 255 characters."""
_MEMORY = "rosidl_py_gen_memory."
"""Prefix of the names of the modules that contain classes which were compiled at run time."""
_GETTERS = {"msg": "get_message", "srv": "get_service", "action": "get_action"}


def start_type_descriptions(scope: EntityScope, names: NodeNames, store: ParameterStore) -> None:
    """Declare the parameter `start_type_description_service`, and serve type descriptions of a node if it is true."""
    if not store.has(PARAMETER):
        description = "If enabled, start the ~/get_type_description service."
        descriptor = ParameterDescriptor(PARAMETER, ParameterType.BOOL, description, read_only=True)
        store.declare(PARAMETER, parameter_value(True), descriptor)
    if store.get(PARAMETER).value is True:
        name, handler = names.resolve_service("~/get_type_description"), partial(_describe, scope)
        try:
            ServiceServer(scope, lazy_service_type(SERVICE), name, handler, SERVICES_DEFAULT)
        except SecurityError as error:  # permissions for nodes of Humble, which do not have this service
            scope.logger.warning(f"types of this node are not described to peers: {error}")


def _describe(scope: EntityScope, request: srv.GetTypeDescription_Request) -> srv.GetTypeDescription_Response:
    if not TYPE_HASH.match(request.type_hash):
        return _failure("Failed to parse type hash")
    reason = "Failed to populate TypeDescription to response."
    try:
        cls = _find_class(scope, request.type_hash)
        if cls is None or not _is_described(cls):
            return _failure("Type not currently in use by this node")
        from rosidl_py_gen import from_dict

        description = from_dict(msg.TypeDescription, type_description(cls))
        response = srv.GetTypeDescription_Response(successful=True, type_description=description)
        encode(response)  # reports what does not fit into a message, such as names of over 255 characters
        if request.include_type_sources:
            reason = "Failed to populate TypeSource_Sequence to response."
            response.type_sources = _sources(cls)
            encode(response)
    except Exception:
        scope.report_failure(f"describing the type {printable(request.type_name, _MAX_NAME_CHARS)} {request.type_hash}")
        return _failure(reason)
    return response


def _find_class(scope: EntityScope, wanted_hash: str) -> type[Any] | None:
    """Return the class of the type with a hash if a node uses the type; None if the node does not use it.

    Raises:
        TypeNotFoundError: the node announces the type, but has no class for it.
    """
    for name, endpoint_hash in _endpoint_types(scope):
        if endpoint_hash == wanted_hash:
            return _load_class(name, wanted_hash)
        service_name = name.removesuffix("_Request")
        if service_name != name:
            service: Any = class_of(service_name, wanted_hash)
            if service is not None and type_hash(service.Request) == endpoint_hash:
                return _load_class(service_name, wanted_hash)
            if (HASHES.get(service_name), HASHES.get(name)) == (wanted_hash, endpoint_hash):
                return _load_class(service_name, wanted_hash)
    actions: Iterator[Any] = (getattr(owned, "action_class", None) for owned in list(scope.owned.values()))
    return next((cls for cls in actions if cls is not None and type_hash(cls) == wanted_hash), None)


def _endpoint_types(scope: EntityScope) -> Iterator[tuple[str, str]]:
    """Yield the announced name and hash of the message type of each endpoint of a node."""
    discovery, graph = scope.discovery, scope.graph
    discovery.refresh()
    for guid in discovery.endpoints_of(scope.number):
        endpoint = graph.endpoints.get(guid)
        if endpoint is not None and "/" in endpoint.type:
            yield endpoint.type, endpoint.type_hash


def _failure(reason: str) -> srv.GetTypeDescription_Response:
    return srv.GetTypeDescription_Response(successful=False, failure_reason=reason)


def _is_described(cls: type[Any]) -> bool:
    """Return False for a class that only forwards serialized messages, whose description has another hash than the
    type.
    """
    return rihs01(type_description(cls)) == type_hash(cls)


def _load_class(name: str, wanted_hash: str) -> type[Any]:
    cls = class_of(name, wanted_hash)
    # None: a lazily imported type without any message until now, for which another node may have a class of bytes.
    if cls is None or (HASHES.get(name) == wanted_hash and not _is_described(cls)):
        package, kind, stem = name.split("/")
        cls = getattr(import_module(f"{_BUNDLED}.{package}.{kind}"), stem)
        if type_hash(cls) != wanted_hash:
            raise TypeNotFoundError(f"{name} with the hash {wanted_hash} is announced, but has no class here")
    return cls


def _sources(cls: type[Any]) -> list[msg.TypeSource]:
    """Return the source (definition file) of a type, then the sources of the types it refers to, sorted by name."""
    top = type_name(cls)
    classes = referenced_classes(cls)
    return [type_source(name, classes[name]) for name in (top, *sorted(set(classes) - {top}))]


def type_source(name: str, cls: type[Any] | None = None) -> msg.TypeSource:
    """Return the source (definition file) of a type; empty if the type is derived from another file, or has no file.

    Args:
        name: name of the type, such as ``pkg/msg/Name``.
        cls: class of the type, which selects one of several definitions with that name.
    """
    package, kind, stem = name.split("/")
    for folder in _interface_folders(package, cls):
        for suffix in (kind, "idl"):
            path = folder / kind / f"{stem}.{suffix}"
            if path.is_file() and _is_from_file(name, cls):
                text = path.read_bytes().decode("utf-8", "replace")
                return msg.TypeSource(type_name=name, encoding=suffix, raw_file_contents=text)
    # X_Request and A_SendGoal are derived from the file of X and A.
    return msg.TypeSource(type_name=name, encoding="implicit" if "_" in stem else kind)


def _interface_folders(package: str, cls: type[Any] | None) -> Iterator[Path]:
    if cls is None or not cls.__module__.startswith((f"{_BUNDLED}.", PREGENERATED_PACKAGE)):
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if prefix:
                yield Path(prefix) / "share" / package
    yield interfaces_dir() / package


def _is_from_file(name: str, cls: type[Any] | None) -> bool:
    """Return False if the definition from which a class was compiled differs from the definition file of its name."""
    if cls is None or not cls.__module__.startswith(_MEMORY):
        return True
    import rosidl_py_gen

    get: Callable[[str], type[Any]] = getattr(rosidl_py_gen, _GETTERS[name.split("/")[1]])
    return type_hash(get(name)) == type_hash(cls)
