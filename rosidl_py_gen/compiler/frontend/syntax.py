"""Tokens and syntax errors of both languages, .msg and .idl."""

from __future__ import annotations

from typing import NamedTuple


class SyntaxProblem(Exception):
    """A definition breaks a rule of its language; `line` and `column` are 1-based."""

    def __init__(self, line: int, column: int, text: str) -> None:
        self.line = line
        self.column = column
        self.text = text
        super().__init__(text)


class Token(NamedTuple):
    """A lexical token with its 1-based position."""

    text: str
    line: int
    column: int

    def problem(self, text: str) -> SyntaxProblem:
        """Return an exception for the token."""
        return SyntaxProblem(self.line, self.column, text)
