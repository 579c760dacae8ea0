"""Parameter objects, which `declare_parameters` returns, typed as the user's dataclass.

A parameter object is a proxy of one immutable instance, which each set replaces. Assigning to an attribute sets the
parameter. Methods of the class get the proxy as `self`, so they may assign; all else, properties included, is read from
the instance. `isinstance` and the functions of `dataclasses` need an instance, which `snapshot` returns.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
from types import MethodType
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, cast

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.parameters.dataclass_binding import _ParameterBinding

T = TypeVar("T")


class ParameterProxy:
    """Proxy of the object at `path` of the binding's current instance. Its own names cannot be names of fields."""

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
    """Return the instance of a parameter object, which must not be changed, or the value itself if it is none."""
    if not isinstance(value, ParameterProxy):
        return value
    return follow(value.__binding__.current, value.__path__)


def follow(value: Any, path: tuple[str, ...]) -> Any:
    """Return the object at a path of attribute names."""
    return functools.reduce(getattr, path, value)


def update_parameters(parameter_object: object, /, **changes: Any) -> None:
    """Set several fields of a parameter object atomically; nested fields as ``left=Motor(...)``.

    Raises as assigning does; then nothing has changed.
    """
    proxy = _proxy(parameter_object)
    proxy.__binding__.set({(*proxy.__path__, name): value for name, value in changes.items()})


def snapshot(parameter_object: T) -> T:
    """Return a copy of the instance, with all values of one moment. Thread: any."""
    return cast("T", copy.deepcopy(current(_proxy(parameter_object))))


def _proxy(live: object) -> ParameterProxy:
    if not isinstance(live, ParameterProxy):
        raise TypeError(f"expected a parameter object of declare_parameters, got {live!r}")
    return live


class FixedList(list[Any]):
    """List that raises if it is changed in place, which would not set the parameter.

    ``drive.tags += ["x"]`` sets the parameter; copies are plain lists.
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
