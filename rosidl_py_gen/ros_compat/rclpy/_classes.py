"""Parts of classes: a base that accepts type arguments, such as ``Publisher[String]``, and attributes that accept only
values of certain types.
"""

from __future__ import annotations

from collections.abc import Callable
from types import GenericAlias
from typing import Any, Generic, TypeVar, overload


class Subscriptable:
    """Base of a class that accepts type arguments, without effect; classes of rclpy are generic since Kilted."""

    def __class_getitem__(cls, arguments: Any) -> Any:
        return GenericAlias(cls, arguments)


_T = TypeVar("_T")


def checked_attribute(name: str, value: _T, member: str) -> _T:
    """Return a value that a program stores in an attribute of rclpy.

    Raise TypeError if the value has no attribute `member`.
    """
    if hasattr(value, member):
        return value
    text = f"{name} is an attribute of rclpy, and {value!r:.100} has no {member!r}"
    raise TypeError(f"{text}: give the program's own attribute another name")


class Checked(Generic[_T]):
    """Descriptor of a field that is stored in the slot `_name`; setting a value of another type raises AssertionError.

    Args:
        kinds: accepted types.
        convert: conversion of the value. [default: none]
    """

    def __init__(self, *kinds: type, convert: Callable[[Any], _T] | None = None) -> None:
        self._kinds, self._convert = kinds, convert

    def __set_name__(self, owner: type, name: str) -> None:
        self._name, self._slot = name, f"_{name}"

    @overload
    def __get__(self, instance: None, owner: type) -> Checked[_T]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> _T: ...
    def __get__(self, instance: object, owner: type) -> Any:
        return self if instance is None else getattr(instance, self._slot)

    def __set__(self, instance: object, value: _T | int | dict[str, Any]) -> None:
        if not isinstance(value, self._kinds):
            expected = " or ".join(kind.__name__ for kind in self._kinds)
            raise AssertionError(f"{self._name} must be {expected}, got {value!r:.100}")
        setattr(instance, self._slot, value if self._convert is None else self._convert(value))
