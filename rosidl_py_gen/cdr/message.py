"""The base classes of generated code, and what every class knows of its ROS type.

Generated classes print their own flat `_encode` and `_decode`. This file gives them equality, `repr` and the public
method names, and leaves every slow path (naming the wrong field, other byte orders) to `walk`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity, FieldType, parse_field_type
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr.arrays import FieldValueError
from rosidl_py_gen.cdr.structured_arrays import find_structured_codec
from rosidl_py_gen.errors import TypeNotFoundError

if TYPE_CHECKING:
    from typing_extensions import Self

    from rosidl_py_gen.cdr.support import Readable

MessageClass: TypeAlias = "type[Message]"  # inside Field the word `type` is a member

RequestT = TypeVar("RequestT", bound="Message")
ResponseT = TypeVar("ResponseT", bound="Message")
GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")

_SHOWN_ELEMENTS = 8


class Field(NamedTuple):
    """One field of a generated class, for code that walks messages.

    Attributes:
        ros_name: the name in the definition, on the wire, in dicts and JSON.
        py_name: the attribute; differs from ros_name for Python keywords.
        type: base, arity and bounds.
        cls: the class of a nested message, None for primitives and strings.
    """

    ros_name: str
    py_name: str
    type: FieldType
    cls: MessageClass | None


class TypeInfo:
    """What a generated class knows of its ROS type; the field table is expanded when it is first needed."""

    __slots__ = ("_fields", "_spec", "defaults", "hash", "name")

    def __init__(
        self,
        name: str,
        hash: str,
        fields: tuple[tuple[str, str | type[Message]] | tuple[str, str, type[Message]], ...],
        defaults: dict[str, str] | None = None,
    ) -> None:
        self.name = name
        self.hash = hash
        self.defaults = defaults or {}
        self._spec = fields
        self._fields: tuple[Field, ...] | None = None

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields in the order of the definition; empty for an empty message."""
        if self._fields is None:
            self._fields = tuple(_field(*entry) for entry in self._spec)
        return self._fields

    def __repr__(self) -> str:
        return f"TypeInfo({self.name!r}, {self.hash!r})"


def _field(ros_name: str, text: str | type[Message], cls: type[Message] | None = None) -> Field:
    if not isinstance(text, str):
        cls, text = text, text._TYPE.name
    elif cls is not None:
        text = cls._TYPE.name + text
    return Field(ros_name, py_name(ros_name), parse_field_type(text), cls)


class Message:
    """Base of every generated message.

    A message is a slotted dataclass. `encode` and `decode` give way when a field has their name; the functions of the
    same name in `rosidl_py_gen` always work.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # mutable, like every dataclass with equality
    _TYPE: ClassVar[TypeInfo]

    def __init_subclass__(cls) -> None:
        # Saves a call on the hot path: the public names are the generated functions themselves.
        if "_encode" in cls.__dict__ and "_TYPE" in cls.__dict__:
            names = {field[0] for field in cls._TYPE._spec}
            if "encode" not in names:
                cls.encode = _public(cls, "encode")  # type: ignore[method-assign]
            if "decode" not in names:
                cls.decode = _public(cls, "decode")  # type: ignore[method-assign]

    def encode(self) -> bytes:
        """The message as XCDR1 little endian with its 4-byte header, exact size, no padding behind.

        Raises:
            EncodeError: a value does not fit its type; names the field path. Nothing is changed.

        Source: docs/internals/protocol.md 2.
        """
        return self._encode()

    @classmethod
    def decode(cls, data: Readable, *, copy: bool = False, arrays: bool = False) -> Self:
        """Read a message from CDR with its 4-byte header, either byte order; bytes behind it are ignored.

        Args:
            data: bytes, bytearray, memoryview or another contiguous buffer.
            copy: False makes arrays read-only views of `data`; True gives writable arrays of their own.
            arrays: True makes sequences and arrays of fixed-size messages structured arrays; see `dtype`.

        Raises:
            DecodeError: names field path and byte offset.
        """
        return cls._decode(data, copy, arrays)

    def _encode(self) -> bytes:
        raise TypeError(f"{type(self).__name__} is not a generated message class")

    @classmethod
    def _decode(cls, data: Readable, copy: bool = False, arrays: bool = False) -> Self:
        raise TypeError(f"{cls.__name__} is not a generated message class")

    def _get_plain(self, field: Field) -> Any:
        """The value of a field, for code that walks messages: numbers, strings, messages, lists and arrays of these."""
        return getattr(self, field.py_name)

    def _set_plain(self, field: Field, value: Any) -> None:
        """Set a field to what `_get_plain` gives."""
        setattr(self, field.py_name, value)

    def __eq__(self, other: object) -> bool:
        if self.__class__ is not other.__class__:
            return NotImplemented
        return all(
            _equal(getattr(self, field.py_name), getattr(other, field.py_name), field) for field in self._TYPE.fields
        )

    def __repr__(self) -> str:
        inside = ", ".join(
            f"{field.py_name}={_shown(getattr(self, field.py_name, None), field)}" for field in self._TYPE.fields
        )
        return f"{type(self).__name__}({inside})"


def _public(cls: type[Message], name: str) -> Any:
    """The generated method under its public name, documented as in the base class."""
    method = cls.__dict__["_" + name]
    function = getattr(method, "__func__", method)
    function.__name__, function.__qualname__ = name, f"{cls.__qualname__}.{name}"
    function.__doc__ = Message.__dict__[name].__doc__
    return method


def _equal(left: Any, right: Any, field: Field) -> bool:
    kind = field.type
    if kind.arity is Arity.SCALAR:
        return bool(left == right)
    if kind.primitive is not None:
        # Lists are welcome in array fields, so [1, 2] equals array([1, 2]); and so are bytes.
        try:
            return bool(np.array_equal(_as_array(left), _as_array(right)))
        except ValueError:  # ragged lists are equal to nothing
            return False
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return _equal_records(left, right, field)
    if not isinstance(left, (list, tuple)) or not isinstance(right, (list, tuple)):
        return bool(left == right)  # a wrong value, which only encoding complains about
    return len(left) == len(right) and all(a == b for a, b in zip(left, right, strict=True))


def _equal_records(left: Any, right: Any, field: Field) -> bool:
    """Compare two sequences of messages, at least one of which is an array."""
    known = find_structured_codec(field.cls) if field.cls is not None else None
    if known is None:
        return False  # a wrong value, which only encoding complains about
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return known.equal(left, right)
    try:
        left, right = (known.to_messages(one) if isinstance(one, np.ndarray) else one for one in (left, right))
    except FieldValueError:
        return False
    return _equal(left, right, field)


def _as_array(value: Any) -> Any:
    return np.frombuffer(value, np.uint8) if isinstance(value, (bytes, bytearray)) else np.asarray(value)


def _shown(value: Any, field: Field | None = None) -> str:
    if isinstance(value, np.ndarray) and field is not None and field.cls is not None:
        return _shown_records(value, field.cls)
    if isinstance(value, np.ndarray) or (isinstance(value, (list, tuple, bytes, bytearray)) and len(value) > 0):
        if isinstance(value, np.ndarray) and value.ndim != 1:
            return repr(value)
        size = len(value)
        first = [_shown(item) for item in value[:_SHOWN_ELEMENTS]]
        tail = [f"... {size} elements"] if size > _SHOWN_ELEMENTS else []
        return "[" + ", ".join(first + tail) + "]"
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, str) and len(value) > 400:
        return f"{value[:200]!r}... {len(value)} characters"
    return repr(value)


def _shown_records(value: Any, cls: type[Message]) -> str:
    """An array of messages, as the list of them would be shown."""
    known = find_structured_codec(cls)
    try:
        first = known.to_messages(value[:_SHOWN_ELEMENTS]) if known is not None else None
    except (FieldValueError, IndexError):
        first = None
    if first is None:
        return repr(value)
    tail = [f"... {len(value)} elements"] if len(value) > _SHOWN_ELEMENTS else []
    return "[" + ", ".join([*map(repr, first), *tail]) + "]"


def require_message(subject: object) -> None:
    """Refuse what is neither a generated message class nor an instance of one.

    Raises:
        TypeNotFoundError: says what was found.
    """
    cls = subject if isinstance(subject, type) else type(subject)
    if not issubclass(cls, Message) or not hasattr(cls, "_TYPE"):
        raise TypeNotFoundError(f"expected a generated message, found {subject!r:.100}")


def is_of_type(value: object, cls: type[Message]) -> bool:
    """Whether it is a message of a class, or of another class for the same type, such as one of rclpy's flavour."""
    if isinstance(value, cls):
        return True
    info = type(value)._TYPE if isinstance(value, Message) else None
    return info is not None and (info.name, info.hash) == (cls._TYPE.name, cls._TYPE.hash)


class ServiceInfo:
    """What a generated service or action class knows of its ROS type.

    Attributes:
        name: ``pkg/srv/Name`` or ``pkg/action/Name``.
        hash: RIHS01 of the service or action type itself.
    """

    __slots__ = ("hash", "name")

    def __init__(self, name: str, hash: str) -> None:
        self.name = name
        self.hash = hash

    def __repr__(self) -> str:
        return f"ServiceInfo({self.name!r}, {self.hash!r})"


class Service(Generic[RequestT, ResponseT]):
    """Base of every generated service; holds `Request`, `Response` and `Event`, and is never instantiated."""

    _TYPE: ClassVar[ServiceInfo]


class Action(Generic[GoalT, ResultT, FeedbackT]):
    """Base of every generated action: `Goal Result Feedback FeedbackMessage SendGoal GetResult`; never instantiated."""

    _TYPE: ClassVar[ServiceInfo]
