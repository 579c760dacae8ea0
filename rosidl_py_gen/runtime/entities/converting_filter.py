"""Treatment of data whose sender uses another definition of the type than its receiver.

Two definitions of one type have the same name on the wire, and decoding with the other one returns wrong values.
Writers announce the RIHS01 hash of their definition. Samples of a definition that another distribution has are
converted to the definition of the reader; those of an unknown definition are dropped. The decision is made once per
writer.

ROS 2 Humble announces no hash. A writer without hash is assumed to use the definition of Humble if its participant is
known to be of Humble; otherwise the one of the reader, unless only that of another distribution fits the bytes.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.message_types import class_of
from rosidl_py_gen.runtime.graph.type_hashes import CONVERTING, type_hashes_differ

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, Payload
    from rosidl_py_gen.type_loading.peer_definitions import PeerDefinition, SampleConverter

W = TypeVar("W")
C = TypeVar("C")

_MAX_ACCEPTED_WRITERS = 1000
_MAX_UNKNOWN_SAMPLES = 100
"""Number of samples of undiscovered writers after which such a writer is accepted without a further search for it."""
_MAX_LISTED_FIELDS = 5
_HUMBLE = "humble"


class PeerConverters(Generic[C]):
    """Conversions for peers' definitions of a type; nothing is loaded before it is needed."""

    _contents = "messages"
    """Noun for the converted data, for log records."""

    def __init__(self, scope: EntityScope, type_: MessageType[Any]) -> None:
        self._scope = scope
        self._type = type_
        self._definitions: Mapping[str, PeerDefinition] | None = None
        self._converters: dict[str, C | None] = {}
        self.cls: Any = None
        """Class of the own definition, after `definitions` was called."""

    def definitions(self) -> Mapping[str, PeerDefinition]:
        """Return the definitions of other distributions by hash."""
        if self._definitions is None:
            from rosidl_py_gen.type_loading.class_lookup import find_class
            from rosidl_py_gen.type_loading.peer_definitions import peer_definitions

            name, type_hash = self._type.ros_name, self._type.type_hash
            self.cls = class_of(name, type_hash)
            try:
                # Types that are imported later, and raw data.
                if self.cls is None or not getattr(self.cls._TYPE, "fields", True):
                    self.cls = find_class(name, lambda hashes: hashes[name] == type_hash) if type_hash else None
                self._definitions = {} if self.cls is None else peer_definitions(self.cls)
            except RosidlError as error:
                self._definitions = {}
                self._scope.logger.warning(
                    f"other definitions of {name} cannot be read, so messages of them are not converted: {error}"
                )
        return self._definitions

    def get(self, type_hash: str) -> C | None:
        """Return the conversion for peers with that hash; None if the definition is unknown or cannot be converted."""
        if type_hash not in self._converters:
            definition = self.definitions().get(type_hash)
            if definition is None:  # not cached: peers determine the hash
                return None
            try:
                self._converters[type_hash] = self._load(definition)
            except RosidlError as error:
                self._converters[type_hash] = None
                self._scope.logger.warning(
                    f"{self._contents} of the definition of {definition.type_name} of {', '.join(definition.distros)} "
                    f"cannot be converted: {error}"
                )
        return self._converters[type_hash]

    def _load(self, definition: PeerDefinition) -> C:
        """Return the conversion for a definition; raises `RosidlError` if there is none."""
        raise NotImplementedError


def _warn_once(
    scope: EntityScope, reported: set[str], endpoint: DiscoveredEndpoint, type_hash: str, text: Callable[[str], str]
) -> None:
    """Log the text about the endpoint's node, as soon as its name is known, once for each hash."""
    if type_hash not in reported and len(reported) < _MAX_ACCEPTED_WRITERS:
        reported.add(type_hash)
        graph, logger = scope.graph, scope.logger
        scope.discovery.call_when_named(lambda: logger.warning(text(graph.describe_node(endpoint))), endpoint)


class MessageConverters(PeerConverters["SampleConverter"]):
    """Conversions from peers' definitions of a message type to the own one."""

    def _load(self, definition: PeerDefinition) -> SampleConverter:
        from rosidl_py_gen.type_loading.peer_definitions import converter_from

        return converter_from(definition, self.cls)


class ConvertingFilter(Generic[W]):
    """Type hash check of one reader, and conversion of the samples of peers with another definition.

    Args:
        guid_of: returns the GUID of a writer, None if it is unknown; the reader chooses how it identifies writers.
        topic: name for log records.
        on_converted: called with the hash of a definition whose samples will be converted.

    Attributes:
        accepted_writers: writers whose samples are delivered unchanged; looked up for every message.
        incompatible_dropped: number of samples that were dropped.
        converted: number of samples that were converted.
        service_hash: hash of the service; empty for a topic.
    """

    def __init__(
        self,
        scope: EntityScope,
        mode: TypeCheck,
        guid_of: Callable[[W], bytes | None],
        message_type: MessageType[Any],
        topic: str,
        service_hash: str = "",
        *,
        on_converted: Callable[[str], object] = lambda _: None,
        hash_of: Callable[[W], str] = lambda _: "",
    ) -> None:
        self._scope = scope
        self._mode = mode
        self._guid_of = guid_of
        self._hash_of = hash_of
        self._type_hash = message_type.type_hash
        self._peers = MessageConverters(scope, message_type)
        self._topic = topic
        self.service_hash = service_hash
        self._on_converted = on_converted
        self._is_late = False
        """True if the definition was set later: the reader announces none, so nothing else warns about drops."""
        self._by_writer: dict[W, SampleConverter] = {}
        self._by_guid: dict[bytes, tuple[DiscoveredEndpoint, SampleConverter | None]] = {}
        """Discovered writers with another definition, which may have left when their samples are taken.

        Without a converter their samples are dropped.
        """
        self._reported: set[str] = set()
        """Hashes that were logged."""
        self.accepted_writers: set[W] = set()
        self.incompatible_dropped = 0
        self.converted = 0
        self._unknown_samples = 0
        self._count_lock = threading.RLock()
        """Guards the numbers, because several threads may take. The other members need no lock: each change is one
        operation, and a thread that misses an entry finds the same decision again.
        """

    def disable(self) -> None:
        """Deliver everything unchanged, because the transport knows the definition of each sample."""
        self._mode = "off"

    def payload(self, writer: W, data: Payload) -> Payload | None:
        """Return a sample of a writer that is not in `accepted_writers`, in the definition of the reader.

        Returns None if it is dropped and counted; raises `DecodeError` if its conversion fails.
        """
        converter = self._by_writer.get(writer)
        if converter is None and self._mode != "off":
            guid = self._guid_of(writer)
            endpoint = self._endpoint(guid)
            if endpoint is None:  # the writer has left, or is not discovered yet
                known = self._by_guid.get(guid or b"") or self._writer_of_key(writer)
                if known is None:
                    with self._count_lock:
                        self._unknown_samples += 1
                    return self._payload_of_left(data) if self._is_late else data
                endpoint, converter = known
                if converter is None:
                    self._count_dropped()
                    return None
            elif not self.is_compatible(endpoint):
                self._count_dropped()
                if self._is_late:
                    found = endpoint.type_hash or endpoint.service_hash
                    text = f"are dropped: its definition is {found}; here it is {self._type_hash}"
                    self._warn(endpoint, found, text)
                return None
            elif type_hashes_differ(endpoint, self._type_hash, self.service_hash):
                converter = self._peers.get(endpoint.type_hash)
            elif self._needs_guess(endpoint) and not self._is_own_humble(endpoint, data):
                return self._guessed_payload(endpoint, data)
            if endpoint is not None and converter is not None:
                self._report(endpoint, converter)
                if len(self._by_writer) >= _MAX_ACCEPTED_WRITERS:
                    self._by_writer.clear()
                self._by_writer[writer] = converter
        if converter is not None:
            return self._convert(converter, data)
        if len(self.accepted_writers) >= _MAX_ACCEPTED_WRITERS:
            self.accepted_writers.clear()
        self.accepted_writers.add(writer)
        return data

    def set_definition(self, message_type: MessageType[Any]) -> None:
        """Convert samples to another definition from now on: that of raw data whose definition was not known before."""
        self._is_late = True
        self._type_hash = message_type.type_hash
        self._peers = MessageConverters(self._scope, message_type)
        self.accepted_writers.clear()
        self._by_writer.clear()
        self._by_guid.clear()

    def of_guids(self, message_type: MessageType[Any]) -> ConvertingFilter[bytes]:
        """Return a filter after `set_definition`, for samples of which only the GUID of the writer is known."""
        other = ConvertingFilter[bytes](self._scope, self._mode, lambda guid: guid, message_type, self._topic)
        other._is_late = True
        other._reported = self._reported
        return other

    def _writer_of_key(self, writer: W) -> tuple[DiscoveredEndpoint, SampleConverter | None] | None:
        """Return a writer with the definition of a sample's key, on a transport whose keys contain the hash."""
        type_hash = self._hash_of(writer)
        return next((known for known in list(self._by_guid.values()) if known[0].type_hash == type_hash), None)

    def _count_dropped(self) -> None:
        with self._count_lock:
            self.incompatible_dropped += 1

    def _convert(self, converter: SampleConverter, data: Payload) -> Payload:
        with self._count_lock:
            self.converted += 1
        return converter(data)

    def _endpoint(self, guid: bytes | None) -> DiscoveredEndpoint | None:
        if guid is None:
            return None
        endpoints = self._scope.graph.endpoints
        # A sample may arrive before the discovery of its writer.
        if guid not in endpoints and self._unknown_samples < _MAX_UNKNOWN_SAMPLES:
            self._scope.discovery.refresh()
        return endpoints.get(guid)

    def is_compatible(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if the samples of a writer are delivered, unchanged or converted."""
        if self._mode in ("warn", "off") or not type_hashes_differ(endpoint, self._type_hash, self.service_hash):
            return True
        return self._mode == "convert" and self._peers.get(endpoint.type_hash) is not None

    def converts(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True, and prepare for its samples, if a writer announces another definition that is converted."""
        if self._mode == "off" or endpoint.type_hash in ("", self._type_hash):
            return False
        converter = self._peers.get(endpoint.type_hash) if self._mode in CONVERTING else None
        if converter is None and self._mode == "warn":
            return False
        if len(self._by_guid) >= _MAX_ACCEPTED_WRITERS:
            self._by_guid.clear()
        self._by_guid[endpoint.guid] = endpoint, converter
        if converter is None:
            return False
        self._on_converted(endpoint.type_hash)
        return True

    def _needs_guess(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if a writer has no hash and may use the definition of another distribution."""
        return (
            self._mode in CONVERTING
            and not (endpoint.type_hash or endpoint.service_hash)
            and bool(self._type_hash)
            and endpoint.participant_guid != self._scope.participant.guid
            and bool(self._peers.definitions())
        )

    def _is_own_humble(self, endpoint: DiscoveredEndpoint, data: Payload) -> bool:
        """Return True if a writer of Humble sends the definition of Humble, and the reader has the same."""
        from rosidl_py_gen.type_loading.peer_definitions import fits_exactly

        return (
            self._scope.graph.is_humble(endpoint.participant_guid) is True
            and not any(_HUMBLE in one.distros for one in self._peers.definitions().values())
            and fits_exactly(self._peers.cls, data)
        )

    def _guessed_payload(self, endpoint: DiscoveredEndpoint, data: Payload) -> Payload:
        """Return a sample of a writer without hash, in the definition of the reader."""
        from rosidl_py_gen.type_loading.peer_definitions import fits_exactly

        graph, definitions = self._scope.graph, self._peers.definitions()
        of_humble = next((key for key, one in definitions.items() if _HUMBLE in one.distros), "")
        is_humble = graph.is_humble(endpoint.participant_guid)
        chosen = of_humble
        old = self._peers.get(of_humble) if of_humble else None
        if not is_humble or (old is not None and not fits_exactly(old.old, data)):
            converters = {key: self._peers.get(key) for key in definitions}
            fitting = [key for key, one in converters.items() if one is not None and fits_exactly(one.old, data)]
            if fits_exactly(self._peers.cls, data):
                # All later distributions announce a hash.
                may_be_humble = is_humble is None and graph.is_ros(endpoint.participant_guid)
                chosen = of_humble if may_be_humble and of_humble in fitting else ""
            else:
                chosen = fitting[0] if len(fitting) == 1 else ""
        converter = self._peers.get(chosen) if chosen else None
        if converter is None:
            return data
        self._report(endpoint, converter)
        return self._convert(converter, data)

    def _payload_of_left(self, data: Payload) -> Payload:
        """Return a sample of a writer that left before `set_definition`, converted if only another definition fits."""
        from rosidl_py_gen.type_loading.peer_definitions import fits_exactly

        definitions = self._peers.definitions()
        if not definitions or fits_exactly(self._peers.cls, data):
            return data
        converters = filter(None, map(self._peers.get, definitions))
        fitting = [one for one in converters if fits_exactly(one.old, data)]
        return self._convert(fitting[0], data) if len(fitting) == 1 else data

    def _report(self, endpoint: DiscoveredEndpoint, converter: SampleConverter) -> None:
        """Log once for each definition that samples are converted."""
        type_hash = converter.old._TYPE.hash
        if type_hash not in self._reported:
            distros = ", ".join(self._peers.definitions()[type_hash].distros)
            texts = [f"its definition of {converter.old._TYPE.name} is that of {distros}, {type_hash}"]
            texts += [f"here it is {converter.new._TYPE.hash}", *field_changes(converter)]
            self._warn(endpoint, type_hash, f"are converted: {'; '.join(texts)}")

    def _warn(self, endpoint: DiscoveredEndpoint, type_hash: str, text: str) -> None:
        topic = self._topic
        _warn_once(
            self._scope, self._reported, endpoint, type_hash, lambda node: f"messages on {topic} from {node} {text}"
        )


def field_changes(converter: SampleConverter) -> list[str]:
    """Return texts about the fields that only one of the two definitions has."""
    texts = []
    for subject, fields in (("dropped", converter.dropped), ("set to the default", converter.defaulted)):
        if fields:
            more = f" and {len(fields) - _MAX_LISTED_FIELDS} more" if len(fields) > _MAX_LISTED_FIELDS else ""
            texts.append(f"{subject}: {', '.join(fields[:_MAX_LISTED_FIELDS])}{more}")
    return texts
