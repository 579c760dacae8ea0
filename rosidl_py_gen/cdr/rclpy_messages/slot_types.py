"""Classes of `rosidl_parser.definition` that the `SLOT_TYPES` of rclpy's messages consist of.

Names, attributes, bases and equality are the same. Without the real package, the import hook provides this module under
its name; the parser itself is not included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(slots=True, repr=False)
class AbstractType:
    """Base of all types; two are equal if class and attributes are."""


@dataclass(slots=True, repr=False)
class AbstractNestableType(AbstractType):
    """Type that may be an element of an array or sequence."""


@dataclass(slots=True, repr=False)
class BasicType(AbstractNestableType):
    """Number, boolean, octet or character; `typename` is its name in IDL, such as ``double``."""

    typename: str


@dataclass(slots=True, repr=False)
class NamedType(AbstractNestableType):
    """Type known by its name alone."""

    name: str


@dataclass(slots=True, repr=False)
class NamespacedType(AbstractNestableType):
    """Message; `namespaces` are package and kind."""

    namespaces: Sequence[str]
    name: str

    def namespaced_name(self) -> tuple[str, ...]:
        return (*self.namespaces, self.name)


@dataclass(slots=True, repr=False)
class AbstractGenericString(AbstractNestableType):
    """Base of all strings."""

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


@dataclass(slots=True, repr=False)
class AbstractString(AbstractGenericString):
    """String of 8-bit characters."""


@dataclass(slots=True, repr=False)
class BoundedString(AbstractString):
    maximum_size: int


class UnboundedString(AbstractString):
    __slots__ = ()


@dataclass(slots=True, repr=False)
class AbstractWString(AbstractGenericString):
    """String of 16-bit characters."""


@dataclass(slots=True, repr=False)
class BoundedWString(AbstractWString):
    maximum_size: int


class UnboundedWString(AbstractWString):
    __slots__ = ()


@dataclass(slots=True, repr=False)
class AbstractNestedType(AbstractType):
    """Array or sequence of `value_type`."""

    value_type: AbstractNestableType

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


@dataclass(slots=True, repr=False)
class Array(AbstractNestedType):
    size: int


@dataclass(slots=True, repr=False)
class AbstractSequence(AbstractNestedType):
    """Sequence, bounded or not."""


@dataclass(slots=True, repr=False)
class BoundedSequence(AbstractSequence):
    maximum_size: int


class UnboundedSequence(AbstractSequence):
    __slots__ = ()


def _has_maximum_size(subject: AbstractType) -> bool:
    name = type(subject).__name__
    if name.startswith("Abstract"):
        raise NotImplementedError(f"{name} is abstract")
    return not name.startswith("Unbounded")
