"""Base classes of messages, services and actions that behave like the classes of a ROS installation.

Source: the message classes that rosidl_generator_py of Jazzy generates; `tests/peers/rclpy_messages` compares both.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.message import Action, Field, Message, Service
from rosidl_py_gen.cdr.rclpy_messages.fields import (
    CHECK,
    IDL_NAMES,
    FieldSlot,
    field_slot,
    from_plain,
    idl_text,
    property_of,
    to_plain,
)

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType


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
    elif kind.is_string:
        suffix, bound = "WString" if kind.base == "wstring" else "String", kind.string_bound
        element = getattr(types, f"Bounded{suffix}")(bound) if bound else getattr(types, f"Unbounded{suffix}")()
    else:
        element = types.BasicType(IDL_NAMES.get(kind.base, kind.base))
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
