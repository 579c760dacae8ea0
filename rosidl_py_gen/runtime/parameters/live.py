"""Live objects: instances of a user's dataclass whose fields show what a parameter store holds.

Every read looks into one complete object that a set replaces as a whole, so no reader, in whatever thread, finds new
values beside old ones in it; `plain` copies that object. Decides what reading, writing, deleting, comparing and copying
a live object means; what may be set is the binding's business (`classes.py`).

A field with ``init=False`` is no parameter. If the class has a `__post_init__`, such fields are what that computes from
the present parameters; without one they are ordinary attributes of the live object.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol, get_type_hints

_PLACE = "_rosidl_place"
_ORDER = ("__lt__", "__le__", "__gt__", "__ge__")


class Binding(Protocol):
    """What ties a live object to a store."""

    current: Any
    """The complete object that is shown; never changed, only replaced."""

    def set(self, path: tuple[str, ...], value: Any) -> None:
        """Set the parameters at or below `path`; raises when they are refused."""


@dataclass(slots=True)
class _Place:
    """Where a live object is: below `path` of what its binding shows."""

    binding: Binding
    path: tuple[str, ...]
    children: dict[str, Any]
    own: dict[str, Any]

    def shown(self, root: Any) -> Any:
        for part in self.path:
            root = getattr(root, part)
        return root


class FixedList(list[Any]):
    """A list that refuses to be changed: that would change neither the parameter nor what others see of it.

    ``drive.tags += ["x"]`` works and sets the parameter; every kind of copy is a plain list.
    """

    __slots__ = ()

    def __new__(cls, items: Any = ()) -> Any:
        """A plain list: whoever makes a list of the same class wants a copy, `dataclasses.asdict` for one."""
        return list(items)

    @classmethod
    def of(cls, items: Any) -> FixedList:
        """The only way to make one."""
        made: FixedList = list.__new__(cls)
        list.extend(made, items)
        return made

    def _refuse(self, *arguments: object, **named: object) -> NoReturn:
        raise TypeError(
            "this list shows a parameter and cannot be changed in place; assign a new one, as in "
            "drive.tags = [*drive.tags, 'x'], or take a copy with list(...)"
        )

    append = extend = insert = pop = remove = clear = sort = reverse = _refuse
    __setitem__ = __delitem__ = __imul__ = _refuse

    def __iadd__(self, other: Any) -> Any:  # type: ignore[misc]  # what is assigned then is a plain list
        return [*self, *other]

    def __copy__(self) -> list[Any]:
        return list(self)

    def __deepcopy__(self, memo: object) -> list[Any]:
        return list(self)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return list, (list(self),)


def make_live(cls: type, source: Any, binding: Binding, path: tuple[str, ...] = ()) -> Any:
    """A live object of `cls`; ordinary attributes begin with the values they have in `source`."""
    live: Any = object.__new__(_live_class(cls))
    place = _Place(binding, path, {}, {})
    for item in dataclasses.fields(cls):
        value = getattr(source, item.name)
        if is_nested(cls, item):
            place.children[item.name] = make_live(hints_of(cls)[item.name], value, binding, (*path, item.name))
        elif not _is_shown(cls, item):
            place.own[item.name] = value
    object.__setattr__(live, _PLACE, place)
    return live


def place_of(live: object) -> tuple[Any, tuple[str, ...]]:
    """Binding and path of a live object; raises `TypeError` for other objects."""
    place = _place(live)
    if place is None:
        raise TypeError(f"{live!r} is no live parameter object; declare_parameters returns one")
    return place.binding, place.path


def plain(value: Any) -> Any:
    """What is live as an independent object of the user's own class, consistent in itself; anything else as it is."""
    if isinstance(value, FixedList):
        return list(value)
    place = _place(value)
    return value if place is None else _plain_copy(value, place.shown(place.binding.current))


def _plain_copy(live: Any, shown: Any) -> Any:
    place: _Place = live.__dict__[_PLACE]
    made = copy.deepcopy(shown)
    for name, child in place.children.items():
        object.__setattr__(made, name, _plain_copy(child, getattr(shown, name)))
    for name, value in place.own.items():
        object.__setattr__(made, name, copy.deepcopy(value))
    return made


def _place(value: object) -> _Place | None:
    found: _Place | None = getattr(value, "__dict__", {}).get(_PLACE)
    return found


@functools.cache
def hints_of(cls: type) -> dict[str, Any]:
    """What the annotations mean, without `Annotated`."""
    return get_type_hints(cls)


def is_nested(cls: type, item: dataclasses.Field[Any]) -> bool:
    """Whether the field is a group of parameters."""
    hint = hints_of(cls)[item.name]
    return item.init and isinstance(hint, type) and dataclasses.is_dataclass(hint)


def _is_shown(cls: type, item: dataclasses.Field[Any]) -> bool:
    return item.init or hasattr(cls, "__post_init__")


# ------------------------------------------------------------------------------------------------------ live classes


@functools.cache
def _live_class(cls: Any) -> type:
    members: dict[str, Any] = {
        "__doc__": cls.__doc__,
        "__module__": cls.__module__,
        "__qualname__": cls.__qualname__,
        "__new__": functools.partial(_new, cls),
        "__getattr__": _missing_attribute,
        "__delattr__": _delete_attribute,
        "__reduce_ex__": lambda self, protocol: (_itself, (plain(self),)),
        "__copy__": plain,
        "__deepcopy__": lambda self, memo: plain(self),
        "__hash__": None,
        "__eq__": _compared("__eq__"),
    }
    if cls.__eq__ is object.__eq__:
        members |= {"__eq__": object.__eq__, "__hash__": object.__hash__}
    members |= {name: _compared(name) for name in _ORDER if getattr(cls, name) is not getattr(object, name)}
    if not cls.__dataclass_params__.frozen:
        members["__setattr__"] = _set_attribute
    for name in dir(cls):
        if isinstance(inspect.getattr_static(cls, name), functools.cached_property):
            members[name] = property(_shown_reader(name))  # cached in the object shown, so as fresh as that
    for item in dataclasses.fields(cls):
        members[item.name] = property(_reader(cls, item))
    return type(cls.__name__, (cls,), members)


def _reader(cls: type, item: dataclasses.Field[Any]) -> Any:
    name = item.name
    if is_nested(cls, item):
        return lambda live: live.__dict__[_PLACE].children[name]
    if not _is_shown(cls, item):
        return lambda live: live.__dict__[_PLACE].own[name]
    return _shown_reader(name)


def _shown_reader(name: str) -> Any:
    def read(live: Any) -> Any:
        place: _Place = live.__dict__[_PLACE]
        shown = place.binding.current
        for part in place.path:
            shown = getattr(shown, part)
        return getattr(shown, name)

    return read


def _new(base: Any, live_class: type, *arguments: Any, **named: Any) -> Any:
    """Calling the class of a live object, as `dataclasses.replace` does, gives a plain object."""
    return base(*map(plain, arguments), **{name: plain(value) for name, value in named.items()})


def _compared(name: str) -> Any:
    def compare(live: Any, other: Any) -> Any:
        left = plain(live)
        return getattr(left, name)(plain(other))

    compare.__name__ = name
    return compare


def _missing_attribute(live: Any, name: str) -> Any:
    """What `__post_init__` left besides the fields."""
    place = _place(live)
    if place is None or name.startswith("__"):
        raise AttributeError(f"{type(live).__name__!r} object has no attribute {name!r}")
    return getattr(place.shown(place.binding.current), name)


def _set_attribute(live: Any, name: str, value: Any) -> None:
    place: _Place = live.__dict__[_PLACE]
    field = next((item for item in dataclasses.fields(live) if item.name == name), None)
    if field is None:
        if not hasattr(type(getattr(type(live), name, None)), "__set__"):
            raise AttributeError(f"{type(live).__name__} has no field {name!r}")
        object.__setattr__(live, name, value)  # a property of the user's class
    elif field.init:
        place.binding.set((*place.path, name), value)
    elif name in place.own:
        place.own[name] = value
    else:
        raise AttributeError(f"{type(live).__name__}.{name} is computed by __post_init__ and cannot be set")


def _delete_attribute(live: Any, name: str) -> None:
    raise AttributeError(f"{name!r} of a live {type(live).__name__} cannot be deleted; it shows a parameter")


def _itself(value: Any) -> Any:
    return value
