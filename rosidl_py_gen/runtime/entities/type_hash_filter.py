"""Check that a writer uses the same definition of the type as its reader.

Two definitions of one type have the same name on the wire, and decoding with the other one returns wrong values. So
samples are dropped if their writer announces another RIHS01 hash. A writer that announces no hash (ROS 2 Humble) is
assumed to use the same definition. The check runs once per writer, with its first sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.graph.type_hashes import type_hashes_differ

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint

W = TypeVar("W")

_MAX_ACCEPTED_WRITERS = 1000
_MAX_UNKNOWN_SAMPLES = 100
"""Number of samples of undiscovered writers after which such a writer is accepted without a further search for it."""


class TypeHashFilter(Generic[W]):
    """Type hash check of one reader.

    Args:
        guid_of: returns the GUID of a writer, None if it is unknown; the reader chooses how it identifies writers.

    Attributes:
        accepted_writers: writers that passed the check; looked up for every message.
        incompatible_dropped: number of samples that did not pass.
    """

    __slots__ = (
        *("_guid_of", "_mode", "_scope", "_service_hash", "_type_hash", "_unknown_samples"),
        *("accepted_writers", "incompatible_dropped"),
    )

    def __init__(
        self,
        scope: EntityScope,
        mode: TypeCheck,
        guid_of: Callable[[W], bytes | None],
        type_hash: str,
        service_hash: str = "",
    ) -> None:
        self._scope = scope
        self._mode = mode
        self._guid_of = guid_of
        self._type_hash = type_hash
        self._service_hash = service_hash
        self.accepted_writers: set[W] = set()
        self.incompatible_dropped = 0
        self._unknown_samples = 0

    def accepts(self, writer: W) -> bool:
        """Return True if a sample of a writer that is not in `accepted_writers` passes the check; else count it."""
        if self._mode == "error":
            endpoint = self._endpoint(self._guid_of(writer))
            if endpoint is None:  # the writer has left, or is not discovered yet
                self._unknown_samples += 1
                if self._unknown_samples < _MAX_UNKNOWN_SAMPLES:
                    return True
            elif not self.is_compatible(endpoint):
                self.incompatible_dropped += 1
                return False
        if len(self.accepted_writers) >= _MAX_ACCEPTED_WRITERS:
            self.accepted_writers.clear()
        self.accepted_writers.add(writer)
        return True

    def _endpoint(self, guid: bytes | None) -> DiscoveredEndpoint | None:
        if guid is None:
            return None
        endpoints = self._scope.graph.endpoints
        if guid not in endpoints:  # a sample may arrive before the discovery of its writer
            self._scope.discovery.refresh()
        return endpoints.get(guid)

    def is_compatible(self, endpoint: DiscoveredEndpoint, type_hash: str | None = None) -> bool:
        """Return True if an endpoint uses the definition of `type_hash`, by default that of the reader."""
        own_hash = self._type_hash if type_hash is None else type_hash
        return self._mode != "error" or not type_hashes_differ(endpoint, own_hash, self._service_hash)
