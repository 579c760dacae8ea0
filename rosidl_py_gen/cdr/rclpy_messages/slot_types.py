"""Classes of `rosidl_parser.definition` that the `SLOT_TYPES` of rclpy's messages consist of.

Names, attributes, bases and equality are the same. Without the real package, the import hook provides this module under
its name; the parser itself is not included.
"""

from __future__ import annotations

from collections.abc import Sequence


class AbstractType:
    """Base of all types; two are equal if class and attributes are."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._values() == other._values()

    __hash__ = None  # type: ignore[assignment]

    def _values(self) -> list[object]:
        return [getattr(self, name) for cls in type(self).__mro__ for name in getattr(cls, "__slots__", ())]


class AbstractNestableType(AbstractType):
    """Type that may be an element of an array or sequence."""

    __slots__ = ()


class BasicType(AbstractNestableType):
    """Number, boolean, octet or character; `typename` is that of IDL, such as ``double``."""

    __slots__ = ("typename",)

    def __init__(self, typename: str) -> None:
        self.typename = typename


class NamedType(AbstractNestableType):
    """Type known by its name alone."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name


class NamespacedType(AbstractNestableType):
    """Message; `namespaces` are package and kind."""

    __slots__ = ("name", "namespaces")

    def __init__(self, namespaces: Sequence[str], name: str) -> None:
        self.namespaces = namespaces
        self.name = name

    def namespaced_name(self) -> tuple[str, ...]:
        return (*self.namespaces, self.name)


class AbstractGenericString(AbstractNestableType):
    """Base of all strings."""

    __slots__ = ()

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


class AbstractString(AbstractGenericString):
    """String of 8-bit characters."""

    __slots__ = ()


class BoundedString(AbstractString):
    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size


class UnboundedString(AbstractString):
    __slots__ = ()


class AbstractWString(AbstractGenericString):
    """String of 16-bit characters."""

    __slots__ = ()


class BoundedWString(AbstractWString):
    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size


class UnboundedWString(AbstractWString):
    __slots__ = ()


class AbstractNestedType(AbstractType):
    """Array or sequence of `value_type`."""

    __slots__ = ("value_type",)

    def __init__(self, value_type: AbstractNestableType) -> None:
        self.value_type = value_type

    def has_maximum_size(self) -> bool:
        return _has_maximum_size(self)


class Array(AbstractNestedType):
    __slots__ = ("size",)

    def __init__(self, value_type: AbstractNestableType, size: int) -> None:
        super().__init__(value_type)
        self.size = size


class AbstractSequence(AbstractNestedType):
    """Sequence, bounded or not."""

    __slots__ = ()


class BoundedSequence(AbstractSequence):
    __slots__ = ("maximum_size",)

    def __init__(self, value_type: AbstractNestableType, maximum_size: int) -> None:
        super().__init__(value_type)
        self.maximum_size = maximum_size


class UnboundedSequence(AbstractSequence):
    __slots__ = ()


def _has_maximum_size(subject: AbstractType) -> bool:
    name = type(subject).__name__
    if name.startswith("Abstract"):
        raise NotImplementedError(f"{name} is abstract")
    return not name.startswith("Unbounded")
