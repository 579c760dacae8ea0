"""Syntax of .msg lines: what was found, with columns, before anything was checked."""

from __future__ import annotations

from typing import NamedTuple


class Word(NamedTuple):
    """A piece of text and where it begins (1-based)."""

    text: str
    line: int
    column: int


class TypeSyntax(NamedTuple):
    """The type of a .msg element. `array` is None, "fixed", "bounded" or "unbounded"; `size` its number."""

    package: Word | None
    name: Word
    bound: Word | None
    array: str | None
    size: Word | None


class ElementSyntax(NamedTuple):
    """One element line of a .msg section. A constant has `value`, a field may have `default`."""

    type: TypeSyntax
    name: Word
    is_constant: bool
    value: Word | None


class SyntaxProblem(Exception):
    """The text does not follow the grammar."""

    def __init__(self, line: int, column: int, text: str) -> None:
        self.line = line
        self.column = column
        self.text = text
        super().__init__(text)
