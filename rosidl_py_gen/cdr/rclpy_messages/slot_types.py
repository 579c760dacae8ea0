"""The classes of `rosidl_parser.definition` that the `SLOT_TYPES` of rclpy's messages are made of.

Same names, attributes, bases and equality. Where the real package is not there, the import hook gives this file under
its name. Nothing else of that package is here: it is a parser, and needs one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn


class AbstractType:
    """The base of all types; two are equal when class and attributes are."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._values() == other._values()

    __hash__ = None  # type: ignore[assignment]

    def _values(self) -> list[object]:
        return [getattr(self, name) for cls in type(self).__mro__ for name in getattr(cls, "__slots__", ())]


class AbstractNestableType(AbstractType):
    """What may be an element of an array or sequence."""

    __slots__ = ()


class BasicType(AbstractNestableType):
    """A number, boolean, octet or character; `typename` is that of IDL, such as ``double``."""

    __slots__ = ("typename",)

    def __init__(self, typename: str) -> None:
        self.typename = typename


class NamedType(AbstractNestableType):
    """A type known by its name alone."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name


class NamespacedType(AbstractNestableType):
    """A message; `namespaces` are package and kind."""

    __slots__ = ("name", "namespaces")

    def __init__(self, namespaces: Sequence[str], name: str) -> None:
        self.namespaces = namespaces
        self.name = name

    def namespaced_name(self) -> tuple[str, ...]:
        return (*self.namespaces, self.name)


class AbstractGenericString(AbstractNestableType):
    """Any string."""

    __slots__ = ()

    def has_maximum_size(self) -> bool:
        _only_below(self)


class AbstractString(AbstractGenericString):
    """A string of 8-bit characters."""

    __slots__ = ()


class BoundedString(AbstractString):
    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class UnboundedString(AbstractString):
    __slots__ = ()

    def has_maximum_size(self) -> bool:
        return False


class AbstractWString(AbstractGenericString):
    """A string of 16-bit characters."""

    __slots__ = ()


class BoundedWString(AbstractWString):
    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class UnboundedWString(AbstractWString):
    __slots__ = ()

    def has_maximum_size(self) -> bool:
        return False


class AbstractNestedType(AbstractType):
    """An array or a sequence of `value_type`."""

    __slots__ = ("value_type",)

    def __init__(self, value_type: AbstractNestableType) -> None:
        self.value_type = value_type

    def has_maximum_size(self) -> bool:
        _only_below(self)


class Array(AbstractNestedType):
    __slots__ = ("size",)

    def __init__(self, value_type: AbstractNestableType, size: int) -> None:
        super().__init__(value_type)
        self.size = size

    def has_maximum_size(self) -> bool:
        return True


class AbstractSequence(AbstractNestedType):
    """A sequence, bounded or not."""

    __slots__ = ()


class BoundedSequence(AbstractSequence):
    __slots__ = ("maximum_size",)

    def __init__(self, value_type: AbstractNestableType, maximum_size: int) -> None:
        super().__init__(value_type)
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class UnboundedSequence(AbstractSequence):
    __slots__ = ()

    def has_maximum_size(self) -> bool:
        return False


def _only_below(subject: object) -> NoReturn:
    raise NotImplementedError(f"{type(subject).__name__} is the base of others, which know")
