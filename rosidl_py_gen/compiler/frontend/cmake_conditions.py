"""Evaluation of the conditions of `if()` in a CMakeLists.txt.

The result is True, False, or None if only the build can decide. Facts: docs/internals/protocol.md 14.2.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from itertools import zip_longest
from typing import NamedTuple

_MAX_WORDS = 200
"""Maximum words of a CMake condition that is evaluated; a longer condition counts as undecided, which also bounds
nested parentheses."""
_TRUE = re.compile(r"1|on|yes|true|y", re.IGNORECASE)
_FALSE = re.compile(r"|0|off|no|false|n|ignore|notfound|.*-notfound", re.IGNORECASE | re.DOTALL)
_NUMBER = re.compile(r"[+-]?\d{1,15}(\.\d{1,15})?")
_VERSION = re.compile(r"\d{1,9}(\.\d{1,9})*")
_PLAIN_REGEX = re.compile(r"\^?[\w ,:;=@!~/-]*\$?")
"""Pattern of regular expressions that CMake and Python interpret equally, and that take linear time."""
_UNARY = ("EXISTS", "COMMAND", "POLICY", "TARGET", "TEST", "IS_DIRECTORY", "IS_SYMLINK", "IS_ABSOLUTE", "IS_READABLE")
_COMPARISONS: dict[str, Callable[[int], bool]] = {
    "LESS": lambda order: order < 0,
    "LESS_EQUAL": lambda order: order <= 0,
    "EQUAL": lambda order: order == 0,
    "GREATER_EQUAL": lambda order: order >= 0,
    "GREATER": lambda order: order > 0,
}
_BINARY = re.compile(f"(STR|VERSION_)?({'|'.join(_COMPARISONS)})|MATCHES|IN_LIST|PATH_EQUAL|IS_NEWER_THAN")


class ConditionWord(NamedTuple):
    """Word of a CMake condition with its variable references replaced.

    `text` is None if a reference has no known value.
    """

    text: str | None
    is_quoted: bool = False


Lookup = Callable[[str], str | None]
"""Function that returns the value of a variable; None if the value is not known, or nothing sets the variable."""
_Item = ConditionWord | bool | None


def evaluate_condition(words: list[ConditionWord], lookup: Lookup) -> bool | None:
    """Return the value of a CMake condition; None if only the build can decide it."""
    if len(words) > _MAX_WORDS:
        return None
    # Innermost parentheses first; each group becomes its value.
    groups: list[list[_Item]] = [[]]
    for word in words:
        if word == ("(", False):
            groups.append([])
        elif word == (")", False):
            if len(groups) < 2:
                return None
            value = _evaluate_flat(groups.pop(), lookup)
            groups[-1].append(value)
        else:
            groups[-1].append(word)
    return _evaluate_flat(groups[0], lookup) if len(groups) == 1 else None


def _evaluate_flat(items: list[_Item], lookup: Lookup) -> bool | None:
    """Return the value of a CMake condition without parentheses: tests first, then NOT, then AND and OR.

    Returns None if undecided.
    """
    values: list[bool | str | None] = []  # values with the words NOT, AND and OR between them
    at = 0
    while at < len(items):
        item, following = items[at], items[at + 1 : at + 3]
        if not isinstance(item, ConditionWord):
            values.append(item)
        elif (name := _keyword(item)) in ("NOT", "AND", "OR"):
            values.append(name)
        elif name in (*_UNARY, "DEFINED") and following:
            values.append(_is_defined(following[0], lookup) if name == "DEFINED" else None)
            at += 1
        elif len(following) == 2 and _BINARY.fullmatch(_keyword(following[0])):
            values.append(_compare(item, _keyword(following[0]), following[1], lookup))
            at += 2
        else:
            values.append(_truth(item, lookup))
        at += 1
    return _combine(values)


def _keyword(item: _Item) -> str:
    return item.text or "" if isinstance(item, ConditionWord) and not item.is_quoted else ""


def _combine(values: list[bool | str | None]) -> bool | None:
    # Words that do not alternate are an error in CMake.
    operands: list[bool | None] = []
    joins: list[str] = []
    is_negated, is_operand_next = False, True
    for value in values:
        if value == "NOT" and is_operand_next:
            is_negated = not is_negated
        elif isinstance(value, str):
            if is_operand_next:
                return None
            joins.append(value)
            is_operand_next = True
        elif not is_operand_next:
            return None
        else:
            operands.append(value != is_negated if value is not None else None)
            is_negated, is_operand_next = False, False
    if is_operand_next:
        return None
    if set(joins) == {"AND", "OR"}:
        return None  # which comes first depends on the release
    if "OR" in joins:
        return True if True in operands else None if None in operands else False
    return False if False in operands else None if None in operands else True


def _is_defined(item: _Item, lookup: Lookup) -> bool | None:
    # An empty value is left undecided: `set(x "")` defines a variable, `set(x)` does not.
    return True if isinstance(item, ConditionWord) and item.text is not None and lookup(item.text) else None


def _truth(word: ConditionWord, lookup: Lookup) -> bool | None:
    """Return the truth value of a single word of a CMake condition, which is a constant or the name of a variable.

    Returns None if only the build can decide it.
    """
    if word.text is None:
        return None
    if _TRUE.fullmatch(word.text):
        return True
    if _FALSE.fullmatch(word.text):
        return False
    if _NUMBER.fullmatch(word.text):
        return None if word.is_quoted else float(word.text) != 0
    if word.is_quoted:
        return None  # policy CMP0054
    value = lookup(word.text)
    return None if value is None else _FALSE.fullmatch(value) is None


def _operand(item: _Item, lookup: Lookup) -> str | None:
    """Return an operand of a CMake comparison: the value of the variable with this name, else the word itself.

    Returns None if only the build decides between the two.
    """
    if not isinstance(item, ConditionWord) or item.text is None:
        return None
    value = lookup(item.text)
    if value is not None:
        # A quoted name of a variable is its value before policy CMP0054.
        return value if not item.is_quoted or value == item.text else None
    is_name = re.match(r"[A-Za-z_]", item.text) is not None
    return None if is_name and not item.is_quoted else item.text


def _compare(left: _Item, name: str, right: _Item, lookup: Lookup) -> bool | None:
    first = _operand(left, lookup)
    is_pattern = name == "MATCHES" and isinstance(right, ConditionWord)
    second = right.text if is_pattern and isinstance(right, ConditionWord) else _operand(right, lookup)
    if first is None or second is None or "." in (first[:1], second[:1]):  # a path begins with "." here
        return None
    if name == "MATCHES":
        return re.search(second, first) is not None if _PLAIN_REGEX.fullmatch(second) and first.isascii() else None
    if name.startswith("STR"):
        order = (first > second) - (first < second) if (first + second).isascii() else None
        return None if order is None else _COMPARISONS[name[3:]](order)
    if name.startswith("VERSION_"):
        if not (_VERSION.fullmatch(first) and _VERSION.fullmatch(second)):
            return None
        pairs = zip_longest(first.split("."), second.split("."), fillvalue="0")
        order = next((operator.sub(int(one), int(two)) for one, two in pairs if int(one) != int(two)), 0)
        return _COMPARISONS[name[8:]](order)
    if name in _COMPARISONS:
        if not (_NUMBER.fullmatch(first) and _NUMBER.fullmatch(second)):
            return None
        difference = float(first) - float(second)
        return _COMPARISONS[name]((difference > 0) - (difference < 0))
    return None  # needs the file system or a policy
