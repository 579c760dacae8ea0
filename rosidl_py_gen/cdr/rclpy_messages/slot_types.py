"""Classes of the package `rosidl_parser.definition` that occur in the `SLOT_TYPES` of rclpy's message classes.

Names, attributes, bases and equality are the same. Without the real package, the import hook provides this module under
its name; the parser itself is not included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(slots=True, repr=False)
class AbstractType:
    """Base class of all types of fields in `SLOT_TYPES`; two types are equal if their class and attributes
    are equal.
    """


@dataclass(slots=True, repr=False)
class AbstractNestableType(AbstractType):
    """Base of types that may be elements of an array or sequence."""


@dataclass(slots=True, repr=False)
class BasicType(AbstractNestableType):
    """Field type of a number, boolean, octet or character; `typename` is its name in IDL, such as ``double``."""

    typename: str


@dataclass(slots=True, repr=False)
class NamedType(AbstractNestableType):
    """Type that is known by its name alone, without package."""

    name: str


@dataclass(slots=True, repr=False)
class NamespacedType(AbstractNestableType):
    """Field type of a message; `namespaces` has its package and kind (``msg``)."""

    namespaces: Sequence[str]
    name: str

    def namespaced_name(self) -> tuple[str, ...]:
        return (*self.namespaces, self.name)


@dataclass(slots=True, repr=False)
class AbstractGenericString(AbstractNestableType):
    """Base of all string types."""

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


@dataclass(slots=True, repr=False)
class AbstractString(AbstractGenericString):
    """Base of string types of 8-bit characters."""


@dataclass(slots=True, repr=False)
class BoundedString(AbstractString):
    maximum_size: int


class UnboundedString(AbstractString):
    __slots__ = ()


@dataclass(slots=True, repr=False)
class AbstractWString(AbstractGenericString):
    """Base of string types of 16-bit characters."""


@dataclass(slots=True, repr=False)
class BoundedWString(AbstractWString):
    maximum_size: int


class UnboundedWString(AbstractWString):
    __slots__ = ()


@dataclass(slots=True, repr=False)
class AbstractNestedType(AbstractType):
    """Base of array and sequence types; `value_type` is the type of the elements."""

    value_type: AbstractNestableType

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


@dataclass(slots=True, repr=False)
class Array(AbstractNestedType):
    size: int


@dataclass(slots=True, repr=False)
class AbstractSequence(AbstractNestedType):
    """Base class of the sequence types of fields, bounded or not."""


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
