"""Parameters of a node as attributes of a dataclass: fields from its annotations, and the objects that show the values.

Names, types, descriptors and conversions come from the annotations. Fields of nested dataclasses get dotted names.

`bind_class` declares each field of a dataclass as a parameter, and returns a parameter object, typed as the dataclass,
whose attributes always have the current values. The parameter object is a proxy of one immutable instance of the
dataclass. New values are checked on a new complete instance, which then replaces the current instance, so neither is
ever partially updated. Assigning to an attribute sets the parameter. Methods of the class get the proxy as `self`, so
they may assign; all else, properties included, is read from the instance. `isinstance` and the functions of
`dataclasses` need an instance, which `snapshot` returns.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
import types
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import MethodType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NoReturn,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from rosidl_py_gen.runtime.parameters.store import RefusedError, call_checked, require_plain, validate
from rosidl_py_gen.runtime.parameters.values import (
    ARRAY_OF,
    INT64_MAX,
    INT64_MIN,
    TYPE_OF,
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterError,
    ParameterImmutableError,
    ParameterType,
    ParameterValue,
    float_range_reason,
    integer_range_reason,
    parameter_value,
    range_reason,
    require_name,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.parameters.store import Commit, ParameterStore

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


# -------------------------------------------------------------------------------------------------------------- objects

T = TypeVar("T")


class ParameterProxy:
    """Parameter object: proxy of an immutable dataclass instance, which is replaced when parameters are set.

    With `path`, the proxy represents the nested object at this path of attributes. Attributes of the proxy itself have
    names that fields cannot have.
    """

    __slots__ = ("__binding__", "__path__")
    __hash__ = None  # type: ignore[assignment]
    __binding__: _ParameterBinding
    __path__: tuple[str, ...]

    def __init__(self, binding: _ParameterBinding, path: tuple[str, ...] = ()) -> None:
        object.__setattr__(self, "__binding__", binding)
        object.__setattr__(self, "__path__", path)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # such as the hooks of `copy`
            raise AttributeError(name)
        path = (*self.__path__, name)
        if path in self.__binding__.groups:
            return ParameterProxy(self.__binding__, path)
        instance = current(self)
        value = getattr(instance, name)
        if inspect.ismethod(value) and value.__self__ is instance:
            return MethodType(value.__func__, self)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        cls: Any = type(current(self))
        attribute = getattr(cls, name, None)
        if isinstance(attribute, property):
            attribute.__set__(self, value)
        elif cls.__dataclass_params__.frozen:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        else:
            update_parameters(self, **{name: value})

    def __eq__(self, other: object) -> bool:
        return bool(current(self) == current(other))

    def __repr__(self) -> str:
        return repr(current(self))

    def __dir__(self) -> list[str]:
        return dir(current(self))

    def __reduce_ex__(self, protocol: object) -> Any:
        return copy.copy, (snapshot(self),)


def current(value: Any) -> Any:
    """Return the current dataclass instance of a parameter object, which must not be changed.

    Returns other values unchanged.
    """
    if not isinstance(value, ParameterProxy):
        return value
    return follow(value.__binding__.current, value.__path__)


def follow(value: Any, path: tuple[str, ...]) -> Any:
    """Return the object that is reached from `value` by a path of attribute names."""
    return functools.reduce(getattr, path, value)


def update_parameters(parameter_object: object, /, **changes: Any) -> None:
    """Set several fields of a parameter object atomically; nested fields as ``left=Motor(...)``.

    Raises:
        ParameterImmutableError: a parameter is read-only; nothing has changed.
        InvalidParameterValueError: a value is refused; nothing has changed.
        AttributeError: there is no such field.
        TypeError: `parameter_object` is not a parameter object, or a nested value is not of its class.
    """
    proxy = _proxy(parameter_object)
    proxy.__binding__.set({(*proxy.__path__, name): value for name, value in changes.items()})


def snapshot(parameter_object: T) -> T:
    """Return a copy of a parameter object as a plain dataclass instance, with all values of one moment. Thread: any.

    Raises:
        TypeError: the argument is not a parameter object.
    """
    return cast("T", copy.deepcopy(current(_proxy(parameter_object))))


def _proxy(live: object) -> ParameterProxy:
    if not isinstance(live, ParameterProxy):
        raise TypeError(f"expected a parameter object of declare_parameters, got {live!r}")
    return live


class FixedList(list[Any]):
    """Value of a list field of a parameter object; raises `TypeError` if the program changes the list in place.

    Such a change would not set the parameter, but ``drive.tags += ["x"]`` does; copies are plain lists.
    """

    __slots__ = ()

    def _refuse(self, *arguments: object, **named: object) -> NoReturn:
        raise TypeError(
            "this list is the value of a parameter and cannot be changed in place; assign a new one, as in "
            "drive.tags = [*drive.tags, 'x'], or copy it with list(...)"
        )

    append = extend = insert = pop = remove = clear = sort = reverse = _refuse
    __setitem__ = __delitem__ = __imul__ = _refuse

    def __iadd__(self, other: Any) -> Any:  # type: ignore[misc]  # assigns a plain list
        return [*self, *other]

    def __reduce_ex__(self, protocol: object) -> Any:
        return list, (list(self),)


class _ParameterBinding:
    """Connection of one parameter object (of `declare_parameters`) to the parameters of a node."""

    def __init__(self, store: ParameterStore, cls: type, prefix: str, validator: Callable[[Any], str | None] | None):
        self.store = store
        self.cls = cls
        self.validator = validator
        self.fields = {field.name: field for field in parameter_fields_of(cls, prefix)}
        self.groups = frozenset(field.path[:end] for field in self.fields.values() for end in range(1, len(field.path)))
        self.values: dict[str, ParameterValue] = {}
        self.current: Any = None

    # Order of a set: on-set callbacks, prepare, store, commit, event, post-set callbacks.

    def prepare(self, changes: Mapping[str, ParameterValue]) -> Commit | None:
        """Check changed parameter values on a new instance of the dataclass.

        Returns:
            A function that makes the new instance the current one; None if no value belongs to the dataclass.

        Raises:
            RefusedError: a validator refuses the values, or their types differ from the fields' types.
        """
        own = {name: value for name, value in changes.items() if name in self.fields}
        if not own and self.current is not None:
            return None
        self._refuse_other_types(own)
        values = {**self.values, **own}
        instance = self._create_instance(values, own)

        def commit() -> None:
            self.values, self.current = values, instance

        return commit

    def _refuse_other_types(self, values: Mapping[str, ParameterValue]) -> None:
        """Raise `RefusedError` if a value has another type than its field, as after the parameter was undeclared and
        declared again.
        """
        for name, value in values.items():
            field = self.fields[name]
            if value.type is not field.kind and (value.is_set or not field.annotation.optional):
                attribute = f"{self.cls.__name__}.{'.'.join(field.path)}"
                raise RefusedError(f"it is bound to {attribute} of type {field.kind.name}, not {value.type.name}")

    def _create_instance(self, values: Mapping[str, ParameterValue], changed: Mapping[str, ParameterValue]) -> Any:
        """Return a new instance of the dataclass, after the validators of the `changed` fields and of the class.

        Raises:
            RefusedError: a validator, or the constructor of the dataclass, refuses a value.
        """
        try:
            plain = {name: field.from_parameter(values[name]) for name, field in self.fields.items()}
        except InvalidParameterValueError as error:
            raise RefusedError(str(error)) from None
        for name in changed:
            self.fields[name].check(plain[name])
        instance = _build(self.cls, {field.path: plain[name] for name, field in self.fields.items()})
        if self.validator is not None:
            validate(f"the validator of {self.cls.__name__}", self.validator, instance)
        for name, field in self.fields.items():
            # Undo all changes that the class or the validator made to the fields.
            value = field.from_parameter(values[name])
            value = FixedList(value) if isinstance(value, list) else value
            object.__setattr__(follow(instance, field.path[:-1]), field.path[-1], value)
        return instance

    def set(self, changes: Mapping[tuple[str, ...], Any]) -> None:
        """Set the parameters that belong to the given attribute paths of the dataclass.

        Raises:
            ParameterImmutableError: a parameter is read-only.
            InvalidParameterValueError: a value is refused.
            AttributeError: there is no field at a path.
        """
        parameters = [item for path, value in changes.items() for item in self._parameters(path, current(value))]
        result = self.store.set_atomically(parameters)
        if result.successful:
            return
        if any(descriptor.read_only for descriptor in self.store.describe_all([item.name for item in parameters])):
            raise ParameterImmutableError(result.reason)
        raise InvalidParameterValueError(result.reason)

    def _parameters(self, path: tuple[str, ...], value: Any) -> list[Parameter]:
        """Return the parameters of the field at an attribute path; a nested dataclass has one for each field below.

        Their values are `value`, or the attributes of `value`.
        """
        if path in self.groups:
            _require_instance(".".join(path), value, type(follow(self.current, path)))
        fields = [field for field in self.fields.values() if field.path[: len(path)] == path]
        if not fields:
            raise AttributeError(f"{self.cls.__name__} has no parameter {'.'.join(path)!r}")
        return [Parameter(field.name, field.to_parameter(follow(value, field.path[len(path) :]))) for field in fields]


def _build(cls: Any, values: Mapping[tuple[str, ...], Any]) -> Any:
    """Create an instance of a dataclass, nested dataclasses included, from a value for each attribute path.

    Raises:
        RefusedError: a constructor raised.
    """
    arguments = {path[0]: value for path, value in values.items() if len(path) == 1}
    for name in dict.fromkeys(path[0] for path in values if len(path) > 1):
        nested = {path[1:]: value for path, value in values.items() if path[0] == name}
        arguments[name] = _build(nested_class(cls, name), nested)
    try:
        return call_checked(f"{cls.__name__}(...)", lambda: cls(**arguments))
    except RefusedError as refusal:
        if isinstance(refusal.__cause__, ValueError):  # raised by __post_init__ with the reason
            raise RefusedError(str(refusal.__cause__) or f"{cls.__name__} refused the values") from None
        raise


def _require_instance(subject: str, value: object, expected: type) -> None:
    """Raise `TypeError` unless a value and its nested dataclasses are instances of the expected classes."""
    if not isinstance(value, expected):
        raise TypeError(
            f"{subject} must be an object of {expected.__name__}, got {value!r} of type {type(value).__name__}"
        )
    for item in dataclasses.fields(expected):
        nested = nested_class(expected, item.name)
        if nested is not None and item.init:
            _require_instance(f"{subject}.{item.name}", getattr(value, item.name), nested)


def bind_class(
    store: ParameterStore,
    cls: type[T],
    *,
    prefix: str = "",
    initial: T | None = None,
    validator: Callable[[T], str | None] | None = None,
) -> T:
    """Declare the fields of a dataclass as parameters, and return the parameter object (see `Node.declare_parameters`).

    Events and post-set callbacks follow after all declarations. The field of an undeclared parameter keeps its last
    value until the parameter is declared again, with the same type.
    """
    require_name(prefix, "the prefix")
    binding = _ParameterBinding(store, cls, f"{prefix}." if prefix else "", validator)
    if validator is not None:
        require_plain(validator, "the validator", "the new instance")
    source = _default_source(cls, initial)
    with store.declare_batch() as declared:
        values = {}
        for name, field in binding.fields.items():
            default = field.to_parameter(follow(source, field.path))
            values[name] = store.declare(name, default, field.descriptor, optional=field.annotation.optional)
            declared.append(name)
        # Callbacks may have set some of them.
        values |= {name: value for name, value in store.values().items() if name in values}
        try:
            commit = binding.prepare(values)
        except RefusedError as refusal:
            reason = f"the parameters of {cls.__name__} cannot be declared: {refusal}"
            raise InvalidParameterValueError(reason) from refusal.__cause__
        assert commit is not None
        commit()
        store.callbacks.add("bound-object", binding.prepare)
    return cast("T", ParameterProxy(binding))


def _default_source(cls: type[T], initial: T | None) -> T:
    if initial is None:
        for item in dataclasses.fields(cls):  # type: ignore[arg-type]  # checked by parameter_fields_of
            if item.init and item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
                raise ParameterClassError(f"{cls.__name__}.{item.name} has no default; add one, or pass initial=")
        return cls()
    source: T = current(initial)
    _require_instance("initial", source, cls)
    return source
