"""From a dataclass to parameters: names, types, descriptors and conversion of each field.

Decides what an annotation means; only this file reads annotations. Nested dataclasses become dotted names.
Binding them to a store is `classes.py`'s.
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
"""Gets the new value; a text it returns is the reason to refuse it."""


class ParameterClassError(ParameterError, TypeError):
    """The author of a parameter dataclass has to change it; the text names class and field."""


@dataclass(frozen=True, slots=True)
class Range:
    """Allowed values of a number, or of every number of an array, ends included; `step` 0 means any."""

    from_value: float
    to_value: float
    step: float = 0


class ReadOnly:
    """Marks a field that keeps the value it was declared with."""


@dataclass(frozen=True, slots=True)
class Width:
    """How many bits an integer has."""

    bits: int
    signed: bool = True

    @property
    def range(self) -> IntRange:
        """The values that fit; those of an unsigned 64-bit integer end where the int64 on the wire ends."""
        if self.signed:
            return IntRange(-(2 ** (self.bits - 1)), 2 ** (self.bits - 1) - 1)
        return IntRange(0, min(2**self.bits - 1, INT64_MAX))


Int8 = Annotated[int, Width(8)]
Int16 = Annotated[int, Width(16)]
Int32 = Annotated[int, Width(32)]
Int64 = Annotated[int, Width(64)]
UInt8 = Annotated[int, Width(8, signed=False)]
UInt16 = Annotated[int, Width(16, signed=False)]
UInt32 = Annotated[int, Width(32, signed=False)]
UInt64 = Annotated[int, Width(64, signed=False)]


@dataclass(slots=True)
class _AnnotationInfo:
    """What an annotation says, collected while it is peeled."""

    kind: ParameterType | None = None
    container: type[list[Any]] | type[tuple[Any, ...]] | None = None
    optional: bool = False
    enum: type[Enum] | None = None
    choices: tuple[Any, ...] = ()
    metadata: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class ParameterField:
    """One leaf of a parameter dataclass.

    Attributes:
        path: attribute names from the outermost object to the leaf.
        name: the dotted name of the parameter, with the prefix of the whole class.
        choices: the allowed parameter values, empty when any is allowed.
        container: list or tuple for arrays.
    """

    path: tuple[str, ...]
    name: str
    kind: ParameterType
    descriptor: ParameterDescriptor
    optional: bool
    enum: type[Enum] | None
    choices: tuple[Any, ...]
    container: type[list[Any]] | type[tuple[Any, ...]] | None
    validators: tuple[Validator, ...]
    element_range: FloatRange | IntRange | None

    def with_prefix(self, prefix: str) -> ParameterField:
        """A field with `prefix` before its name, dot included."""
        name = prefix + self.name
        return dataclasses.replace(self, name=name, descriptor=dataclasses.replace(self.descriptor, name=name))

    def to_parameter(self, value: Any) -> ParameterValue:
        """The parameter value of a field's value; raises `InvalidParameterValueError` naming the field."""
        if value is None and self.optional:
            return ParameterValue()
        if self.enum is not None and isinstance(value, self.enum):
            value = _enum_plain(self.enum, value)
        elif self.kind is ParameterType.DOUBLE and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)  # A default of 1 for a float is what Python means too.
        elif self.kind is ParameterType.DOUBLE_ARRAY and isinstance(value, (list, tuple)):
            value = [float(item) if type(item) is int else item for item in value]
        try:
            return parameter_value(value, self.kind)
        except InvalidParameterValueError as error:
            raise InvalidParameterValueError(f"parameter {self.name!r}: {error}") from error

    def from_parameter(self, value: ParameterValue) -> Any:
        """The field's value; raises `InvalidParameterValueError` when it is none of the choices."""
        plain = value.value
        if plain is None:
            return None
        if self.choices and plain not in self.choices:
            known = ", ".join(repr(choice) for choice in self.choices)
            raise InvalidParameterValueError(f"Parameter {self.name} must be one of {known}, got {plain!r}")
        if self.enum is not None:
            return _enum_member(self.enum, plain)
        return self.container(plain) if self.container is not None else plain  # type: ignore[arg-type]

    def check(self, value: Any) -> None:
        """Ask validators and ranges of items; other ranges are the descriptor's.

        Raises:
            RefusedError: one of them refused. CallbackAnswerError: a validator answers neither None nor a text.
        """
        if value is None:
            return
        allowed = self.element_range
        if allowed is not None:
            for index, item in enumerate(value):
                name = f"{self.name}[{index}]"
                if isinstance(allowed, IntRange):
                    reason = integer_range_reason(name, item, allowed)
                else:
                    reason = float_range_reason(name, item, allowed)
                if reason:
                    raise RefusedError(reason)
        for validator in self.validators:
            validate(f"the validator of {self.name!r}", validator, value)


def _enum_by_value(enum: type[Enum]) -> bool:
    """Enums whose values are all texts or all integers go by value, others by name."""
    kinds = {type(member.value) for member in enum}
    return len(kinds) == 1 and kinds <= {str, int}


def _enum_plain(enum: type[Enum], member: Enum) -> Any:
    return member.value if _enum_by_value(enum) else member.name


def _enum_member(enum: type[Enum], plain: Any) -> Enum:
    return enum(plain) if _enum_by_value(enum) else enum[plain]


# --------------------------------------------------------------------------------------------------------- planning


def plan_class(cls: type, prefix: tuple[str, ...] = ()) -> tuple[ParameterField, ...]:
    """The leaves of a dataclass in the order of its fields; raises `ParameterClassError`."""
    if not isinstance(cls, type) or not dataclasses.is_dataclass(cls):
        what = (
            f"{cls!r} is an object; give its class" if dataclasses.is_dataclass(cls) else f"{cls!r} is not a dataclass"
        )
        raise ParameterClassError(what)
    try:
        hints = get_type_hints(cls, include_extras=True)
    except NameError as error:
        raise ParameterClassError(
            f"{cls.__name__}: {error}; its annotations must name things that its module has (not local ones)"
        ) from error
    plans: list[ParameterField] = []
    for item in dataclasses.fields(cls):
        if not item.init:
            continue
        if "." in item.name or item.name.startswith("__"):
            raise ParameterClassError(f"{cls.__name__}.{item.name}: this name cannot be a parameter")
        nested = nested_class(cls, item.name)
        if nested is not None:
            plans += plan_class(nested, (*prefix, item.name))
        else:
            plans.append(_plan_field(cls, item.name, hints[item.name], (*prefix, item.name)))
    return tuple(plans)


def nested_class(cls: type, name: str) -> type | None:
    """The dataclass that makes this field a group of parameters, if one does."""
    hint = _hints_without_metadata(cls)[name]
    return hint if isinstance(hint, type) and dataclasses.is_dataclass(hint) else None


_hints_without_metadata = functools.cache(get_type_hints)


def _plan_field(cls: type, name: str, annotation: Any, path: tuple[str, ...]) -> ParameterField:
    where = f"{cls.__name__}.{name}"
    shape = _unwrap_annotation(where, annotation)
    if shape.kind is None:
        raise ParameterClassError(
            f"{where}: {annotation!r} cannot be a parameter; expected bool, int, float, str, bytes, a list of one of "
            "these, Literal, an Enum, a dataclass, or one of these with None"
        )
    dotted = ".".join(path)
    number_range = _range(where, shape)
    choices_text = f"one of: {', '.join(str(choice) for choice in shape.choices)}" if shape.choices else ""
    is_array = shape.kind.is_array
    if is_array and number_range is not None:
        choices_text = f"each from {number_range.from_value} to {number_range.to_value}"
    descriptor = ParameterDescriptor(
        dotted,
        shape.kind,
        next((item for item in shape.metadata if isinstance(item, str)), ""),
        choices_text,
        any(item is ReadOnly or isinstance(item, ReadOnly) for item in shape.metadata),
        floating_point_range=number_range if isinstance(number_range, FloatRange) and not is_array else None,
        integer_range=number_range if isinstance(number_range, IntRange) and not is_array else None,
    )
    return ParameterField(
        path,
        dotted,
        shape.kind,
        descriptor,
        shape.optional,
        shape.enum,
        shape.choices,
        shape.container,
        _validators(where, shape),
        number_range if is_array else None,
    )


def _validators(where: str, shape: _AnnotationInfo) -> tuple[Validator, ...]:
    found = tuple(item for item in shape.metadata if callable(item) and not isinstance(item, type))
    for validator in found:
        try:
            require_plain(validator, "the validator", "the value")
        except TypeError as error:
            raise ParameterClassError(f"{where}: {error}") from error
    return found


def _unwrap_annotation(where: str, annotation: Any) -> _AnnotationInfo:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        shape = _unwrap_annotation(where, arguments[0])
        shape.metadata = (*shape.metadata, *arguments[1:])
        return shape
    if origin in (Union, types.UnionType) and len(arguments) == 2 and type(None) in arguments:
        shape = _unwrap_annotation(where, next(item for item in arguments if item is not type(None)))
        shape.optional = True
        return shape
    if origin is Literal:
        return _AnnotationInfo(kind=_common_kind(where, arguments), choices=arguments)
    if origin is list or (origin is tuple and len(arguments) == 2 and arguments[1] is Ellipsis):
        return _peel_array(where, origin, arguments[0])
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        choices = tuple(_enum_plain(annotation, member) for member in annotation)
        return _AnnotationInfo(kind=_common_kind(where, choices), enum=annotation, choices=choices)
    return _AnnotationInfo(kind=TYPE_OF.get(annotation))


def _peel_array(where: str, container: Any, item: Any) -> _AnnotationInfo:
    inner = _unwrap_annotation(where, item)
    if inner.enum is not None or inner.choices or inner.optional or inner.container is not None:
        return _AnnotationInfo()
    return _AnnotationInfo(kind=ARRAY_OF.get(inner.kind), container=container, metadata=inner.metadata)


def _common_kind(where: str, values: tuple[Any, ...]) -> ParameterType:
    kinds = {TYPE_OF.get(type(value)) for value in values}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind not in (ParameterType.STRING, ParameterType.INTEGER, ParameterType.BOOL):
        raise ParameterClassError(f"{where}: choices must be all str, all int or all bool, got {values!r}")
    return kind


def _range(where: str, shape: _AnnotationInfo) -> FloatRange | IntRange | None:
    given = next((item for item in shape.metadata if isinstance(item, Range)), None)
    width = next((item for item in shape.metadata if isinstance(item, Width)), None)
    integral = shape.kind in (ParameterType.INTEGER, ParameterType.INTEGER_ARRAY)
    real = shape.kind in (ParameterType.DOUBLE, ParameterType.DOUBLE_ARRAY)
    if (given is not None and not (integral or real)) or (width is not None and not integral):
        raise ParameterClassError(f"{where}: a range is for numbers only")
    if given is None:
        return None if width is None or width.range == IntRange(INT64_MIN, INT64_MAX) else width.range
    made = _real_range(given) if real else _integer_range(where, given)
    reason = range_reason(made)
    if reason:
        raise ParameterClassError(f"{where}: {reason}")
    if width is not None and not (
        width.range.from_value <= min(made.from_value, made.to_value)
        and max(made.from_value, made.to_value) <= width.range.to_value
    ):
        raise ParameterClassError(f"{where}: {given!r} does not fit {width!r}")
    return made


def _real_range(given: Range) -> FloatRange:
    try:
        return FloatRange(float(given.from_value), float(given.to_value), float(given.step))
    except (TypeError, ValueError, OverflowError):
        return FloatRange(given.from_value, given.to_value, given.step)  # for `range_reason` to say what is wrong


def _integer_range(where: str, given: Range) -> IntRange:
    try:
        ends = int(given.from_value), int(given.to_value), int(given.step)
        exact = ends == (given.from_value, given.to_value, given.step)
    except (TypeError, ValueError, OverflowError):
        exact = False
    if not exact:
        raise ParameterClassError(f"{where}: the range of an int must have integer ends and step, got {given!r}")
    return IntRange(*ends)
