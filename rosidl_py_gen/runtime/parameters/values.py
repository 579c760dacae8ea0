"""Parameter values, descriptors and the errors about them.

Decides which Python value is which parameter type (docs/internals/protocol.md 9.2). Values are immutable: arrays are
tuples, byte arrays are `bytes`. Storing and checking is `store.py`, messages are `messages.py`.
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
    """Numbers of rcl_interfaces/ParameterType."""

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
    """The caller asked for something a parameter does not allow."""

    source: str = ""
    """File or argument that the refused initial value is from; empty for other errors."""


class InvalidParameterNameError(ParameterError, ValueError):
    """The caller gave a name a parameter cannot have."""


class InvalidParameterValueError(ParameterError, ValueError):
    """The caller gave a value that is no parameter value, or that the node refused; the text has the reason."""


class ParameterAlreadyDeclaredError(ParameterError):
    """The caller declared a parameter a second time."""


class ParameterNotDeclaredError(ParameterError, LookupError):
    """The caller used parameters that nobody declared; `names` lists them all.

    Another node (`node`) does not say which of the `names` it was asked for it does not have, nor whether one is only
    unset.
    """

    def __init__(self, names: Sequence[str], node: str = "") -> None:
        self.names = tuple(names)
        if node:
            super().__init__(f"at least one of {list(names)} is undeclared or has no value on {node}")
        else:
            super().__init__(f"Invalid access to undeclared parameter(s): {list(names)}")


class ParameterUninitializedError(ParameterError, LookupError):
    """The caller read a parameter that is declared but has no value yet."""


class ParameterImmutableError(ParameterError):
    """The caller tried to change or undeclare a read-only parameter."""


class WrongParameterTypeError(ParameterError, TypeError):
    """A parameter has another type than asked for; the text names both."""

    def __init__(self, name: str, expected: str, actual: str) -> None:
        self.name, self.expected, self.actual = name, expected, actual
        super().__init__(f"parameter {name!r} is of type {actual}, expected {expected}")


class ParameterValue(NamedTuple):  # like Parameter made so often that a frozen dataclass would show in every set
    """A value with its type; make one with `parameter_value`, which checks that they fit."""

    type: ParameterType = ParameterType.NOT_SET
    value: PythonValue = None

    @property
    def is_set(self) -> bool:
        """False for NOT_SET."""
        return self.type is not ParameterType.NOT_SET


class Parameter(NamedTuple):
    """A name with a value."""

    name: str
    value: ParameterValue = ParameterValue()


ParametersToSet: TypeAlias = "Mapping[str, object] | Iterable[Parameter]"
"""Names with values, or `Parameter` objects."""


@dataclass(frozen=True, slots=True)
class ParameterEvent:
    """What one set or declaration did.

    Attributes:
        new: had no value before.
        changed: had one before, even an equal one.
        deleted: have none any more.
    """

    new: tuple[Parameter, ...] = ()
    changed: tuple[Parameter, ...] = ()
    deleted: tuple[Parameter, ...] = ()

    def __bool__(self) -> bool:
        """False when nothing has a place in it."""
        return bool(self.new or self.changed or self.deleted)

    def without(self, names: Iterable[str]) -> ParameterEvent:
        """A copy without these parameters."""
        gone = frozenset(names)
        parts = (self.new, self.changed, self.deleted)
        return ParameterEvent(*(tuple(item for item in part if item.name not in gone) for part in parts))


@dataclass(frozen=True, slots=True)
class SetResult:
    """The answer to one set request; `reason` is empty on success unless a callback gave one."""

    successful: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class FloatRange:
    """Allowed values of a DOUBLE; `step` 0 means any value between the ends."""

    from_value: float
    to_value: float
    step: float = 0.0


@dataclass(frozen=True, slots=True)
class IntRange:
    """Allowed values of an INTEGER; `step` 0 means any value between the ends."""

    from_value: int
    to_value: int
    step: int = 0


@dataclass(frozen=True, slots=True)
class ParameterDescriptor:
    """What a node says about a parameter; fields of rcl_interfaces/ParameterDescriptor."""

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
    """Turn a Python value into a parameter value.

    Accepts None, bool, int, float, str, bytes, lists, tuples, array.array and numpy scalars and arrays. An empty list
    is a byte array, as in rclpy, unless `kind` names the array type. Raises `InvalidParameterValueError`, for a
    `ParameterValue` whose type and value do not fit too.
    """
    if type(value) in (float, bool, bytes):  # each is a parameter value as it is
        made = ParameterValue(TYPE_OF[type(value)], value)  # type: ignore[arg-type]
    elif isinstance(value, ParameterValue):
        if not isinstance(value.type, ParameterType):
            raise InvalidParameterValueError(f"the type of a ParameterValue must be a ParameterType, got {value!r}")
        made = parameter_value(value.value, value.type)
    else:
        plain = _plain(value)
        if kind is not None and kind.is_array and isinstance(plain, tuple) and not plain:
            return ParameterValue(kind, b"" if kind is ParameterType.BYTE_ARRAY else ())
        made = _infer(plain)
    if kind is not None and made.type is not kind:
        if made.value == b"" and kind.is_array:
            return ParameterValue(kind, ())
        raise InvalidParameterValueError(f"{value!r} is of type {made.type.name}, expected {kind.name}")
    return made


def widened(value: ParameterValue, kind: ParameterType) -> ParameterValue:
    """Whole numbers as doubles, where doubles are declared and hold them exactly; everything else as it is.

    ``speed: 2`` in a file, ``-p speed:=2`` and most programs mean 2.0. The other way is never gone.
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
    """Raises `TypeError` for what is neither, `InvalidParameterValueError` for a value that is no parameter value."""
    if isinstance(values, Mapping):
        return [_parameter(name, value) for name, value in values.items()]
    if isinstance(values, (str, bytes, Parameter)) or not isinstance(values, Iterable):
        raise TypeError(f"expected a dict of names and values, or a list of Parameter objects, got {values!r}")
    return [checked_parameter(item) for item in values]


def checked_parameter(item: object) -> Parameter:
    """A parameter as users make them, once type and value are known to fit.

    Raises `TypeError` for what is none, `InvalidParameterValueError`.
    """
    if not isinstance(item, Parameter):
        raise TypeError(f"expected Parameter objects, found {item!r}; a dict of names and values will do too")
    if not isinstance(item.value, ParameterValue) or not isinstance(item.value.type, ParameterType):
        raise TypeError(f"the value of a Parameter must be a ParameterValue, as parameter_value makes it, got {item!r}")
    return _parameter(item.name, item.value)


def _parameter(name: object, value: object) -> Parameter:
    try:
        return Parameter(require_name(name), parameter_value(value))
    except InvalidParameterValueError as error:
        raise InvalidParameterValueError(f"parameter {name!r}: {error}") from error


def require_name(name: object, what: str = "a parameter's name") -> str:
    """Raises `TypeError` for what is no text."""
    if not isinstance(name, str):
        raise TypeError(f"{what} must be a text, got {name!r} of type {type(name).__name__}")
    return name


def require_names(names: object, what: str = "names of parameters") -> list[str]:
    """A list of texts; raises `TypeError` for anything else, a single text included."""
    if isinstance(names, (str, bytes)) or not isinstance(names, Iterable):
        raise TypeError(f"{what} must be given as a list of texts, got {names!r}")
    return [require_name(name) for name in names]


def as_prefixes(prefixes: str | Sequence[str]) -> list[str]:
    """One prefix or several; raises `TypeError` for what is no text."""
    return require_names([prefixes] if isinstance(prefixes, str) else prefixes, "prefixes")


def _plain(value: object) -> object:
    """Replace numpy and array.array values by plain ones, sequences by tuples."""
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
        # str() drops the class of str enums and the like, which would not compare or print as plain text.
        return ParameterType.STRING, _utf8(str.__str__(value))
    if isinstance(value, bool):
        return ParameterType.BOOL, value
    if isinstance(value, int):
        return ParameterType.INTEGER, _int64(value)
    if isinstance(value, float):
        return ParameterType.DOUBLE, float(value)
    raise InvalidParameterValueError(
        f"{value!r} of type {type(value).__name__} is no parameter value; expected None, bool, int, float, str, bytes "
        "or a list of one of these types"
    )


def _utf8(text: str) -> str:
    if not text.isascii():
        try:
            str.encode(text)
        except UnicodeEncodeError as error:
            raise InvalidParameterValueError(
                f"{text!r} cannot be sent: {error.reason} at character {error.start}"
            ) from None
    return text


def _int64(value: object) -> int:
    number = operator.index(value)  # type: ignore[arg-type]
    if not INT64_MIN <= number <= INT64_MAX:
        raise InvalidParameterValueError(f"{number} does not fit an int64")
    return number


def _infer_array(items: tuple[object, ...]) -> ParameterValue:
    if all(isinstance(item, bytes) for item in items):
        joined = b"".join(item for item in items if isinstance(item, bytes))
        if len(joined) != len(items):
            raise InvalidParameterValueError(f"a list of bytes must have one byte per item, got {list(items)!r}")
        return ParameterValue(ParameterType.BYTE_ARRAY, joined)
    found = [_infer_scalar(item) for item in items]
    kinds = {kind for kind, _ in found}
    if len(kinds) != 1:
        names = ", ".join(sorted(kind.name for kind in kinds))
        raise InvalidParameterValueError(f"all items of an array must have one type, got {names} in {list(items)!r}")
    return ParameterValue(ARRAY_OF[kinds.pop()], tuple(value for _, value in found))  # type: ignore[arg-type]
