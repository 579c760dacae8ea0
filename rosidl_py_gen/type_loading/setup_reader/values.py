"""Values of expressions in a setup.py that is read without running it.

Texts, numbers, None, `range` and paths are their own values. Lists and dicts are objects with an identity, so that a
change by one name is seen by the others. A value that is not known has a reason, for people.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    import ast

    from rosidl_py_gen.compiler.frontend.package_budget import PackageBudget

PLAIN_TYPES = (str, int, float, type(None), range, PurePosixPath)
"""Types of values that have no parts and never change."""


class UncertainError(RosidlError):
    """A value is not known completely; the text is the reason."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Element of an iteration that represents an unknown number of other elements; `why` is the reason."""

    why: str


@dataclass(slots=True, eq=False)
class ListValue:
    """List or tuple; with a reason `why` it may have other elements, or lack some."""

    items: list[object] = field(default_factory=list)
    is_tuple: bool = False
    why: str = ""


@dataclass(slots=True, eq=False)
class DictValue:
    """Dict with plain keys; with a reason `why` it may have other items, or lack some."""

    items: dict[object, object] = field(default_factory=dict)
    has_default_list: bool = False
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ViewValue:
    """View of the keys, values or items of a dict."""

    base: DictValue
    kind: str


@dataclass(slots=True, eq=False)
class IteratorValue:
    """Iterator, which can be consumed once; its elements may be gaps."""

    elements: Iterator[object]


@dataclass(slots=True, eq=False)
class FileValue:
    """Text file that is open for reading, at a position; with a reason `why`, more or less of it may be left."""

    text: str
    position: int = 0
    why: str = ""


@dataclass(frozen=True, slots=True)
class Known:
    """Module, function or class with a meaning for the reader, by its full name."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Method of a value."""

    base: object
    name: str


@dataclass(slots=True, eq=False)
class Scope:
    """Variables of a module, function or comprehension; `redirected` are the names that belong to an outer scope."""

    names: dict[str, object] = field(default_factory=dict)
    outer: Scope | None = None
    redirected: dict[str, Scope] = field(default_factory=dict)
    is_comprehension: bool = False

    def holder(self, name: str) -> Scope | None:
        """Return the scope that has a variable, or None."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.redirected:
                scope = scope.redirected[name]
                return scope if name in scope.names else None
            if name in scope.names:
                return scope
            scope = scope.outer
        return None


Names = frozenset[tuple[str, Scope]]


@dataclass(frozen=True, slots=True)
class Unknown:
    """Value that cannot be determined.

    Attributes:
        why: the reason.
        names: variables, with scopes in which they are found, that a use of the value may change.
        is_harmless: a call of the value changes no files.
    """

    why: str
    names: Names = frozenset()
    is_harmless: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FunctionValue:
    """Function or lambda of the file, with the values of its defaults."""

    node: ast.FunctionDef | ast.Lambda
    scope: Scope
    defaults: tuple[object, ...]
    keyword_defaults: dict[str, object]


def plain(value: object, budget: PackageBudget) -> object:
    """Return a value as an object of Python; raises `UncertainError` if a part is not known."""
    budget.step()
    if isinstance(value, PLAIN_TYPES):
        return value
    if isinstance(value, ListValue) and not value.why:
        items = [plain(item, budget) for item in value.items]
        return tuple(items) if value.is_tuple else items
    if isinstance(value, ViewValue) and value.kind == "keys" and not value.base.why:
        return value.base.items.keys()
    if isinstance(value, DictValue) and not value.why:
        return {key: plain(item, budget) for key, item in value.items.items()}
    raise UncertainError(getattr(value, "why", "") or "an object")


def known_part(value: object, budget: PackageBudget) -> tuple[object, str]:
    """Return a value as an object of Python with None for unknown parts, and the first reason, or an empty text."""
    budget.step()
    if isinstance(value, PurePosixPath):
        return str(value), ""
    if isinstance(value, PLAIN_TYPES):
        return value, ""
    if isinstance(value, ListValue):
        parts = [known_part(item, budget) for item in value.items]
        return [part for part, _ in parts], next(filter(None, (value.why, *(why for _, why in parts))), "")
    if isinstance(value, DictValue):
        pairs = {str(key): known_part(item, budget) for key, item in value.items.items()}
        reasons = (value.why, *(why for _, why in pairs.values()))
        return {key: part for key, (part, _) in pairs.items()}, next(filter(None, reasons), "")
    return None, getattr(value, "why", "") or "an object that setup.py creates"


def wrapped(value: object) -> object:
    """Return an object of Python as a value."""
    if isinstance(value, list | tuple):
        return ListValue([wrapped(item) for item in value], isinstance(value, tuple))
    return value
