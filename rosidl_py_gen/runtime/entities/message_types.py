"""Message and service types in the form that entities use, and the check of received samples against the type.

A type is given as a generated class, or by its name, such as ``"std_msgs/msg/String"``. With a name, messages are dicts
(`to_dict`, `from_dict`), so that a program needs no generated code. An entity's form of a type is a name, a hash, and
functions that encode and decode.

`TypeHashFilter` drops and counts samples whose sender has another definition of the type. Two definitions of one type
have the same name on the network, and decoding with the wrong one returns wrong values. Writers announce the RIHS01
hash of their definition, which is compared once per writer.

ROS 2 Humble announces no hash. Samples without hash are checked only if the definition of the type, or of a type in it,
differs between distributions (docs/internals/protocol.md 1.9). If the participant is known to be of Humble, the
definition of Humble is assumed. Every sample of other participants must have the size of the definition in use.
"""

from __future__ import annotations

import threading
import weakref
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.terminal_text import is_logged
from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.cdr.message import is_of_type
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.graph import distribution_advice, type_hashes_differ

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, Payload
    from rosidl_py_gen.type_loading import DistributionVariants

T = TypeVar("T")
RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
MessageT = TypeVar("MessageT", bound=Message)

DictMessage: TypeAlias = "dict[str, Any]"
"""Message as a dict, as `to_dict` returns it; the types of its values depend on the definition."""

_BUFFER_BASES = ("uint8", "char")
"""Element types of unbounded arrays that rosidl stores as buffers of bytes in Lyrical; `byte` is not one of them."""

# Separate from the classes of `dynamic`, because programs that forward bytes subscribe with a class that has the hash
# of a type and no fields, which a search for a class of that hash must not find.
_classes: weakref.WeakValueDictionary[tuple[str, str], type[Any]] = weakref.WeakValueDictionary()


@dataclass(frozen=True, slots=True)
class MessageType(Generic[T]):
    """Message type in the form that entities use.

    Attributes:
        ros_name: ``pkg/msg/Name``, or ``pkg/srv/Name_Request``.
        type_hash: RIHS01 text.
        encode: returns 4-byte header and CDR of a message; raises EncodeError, or TypeError for a message of another
            type.
        decode: returns the message; raises DecodeError.
    """

    ros_name: str
    type_hash: str
    encode: Callable[[T], bytes]
    decode: Callable[[Payload], T]


@dataclass(frozen=True, slots=True)
class ServiceType(Generic[RequestT, ResponseT]):
    """Service type in the form that entities use.

    Attributes:
        ros_name: ``pkg/srv/Name``.
        type_hash: RIHS01 text of the service, not of a message.
        request: type of the request.
        response: type of the response.
    """

    ros_name: str
    type_hash: str
    request: MessageType[RequestT]
    response: MessageType[ResponseT]


def message_type(source: type[Message] | str, *, arrays: bool = False) -> MessageType[Any]:
    """Return the `MessageType` of a message class or a type name.

    Args:
        source: class, or a name such as ``"std_msgs/msg/String"``.
        arrays: decode sequences of fixed-size messages as structured arrays; not with a name.

    Raises:
        TypeNotFoundError: there is no type with the name.
        TypeError: `source` is neither a name nor a message class, or a name is combined with `arrays`.
    """
    cls = generated_class(source, Message, "std_msgs/msg/String", arrays=arrays)
    return _converters(source, arrays)(cls)


def service_type(source: type[Service[Any, Any]] | str, *, arrays: bool = False) -> ServiceType[Any, Any]:
    """Return the `ServiceType` of a service class or a type name.

    Args:
        source: class, or a name such as ``"std_srvs/srv/Trigger"``.
        arrays: decode sequences of fixed-size messages as structured arrays; not with a name.

    Raises:
        TypeNotFoundError: there is no type with the name.
        TypeError: `source` is neither a name nor a service class, or a name is combined with `arrays`.
    """
    cls = generated_class(source, Service, "example_interfaces/srv/AddTwoInts", arrays=arrays)
    _remember(cls)
    make = _converters(source, arrays)
    return ServiceType(cls._TYPE.name, cls._TYPE.hash, make(cls.Request), make(cls.Response))


def generated_class(source: object, base: type[Any], example: str, *, arrays: bool) -> Any:
    """Return the class of a message, service or action type, which is given as a class or by its name.

    Args:
        source: class or name.
        base: expected base: `Message`, `Service` or `Action`.
        example: name for the error text.
        arrays: the caller requests structured arrays, which need a class.

    Raises:
        TypeNotFoundError: there is no type with the name.
        TypeError: `source` is neither a name nor such a class, or a name is combined with `arrays`.
    """
    kind = base.__name__.lower()
    if isinstance(source, str):
        if arrays:
            raise TypeError(f"arrays=True needs a class; with the {kind} type as text, messages are dicts of lists")
        return getattr(import_module("rosidl_py_gen"), f"get_{kind}")(source)
    if not (isinstance(source, type) and issubclass(source, base) and source is not base):
        raise TypeError(f"expected a generated {kind} class or a text like {example!r}, got {source!r}")
    return source


def _converters(source: object, arrays: bool) -> Callable[[type[Any]], MessageType[Any]]:
    return _untyped if isinstance(source, str) else _with_arrays if arrays else _typed


def class_of(ros_name: str, type_hash: str) -> type[Any] | None:
    """Return the class that an entity of this process uses for the type with a name and a hash; None if there is none.

    A class that was compiled at run time may have the same type name as another class, so the hash is compared. Lazy
    types, whose classes are not imported yet, are not found.
    """
    return _classes.get((ros_name, type_hash))


def _remember(cls: type[Any]) -> None:
    """Store a class so that `class_of` finds it.

    A class without fields, which only forwards bytes, replaces no other class.
    """
    known = _classes.setdefault((cls._TYPE.name, cls._TYPE.hash), cls)
    if known is not cls and getattr(cls._TYPE, "fields", True):
        _classes[cls._TYPE.name, cls._TYPE.hash] = cls


def has_unbounded_bytes(message_type: MessageType[Any]) -> bool:
    """Return True if a message of the type can contain an unbounded byte array at any depth.

    Messages that remain bytes and whose fields are unknown count as True. Lazy types contain no such array.
    """
    cls = class_of(message_type.ros_name, message_type.type_hash)
    if cls is None or not cls._TYPE.fields:
        return message_type.decode is bytes
    classes = (member for member in referenced_classes(cls).values() if issubclass(member, Message))
    types = (field.type for member in classes for field in member._TYPE.fields)
    return any(type_.base in _BUFFER_BASES and type_.arity is Arity.UNBOUNDED for type_ in types)


def raw_type(message_type: MessageType[Any]) -> MessageType[bytes]:
    """Return a copy of a message type whose messages are serialized bytes, which are not encoded and decoded."""
    return MessageType(message_type.ros_name, message_type.type_hash, bytes, bytes)


def _typed(cls: type[MessageT]) -> MessageType[MessageT]:
    _remember(cls)
    encode_own = cls._encode  # the generated function itself: a wrapper costs as much as encoding a small message

    def encode(value: MessageT) -> bytes:
        if value.__class__ is cls or isinstance(value, cls):
            return encode_own(value)
        if is_of_type(value, cls):
            return value._encode()
        raise TypeError(f"expected a {cls.__name__} ({cls._TYPE.name}), got {type(value).__name__}: {value!r:.100}")

    return MessageType(cls._TYPE.name, cls._TYPE.hash, encode, cls._decode)


def _with_arrays(cls: type[MessageT]) -> MessageType[MessageT]:
    return replace(_typed(cls), decode=lambda data: cls._decode(data, False, True))


def _untyped(cls: type[Message]) -> MessageType[DictMessage]:
    from rosidl_py_gen import from_dict, to_dict

    _remember(cls)
    return MessageType(
        cls._TYPE.name,
        cls._TYPE.hash,
        lambda value: from_dict(cls, value)._encode(),
        lambda data: to_dict(cls._decode(data)),
    )


def lazy_service_type(name: str) -> ServiceType[Any, Any]:
    """Return the `ServiceType` of a bundled service, whose class is imported when a message is encoded or decoded."""
    load = cache(lambda: service_type(_bundled_class(name)))
    request = _lazy_type(f"{name}_Request", lambda: load().request)
    return ServiceType(name, HASHES[name], request, _lazy_type(f"{name}_Response", lambda: load().response))


def lazy_message_type(name: str) -> MessageType[Any]:
    """Return the `MessageType` of a bundled message, whose class is imported when a message is encoded or decoded."""
    return _lazy_type(name, cache(lambda: message_type(_bundled_class(name))))


def _lazy_type(name: str, load: Callable[[], MessageType[Any]]) -> MessageType[Any]:
    return MessageType(name, HASHES[name], lambda value: load().encode(value), lambda data: load().decode(data))


def _bundled_class(name: str) -> Any:
    package, kind, stem = name.split("/")
    return getattr(import_module(f"rosidl_py_gen.msgs.{package}.{kind}"), stem)


# ----------------------------------------------------------------------------------------------------- check of samples

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
        self._variants: DistributionVariants | None = None
        """Definition in use, and the definitions of other distributions; set by `_others`."""
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
            advice = (
                f", but the definition of {', '.join(fitting)}; {distribution_advice(fitting, name)}" if fitting else ""
            )
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
            from rosidl_py_gen.type_loading import DistributionVariants

            name, type_hash = self._type.ros_name, self._type.type_hash
            cls = class_of(name, type_hash)
            try:
                if cls is not None and getattr(cls._TYPE, "fields", True):
                    self._variants = DistributionVariants(cls)
                else:  # a type that is imported later, or raw data
                    self._variants = DistributionVariants.find(name, type_hash) if type_hash else None
                self._other_hashes = {} if self._variants is None else self._variants.hashes
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
        assert self._variants is not None
        try:
            return self._variants.fits(data, distro)
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
