"""Names, types, descriptors and conversions of the parameters of a dataclass, from its annotations.

Fields of nested dataclasses get dotted names.
"""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from rosidl_py_gen.runtime.parameters.callbacks import RefusedError, require_plain, validate
from rosidl_py_gen.runtime.parameters.validation import float_range_reason, integer_range_reason, range_reason
from rosidl_py_gen.runtime.parameters.values import (
    ARRAY_OF,
    INT64_MAX,
    INT64_MIN,
    TYPE_OF,
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    ParameterDescriptor,
    ParameterError,
    ParameterType,
    ParameterValue,
    parameter_value,
)

Validator = Callable[[Any], "str | None"]
"""Function that takes the new value of a field or object, and returns None, or the reason to refuse the value."""


class ParameterClassError(ParameterError, TypeError):
    """Raised for a dataclass whose fields cannot be parameters; the text names class and field."""


@dataclass(frozen=True, slots=True)
class Range:
    """Annotation of a field: allowed values of a number, or of each number of an array.

    Attributes:
        from_value: lowest value.
        to_value: highest value.
        step: distance between allowed values; 0 allows all values in the range.
    """

    from_value: float
    to_value: float
    step: float = 0


class ReadOnly:
    """Annotation of a field whose parameter is read-only: it keeps the value of its declaration."""


Int8 = Annotated[int, IntRange(-(2**7), 2**7 - 1)]
"""Integer from -128 to 127, as the type of a field of a parameter class."""
Int16 = Annotated[int, IntRange(-(2**15), 2**15 - 1)]
"""Integer from -32768 to 32767, as the type of a field of a parameter class."""
Int32 = Annotated[int, IntRange(-(2**31), 2**31 - 1)]
"""Integer from -2147483648 to 2147483647, as the type of a field of a parameter class."""
Int64 = Annotated[int, IntRange(INT64_MIN, INT64_MAX)]
"""Integer from -2^63 to 2^63 - 1, as the type of a field of a parameter class."""
UInt8 = Annotated[int, IntRange(0, 2**8 - 1)]
"""Integer from 0 to 255, as the type of a field of a parameter class."""
UInt16 = Annotated[int, IntRange(0, 2**16 - 1)]
"""Integer from 0 to 65535, as the type of a field of a parameter class."""
UInt32 = Annotated[int, IntRange(0, 2**32 - 1)]
"""Integer from 0 to 4294967295, as the type of a field of a parameter class."""
UInt64 = Annotated[int, IntRange(0, INT64_MAX)]
"""Integer from 0 to 2^63 - 1, the largest integer parameter, as the type of a field of a parameter class."""


@dataclass(frozen=True, slots=True)
class FieldAnnotation:
    """Parsed annotation of a field of a parameter dataclass.

    Attributes:
        kind: type of the parameter; None for a type that no parameter can have.
        container: list or tuple for arrays.
        optional: the parameter may have no value (None).
        enum: Enum class of the field.
        choices: allowed parameter values; empty if all are allowed.
        metadata: further arguments of `Annotated`.
    """

    kind: ParameterType | None = None
    container: type[list[Any]] | type[tuple[Any, ...]] | None = None
    optional: bool = False
    enum: type[Enum] | None = None
    choices: tuple[Any, ...] = ()
    metadata: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class ParameterField:
    """Field of a parameter dataclass that is one parameter.

    Attributes:
        path: attribute names from the outermost object to the field.
        annotation: parsed annotation.
        descriptor: descriptor of the parameter.
        validators: functions that may refuse a value.
        element_range: range of each element of an array.
    """

    path: tuple[str, ...]
    annotation: FieldAnnotation
    descriptor: ParameterDescriptor
    validators: tuple[Validator, ...]
    element_range: FloatRange | IntRange | None

    @property
    def name(self) -> str:
        """Dotted name of the parameter, such as ``left.speed`` for a nested field."""
        return self.descriptor.name

    @property
    def kind(self) -> ParameterType:
        """Type of the parameter."""
        return self.descriptor.type

    def to_parameter(self, value: Any) -> ParameterValue:
        """Convert a value of the field, such as an Enum member, to a parameter value.

        Raises:
            InvalidParameterValueError: the value does not fit; the text contains the name of the parameter.
        """
        if value is None and self.annotation.optional:
            return ParameterValue()
        if self.annotation.enum is not None and isinstance(value, self.annotation.enum):
            value = _enum_plain(self.annotation.enum, value)
        elif self.kind is ParameterType.DOUBLE and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)  # as Python, accept an int for a float
        elif self.kind is ParameterType.DOUBLE_ARRAY and isinstance(value, (list, tuple)):
            value = [float(item) if type(item) is int else item for item in value]
        try:
            return parameter_value(value, self.kind)
        except InvalidParameterValueError as error:
            raise InvalidParameterValueError(f"parameter {self.name!r}: {error}") from error

    def from_parameter(self, value: ParameterValue) -> Any:
        """Convert a parameter value to a value of the field, such as an Enum member.

        Raises:
            InvalidParameterValueError: the value is not one of the field's choices.
        """
        plain = value.value
        if plain is None:
            return None
        if self.annotation.choices and plain not in self.annotation.choices:
            choices = ", ".join(repr(choice) for choice in self.annotation.choices)
            raise InvalidParameterValueError(f"Parameter {self.name} must be one of {choices}, got {plain!r}")
        if self.annotation.enum is not None:
            return self.annotation.enum(plain) if _enum_by_value(self.annotation.enum) else self.annotation.enum[plain]  # type: ignore[index]
        return self.annotation.container(plain) if self.annotation.container is not None else plain  # type: ignore[arg-type]

    def check(self, value: Any) -> None:
        """Check the range of each element of an array, and call the field's validators; the store checks all else.

        Raises:
            RefusedError: an element is out of range, or a validator refuses the value or raises.
            CallbackAnswerError: a validator returned something else than None or a reason.
        """
        if value is None:
            return
        allowed = self.element_range
        if allowed is not None:
            for index, item in enumerate(value):
                range_check: Any = integer_range_reason if isinstance(allowed, IntRange) else float_range_reason
                if reason := range_check(f"{self.name}[{index}]", item, allowed):
                    raise RefusedError(reason)
        for validator in self.validators:
            validate(f"the validator of {self.name!r}", validator, value)


def _enum_by_value(enum: type[Enum]) -> bool:
    """Return True if members of an Enum are stored as parameters by their values (all str, or all int), and not by
    their names.
    """
    kinds = {type(member.value) for member in enum}
    return len(kinds) == 1 and kinds <= {str, int}


def _enum_plain(enum: type[Enum], member: Enum) -> Any:
    return member.value if _enum_by_value(enum) else member.name


def parameter_fields_of(cls: type, prefix: str = "", path: tuple[str, ...] = ()) -> list[ParameterField]:
    """Return the parameters of a dataclass in the order of its fields, fields of nested dataclasses included.

    Args:
        cls: dataclass.
        prefix: prepended to the names of parameters.
        path: attributes that lead to the dataclass, if it is nested.

    Raises:
        ParameterClassError: the class is not a dataclass, or a field cannot be a parameter.
    """
    if not isinstance(cls, type) or not dataclasses.is_dataclass(cls):
        raise ParameterClassError(
            f"{cls!r} is an object; pass its class" if dataclasses.is_dataclass(cls) else f"{cls!r} is not a dataclass"
        )
    try:
        hints = get_type_hints(cls, include_extras=True)
    except NameError as error:
        raise ParameterClassError(
            f"{cls.__name__}: {error}; its annotations must only use names of its module (no local names)"
        ) from error
    parameters: list[ParameterField] = []
    for item in dataclasses.fields(cls):
        if not item.init:
            continue
        if "." in item.name or item.name.startswith("__"):
            raise ParameterClassError(f"{cls.__name__}.{item.name}: this name cannot be a parameter")
        nested = nested_class(cls, item.name)
        if nested is not None:
            parameters += parameter_fields_of(nested, prefix, (*path, item.name))
        else:
            parameters.append(_plan_field(cls, hints[item.name], prefix, (*path, item.name)))
    return parameters


def nested_class(cls: type, name: str) -> type | None:
    """Return the dataclass that is the type of a field, which then is a group of parameters; None for other types."""
    hint = _hints_without_metadata(cls)[name]
    return hint if isinstance(hint, type) and dataclasses.is_dataclass(hint) else None


_hints_without_metadata = functools.cache(get_type_hints)


def _plan_field(cls: type, annotation: Any, prefix: str, path: tuple[str, ...]) -> ParameterField:
    location = f"{cls.__name__}.{path[-1]}"
    info = _unwrap_annotation(location, annotation)
    if info.kind is None:
        raise ParameterClassError(
            f"{location}: {annotation!r} cannot be a parameter; expected bool, int, float, str, bytes, a list of one "
            "of these, Literal, an Enum, a dataclass, or one of these with None"
        )
    number_range = _range(location, info)
    constraints = f"one of: {', '.join(str(choice) for choice in info.choices)}" if info.choices else ""
    element_range = None
    if info.kind.is_array and number_range is not None:
        element_range, number_range = number_range, None
        constraints = f"each from {element_range.from_value} to {element_range.to_value}"
    descriptor = ParameterDescriptor(
        prefix + ".".join(path),
        info.kind,
        next((item for item in info.metadata if isinstance(item, str)), ""),
        constraints,
        any(item is ReadOnly or isinstance(item, ReadOnly) for item in info.metadata),
        floating_point_range=number_range if isinstance(number_range, FloatRange) else None,
        integer_range=number_range if isinstance(number_range, IntRange) else None,
    )
    return ParameterField(path, info, descriptor, _validators(location, info), element_range)


def _validators(location: str, info: FieldAnnotation) -> tuple[Validator, ...]:
    validators = tuple(item for item in info.metadata if callable(item) and not isinstance(item, type))
    for validator in validators:
        try:
            require_plain(validator, "the validator", "the value")
        except TypeError as error:
            raise ParameterClassError(f"{location}: {error}") from error
    return validators


def _unwrap_annotation(location: str, annotation: Any) -> FieldAnnotation:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        info = _unwrap_annotation(location, arguments[0])
        return dataclasses.replace(info, metadata=(*info.metadata, *arguments[1:]))
    if origin in (Union, types.UnionType) and len(arguments) == 2 and type(None) in arguments:
        other = next(item for item in arguments if item is not type(None))
        return dataclasses.replace(_unwrap_annotation(location, other), optional=True)
    if origin is Literal:
        return FieldAnnotation(kind=_common_kind(location, arguments), choices=arguments)
    if origin is list or (origin is tuple and len(arguments) == 2 and arguments[1] is Ellipsis):
        return _array_info(location, origin, arguments[0])
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        choices = tuple(_enum_plain(annotation, member) for member in annotation)
        return FieldAnnotation(kind=_common_kind(location, choices), enum=annotation, choices=choices)
    return FieldAnnotation(kind=TYPE_OF.get(annotation))


def _array_info(location: str, container: Any, item: Any) -> FieldAnnotation:
    inner = _unwrap_annotation(location, item)
    if inner.enum is not None or inner.choices or inner.optional or inner.container is not None:
        return FieldAnnotation()
    return FieldAnnotation(kind=ARRAY_OF.get(inner.kind), container=container, metadata=inner.metadata)


def _common_kind(location: str, values: tuple[Any, ...]) -> ParameterType:
    kinds = {TYPE_OF.get(type(value)) for value in values}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind not in (ParameterType.STRING, ParameterType.INTEGER, ParameterType.BOOL):
        raise ParameterClassError(f"{location}: choices must be all str, all int or all bool, got {values!r}")
    return kind


def _range(location: str, info: FieldAnnotation) -> FloatRange | IntRange | None:
    requested = next((item for item in info.metadata if isinstance(item, Range)), None)
    width = next((item for item in info.metadata if isinstance(item, IntRange)), None)  # of Int8 and the like
    integral = info.kind in (ParameterType.INTEGER, ParameterType.INTEGER_ARRAY)
    real = info.kind in (ParameterType.DOUBLE, ParameterType.DOUBLE_ARRAY)
    if (requested is not None and not (integral or real)) or (width is not None and not integral):
        raise ParameterClassError(f"{location}: a range is for numbers only")
    if requested is None:
        return None if width == IntRange(INT64_MIN, INT64_MAX) else width
    result = _convert_range(location, requested, float if real else int)
    if reason := range_reason(result):
        raise ParameterClassError(f"{location}: {reason}")
    ends = result.from_value, result.to_value
    if width is not None and not width.from_value <= min(ends) <= max(ends) <= width.to_value:
        raise ParameterClassError(f"{location}: {requested!r} does not fit {width!r}")
    return result


def _convert_range(location: str, requested: Range, kind: type[float]) -> FloatRange | IntRange:
    numbers = requested.from_value, requested.to_value, requested.step
    try:
        converted = tuple(map(kind, numbers))
    except (TypeError, ValueError, OverflowError):
        converted = ()
    if kind is float and converted:
        return FloatRange(*converted)
    if converted == numbers:
        return IntRange(*map(int, converted))
    rule = "a float must have numbers as its ends" if kind is float else "an int must have integer ends"
    raise ParameterClassError(f"{location}: the range of {rule} and step, got {requested!r}")
