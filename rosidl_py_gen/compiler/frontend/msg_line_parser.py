"""Parser of one field or constant in a .msg section, without comment and trailing blanks.

The language is regular, so a table defines it: the pattern of each token, and the tokens that may follow. Spaces
separate type, name and default, so they are tokens, too. Names and values are checked later, where an error can state
the rule.
Source: docs/internals/protocol.md 1.3.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from rosidl_py_gen.compiler.frontend.syntax import SyntaxProblem, Token

_TYPE, _SIZE = r"[^\s/<=\[\]]+", r"[^\s<=\[\]]+"
_END = "the end"


class _Rule(NamedTuple):
    """Pattern of a token, its name in errors, and the tokens that may follow: no two of them begin alike."""

    pattern: str
    display: str
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
_FOLLOWING = {
    kind: re.compile("|".join(f"({_RULES[one].pattern})" for one in rule.following)) for kind, rule in _RULES.items()
}
"""Pattern of the tokens that may follow a token: one group for each."""


def parse_element(text: str, line: int, start: int = 0) -> dict[str, Token]:
    """Return the tokens of an element line by their kinds; the element starts at the index `start`.

    ``member`` is the name of a type after its package, which is ``type`` then. A constant has ``equals``, and ``value``
    unless it is empty.

    Raises:
        SyntaxProblem: the line breaks the grammar.
    """
    tokens: dict[str, Token] = {}
    kind, position = "start", start
    while kind != _END:
        match = _FOLLOWING[kind].match(text, position)
        if match is None or match.lastindex is None:
            raise _problem(kind, text, line, position)
        kind = _RULES[kind].following[match.lastindex - 1]
        tokens[kind] = Token(match[0], line, position + 1)
        position = match.end()
    return tokens


def _problem(kind: str, text: str, line: int, position: int) -> SyntaxProblem:
    following = _RULES[kind].following
    expected = " or ".join(sorted({_RULES[one].display for one in following}))
    if position < len(text):
        message = f'expected {expected}, found "{text[position]}"'
    elif "space" in following:
        message = "expected a type, a space and a name, found no name"
    else:
        message = f"expected {expected}, found the end of the line"
    return SyntaxProblem(line, position + 1, message)
