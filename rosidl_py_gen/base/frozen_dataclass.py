"""Frozen dataclasses for modules that every program loads."""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError, dataclass, fields
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_):
        return lambda function: function


T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def frozen_dataclass(cls: type[T]) -> type[T]:
    """Return what ``dataclass(frozen=True, slots=True)`` returns, in a third of the time.

    `dataclass` compiles six methods for each class, and this compiles one. Fields have no options but defaults.
    """
    made: Any = dataclass(init=False, repr=False, eq=False, slots=True)(cls)
    names = tuple(one.name for one in fields(made))
    get: Callable[[Any], tuple[Any, ...]] = attrgetter("__class__", *names)  # with one name, it would return no tuple

    def refuse(self: Any, name: str, *value: Any) -> None:
        if type(self) is made or name in names:
            raise FrozenInstanceError(f"cannot {'assign to' if value else 'delete'} field {name!r}")
        (object.__setattr__ if value else object.__delattr__)(self, name, *value)

    def is_equal(self: Any, other: Any) -> bool:
        return get(self) == get(other) if other.__class__ is self.__class__ else NotImplemented

    @recursive_repr()
    def text(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def restore(self: Any, state: Any) -> None:
        for name, value in zip(names, state, strict=True):
            object.__setattr__(self, name, value)

    methods = {
        "__init__": _init(made),
        "__repr__": text,
        "__eq__": is_equal,
        "__hash__": lambda self: hash(get(self)),
        "__setattr__": refuse,
        "__delattr__": refuse,
        "__getstate__": lambda self: [getattr(self, name) for name in names],
        "__setstate__": restore,
    }
    for name, method in methods.items():
        if name not in cls.__dict__:
            method.__name__, method.__qualname__ = name, f"{made.__qualname__}.{name}"
            setattr(made, name, method)
    made.__dataclass_params__.frozen = made.__dataclass_params__.eq = made.__dataclass_params__.repr = True
    return made  # type: ignore[no-any-return]


def _init(cls: Any) -> Any:
    scope: dict[str, Any] = {"_MISSING": MISSING}
    parameters, body = ["self"], []
    for one in fields(cls):
        name, value = one.name, one.name
        scope[f"_set_{name}"] = getattr(cls, name).__set__
        if one.default is not MISSING:
            scope[f"_default_{name}"] = one.default
            parameters.append(f"{name}=_default_{name}")
        elif one.default_factory is not MISSING:
            scope[f"_make_{name}"] = one.default_factory
            parameters.append(f"{name}=_MISSING")
            value = f"_make_{name}() if {name} is _MISSING else {name}"
        else:
            parameters.append(name)
        body.append(f" _set_{name}(self, {value})")
    if hasattr(cls, "__post_init__"):
        body.append(" self.__post_init__()")
    exec("\n".join([f"def __init__({', '.join(parameters)}):", *(body or [" pass"])]), scope)
    init = scope["__init__"]
    init.__module__ = cls.__module__
    init.__annotations__ = {**{one.name: one.type for one in fields(cls)}, "return": None}
    return init
