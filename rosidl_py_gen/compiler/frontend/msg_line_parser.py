"""One element line of a .msg section: a field or a constant, after comments and trailing blanks were cut.

The language is regular, so a table says it: how each word is written, and what may stand behind it. Spaces separate
type, name and default, so they are words, too. Which names and values are legal is checked later, where the error can
say what the rule is. Source: docs/internals/protocol.md 1.3.
"""

from __future__ import annotations

import re
from typing import NamedTuple

_TYPE, _SIZE = r"[^\s/<=\[\]]+", r"[^\s<=\[\]]+"
_END = "the end"


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


class _Rule(NamedTuple):
    """How a word is written, what errors call it, and which words may follow: no two of these begin alike."""

    written: str
    shown: str
    following: tuple[str, ...]


_RULES = {
    "start": _Rule("", "", ("type",)),
    "type": _Rule(_TYPE, "a type", ("space", "slash", "at most", "open")),
    "slash": _Rule("/", '"/"', ("member",)),
    "member": _Rule(_TYPE, "a type", ("space", "at most", "open")),
    "at most": _Rule("<=", '"<="', ("bound",)),
    "bound": _Rule(_SIZE, "a number", ("space", "open")),
    "open": _Rule(r"\[", '"["', ("close", "fixed", "limit")),
    "limit": _Rule("<=", '"<="', ("bounded",)),
    "bounded": _Rule(_SIZE, "a number", ("close",)),
    "fixed": _Rule(_SIZE, "a number", ("close",)),
    "close": _Rule(r"\]", '"]"', ("space",)),
    "space": _Rule(r" \s*", "a space", ("name",)),
    "name": _Rule(r"[^\s=]+", "a name", ("blank", "equals", _END)),
    "blank": _Rule(r" \s*", "a space", ("default", "equals")),
    "default": _Rule(r"[^\s=][^=]*", "a default value", (_END,)),
    "equals": _Rule(r"=\s*", '"="', ("value", _END)),
    "value": _Rule(r"\S.*", "a value", (_END,)),
    _END: _Rule(r"\Z", _END, ()),
}
_AHEAD = {
    word: re.compile("|".join(f"({_RULES[one].written})" for one in rule.following)) for word, rule in _RULES.items()
}
"""What may follow a word: one group for each."""


def parse_element(text: str, line: int) -> ElementSyntax:
    """One element line.

    Raises:
        SyntaxProblem: with the column and what was expected there.
    """
    found = _words(text, line)
    array = next((one for one in ("fixed", "bounded", "open") if one in found), None)
    kind = TypeSyntax(
        found["type"] if "member" in found else None,
        found.get("member", found["type"]),
        found.get("bound"),
        "unbounded" if array == "open" else array,
        found.get("fixed", found.get("bounded")),
    )
    return ElementSyntax(kind, found["name"], "equals" in found, found.get("value", found.get("default")))


def _words(text: str, line: int) -> dict[str, Word]:
    found: dict[str, Word] = {}
    word, position = "start", 0
    while word != _END:
        match = _AHEAD[word].match(text, position)
        if match is None or match.lastindex is None:
            raise _problem(word, text, line, position)
        word = _RULES[word].following[match.lastindex - 1]
        found[word] = Word(match[0], line, position + 1)
        position = match.end()
    return found


def _problem(word: str, text: str, line: int, position: int) -> SyntaxProblem:
    following = _RULES[word].following
    expected = " or ".join(sorted({_RULES[one].shown for one in following}))
    if position < len(text):
        return SyntaxProblem(line, position + 1, f'expected {expected}, found "{text[position]}"')
    if "space" in following:
        return SyntaxProblem(line, position + 1, "expected a type, a space and a name, found no name")
    return SyntaxProblem(line, position + 1, f"expected {expected}, found the end of the line")
