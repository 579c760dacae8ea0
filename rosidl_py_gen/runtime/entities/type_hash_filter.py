"""Check of received samples, which drops and counts samples whose sender has another definition of the type.

Two definitions of one type have the same name on the network, and decoding with the wrong one returns wrong values.
Writers announce the RIHS01 hash of their definition, which is compared once per writer.

ROS 2 Humble announces no hash. Samples without hash are checked only if the definition of the type, or of a type in it,
differs between distributions (docs/internals/protocol.md 1.9). If the participant is known to be of Humble, the
definition of Humble is assumed. Every sample of other participants must have the size of the definition in use.
"""

from __future__ import annotations

import threading
from enum import Enum, auto
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.terminal_text import is_logged
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.message_types import class_of
from rosidl_py_gen.runtime.graph.type_hashes import distribution_advice, type_hashes_differ

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, Payload

W = TypeVar("W")

_MAX_WRITERS = 1000
_MAX_UNKNOWN_SAMPLES = 100
"""Number of samples from a writer that was not discovered after which the writer is accepted and not searched for any
more."""
_HUMBLE = "humble"


class _Verdict(Enum):
    """Decision whether the samples of a writer are delivered or dropped."""

    DROP = auto()
    DELIVER = auto()
    """Deliver this sample; the next sample of the writer is checked, too."""
    DELIVER_ALL = auto()


class TypeHashFilter(Generic[W]):
    """Type hash check of one reader.

    Args:
        guid_of: returns the GUID of a writer, None if it is unknown; the reader chooses how it identifies writers.
        topic: name for log records.

    Attributes:
        accepted_writers: writers whose samples are delivered; looked up for every message.
        incompatible_dropped: number of samples that were dropped.
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
    ) -> None:
        self._scope = scope
        self._mode = mode
        self._guid_of = guid_of
        self._type = message_type
        self._topic = topic
        self.service_hash = service_hash
        self._cls: type[Any] | None = None
        """Class with the definition in use; set by `_others`."""
        self._other_hashes: Mapping[str, str] | None = None
        self._is_late = False
        """True if the definition was set after creation. The reader then announces no hash, so this filter must warn
        about drops."""
        self._incompatible: dict[bytes, DiscoveredEndpoint] = {}
        """Discovered writers with another definition. A writer may have left when its samples are taken."""
        self._reported: set[tuple[bytes, str]] = set()
        """Participants about whose dropped samples a warning was logged, each with its hash of the type; both may be
        empty if unknown."""
        self.accepted_writers: set[W] = set()
        self.incompatible_dropped = 0
        self._last_drop: tuple[DiscoveredEndpoint, str] | None = None
        """Writer without hash whose sample was dropped most recently, and the reason."""
        self._unknown_samples = 0
        self._count_lock = threading.RLock()
        """Lock for the counters, because several threads may take messages. The other attributes need no lock: each
        change is one operation, and a thread that misses an entry makes the same decision again."""

    def disable(self) -> None:
        """Deliver all samples, because the transport itself matches endpoints by their hash."""
        self._mode = "off"

    @property
    def drop_reason(self) -> str:
        """Reason why the last sample of a writer without hash was dropped; empty if none was."""
        if self._last_drop is None:
            return ""
        endpoint, why = self._last_drop
        return f"{self._scope.graph.describe_node(endpoint)} announces no type hash, and {why}"

    def accepts(self, writer: W, data: Payload) -> bool:
        """Return True if a sample of a writer that is not in `accepted_writers` is to be delivered.

        Otherwise count it as dropped.
        """
        verdict = _Verdict.DELIVER_ALL if self._mode == "off" else self._verdict(self._guid_of(writer), data)
        if verdict is _Verdict.DELIVER_ALL:
            if len(self.accepted_writers) >= _MAX_WRITERS:
                self.accepted_writers.clear()
            self.accepted_writers.add(writer)
        return verdict is not _Verdict.DROP

    def accepts_from(self, guid: bytes, data: Payload) -> bool:
        """Return True if a sample of the writer with this GUID is to be delivered; otherwise count it as dropped."""
        return self._mode == "off" or self._verdict(guid, data) is not _Verdict.DROP

    def is_compatible(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if the hash that a writer announces allows its samples to be delivered."""
        if self._mode == "off" or not type_hashes_differ(endpoint, self._type.type_hash, self.service_hash):
            return True
        # The bytes of another distribution's definition are known to be misread.
        return self._mode == "warn" and endpoint.type_hash not in self._others().values()

    def remember(self, endpoint: DiscoveredEndpoint) -> None:
        """Record a writer with another definition, so that its samples are also dropped if they are taken after it has
        left.
        """
        if not self.is_compatible(endpoint):
            if len(self._incompatible) >= _MAX_WRITERS:
                self._incompatible.clear()
            self._incompatible[endpoint.guid] = endpoint

    def set_definition(self, message_type: MessageType[Any]) -> None:
        """Set the definition of raw samples that was not known before; samples of other definitions are dropped."""
        self._is_late = True
        self._type, self._other_hashes = message_type, None
        self.accepted_writers.clear()
        self._incompatible.clear()

    def _verdict(self, guid: bytes | None, data: Payload) -> _Verdict:
        endpoint = self._endpoint(guid)
        if endpoint is None:  # the writer has left, or is not discovered yet
            endpoint = self._incompatible.get(guid or b"")
        if endpoint is None:
            with self._count_lock:
                self._unknown_samples += 1
            if not (self._others() and not self._fits(data)):
                return _Verdict.DELIVER
            text = f"they do not fit the definition of {self._type.ros_name} in use here"
            if (b"", "") not in self._reported:
                self._reported.add((b"", ""))
                self._scope.logger.warning(f"messages on {self._topic} from an unknown node are dropped: {text}")
            return self._drop()
        if not self.is_compatible(endpoint):
            if self._is_late:
                found = endpoint.type_hash or endpoint.service_hash
                self._warn(endpoint, found, f"its definition is {found}; here it is {self._type.type_hash}")
            return self._drop()
        if self._is_checked_without_hash(endpoint):
            return self._verdict_without_hash(endpoint, data)
        return _Verdict.DELIVER_ALL

    def _endpoint(self, guid: bytes | None) -> DiscoveredEndpoint | None:
        if guid is None:
            return None
        endpoints = self._scope.graph.endpoints
        # A sample may arrive before the discovery of its writer.
        if guid not in endpoints and self._unknown_samples < _MAX_UNKNOWN_SAMPLES:
            self._scope.discovery.refresh()
        return endpoints.get(guid)

    def _is_checked_without_hash(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if a writer announces no hash and the type has another definition in some distribution."""
        return (
            not (endpoint.type_hash or endpoint.service_hash)
            and bool(self._type.type_hash)
            and endpoint.participant_guid != self._scope.participant.guid
            and bool(self._others())
        )

    def _verdict_without_hash(self, endpoint: DiscoveredEndpoint, data: Payload) -> _Verdict:
        graph, guid, others, name = self._scope.graph, endpoint.participant_guid, self._others(), self._type.ros_name
        is_humble = graph.is_humble(guid)
        if is_humble and _HUMBLE in others:
            text = f"it is of ROS 2 Humble, whose definition of {name} is another one"
            return self._drop_without_hash(endpoint, f"{text}; {distribution_advice((_HUMBLE,), name)}")
        if not self._fits(data):
            text = f"its messages do not fit the definition of {name} in use here"
            fitting = tuple(distro for distro in others if self._fits(data, distro))
            advice = f", but that of {', '.join(fitting)}; {distribution_advice(fitting, name)}" if fitting else ""
            return self._drop_without_hash(endpoint, text + advice)
        if is_humble:
            return _Verdict.DELIVER_ALL
        # All later distributions announce a hash, so a participant of ROS that has sent no node names is of Humble.
        if is_humble is None and graph.is_ros(guid) and _HUMBLE in others and self._fits(data, _HUMBLE):
            text = f"its messages fit the definition of {name} of ROS 2 Humble as well"
            return self._drop_without_hash(endpoint, f"{text}; {distribution_advice((_HUMBLE,), name)}")
        return _Verdict.DELIVER

    def _drop_without_hash(self, endpoint: DiscoveredEndpoint, why: str) -> _Verdict:
        self._last_drop = endpoint, why
        self._warn(endpoint, "", f"it announces no type hash, and {why}")
        return self._drop()

    def _drop(self) -> _Verdict:
        with self._count_lock:
            self.incompatible_dropped += 1
        return _Verdict.DROP

    def _others(self) -> Mapping[str, str]:
        """Return the hashes that the type has in distributions with another definition, which are computed at the first
        call.
        """
        if self._other_hashes is None:
            from rosidl_py_gen.type_loading.class_lookup import find_class
            from rosidl_py_gen.type_loading.from_description import other_hashes

            name, type_hash = self._type.ros_name, self._type.type_hash
            cls = class_of(name, type_hash)
            try:
                # Types that are imported later, and raw data.
                if cls is None or not getattr(cls._TYPE, "fields", True):
                    cls = find_class(name, lambda hashes: hashes[name] == type_hash) if type_hash else None
                self._cls, self._other_hashes = cls, {} if cls is None else other_hashes(cls)
            except RosidlError as error:
                self._other_hashes = {}
                self._scope.logger.warning(
                    f"the definitions of {name} of other distributions cannot be read, so messages without type hash "
                    f"are not checked: {error}"
                )
        return self._other_hashes

    def _fits(self, data: Payload, distro: str = "") -> bool:
        """Return True if data has the size of a message of the type, with the definition in use or the definition of a
        distribution.
        """
        from rosidl_py_gen.type_loading.from_description import class_in, fits_exactly

        assert self._cls is not None
        try:
            return fits_exactly(class_in(distro, self._cls) if distro else self._cls, data)
        except RosidlError:  # the definition cannot be compiled
            return False

    def _warn(self, endpoint: DiscoveredEndpoint, type_hash: str, why: str) -> None:
        """Log why samples are dropped, once for each participant, as soon as the name of its node is known."""
        key = endpoint.participant_guid, type_hash
        if key not in self._reported and len(self._reported) < _MAX_WRITERS:
            self._reported.add(key)
            if not is_logged(len(self._reported)):  # peers decide how many participants there are
                return
            graph, logger, topic = self._scope.graph, self._scope.logger, self._topic
            self._scope.discovery.call_when_named(
                lambda: logger.warning(f"messages on {topic} from {graph.describe_node(endpoint)} are dropped: {why}"),
                endpoint,
            )
