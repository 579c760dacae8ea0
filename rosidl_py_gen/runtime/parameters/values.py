"""Parameter values, descriptors and errors, and the validation of names, descriptors and values.

Values are immutable: arrays are tuples, byte arrays are `bytes`. The functions that validate have no side effects.
Functions with names ``…_reason`` return the reason against a value, or "". Reasons against setting a value are sent to
other nodes, and equal the texts of rclpy literally.
Source: docs/internals/protocol.md 9.2 to 9.4.
"""

from __future__ import annotations

import functools
import math
import operator
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar, get_type_hints

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


# ----------------------------------------------------------------------------------------------------------- validation

NumberT = TypeVar("NumberT", int, float, covariant=True)

SEPARATOR = "."
DEPTH_RECURSIVE = 0
RELATIVE_TOLERANCE = 1e-6
"""Relative distance up to which a double counts as equal to an end or step of a range."""
UNDECLARED_REASON = "Static parameter cannot be undeclared"
EMPTY_LIST_REASON = (
    "parameter list cannot be empty, this might be due to "
    "pre_set_parameters_callback modifying the original parameters list."
)


def refusal_reason(parameter: Parameter, descriptor: ParameterDescriptor, *, declaring: bool = False) -> str:
    """Return the reason why a parameter cannot be set, by its descriptor; "" if it can.

    Args:
        parameter: name and new value.
        descriptor: declared type, range and others.
        declaring: the value is of a declaration, so a read-only parameter may be set, and may have no value.
    """
    name, value = parameter.name, parameter.value
    if descriptor.read_only and not declaring:
        return read_only_reason(name)
    if not descriptor.dynamic_typing and descriptor.type is not ParameterType.NOT_SET:
        if not value.is_set:
            return "" if declaring else UNDECLARED_REASON
        if value.type is not descriptor.type:
            return type_reason(descriptor.type.name, value.type.name)
    if value.type is ParameterType.INTEGER and descriptor.integer_range is not None:
        assert isinstance(value.value, int)
        return integer_range_reason(name, value.value, descriptor.integer_range)
    if value.type is ParameterType.DOUBLE and descriptor.floating_point_range is not None:
        assert isinstance(value.value, float)
        return float_range_reason(name, value.value, descriptor.floating_point_range)
    return ""


def read_only_reason(name: str) -> str:
    """Return the reason for refusing to set a read-only parameter, with the text of rclpy."""
    return f"Trying to set a read-only parameter: {name}."


def type_reason(expected: str, found: str) -> str:
    """Return the reason for refusing a value of another type, with the text of rclpy."""
    return f"Wrong parameter type, expected 'Type.{expected}' got 'Type.{found}'"


class _Range(Protocol[NumberT]):
    """Type of a range of numbers: a class of this package, or a message of rcl_interfaces."""

    @property
    def from_value(self) -> NumberT: ...
    @property
    def to_value(self) -> NumberT: ...
    @property
    def step(self) -> NumberT: ...


def integer_range_reason(name: str, value: int, allowed: _Range[int]) -> str:
    """Return the reason why an integer is not in a range; "" if it is an end of the range, or a step inside it."""
    low, high = min(allowed.from_value, allowed.to_value), max(allowed.from_value, allowed.to_value)
    if value in (low, high):
        return ""
    if not low < value < high:
        return f"Parameter {name} out of range. Min: {low}, Max: {high}, value: {value}"
    if allowed.step != 0 and (value - low) % allowed.step != 0:
        return (
            f"The parameter value for {name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return ""


def float_range_reason(name: str, value: float, allowed: _Range[float]) -> str:
    """Return the reason why a double is not in a range.

    Returns "" if it is in the range, with a tolerance of 1e-6 at the ends and steps. If steps cannot be counted,
    because they are too small or the range has no lower end, every value counts as being on a step.
    """
    low, high = min(allowed.from_value, allowed.to_value), max(allowed.from_value, allowed.to_value)
    if any(math.isclose(value, end, rel_tol=RELATIVE_TOLERANCE) for end in (low, high)):
        return ""
    if not low < value < high:
        return f"Parameter {name} out of range Min: {low}, Max: {high}, value: {value}"
    steps = (value - low) / allowed.step if allowed.step != 0.0 else math.inf
    if math.isfinite(steps):
        nearest = low + round(steps) * allowed.step
        if not math.isclose(nearest, value, rel_tol=RELATIVE_TOLERANCE):
            return (
                f"The parameter value for {name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return ""


def name_reason(name: object) -> str:
    """Return the reason why a parameter cannot have a name; "" if it can."""
    if isinstance(name, str) and name and (name.isascii() or name.encode("utf-8", "ignore").decode() == name):
        return ""
    return f"the name of a parameter must be a str that is not empty, got {name!r}"


def range_reason(allowed: FloatRange | IntRange | None) -> str:
    """Return the reason why the range of a descriptor is invalid or cannot be sent; "" if it is valid or None."""
    if allowed is None:
        return ""
    numbers = (allowed.from_value, allowed.to_value, allowed.step)
    if isinstance(allowed, IntRange):
        fits = all(isinstance(number, int) and INT64_MIN <= number <= INT64_MAX for number in numbers)
        if not fits or allowed.step < 0:
            return f"{allowed!r} must have 64-bit integers and a step >= 0"
        return ""
    if not all(isinstance(number, (int, float)) and _fits_float(number) for number in numbers):
        return f"{allowed!r} must have numbers as its ends and step"
    if allowed.step != 0 and (math.isinf(min(allowed.from_value, allowed.to_value)) or math.isinf(allowed.step)):
        return f"{allowed!r} has a step, so its step and lower end must be finite"
    return ""


def _fits_float(number: float) -> bool:
    try:
        return not math.isnan(number)
    except OverflowError:
        return False


@dataclass(frozen=True, slots=True)
class ListParametersResult:
    """Names of parameters in the order of declaration, and their groups."""

    names: tuple[str, ...]
    prefixes: tuple[str, ...]


def list_names(names: Iterable[str], prefixes: Sequence[str], depth: int) -> ListParametersResult:
    """Return the names, with their groups, that a list_parameters request selects (docs/internals/protocol.md 9.3).

    Args:
        names: names of all parameters.
        prefixes: groups whose parameters are selected; empty: all parameters.
        depth: maximum number of parts of a name below the prefix; 0 is unlimited.
    """
    selected = tuple(name for name in names if _is_listed(name, prefixes, depth))
    groups = dict.fromkeys(name.rpartition(SEPARATOR)[0] for name in selected if SEPARATOR in name)
    return ListParametersResult(selected, tuple(groups))


def _is_listed(name: str, prefixes: Sequence[str], depth: int) -> bool:
    if not prefixes:
        return depth == DEPTH_RECURSIVE or name.count(SEPARATOR) < depth
    for prefix in prefixes:
        if name == prefix:
            return True
        if name.startswith(prefix + SEPARATOR):
            rest = name[len(prefix) + 1 :]
            if depth == DEPTH_RECURSIVE or rest.count(SEPARATOR) < depth:
                return True
    return False


@functools.cache
def _descriptor_types() -> dict[str, Any]:
    return get_type_hints(ParameterDescriptor)


def checked_descriptor(name: str, descriptor: ParameterDescriptor) -> ParameterDescriptor:
    """Return the descriptor of a parameter with the parameter's name in it.

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid.
    """
    if not isinstance(descriptor, ParameterDescriptor):
        raise TypeError(f"parameter {name!r}: the descriptor must be a ParameterDescriptor, got {descriptor!r}")
    for attribute, kind in _descriptor_types().items():
        value = getattr(descriptor, attribute)
        if not isinstance(value, kind):
            expected = ParameterDescriptor.__annotations__[attribute]
            raise TypeError(f"parameter {name!r}: {attribute} of the descriptor must be a {expected}, got {value!r}")
    if reason := range_reason(descriptor.floating_point_range) or range_reason(descriptor.integer_range):
        raise InvalidParameterValueError(f"parameter {name!r}: {reason}")
    return replace(descriptor, name=name)


def declared_descriptor(
    name: str, default: ParameterValue, descriptor: ParameterDescriptor | None
) -> ParameterDescriptor:
    """Return the descriptor of a declared parameter; if it has no type, it gets the type of the default.

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid, or there is no type.
        WrongParameterTypeError: the default has another type than the descriptor.
    """
    descriptor = checked_descriptor(name, descriptor or ParameterDescriptor())
    default = coerce_empty_list(default, descriptor)
    if descriptor.dynamic_typing:
        return descriptor
    kind = default.type if descriptor.type is ParameterType.NOT_SET else descriptor.type
    if kind is ParameterType.NOT_SET:
        raise InvalidParameterValueError(
            f"parameter {name!r} has no type; pass a default, or a descriptor with a type or with dynamic_typing"
        )
    if default.is_set and default.type is not kind:
        raise WrongParameterTypeError(name, kind.name, default.type.name)
    return replace(descriptor, type=kind)


def apply_descriptor(
    before: ParameterDescriptor, value: ParameterValue, descriptor: ParameterDescriptor, alternative: ParameterValue
) -> tuple[ParameterDescriptor, Parameter, str]:
    """Apply a new descriptor to a parameter, without storing anything.

    The value is retained if it fits, else replaced by the alternative, if there is one. A descriptor without a type
    gets the type of the parameter.

    Args:
        before: current descriptor.
        value: current value.
        descriptor: new descriptor.
        alternative: new value if the current value does not fit; NOT_SET if there is none.

    Returns:
        new descriptor, parameter with its new value, and the reason why they do not fit, or "".

    Raises:
        TypeError: the descriptor, or one of its fields, has the wrong type.
        InvalidParameterValueError: a range is invalid.
    """
    descriptor = checked_descriptor(before.name, descriptor)
    if descriptor.type is ParameterType.NOT_SET and not descriptor.dynamic_typing:
        descriptor = replace(descriptor, type=before.type)
    parameter = Parameter(before.name, coerce_empty_list(value, descriptor))
    reason = refusal_reason(parameter, descriptor, declaring=True)
    if reason and alternative.is_set:
        value = coerce_empty_list(alternative, descriptor)
        value = value if descriptor.dynamic_typing else widened(value, descriptor.type)
        parameter = Parameter(before.name, value)
        reason = refusal_reason(parameter, descriptor, declaring=True)
    if descriptor.dynamic_typing:
        descriptor = replace(descriptor, type=parameter.value.type)
    return descriptor, parameter, reason


def coerce_empty_list(value: ParameterValue, descriptor: ParameterDescriptor) -> ParameterValue:
    """Return an empty list, whose element type is unknown in YAML and Python, as the declared array type.

    Other values are returned unchanged.
    """
    if descriptor.type.is_array and value.type.is_array and not value.value:
        return parameter_value((), descriptor.type)
    return value
