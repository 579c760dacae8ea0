"""Base classes of messages, services and actions that behave like the classes of a ROS installation, and their fields.

Fields have names, IDL types, slots and defaults. Values that programs assign are converted, and checked by the rules
and with the error texts of rclpy for ROS_PYTHON_CHECK_FIELDS=1. These checks differ from the checks of encoding: an int
is not a float, and a set may be a sequence.

Source: the message classes that rosidl_generator_py of Jazzy generates; `tests/peers/rclpy_messages` compares both.
"""

from __future__ import annotations

import math
import os
from array import array
from collections import UserList, UserString
from collections.abc import Callable, Sequence, Set
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, short_repr
from rosidl_py_gen.cdr.message import Action, Field, Message, Service
from rosidl_py_gen.cdr.rclpy_messages.arrays import BYTES, as_list, joined_bytes, to_array

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType, Primitive


def check(field: Field, value: Any) -> bool:
    """Check a value before it is assigned to a field; raise AssertionError with rclpy's text if the value is invalid.

    Returns True if the value is to be stored unchanged, because it is a scalar or an array of the right type, and False
    if it must be converted.
    """
    if field.type.arity is Arity.SCALAR:
        _check_scalar(field, value)
        return True
    return _is_right_array(field, value) or _check_many(field, value)


def _require(ok: bool, text: str) -> None:
    if not ok:
        raise AssertionError(text)


def _check_scalar(field: Field, value: Any) -> None:
    name, kind = field.py_name, field.type
    if field.cls is not None:
        cls = field.cls
        _require(isinstance(value, cls), f"The '{name}' field must be a sub message of type '{cls.__name__}'")
    elif kind.string_bound:
        text = f"The '{name}' field must be string value not longer than {kind.string_bound}"
        _require(isinstance(value, (str, UserString)) and len(value) <= kind.string_bound, text)
    elif kind.base == "byte":
        text = f"The '{name}' field must be of type 'bytes' or 'ByteString' with length 1"
        _require(isinstance(value, (bytes, bytearray)) and len(value) == 1, text)
    else:
        python = _python_type(field)
        _require(isinstance(value, python), f"The '{name}' field must be of type '{python.__name__}'")
        number = _number(kind)
        if number:
            _require(_is_in_range(value, number), f"The '{name}' field must be {_range_text(number)}")


def _range_text(number: Primitive) -> str:
    if number.max_float:
        return f"a {number.idl} in [{-number.max_float!r}, {number.max_float!r}]"
    low, high = number.integer_range
    return f"an {'integer' if low else 'unsigned integer'} in [{low}, {high}]"


def _number(kind: FieldType) -> Primitive | None:
    """Return the primitive of a type of numbers; None for bools, bytes and other types."""
    primitive = kind.primitive
    return primitive if primitive is not None and primitive.array_code else None


def _python_type(field: Field) -> type:
    kind = field.type
    if field.cls is not None:
        return field.cls
    types = {"bool": bool, "int": int, "float": float}
    return bytes if kind.base == "byte" else types[kind.primitive.python] if kind.primitive is not None else str


def _is_in_range(value: Any, number: Primitive) -> bool:
    if number.max_float:
        return not (value < -number.max_float or value > number.max_float) or math.isinf(value)
    low, high = number.integer_range
    return bool(low <= value <= high)


def _is_right_array(field: Field, value: Any) -> bool:
    """Return True for an array of numbers of the field's type and size, and False if the value is not an array.

    Raises AssertionError for an array of another type or size.
    """
    name, kind, number = field.py_name, field.type, _number(field.type)
    if number is None:
        return False
    if kind.arity is Arity.ARRAY:
        if not isinstance(value, np.ndarray):
            return False
        dtype = DTYPES[number.code]
        text = f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype.name}'"
        _require(value.dtype == dtype, text)
        _require(value.size == kind.capacity, f"The '{name}' numpy.ndarray() must have a size of {kind.capacity}")
        return True
    if not isinstance(value, array):
        return False
    type_code = number.array_code
    _require(value.typecode == type_code, f"The '{name}' array.array() must have the type code of '{type_code}'")
    if kind.arity is Arity.BOUNDED:
        _require(len(value) <= kind.capacity, f"The '{name}' array.array() must have a size <= {kind.capacity}")
    return True


def _check_many(field: Field, value: Any) -> bool:
    """Check a collection that is not an array for a field; raise AssertionError if it is invalid.

    Returns False, which means that the collection must be converted before it is stored.
    """
    kind, python, number = field.type, _python_type(field), _number(field.type)
    lengths = {Arity.ARRAY: f" with length {kind.capacity}", Arity.BOUNDED: f" with length <= {kind.capacity}"}
    text = f"The '{field.py_name}' field must be a set or sequence{lengths.get(kind.arity, '')} and each value of type "
    text += f"'{python.__name__}'"
    if number and number.max_float:
        text += f" and each {number.idl} in [{-number.max_float:f}, {number.max_float:f}]"
    elif number:
        text += f" and each {_range_text(number).removeprefix('an ')}"
    is_sequence = isinstance(value, (Sequence, Set, UserList, array)) and not isinstance(value, (str, UserString))
    _require(is_sequence, text)
    _require(kind.arity is not Arity.ARRAY or len(value) == kind.capacity, text)
    _require(kind.arity is not Arity.BOUNDED or len(value) <= kind.capacity, text)
    _require(all(isinstance(item, python) for item in value), text)
    _require(not number or all(_is_in_range(item, number) for item in value), text)
    return False


CHECK = os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1"
_ZERO: dict[str, Any] = {"bool": False, "int": 0, "float": 0.0}
_RESERVED = {"encode", "decode", "write", "read", "native", "assign", "check_fields", "fields_and_field_types"}
"""Names of fields whose storage attribute, the name with an underscore, would replace a method of the message classes.
"""


def slot_name(name: str) -> str:
    """Return the name of the attribute that stores a field in a message class of rclpy's API, given the field's Python
    name.
    """
    return f"_{name}_" if name in _RESERVED else f"_{name}"


def idl_text(kind: FieldType) -> str:
    """Return the type of a field in the form that `get_fields_and_field_types` returns, such as
    ``sequence<std_msgs/Header, 3>``.
    """
    if kind.is_message:
        package, _, name = kind.base.split("/")
        text = f"{package}/{name}"
    else:
        name = kind.base if kind.primitive is None else kind.primitive.idl
        text = name + (f"<{kind.string_bound}>" if kind.string_bound else "")
    match kind.arity:
        case Arity.ARRAY:
            return f"{text}[{kind.capacity}]"
        case Arity.BOUNDED:
            return f"sequence<{text}, {kind.capacity}>"
        case Arity.UNBOUNDED:
            return f"sequence<{text}>"
        case _:
            return text


class FieldSlot(NamedTuple):
    """Field of a message class of rclpy's API, with the functions that read and assign it.

    Attributes:
        get, put: descriptor functions of the slot, without conversion.
        default: function that returns the value in a new message.
        convert: function that converts an assigned value; None stores it unchanged.
        array_code: type code of a sequence of numbers that constructors convert before they assign it.
    """

    field: Field
    get: Callable[[Any], Any]
    put: Callable[[Any, Any], None]
    default: Callable[[], Any]
    convert: Callable[[Any], Any] | None
    array_code: str


def field_slot(cls: type, field: Field, default: Any) -> FieldSlot:
    """Return the functions that read and assign a field of a message class of rclpy's API.

    `default` is the default value in the definition, or None.
    """
    member = cls.__dict__[slot_name(field.py_name)]
    kind = field.type
    number = _number(kind)
    code, type_code = (number.code, number.array_code) if number else ("", "")
    convert: Callable[[Any], Any] | None = None
    if code and kind.arity is not Arity.SCALAR:
        convert = (
            (lambda value: to_array(value, type_code))
            if kind.is_sequence
            else lambda value: np.array(value, DTYPES[code])
        )
    array_code = type_code if kind.is_sequence and default is None else ""
    return FieldSlot(field, member.__get__, member.__set__, _default(field, default, convert), convert, array_code)


def _default(field: Field, default: Any, convert: Callable[[Any], Any] | None) -> Callable[[], Any]:
    kind = field.type
    if kind.arity is Arity.SCALAR:
        if field.cls is not None:
            return field.cls
        value = default
        if default is None:
            value = b"\0" if kind.base == "byte" else _ZERO[kind.primitive.python] if kind.primitive else ""
        return lambda: value
    if convert is not None and kind.arity is Arity.ARRAY and default is None:
        count, code = kind.capacity, kind.primitive.code if kind.primitive is not None else ""
        return lambda: np.zeros(count, DTYPES[code])
    if convert is not None:
        return lambda: convert(default or ())
    if default is not None:
        return lambda: list(default)
    if kind.arity is not Arity.ARRAY:
        return list
    if field.cls is not None:
        cls = field.cls
        return lambda: [cls() for _ in range(kind.capacity)]
    value = b"\0" if kind.base == "byte" else False if kind.primitive is not None else ""
    return lambda: [value] * kind.capacity


def property_of(slot: FieldSlot) -> property:
    """Return the property through which programs read and assign a field, with rclpy's checks and conversion."""
    field, put, convert = slot.field, slot.put, slot.convert

    def assign(self: Any, value: Any) -> None:
        try:
            checked = self._CHECK
        except AttributeError:  # a received message
            checked = CHECK
        if (checked and check(field, value)) or convert is None:
            put(self, value)
        else:
            put(self, convert(value))

    return property(slot.get, assign, doc=f"Message field '{field.py_name}'.")


# --- conversion between values of rclpy's messages and ours -----------------------------------------------------------


def to_plain(slot: FieldSlot, value: Any) -> Any:
    """Convert a field's value in a message of rclpy's API to the form of native classes: integers for bytes, lists for
    collections.

    Raises `FieldValueError` for a wrong element of type byte.
    """
    kind = slot.field.type
    if kind.base == "byte":
        if kind.arity is not Arity.SCALAR:
            return joined_bytes(value)
        if not isinstance(value, bytes) or len(value) != 1:
            raise FieldValueError(f"expected bytes of length 1, found {short_repr(value)}")
        return value[0]
    return value if kind.arity is Arity.SCALAR or kind.primitive is not None else as_list(value)


def from_plain(slot: FieldSlot, value: Any) -> Any:
    """Convert a field's value from the form of native classes to the form of rclpy's API.

    A value that does not fit stays unchanged; encoding the message then fails.
    """
    kind = slot.field.type
    if kind.base == "byte":
        if kind.arity is Arity.SCALAR:
            return BYTES[value] if isinstance(value, int) and 0 <= value < 256 else value
        return [BYTES[number] for number in value] if isinstance(value, np.ndarray) else value
    if kind.base == "bool" and isinstance(value, np.ndarray):
        return value.tolist()
    return value if slot.convert is None else slot.convert(value)


class RclpyMeta(type):
    """Base of the metaclasses of message classes; each message class has its own metaclass, as in rclpy."""

    _TYPE_SUPPORT: ClassVar[Any] = None

    def __init__(cls, name: str, bases: tuple[type, ...], namespace: dict[str, Any]) -> None:
        super().__init__(name, bases, namespace)
        if "_TYPE" in namespace:
            type(cls)._TYPE_SUPPORT = namespace["_TYPE"]
        if "_DEFAULTS" in namespace:
            _complete(cls, namespace)

    @classmethod
    def __import_type_support__(cls) -> None:
        """Do nothing, for programs that call this method of rclpy: rclpy loads a C library here, which these classes do
        not need.
        """


def metaclass(name: str, module: str) -> type[RclpyMeta]:
    """Return a new metaclass for the message class `name`, as in rclpy each message class has its own."""
    return type(f"Metaclass_{name}", (RclpyMeta,), {"__module__": module})


def _complete(cls: Any, namespace: dict[str, Any]) -> None:
    """Add properties, defaults and read-only constants to a message class of rclpy's API, from its table of fields."""
    defaults = namespace["_DEFAULTS"]
    fields = cls._TYPE.fields
    cls._SLOTS = {field.py_name: field_slot(cls, field, defaults.get(field.ros_name)) for field in fields}
    for name, one in cls._SLOTS.items():
        setattr(cls, name, property_of(one))
    constants = {name: value for name, value in namespace.items() if name.isupper() and not name.startswith("_")}
    for name, value in constants.items():
        setattr(type(cls), name, property(lambda _, value=value: value))  # type: ignore[misc]
    for field in fields:
        if field.ros_name in defaults:
            name, make = f"{field.ros_name.upper()}__DEFAULT", cls._SLOTS[field.py_name].default
            setattr(cls, name, make())
            setattr(type(cls), name, property(lambda _, make=make: make()))  # type: ignore[misc]
    cls.__slots__ = [*(f"_{name}" for name in cls._SLOTS), "_check_fields"]


class _LazyClassAttribute:
    """Class attribute that is computed at its first use. Thread: any; threads may compute equal values."""

    def __init__(self, name: str, make: Any) -> None:
        self.name = name
        self.make = make

    def __get__(self, instance: object, owner: type) -> Any:
        value = self.make(owner)
        setattr(owner, self.name, value)
        return value


def _slot_types(cls: type[Message]) -> tuple[Any, ...]:
    try:
        types = import_module("rosidl_parser.definition")
    except ImportError:
        types = import_module("rosidl_py_gen.cdr.rclpy_messages.slot_types")
    return tuple(_slot_type(field.type, types) for field in cls._TYPE.fields)


def _slot_type(kind: FieldType, types: Any) -> Any:
    if kind.is_message:
        package, folder, name = kind.base.split("/")
        element = types.NamespacedType([package, folder], name)
    elif kind.primitive is not None:
        element = types.BasicType(kind.primitive.idl)
    else:
        suffix, bound = "WString" if kind.base == "wstring" else "String", kind.string_bound
        element = getattr(types, f"Bounded{suffix}")(bound) if bound else getattr(types, f"Unbounded{suffix}")()
    match kind.arity:
        case Arity.ARRAY:
            return types.Array(element, kind.capacity)
        case Arity.BOUNDED:
            return types.BoundedSequence(element, kind.capacity)
        case Arity.UNBOUNDED:
            return types.UnboundedSequence(element)
        case _:
            return element


class RclpyMessage(Message):
    """Base class of message classes of rclpy's API.

    Fields are passed by name, and assigned values are converted as in rclpy.
    """

    __slots__ = ("_CHECK",)
    __hash__ = None
    _DEFAULTS: ClassVar[dict[str, Any]]
    _SLOTS: ClassVar[dict[str, FieldSlot]]
    _CHECK: bool  # not set in received messages
    SLOT_TYPES: ClassVar[Any] = _LazyClassAttribute("SLOT_TYPES", _slot_types)
    _fields_and_field_types: ClassVar[Any] = _LazyClassAttribute(
        "_fields_and_field_types", lambda cls: {field.ros_name: idl_text(field.type) for field in cls._TYPE.fields}
    )

    def __init__(self, **kwargs: Any) -> None:
        """Set the fields from keyword arguments.

        As in rclpy, an unknown argument is ignored, or raises AssertionError if fields are checked.
        """
        self._CHECK = checked = kwargs.get("check_fields", CHECK)
        if checked and (unknown := sorted(kwargs.keys() - self._SLOTS.keys() - {"check_fields"})):
            raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(unknown)}")
        for name, one in self._SLOTS.items():
            if name not in kwargs:
                one.put(self, one.default())
            else:
                value = kwargs[name]
                setattr(self, name, one.convert(value) if one.convert is not None and one.array_code else value)

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the names of the fields with their IDL types, such as ``sequence<float, 3>``."""
        return dict(cls._fields_and_field_types)

    @property
    def _check_fields(self) -> bool:
        try:
            return self._CHECK
        except AttributeError:
            return CHECK

    @_check_fields.setter
    def _check_fields(self, value: bool) -> None:
        self._CHECK = value

    def _get_plain(self, field: Field) -> Any:
        one = self._SLOTS[field.py_name]
        return to_plain(one, one.get(self))

    def _set_plain(self, field: Field, value: Any) -> None:
        one = self._SLOTS[field.py_name]
        one.put(self, from_plain(one, value))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, self.__class__):
            return False
        return all(_equal(one.get(self), one.get(other)) for one in self._SLOTS.values())

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={_value_repr(one, one.get(self))}" for name, one in self._SLOTS.items())
        package = type(self).__module__.rpartition(".")[0]
        return f"{package}.{type(self).__name__}({inside})"

    def __reduce__(self) -> Any:
        return _restore, (type(self), [one.get(self) for one in self._SLOTS.values()], self._check_fields)


def _restore(cls: type[RclpyMessage], values: list[Any], checked: bool) -> RclpyMessage:
    message = object.__new__(cls)
    message._CHECK = checked
    for one, value in zip(cls._SLOTS.values(), values, strict=True):
        one.put(message, value)
    return message


def _equal(left: Any, right: Any) -> bool:
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return bool(np.array_equal(left, right))
    return bool(left == right)


def _value_repr(one: FieldSlot, value: Any) -> str:
    if one.convert is None or one.field.type.arity is Arity.ARRAY:
        return repr(value)
    return repr(value)[len("array('X', ") : -1] if len(value) else "[]"


class RclpyService(Service[Any, Any]):
    """Base class of service classes of rclpy's API."""

    def __init__(self) -> None:
        raise NotImplementedError("Service classes can not be instantiated")


class RclpyAction(Action[Any, Any, Any]):
    """Base class of action classes of rclpy's API; the nested class `Impl` contains the action's services
    and messages.
    """

    def __init__(self) -> None:
        raise NotImplementedError("Action classes can not be instantiated")
