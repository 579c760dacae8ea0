"""Message and service types in the form that entities use: a name, a hash, and functions that encode and decode.

A type is given as a generated class, or by its name, such as ``"std_msgs/msg/String"``. With a name, messages are dicts
(`to_dict`, `from_dict`), so that a program needs no generated code.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.cdr.message import is_of_type
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.msgs.hashes import HASHES

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.api import Payload

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
