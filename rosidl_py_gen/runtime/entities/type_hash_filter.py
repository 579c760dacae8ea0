"""Whether what a writer sends was made with the definition that we read it with.

Two definitions under one name have the same name on the wire, and values of one come out of the other as different
values. Decides that nothing of a writer is handed out whose announced RIHS01 hash is known and is not ours; a hash that
is not announced, as by Humble, is taken for ours. A writer is judged once, with its first sample.
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

_MAX_KNOWN = 1000
_MAX_LOOKS = 100


class TypeHashFilter(Generic[W]):
    """The check of what reads.

    Args:
        guid_of: the GUID of a writer, None when it is not known; by what the reader calls it.

    Attributes:
        agreeing: writers whose samples may be handed out; looked up for every message.
        withheld: how many samples were not.
    """

    __slots__ = (
        "_guid_of",
        "_mode",
        "_scope",
        "_service_hash",
        "_type_hash",
        "_unknown",
        "accepted_writers",
        "incompatible_dropped",
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
        self._unknown = 0

    def accepts(self, writer: W) -> bool:
        """Whether samples of a writer that is not in `accepted_writers` may be handed out; counts those that may
        not.
        """
        if self._mode == "error":
            endpoint = self._endpoint(self._guid_of(writer))
            if endpoint is None:
                self._unknown += 1  # it is gone, or nobody tells of it; looked for again, but not for ever
                if self._unknown < _MAX_LOOKS:
                    return True
            elif not self.is_compatible(endpoint):
                self.incompatible_dropped += 1
                return False
        if len(self.accepted_writers) >= _MAX_KNOWN:
            self.accepted_writers.clear()
        self.accepted_writers.add(writer)
        return True

    def _endpoint(self, guid: bytes | None) -> DiscoveredEndpoint | None:
        if guid is None:
            return None
        endpoints = self._scope.graph.endpoints
        if guid not in endpoints:  # its data may overtake what is told of it
            self._scope.discovery.refresh()
        return endpoints.get(guid)

    def is_compatible(self, endpoint: DiscoveredEndpoint, type_hash: str | None = None) -> bool:
        """Whether an endpoint may be talked to; `type_hash` is ours for its direction, if not that of the reader."""
        ours = self._type_hash if type_hash is None else type_hash
        return self._mode != "error" or not type_hashes_differ(endpoint, ours, self._service_hash)
