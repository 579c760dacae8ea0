"""Asking a node how a type is defined, through its ``~/get_type_description``.

Whoever asks without a hash takes the one that the node itself announces, never one of a definition here.
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
from rosidl_py_gen.runtime.entities.lazy_types import late_service_type
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.type_resolution.announcements import TYPE_HASH, join_truncated

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
_ENDPOINTS_PATIENCE_S = 1.0
"""A node's endpoints are usually known some milliseconds after its name, or before it."""
_AGAIN_S, _LOOK_S = 1.0, 0.02
"""After this time without an answer it is asked once more; between two looks whether it was asked."""
_PARTS = {
    "srv": "; a service is announced as its messages: ask for its _Request or _Response, or give the type_hash",
    "action": "; an action is announced as its messages: ask for its _SendGoal_Request, _GetResult_Response or "
    "_FeedbackMessage, or give the type_hash",
}


class TypeDescriptionError(RosidlError, LookupError):
    """The remote node cannot describe the type; the text is its reason, or why it could not be asked."""


async def announced_hash(
    scope: EntityScope, node: str, type_name: str, timeout_s: float | None
) -> tuple[str, float | None]:
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

    await scope.wait_until(known, deadline.remaining_s(_ENDPOINTS_PATIENCE_S), lambda: scope.closed)
    return _only_hash(node, type_name, graph.announced_hashes(name, namespace, type_name)), deadline.remaining_s()


def _only_hash(node: str, type_name: str, found: dict[str, set[str]]) -> str:
    told = {text: topics for text, topics in found.items() if TYPE_HASH.match(text)}
    if len(told) == 1:
        return next(iter(told))
    if told:
        listed = [f"{text} ({join_truncated(sorted(topics))})" for text, topics in sorted(told.items())]
        raise TypeDescriptionError(
            f"{node} announces {len(told)} type hashes for {type_name}: {join_truncated(listed)}; "
            "say which by type_hash"
        )
    if found:
        where = join_truncated(sorted(set().union(*found.values())))
        raise TypeDescriptionError(
            f"{node} announces no type hash for {type_name} ({where}), as nodes of ROS 2 Humble do; give the type_hash"
        )
    raise TypeDescriptionError(f"{node} announces no endpoint of {type_name}{_PARTS.get(type_name.split('/')[1], '')}")


async def request_type_description(
    scope: EntityScope,
    service: str,
    type_name: str,
    wanted_hash: str,
    include_sources: bool,
    timeout_s: float | None,
) -> bytes:
    """Call ``get_type_description`` of a node; the answer is left encoded, as it may be large.

    Raises:
        CallTimeoutError, IncompatibleServiceError, InvalidNameError: as their names say.
    """
    known = late_service_type(SERVICE)
    client: Client[srv.GetTypeDescription_Request, bytes] = Client(
        scope, replace(known, response=raw_type(known.response)), service, SERVICES_DEFAULT
    )
    try:
        request = srv.GetTypeDescription_Request(
            type_name=type_name, type_hash=wanted_hash, include_type_sources=include_sources
        )
        return await _call_with_retry(scope, client, request, timeout_s)
    finally:
        client.close()


async def _call_with_retry(
    scope: EntityScope, client: Client[srv.GetTypeDescription_Request, bytes], request: Any, timeout_s: float | None
) -> bytes:
    """The first answer; a server on Fast DDS drops that to a client it does not know yet (docs/interop.md)."""
    calls = [asyncio.ensure_future(client.call(request, timeout_s))]

    def is_asked() -> bool:
        return client.in_flight_count > 0 or calls[0].done()

    try:
        await scope.wait_until(is_asked, timeout_s, lambda: scope.closed, poll_s=_LOOK_S)
        if not (await asyncio.wait(calls, timeout=_AGAIN_S))[0]:
            calls.append(asyncio.ensure_future(client.call(request, timeout_s)))
        done, _ = await asyncio.wait(calls, return_when=asyncio.FIRST_COMPLETED)
        return min(done, key=lambda one: one.exception() is not None).result()
    finally:
        for one in calls:
            one.cancel()
        await asyncio.gather(*calls, return_exceptions=True)


def decode_description(who: str, answer: bytes) -> srv.GetTypeDescription_Response:
    """Decode what `request_type_description` gives; raises `TypeDescriptionError` with the reason of the node,
    `who`.
    """
    response = srv.GetTypeDescription_Response.decode(answer)
    if not response.successful:
        raise TypeDescriptionError(f"{who}: {printable(response.failure_reason[:500])}")
    return response
