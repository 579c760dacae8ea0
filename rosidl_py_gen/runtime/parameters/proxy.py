"""Parameter objects: what `declare_parameters` returns, typed as the user's dataclass.

A parameter object is a proxy of one complete instance, which every set replaces as a whole: an instance, once seen,
never changes. Assigning to an attribute sets the parameter. Decides what reading, assigning, comparing and copying
mean; what may be set is the binding's business (`classes.py`).

Methods of the class get the proxy, so they may assign; everything else, properties included, is read from the instance.
`isinstance` and the functions of `dataclasses` need the instance itself, of which `snapshot` gives a copy.
"""

from __future__ import annotations

import copy
import dataclasses
import inspect
from types import MethodType
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, cast

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.parameters.dataclass_binding import _ParameterBinding

T = TypeVar("T")


class ParameterProxy:
    """What is at `path` of the binding's current instance; names with underscores leave all others to the user."""

    __slots__ = ("__binding__", "__path__")
    __hash__ = None  # type: ignore[assignment]
    __binding__: _ParameterBinding
    __path__: tuple[str, ...]

    def __init__(self, binding: _ParameterBinding, path: tuple[str, ...] = ()) -> None:
        object.__setattr__(self, "__binding__", binding)
        object.__setattr__(self, "__path__", path)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what copy and the like look for
            raise AttributeError(name)
        path = (*self.__path__, name)
        if path in self.__binding__.groups:
            return ParameterProxy(self.__binding__, path)
        shown = current(self)
        value = getattr(shown, name)
        if inspect.ismethod(value) and value.__self__ is shown:
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
    """The instance behind a parameter object, for reading only; anything else as it is."""
    if not isinstance(value, ParameterProxy):
        return value
    shown = value.__binding__.current
    for part in value.__path__:
        shown = getattr(shown, part)
    return shown


def update_parameters(live: object, **changes: Any) -> None:
    """Set several fields of a parameter object in one atomic step; nested fields as ``left=Motor(...)``.

    Raises as assigning does, and then nothing has changed.
    """
    proxy = _proxy(live)
    proxy.__binding__.set({(*proxy.__path__, name): value for name, value in changes.items()})


def snapshot(live: T) -> T:
    """An independent instance of the class: all values as they were at one moment, in any thread.

    Reading several attributes one after the other may see a set that comes in between; a snapshot cannot.
    """
    return cast("T", copy.deepcopy(current(_proxy(live))))


def _proxy(live: object) -> ParameterProxy:
    if not isinstance(live, ParameterProxy):
        raise TypeError(f"{live!r} is no parameter object; declare_parameters returns one")
    return live


class FixedList(list[Any]):
    """A list that refuses to be changed: that would change neither the parameter nor what others see of it.

    ``drive.tags += ["x"]`` works and sets the parameter; copies are plain lists.
    """

    __slots__ = ()

    def _refuse(self, *arguments: object, **named: object) -> NoReturn:
        raise TypeError(
            "this list shows a parameter and cannot be changed in place; assign a new one, as in "
            "drive.tags = [*drive.tags, 'x'], or take a copy with list(...)"
        )

    append = extend = insert = pop = remove = clear = sort = reverse = _refuse
    __setitem__ = __delitem__ = __imul__ = _refuse

    def __iadd__(self, other: Any) -> Any:  # type: ignore[misc]  # what is assigned then is a plain list
        return [*self, *other]

    def __reduce_ex__(self, protocol: object) -> Any:
        return list, (list(self),)
