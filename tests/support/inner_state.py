"""State of nodes, entities and contexts that their public interface does not show.

Tests reach it through these functions, so that a change of the structure changes one place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph import Graph


def scope_of(owner: Any) -> EntityScope:
    """Return the scope of a node or entity: its participant, discovery and event loop, and what it owns."""
    scope: EntityScope = owner._scope
    return scope


def participant_of(owner: Any) -> Any:
    """Return the participant of a node or entity."""
    return owner._scope.participant


def graph_of(owner: Any) -> Graph:
    """Return the graph that a node or entity has discovered."""
    return scope_of(owner).graph


def parts_of(owner: Any) -> list[Any]:
    """Return the open entities of which an action server, an action client or a parameter client consists."""
    return list(owner._parts.owned.values())


def transport_end_of(endpoint: Any) -> Any:
    """Return the end of a client or server in the transport: a `TransportClient` or `TransportServer`."""
    return endpoint._transport_end


def reader_of(subscription: Any) -> Any:
    """Return the reader of a subscription in the transport; the samples in its `queue` wait for the subscription."""
    return subscription._reader


def servers_of(client: Any) -> set[bytes]:
    """Return the GUIDs of the reply writers of the servers that a client can call."""
    servers: set[bytes] = client._servers()
    return servers


def is_awaited(owner: Any) -> bool:
    """Return True if a task or thread waits for a transform of a buffer, or for messages of a filter."""
    return bool(owner._waiters)


def type_fields(message: Any) -> tuple[Any, ...]:
    """Return the descriptions of the fields of a message or message class, with the classes of nested messages."""
    fields: tuple[Any, ...] = message._TYPE.fields
    return fields
