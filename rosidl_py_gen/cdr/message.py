"""Base classes of generated code, the ROS type of a class, and classes without fields for serialized messages.

Generated classes have flat `_encode` and `_decode` of their own. This module adds equality, `repr` and the public
methods. Slow paths are in `codec`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeAlias, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.cdr.arrays import FieldValueError
from rosidl_py_gen.cdr.structured_arrays import StructuredCodec
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

NESTED_CLASSES = {
    "Service": ("Request", "Response", "Event"),
    "Action": ("Goal", "Result", "Feedback", "FeedbackMessage", "SendGoal", "GetResult"),
}
"""Names of the classes inside a class of a service or action, by the name of its base class."""
_MAX_REPR_ELEMENTS = 8


class Field(NamedTuple):
    """Field of a generated class.

    Attributes:
        ros_name: name in the definition, in dicts and in JSON.
        py_name: attribute; differs from ros_name for Python keywords.
        type: base, arity and bounds.
        cls: class of a nested message, None for primitives and strings.
    """

    ros_name: str
    py_name: str
    type: FieldType
    cls: MessageClass | None


class TypeInfo:
    """ROS type of a generated message class: name, hash and fields.

    The table of fields is made at the first use of `fields`. Thread: any. Threads that make the table at the same time
    make equal tuples, and a tuple is stored when it is complete.
    """

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
        """Fields of the message in the order of the definition; empty for an empty message."""
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
    return Field(ros_name, py_name(ros_name), FieldType.parse(text), cls)


class Message:
    """Base class of every generated message, which is a slotted dataclass.

    If a field is called `encode` or `decode`, it replaces the method of that name; the functions `rosidl_py_gen.encode`
    and `rosidl_py_gen.decode` work for all messages.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # mutable, like every dataclass with equality
    _TYPE: ClassVar[TypeInfo]

    def __init_subclass__(cls) -> None:
        # The public names are the generated functions themselves, which saves a call on the hot path.
        if "_encode" in cls.__dict__ and "_TYPE" in cls.__dict__:
            names = {field[0] for field in cls._TYPE._spec}
            if "encode" not in names:
                cls.encode = _public(cls, "encode")  # type: ignore[method-assign]
            if "decode" not in names:
                cls.decode = _public(cls, "decode")  # type: ignore[method-assign]

    def encode(self) -> bytes:
        """Return the message as CDR (XCDR1, little endian) with its 4-byte header.

        Raises:
            EncodeError: a value does not fit its type; names the field path.
        """
        return self._encode()

    @classmethod
    def decode(cls, data: Readable, *, copy: bool = False, arrays: bool = False) -> Self:
        """Return the message that CDR data with its 4-byte header encodes.

        Args:
            data: bytes, bytearray, memoryview or another contiguous buffer.
            copy: False makes arrays read-only views of `data`; True makes them writable copies.
            arrays: True makes sequences and arrays of fixed-size messages structured arrays.

        Raises:
            DecodeError: the data is not valid; names field path and byte offset.
        """
        return cls._decode(data, copy, arrays)

    def _encode(self) -> bytes:
        raise TypeError(f"{type(self).__name__} is not a generated message class")

    @classmethod
    def _decode(cls, data: Readable, copy: bool = False, arrays: bool = False) -> Self:
        raise TypeError(f"{cls.__name__} is not a generated message class")

    def _get_plain(self, field: Field) -> Any:
        """Return the value of a field in the form that generated native classes use: a number, string, message, or list
        or array of these.
        """
        return getattr(self, field.py_name)

    def _set_plain(self, field: Field, value: Any) -> None:
        """Set a field to a value of the kind that `_get_plain` returns."""
        setattr(self, field.py_name, value)

    def __eq__(self, other: object) -> bool:
        if self.__class__ is not other.__class__:
            return NotImplemented
        return all(
            _equal(getattr(self, field.py_name), getattr(other, field.py_name), field) for field in self._TYPE.fields
        )

    def __repr__(self) -> str:
        values = [(field, getattr(self, field.py_name, None)) for field in self._TYPE.fields]
        arguments = ", ".join(f"{field.py_name}={_value_repr(value, field)}" for field, value in values)
        return f"{type(self).__name__}({arguments})"


def _public(cls: type[Message], name: str) -> Any:
    """Return a generated method such as ``_encode`` under its public name, with the docstring of the base class."""
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
        # Array fields accept lists and bytes, so [1, 2] equals array([1, 2]).
        try:
            return bool(np.array_equal(_as_array(left), _as_array(right)))
        except ValueError:  # ragged lists
            return False
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return _equal_records(left, right, field)
    if not isinstance(left, (list, tuple)) or not isinstance(right, (list, tuple)):
        return bool(left == right)  # a wrong value, for which encoding raises
    return len(left) == len(right) and all(a == b for a, b in zip(left, right, strict=True))


def _equal_records(left: Any, right: Any, field: Field) -> bool:
    """Return True if two sequences of messages, at least one of them a structured array, have equal elements."""
    codec = StructuredCodec.find(field.cls) if field.cls is not None else None
    if codec is None:
        return False  # a wrong value, for which encoding raises
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return codec.equal(left, right)
    try:
        left, right = (codec.to_messages(one) if isinstance(one, np.ndarray) else one for one in (left, right))
    except FieldValueError:
        return False
    return _equal(left, right, field)


def _as_array(value: Any) -> Any:
    return np.frombuffer(value, np.uint8) if isinstance(value, (bytes, bytearray)) else np.asarray(value)


def _value_repr(value: Any, field: Field | None = None) -> str:
    if isinstance(value, np.ndarray):
        elements: Any = value[:_MAX_REPR_ELEMENTS] if value.ndim == 1 else None
        if field is not None and field.cls is not None:
            elements = _leading_messages(value, field.cls)
        return repr(value) if elements is None else _list_repr(elements, len(value))
    if isinstance(value, (list, tuple, bytes, bytearray)) and len(value) > 0:
        return _list_repr(value[:_MAX_REPR_ELEMENTS], len(value))
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, str) and len(value) > 400:
        return f"{value[:200]!r}... {len(value)} characters"
    return repr(value)


def _leading_messages(value: Any, cls: type[Message]) -> list[Message] | None:
    codec = StructuredCodec.find(cls)
    try:
        return codec.to_messages(value[:_MAX_REPR_ELEMENTS]) if codec is not None else None
    except (FieldValueError, IndexError):
        return None


def _list_repr(leading: Any, size: int) -> str:
    tail = [f"... {size} elements"] if size > _MAX_REPR_ELEMENTS else []
    return f"[{', '.join([*map(_value_repr, leading), *tail])}]"


def require_message(subject: object) -> None:
    """Raise `TypeNotFoundError` if the argument is neither a generated message class nor an instance of one."""
    cls = subject if isinstance(subject, type) else type(subject)
    if not issubclass(cls, Message) or not hasattr(cls, "_TYPE"):
        raise TypeNotFoundError(f"expected a generated message, found {subject!r:.100}")


def is_of_type(value: object, cls: type[Message]) -> bool:
    """Return True if a value is a message of the class, or of another class of the same ROS type, such as rclpy's."""
    if isinstance(value, cls):
        return True
    info = type(value)._TYPE if isinstance(value, Message) else None
    return info is not None and (info.name, info.hash) == (cls._TYPE.name, cls._TYPE.hash)


def opaque_message_class(type_name: str, type_hash: str) -> type[Message]:
    """Return a class without fields that has the name and hash of a type, for serialized messages."""

    class OpaqueMessage(Message):
        __slots__ = ()
        _TYPE = TypeInfo(str(RosName.parse(type_name, "msg")), type_hash, ())

    return OpaqueMessage


class ServiceInfo:
    """ROS type of a generated service or action class: its name and its hash.

    Attributes:
        name: ``pkg/srv/Name`` or ``pkg/action/Name``.
        hash: RIHS01 hash of the service or action type itself.
    """

    __slots__ = ("hash", "name")

    def __init__(self, name: str, hash: str) -> None:
        self.name = name
        self.hash = hash

    def __repr__(self) -> str:
        return f"ServiceInfo({self.name!r}, {self.hash!r})"


class Service(Generic[RequestT, ResponseT]):
    """Base class of every generated service: a namespace for `Request`, `Response` and `Event`, which is never
    instantiated.
    """

    _TYPE: ClassVar[ServiceInfo]


class Action(Generic[GoalT, ResultT, FeedbackT]):
    """Base class of every generated action: a namespace for its messages and services, which is never instantiated."""

    _TYPE: ClassVar[ServiceInfo]
