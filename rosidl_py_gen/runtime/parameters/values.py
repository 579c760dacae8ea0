"""Parameter values, descriptors and errors.

Values are immutable: arrays are tuples, byte arrays are `bytes`. Source: docs/internals/protocol.md 9.2.
"""

from __future__ import annotations

import operator
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, TypeAlias

from rosidl_py_gen.errors import RosidlError

PythonValue = (
    None | bool | int | float | str | bytes | tuple[bool, ...] | tuple[int, ...] | tuple[float, ...] | tuple[str, ...]
)
INT64_MIN, INT64_MAX = -(2**63), 2**63 - 1


class ParameterType(IntEnum):
    """Type of a parameter, with the numbers of rcl_interfaces/ParameterType."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @property
    def is_array(self) -> bool:
        """True for the five array types."""
        return self >= ParameterType.BYTE_ARRAY


class ParameterError(RosidlError):
    """Base class of errors about parameters."""

    source: str = ""
    """File or argument that sets the refused initial value; "" for other errors."""


class InvalidParameterNameError(ParameterError, ValueError):
    """Raised if a parameter cannot have a name."""


class InvalidParameterValueError(ParameterError, ValueError):
    """Raised for an object that cannot be a parameter value, or that the node refuses; the text has the reason."""


class ParameterAlreadyDeclaredError(ParameterError):
    """Raised if a parameter is declared a second time."""


class ParameterNotDeclaredError(ParameterError, LookupError):
    """Raised for undeclared parameters.

    Attributes:
        names: the undeclared parameters; for a remote node all requested parameters, because its response does not
            contain which of them is undeclared or has no value.
    """

    def __init__(self, names: Sequence[str], node: str = "") -> None:
        self.names = tuple(names)
        if node:
            super().__init__(f"at least one of {list(names)} is undeclared or has no value on {node}")
        else:
            super().__init__(f"Invalid access to undeclared parameter(s): {list(names)}")


class ParameterUninitializedError(ParameterError, LookupError):
    """Raised if a parameter is read that is declared but has no value yet."""


class ParameterImmutableError(ParameterError):
    """Raised if a read-only parameter is to be changed or undeclared."""


class WrongParameterTypeError(ParameterError, TypeError):
    """Raised if a parameter has another type than expected."""

    def __init__(self, name: str, expected: str, actual: str) -> None:
        self.name, self.expected, self.actual = name, expected, actual
        super().__init__(f"parameter {name!r} is of type {actual}, expected {expected}")


class ParameterValue(NamedTuple):  # a frozen dataclass would slow down every set
    """Value of a parameter with its type, which `parameter_value` creates from a Python value after checking it."""

    type: ParameterType = ParameterType.NOT_SET
    value: PythonValue = None

    @property
    def is_set(self) -> bool:
        """True if there is a value; False for type NOT_SET."""
        return self.type is not ParameterType.NOT_SET


class Parameter(NamedTuple):
    """Parameter: its name, and its value with type."""

    name: str
    value: ParameterValue = ParameterValue()


ParametersToSet: TypeAlias = "Mapping[str, object] | Iterable[Parameter]"
"""Parameters to set: a dict of names and values, or `Parameter` objects."""


@dataclass(frozen=True, slots=True)
class ParameterEvent:
    """Changes of parameters by one set or declaration.

    Attributes:
        new: parameters that had no value before.
        changed: parameters that had a value before, even an equal one.
        deleted: parameters that have no value afterwards.
    """

    new: tuple[Parameter, ...] = ()
    changed: tuple[Parameter, ...] = ()
    deleted: tuple[Parameter, ...] = ()

    def __bool__(self) -> bool:
        """Return True if the event contains a change."""
        return bool(self.new or self.changed or self.deleted)

    def without(self, names: Iterable[str]) -> ParameterEvent:
        """Return a copy of the event without the parameters of these names."""
        removed = frozenset(names)
        fields = (self.new, self.changed, self.deleted)
        return ParameterEvent(*(tuple(item for item in items if item.name not in removed) for items in fields))


@dataclass(frozen=True, slots=True)
class SetResult:
    """Result of setting one parameter, or several atomically.

    Attributes:
        successful: the values are set.
        reason: reason of a refusal; on success empty unless a callback returned a text.
    """

    successful: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class FloatRange:
    """Allowed values of a parameter of type DOUBLE; `step` 0 allows all values in the range."""

    from_value: float
    to_value: float
    step: float = 0.0


@dataclass(frozen=True, slots=True)
class IntRange:
    """Allowed values of a parameter of type INTEGER; `step` 0 allows all values in the range."""

    from_value: int
    to_value: int
    step: int = 0


@dataclass(frozen=True, slots=True)
class ParameterDescriptor:
    """Description of a parameter, with the fields of rcl_interfaces/ParameterDescriptor."""

    name: str = ""
    type: ParameterType = ParameterType.NOT_SET
    description: str = ""
    additional_constraints: str = ""
    read_only: bool = False
    dynamic_typing: bool = False
    floating_point_range: FloatRange | None = None
    integer_range: IntRange | None = None


TYPE_OF: dict[object, ParameterType] = {
    bool: ParameterType.BOOL,
    int: ParameterType.INTEGER,
    float: ParameterType.DOUBLE,
    str: ParameterType.STRING,
    bytes: ParameterType.BYTE_ARRAY,
}
ARRAY_OF: dict[ParameterType | None, ParameterType] = {
    ParameterType.BOOL: ParameterType.BOOL_ARRAY,
    ParameterType.INTEGER: ParameterType.INTEGER_ARRAY,
    ParameterType.DOUBLE: ParameterType.DOUBLE_ARRAY,
    ParameterType.STRING: ParameterType.STRING_ARRAY,
}


def parameter_value(value: object, kind: ParameterType | None = None) -> ParameterValue:
    """Convert a Python value to a parameter value.

    Accepts None, bool, int, float, str, bytes, lists, tuples, array.array, numpy scalars and arrays, and
    `ParameterValue`. An empty list is a byte array, as in rclpy, unless `kind` is another array type.

    Raises:
        InvalidParameterValueError: the value is of another type, or does not fit `kind`.
    """
    if type(value) in (float, bool, bytes):  # needs no conversion
        result = ParameterValue(TYPE_OF[type(value)], value)  # type: ignore[arg-type]
    elif isinstance(value, ParameterValue):
        if not isinstance(value.type, ParameterType):
            raise InvalidParameterValueError(f"the type of a ParameterValue must be a ParameterType, got {value!r}")
        result = parameter_value(value.value, value.type)
    else:
        plain = _plain(value)
        if kind is not None and kind.is_array and isinstance(plain, tuple) and not plain:
            return ParameterValue(kind, b"" if kind is ParameterType.BYTE_ARRAY else ())
        result = _infer(plain)
    if kind is not None and result.type is not kind:
        raise InvalidParameterValueError(f"{value!r} is of type {result.type.name}, expected {kind.name}")
    return result


def widened(value: ParameterValue, kind: ParameterType) -> ParameterValue:
    """Return a value with its integers converted to doubles, if doubles are declared and represent them exactly.

    ``speed: 2`` in a file, ``-p speed:=2`` and most programs mean 2.0. Doubles are never converted to integers.

    Args:
        value: value, which is returned unchanged if nothing is converted.
        kind: declared type.
    """
    plain = value.value
    if kind is ParameterType.DOUBLE and value.type is ParameterType.INTEGER:
        number = float(plain)  # type: ignore[arg-type]
        return ParameterValue(kind, number) if int(number) == plain else value
    if kind is ParameterType.DOUBLE_ARRAY and value.type is ParameterType.INTEGER_ARRAY:
        numbers = tuple(float(item) for item in plain)  # type: ignore[union-attr]
        return ParameterValue(kind, numbers) if tuple(map(int, numbers)) == plain else value
    return value


def as_parameters(values: ParametersToSet) -> list[Parameter]:
    """Return a list of parameters from a dict of names and values, or from `Parameter` objects, which are checked.

    Raises:
        TypeError: the argument is neither, or a name is not a string.
        InvalidParameterValueError: an object cannot be a parameter value.
    """
    if isinstance(values, Mapping):
        return [_parameter(name, value) for name, value in values.items()]
    if isinstance(values, (str, bytes, Parameter)) or not isinstance(values, Iterable):
        raise TypeError(f"expected a dict of names and values, or a list of Parameter objects, got {values!r}")
    return [checked_parameter(item) for item in values]


def checked_parameter(item: object) -> Parameter:
    """Return a `Parameter` whose type is inferred again from its value.

    Raises:
        TypeError: the object is not a `Parameter` with a `ParameterValue`, or its name is not a string.
        InvalidParameterValueError: value and type do not fit each other.
    """
    if not isinstance(item, Parameter):
        raise TypeError(f"expected Parameter objects or a dict of names and values, got {item!r}")
    if not isinstance(item.value, ParameterValue) or not isinstance(item.value.type, ParameterType):
        raise TypeError(f"the value of a Parameter must be a ParameterValue (see parameter_value), got {item!r}")
    return _parameter(item.name, item.value)


def _parameter(name: object, value: object) -> Parameter:
    try:
        return Parameter(require_name(name), parameter_value(value))
    except InvalidParameterValueError as error:
        raise InvalidParameterValueError(f"parameter {name!r}: {error}") from error


def require_name(name: object, subject: str = "the name of a parameter") -> str:
    """Return a name, which must be a string.

    Raises:
        TypeError: the object is not a string; the text contains `subject`.
    """
    if not isinstance(name, str):
        raise TypeError(f"{subject} must be a str, got {name!r} of type {type(name).__name__}")
    return name


def require_names(names: object, subject: str = "names of parameters") -> list[str]:
    """Return a list of names, which must not be a single string.

    Raises:
        TypeError: the object is not an iterable of strings.
    """
    if isinstance(names, (str, bytes)) or not isinstance(names, Iterable):
        raise TypeError(f"{subject} must be a list of str, got {names!r}")
    return [require_name(name) for name in names]


def as_names(names: str | Sequence[str], subject: str = "names of parameters") -> list[str]:
    """Return a list of names from a single name or several names.

    Raises:
        TypeError: the object is neither a string nor an iterable of strings.
    """
    return require_names([names] if isinstance(names, str) else names, subject)


def _plain(value: object) -> object:
    """Return a value in which objects of numpy and `array.array` are replaced by plain Python values, and sequences by
    tuples.
    """
    if type(value) in (str, int):
        return value
    if isinstance(value, (bytes, bytearray, memoryview)):
        return bytes(value)
    if isinstance(value, array):
        return tuple(value.tolist())
    if hasattr(value, "tolist") and not isinstance(value, type):  # numpy, without importing it
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return tuple(_plain(item) if not isinstance(item, (list, tuple)) else item for item in value)
    return value


def _infer(value: object) -> ParameterValue:
    if value is None:
        return ParameterValue()
    if isinstance(value, bytes):
        return ParameterValue(ParameterType.BYTE_ARRAY, value)
    if isinstance(value, tuple):
        return _infer_array(value)
    kind, plain = _infer_scalar(value)
    return ParameterValue(kind, plain)


def _infer_scalar(value: object) -> tuple[ParameterType, bool | int | float | str]:
    if isinstance(value, str):
        text = str.__str__(value)  # a str enum would not compare or print like a str
        try:
            str.encode(text)
        except UnicodeEncodeError as error:
            reason = f"{error.reason} at character {error.start}"
            raise InvalidParameterValueError(f"{text!r} cannot be encoded as UTF-8: {reason}") from None
        return ParameterType.STRING, text
    if isinstance(value, bool):
        return ParameterType.BOOL, value
    if isinstance(value, int):
        number = operator.index(value)
        if not INT64_MIN <= number <= INT64_MAX:
            raise InvalidParameterValueError(f"{number} does not fit an int64")
        return ParameterType.INTEGER, number
    if isinstance(value, float):
        return ParameterType.DOUBLE, float(value)
    raise InvalidParameterValueError(
        f"{value!r} of type {type(value).__name__} is not a parameter value; expected None, bool, int, float, str, "
        "bytes or a list of one of these types"
    )


def _infer_array(items: tuple[object, ...]) -> ParameterValue:
    if all(isinstance(item, bytes) for item in items):
        joined = b"".join(item for item in items if isinstance(item, bytes))
        if len(joined) != len(items):
            raise InvalidParameterValueError(f"a list of bytes must have one byte in each item, got {list(items)!r}")
        return ParameterValue(ParameterType.BYTE_ARRAY, joined)
    scalars = [_infer_scalar(item) for item in items]
    kinds = {kind for kind, _ in scalars}
    if len(kinds) != 1:
        names = ", ".join(sorted(kind.name for kind in kinds))
        raise InvalidParameterValueError(f"all items of an array must have one type, got {names} in {list(items)!r}")
    return ParameterValue(ARRAY_OF[kinds.pop()], tuple(value for _, value in scalars))  # type: ignore[arg-type]
