"""Objects that show the parameters of a node as attributes of a dataclass.

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
from types import MethodType
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, cast

from rosidl_py_gen.runtime.parameters.callbacks import RefusedError, call_checked, require_plain, validate
from rosidl_py_gen.runtime.parameters.dataclass_fields import ParameterClassError, nested_class, parameter_fields_of
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValueError,
    Parameter,
    ParameterImmutableError,
    ParameterValue,
    require_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.parameters.callbacks import Commit
    from rosidl_py_gen.runtime.parameters.store import ParameterStore

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
