"""Values of expressions in a setup.py that is read without running it.

Texts, numbers, None, `range` and paths are represented by themselves. Lists and dicts are objects with an identity, so
that a change by one name is seen by the others. A value that is not known has a reason, which is a text for people.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    import ast

    from rosidl_py_gen.compiler.frontend import PackageBudget

PLAIN_TYPES = (str, int, float, type(None), range, PurePosixPath)
"""Python types of values in setup.py that have no parts and never change."""


class UncertainError(RosidlError):
    """Error of a value in a setup.py that is not known completely; the text is the reason."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Placeholder for an unknown number of elements in an iteration; `why` is the reason."""

    why: str


@dataclass(slots=True, eq=False)
class ListValue:
    """List or tuple in a setup.py; with a reason `why`, it may have other elements, or lack some."""

    items: list[object] = field(default_factory=list)
    is_tuple: bool = False
    why: str = ""


@dataclass(slots=True, eq=False)
class DictValue:
    """Dict with plain keys in a setup.py; with a reason `why`, it may have other items, or lack some."""

    items: dict[object, object] = field(default_factory=dict)
    has_default_list: bool = False
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ViewValue:
    """Result of `keys()`, `values()` or `items()` of a dict in a setup.py."""

    base: DictValue
    kind: str


@dataclass(slots=True, eq=False)
class IteratorValue:
    """Iterator in a setup.py, which can be consumed once; a `Gap` in it stands for unknown elements."""

    elements: Iterator[object]


@dataclass(slots=True, eq=False)
class FileValue:
    """Text file that a setup.py has opened, at a reading position; with a reason `why`, the position is uncertain."""

    text: str
    position: int = 0
    why: str = ""


@dataclass(frozen=True, slots=True)
class Known:
    """Module, function or class that the reader of setup.py understands, by its full name."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Bound method in a setup.py: the method and the value to which it belongs."""

    base: object
    name: str


@dataclass(slots=True, eq=False)
class Scope:
    """Scope in a setup.py: the variables of a module, function or comprehension.

    `redirected` has the names that ``global`` or ``nonlocal`` assign to an outer scope.
    """

    names: dict[str, object] = field(default_factory=dict)
    outer: Scope | None = None
    redirected: dict[str, Scope] = field(default_factory=dict)
    is_comprehension: bool = False

    def holder(self, name: str) -> Scope | None:
        """Return the scope, this scope or an outer one, in which a variable has its value; None if no scope has it."""
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
    """Value in a setup.py that cannot be determined.

    Attributes:
        why: the reason.
        names: variables, with the scopes in which they are found, that a use of the value may change.
        is_harmless: a call of the value changes no files.
    """

    why: str
    names: Names = frozenset()
    is_harmless: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FunctionValue:
    """Function or lambda that a setup.py defines, with the values of its parameters' defaults."""

    node: ast.FunctionDef | ast.Lambda
    scope: Scope
    defaults: tuple[object, ...]
    keyword_defaults: dict[str, object]


def plain(value: object, budget: PackageBudget) -> object:
    """Return a value of setup.py as a Python object; raises `UncertainError` if a part of the value is not known."""
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
    """Return a value of setup.py as a Python object with None for unknown parts, and the reason for the first of them
    or "".
    """
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
    """Return a Python object as a value of setup.py: lists and tuples become `ListValue`."""
    if isinstance(value, list | tuple):
        return ListValue([wrapped(item) for item in value], isinstance(value, tuple))
    return value
