"""Client of the service ``~/get_type_description``, with which a node describes its types.

A request without hash uses the hash that the node itself announces, never that of a local definition.
Source: docs/internals/protocol.md 9.8.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.msgs.type_description_interfaces import srv
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.message_types import lazy_service_type, raw_type
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.type_resolution.announcements import TYPE_HASH, join_truncated

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
_ENDPOINTS_TIMEOUT_S = 1.0
"""Time until a node's endpoints are discovered; usually some milliseconds after its name, or before."""
_RETRY_DELAY_S = 1.0
"""Time without a reply after which the request is repeated."""
_SENT_POLL_INTERVAL_S = 0.02
_HINTS = {
    "srv": "; a service is announced as its messages: ask for its _Request or _Response, or give the type_hash",
    "action": "; an action is announced as its messages: ask for its _SendGoal_Request, _GetResult_Response or "
    "_FeedbackMessage, or give the type_hash",
}


class TypeDescriptionError(RosidlError, LookupError):
    """The remote node cannot describe the type, or could not be asked; the text contains the reason."""


async def announced_hash(
    scope: EntityScope, node: str, type_name: str, timeout_s: float | None
) -> tuple[str, float | None]:
    """Return the only hash that ``/ns/node`` announces for a type, and the rest of `timeout_s`.

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
    await scope.wait_until(names_by_hash, deadline.remaining_s(_ENDPOINTS_TIMEOUT_S))
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
    """Call ``get_type_description`` of a node; the response remains encoded, because it may be large.

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
    """Return the first response; Fast DDS drops it for an unknown client (docs/internals/parity.md)."""
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
    """Decode a response of `request_type_description`; raises `TypeDescriptionError` with the node's reason."""
    response = srv.GetTypeDescription_Response.decode(data)
    if not response.successful:
        raise TypeDescriptionError(f"{node}: {printable(response.failure_reason[:500])}")
    return response
