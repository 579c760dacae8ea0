"""What endpoints need of a message type: its names, and two functions between values and bytes.

Decides how "a type" may be given: as a generated class, or as text such as ``"std_msgs/msg/String"``. With text the
values are dicts (`to_dict` / `from_dict`), so that a program works without importing, or even having, generated code.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.cdr.message import is_of_type
from rosidl_py_gen.cdr.typesupport import referenced_classes

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.samples import Payload

T = TypeVar("T")
RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
MessageT = TypeVar("MessageT", bound=Message)

DictMessage: TypeAlias = "dict[str, Any]"
"""A message as `to_dict` shows it; its values are whatever the definition says."""

_BUFFER_BASES = ("uint8", "char")
"""What rosidl makes buffers of: `char` is the same to it, `byte` is not."""

# Not those of `dynamic`: whoever leaves bytes as they are subscribes with a class that has the hash of a type and no
# fields. Others must not find it when they look for a class of that hash, and describing a type must not load dynamic.
_classes: weakref.WeakValueDictionary[tuple[str, str], type[Any]] = weakref.WeakValueDictionary()


@dataclass(frozen=True, slots=True)
class MessageType(Generic[T]):
    """A message type as endpoints use it.

    Attributes:
        ros_name: ``pkg/msg/Name``, or ``pkg/srv/Name_Request``.
        type_hash: RIHS01 text.
        encode: value -> 4-byte header + CDR; raises EncodeError, or TypeError for a value of another type.
        decode: the reverse; raises DecodeError.
    """

    ros_name: str
    type_hash: str
    encode: Callable[[T], bytes]
    decode: Callable[[Payload], T]


@dataclass(frozen=True, slots=True)
class ServiceType(Generic[RequestT, ResponseT]):
    """A service type as endpoints use it; `type_hash` is the one of the service itself."""

    ros_name: str
    type_hash: str
    request: MessageType[RequestT]
    response: MessageType[ResponseT]


def message_type(source: type[Message] | str, *, arrays: bool = False) -> MessageType[Any]:
    """Raises `TypeNotFoundError` for a text that names no known type, `TypeError` for anything else.

    `arrays`: messages of a class are decoded with structured arrays; `TypeError` for a text.
    """
    if isinstance(source, str):
        from rosidl_py_gen import get_message

        _refuse_arrays(arrays)
        return _untyped(get_message(source))
    if not (isinstance(source, type) and issubclass(source, Message) and source is not Message):
        raise TypeError(f"expected a generated message class or a text like 'std_msgs/msg/String', got {source!r}")
    return _with_arrays(source) if arrays else _typed(source)


def service_type(source: type[Service[Any, Any]] | str, *, arrays: bool = False) -> ServiceType[Any, Any]:
    """Raises as `message_type`, whose `arrays` it has."""
    cls: Any = source
    if isinstance(source, str):
        from rosidl_py_gen import get_service

        _refuse_arrays(arrays)
        cls = get_service(source)
    elif not (isinstance(source, type) and issubclass(source, Service) and source is not Service):
        raise TypeError(
            f"expected a generated service class or a text like 'example_interfaces/srv/AddTwoInts', got {source!r}"
        )
    _remember(cls)
    make = _untyped if isinstance(source, str) else _with_arrays if arrays else _typed
    return ServiceType(cls._TYPE.name, cls._TYPE.hash, make(cls.Request), make(cls.Response))


def _refuse_arrays(arrays: bool) -> None:
    if arrays:
        raise TypeError("arrays=True needs a class: types given as text make dicts of lists")


def class_of(ros_name: str, type_hash: str) -> type[Any] | None:
    """The class an endpoint of this process got its message or service type from; None for types imported late.

    A name alone does not tell: a class compiled from text may share it with another.
    """
    return _classes.get((ros_name, type_hash))


def _remember(cls: type[Any]) -> None:
    _classes[cls._TYPE.name, cls._TYPE.hash] = cls


def has_unbounded_bytes(known: MessageType[Any]) -> bool:
    """Whether messages have an unbounded array of bytes, also deep inside; True for raw ones of unknown fields.

    Types that are loaded late have none.
    """
    cls = class_of(known.ros_name, known.type_hash)
    if cls is None or not cls._TYPE.fields:
        return known.decode is bytes
    parts = (part for part in referenced_classes(cls).values() if issubclass(part, Message))
    kinds = (field.type for part in parts for field in part._TYPE.fields)
    return any(kind.base in _BUFFER_BASES and kind.arity is Arity.UNBOUNDED for kind in kinds)


def raw_type(known: MessageType[Any]) -> MessageType[bytes]:
    """A type whose messages are left as bytes."""
    return MessageType(known.ros_name, known.type_hash, bytes, bytes)


def _typed(cls: type[MessageT]) -> MessageType[MessageT]:
    _remember(cls)
    # The generated functions themselves: a wrapper would cost as much as encoding a small message.
    encode_known = cls._encode

    def encode(value: MessageT) -> bytes:
        if value.__class__ is cls or isinstance(value, cls):
            return encode_known(value)
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
