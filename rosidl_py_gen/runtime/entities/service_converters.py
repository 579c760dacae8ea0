"""Conversion between the own definition of a service and those of other distributions.

For transports whose keys contain the hash of the service, so that the definition of each request and response is known.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.entities.type_hash_filter import PeerConverters, field_changes
from rosidl_py_gen.runtime.graph.type_hashes import CONVERTING
from rosidl_py_gen.runtime.transport.service_api import ServiceConversion

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, Payload
    from rosidl_py_gen.type_loading.peer_definitions import PeerDefinition, SampleConverter


class ServiceConverters(PeerConverters[ServiceConversion]):
    """Conversions of one client or server."""

    _contents = "requests and responses"

    def __init__(
        self, scope: EntityScope, service_type: ServiceType[Any, Any], mode: TypeCheck, name: str, *, is_client: bool
    ) -> None:
        super().__init__(scope, service_type)
        self._mode = mode
        self._name = name
        self._is_client = is_client
        self._changes: dict[str, str] = {}
        """Texts about each conversion, by hash of the service."""
        self._reported: set[str] = set()
        self.converted = 0
        """Number of received requests or responses that were converted."""

    def accepts(self, endpoint: DiscoveredEndpoint, accept: Callable[[str], object]) -> bool:
        """Return True if the other side has another definition that is converted, and pass its hash to `accept`."""
        service_hash = endpoint.service_hash
        if self._mode not in CONVERTING or service_hash in ("", self._type.type_hash) or self.get(service_hash) is None:
            return False
        accept(service_hash)
        self._report(endpoint)
        return True

    def _load(self, definition: PeerDefinition) -> ServiceConversion:
        from rosidl_py_gen.type_loading.peer_definitions import converter_from, converter_to, part_of

        read, written = ("Response", "Request") if self._is_client else ("Request", "Response")
        name = definition.type_name
        received = converter_from(part_of(definition, f"{name}_{read}"), getattr(self.cls, read))
        sent = converter_to(part_of(definition, f"{name}_{written}"), getattr(self.cls, written))
        directions = ("received", received), ("sent", sent)
        changes = (f"; {how}, {text}" for how, converter in directions for text in field_changes(converter))
        own_hash, distros = self._type.type_hash, ", ".join(definition.distros)
        self._changes[definition.type_hash] = (
            f"is that of {distros}, {definition.type_hash}; here it is {own_hash}{''.join(changes)}"
        )
        return ServiceConversion(partial(self._receive, received), sent.encode)

    def _receive(self, converter: SampleConverter, data: Payload) -> bytes:
        self.converted += 1
        return converter(data)

    def _report(self, endpoint: DiscoveredEndpoint) -> None:
        """Log once for each definition that requests and responses are converted."""
        service_hash = endpoint.service_hash
        if service_hash in self._reported:
            return
        self._reported.add(service_hash)
        discovery, logger = self._scope.discovery, self._scope.logger

        def log() -> None:
            node = discovery.graph.describe_node(endpoint)
            logger.warning(
                f"{self._contents} of {self._name} are converted for {node}: its definition of "
                f"{self._type.ros_name} {self._changes[service_hash]}"
            )

        discovery.call_when_named(endpoint, log)
