"""Conditions of CMake's if(), with three answers: yes, no, and None for what cannot be known.

Unknown are all that depends on the machine, on packages that are not here, on what the user of the build chooses.
Source: the manual of if(); constants and numbers come before variables, quoted texts are never variables (CMP0054).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.spec.cmake_values import UNKNOWN, UNKNOWN_VALUE, Meter, State, Value, items, matches

if TYPE_CHECKING:
    from collections.abc import Callable

Answer = bool | None
T = TypeVar("T", str, float, tuple[int, ...])

_TRUE = frozenset({"1", "ON", "YES", "TRUE", "Y"})
_FALSE = frozenset({"", "0", "OFF", "NO", "FALSE", "N", "IGNORE", "NOTFOUND"})
_NUMBER = re.compile(r"[+-]?\d{1,15}(?:\.\d{1,15})?\Z", re.ASCII)
_VERSION = re.compile(r"\d{1,9}(?:\.\d{1,9}){0,7}\Z", re.ASCII)
_UNARY = frozenset({"DEFINED", "EXISTS", "IS_DIRECTORY", "IS_ABSOLUTE", "IS_SYMLINK", "POLICY", "TARGET", "TEST"})
_UNARY |= {"COMMAND"}
_ORDER = ("EQUAL", "LESS", "GREATER", "LESS_EQUAL", "GREATER_EQUAL")
_BINARY = frozenset({"MATCHES", "IN_LIST", "IS_NEWER_THAN", "PATH_EQUAL"})
_BINARY |= {prefix + word for prefix in ("", "STR", "VERSION_") for word in _ORDER}
_MOST_TERMS = 200
_ROS_2 = frozenset({"ENV{ROS_VERSION}", "ENV{ROS_DISTRO}", "ENV{AMENT_PREFIX_PATH}"})


@dataclass(frozen=True, slots=True)
class Term:
    """One argument of a condition.

    Attributes:
        texts: what it may stand for after expansion.
        quoted: it is a text, never the name of a variable.
        written: it has no references, so a name in it was meant as one.
    """

    texts: tuple[str, ...]
    quoted: bool
    written: bool

    @property
    def word(self) -> str:
        """The keyword or parenthesis this may be."""
        return self.texts[0] if not self.quoted and len(self.texts) == 1 else ""


class _MalformedError(Exception):
    """Not a condition."""


def holds(terms: list[Term], state: State, exists: Callable[[str], Answer], meter: Meter) -> Answer:
    """Whether a condition is true; None when that cannot be known, or when it is not a condition.

    Args:
        terms: the expanded arguments.
        state: the variables.
        exists: says whether a path exists.
        meter: is charged for matching.
    """
    depth = most = 0
    for term in terms:
        depth += (term.word == "(") - (term.word == ")")
        most = max(most, depth)
    if len(terms) > _MOST_TERMS or most > 20:
        return None
    reader = _Reader(terms, state, exists, meter)
    try:
        answer = reader.any_of()
    except _MalformedError:
        return None
    return answer if reader.at == len(terms) else None


class _Reader:
    """Reads a condition from left to right."""

    def __init__(self, terms: list[Term], state: State, exists: Callable[[str], Answer], meter: Meter) -> None:
        self.terms = terms
        self.state = state
        self.exists = exists
        self.meter = meter
        self.at = 0

    def any_of(self) -> Answer:
        answer = self.all_of()
        while self.accept("OR"):
            right = self.all_of()
            answer = True if True in (answer, right) else None if None in (answer, right) else False
        return answer

    def all_of(self) -> Answer:
        answer = self.negated()
        while self.accept("AND"):
            right = self.negated()
            answer = False if False in (answer, right) else None if None in (answer, right) else True
        return answer

    def negated(self) -> Answer:
        turns = 0
        while self.accept("NOT"):
            turns += 1
        answer = self.primary()
        return answer if answer is None or turns % 2 == 0 else not answer

    def primary(self) -> Answer:
        if self.accept("("):
            answer = self.any_of()
            if not self.accept(")"):
                raise _MalformedError
            return answer
        first = self.take()
        if first.word in _UNARY and self.at < len(self.terms):
            return self.unary(first.word, self.take())
        if self.at < len(self.terms) and self.terms[self.at].word in _BINARY:
            operator = self.take().word
            return self.binary(operator, first, self.take())
        return _agreed(tuple(self.truth(text, first) for text in first.texts))

    def take(self) -> Term:
        if self.at >= len(self.terms):
            raise _MalformedError
        self.at += 1
        return self.terms[self.at - 1]

    def accept(self, word: str) -> bool:
        found = self.at < len(self.terms) and self.terms[self.at].word == word
        self.at += found
        return found

    def truth(self, text: str, term: Term) -> Answer:
        if UNKNOWN in text:
            return None
        upper = text.upper()
        if upper in _TRUE or upper in _FALSE or upper.endswith("-NOTFOUND"):
            return upper in _TRUE
        if _NUMBER.match(text):
            return float(text) != 0
        if term.quoted:
            return False
        return _agreed(tuple(_is_set(value) for value in self.state.get(text)))

    def unary(self, operator: str, term: Term) -> Answer:
        answers: list[Answer] = []
        for text in term.texts:
            if UNKNOWN in text:
                answers.append(None)
            elif operator == "DEFINED":
                answers.append(self.defined(text))
            elif operator in ("EXISTS", "IS_DIRECTORY"):
                answers.append(self.exists(text))
            else:
                answers.append(None)
        return _agreed(tuple(answers))

    def defined(self, name: str) -> Answer:
        if name.startswith(("ENV{", "CACHE{")):
            return True if name in _ROS_2 else None
        return _agreed(tuple(None if value == UNKNOWN else value is not None for value in self.state.get(name)))

    def binary(self, operator: str, left: Term, right: Term) -> Answer:
        if operator == "IN_LIST":
            lists = [value or "" for text in right.texts for value in self.state.get(text)]
            pairs = [(one, other) for one in self.operand(left, False) for other in lists]
            return _agreed(tuple(_in_list(one, other) for one, other in pairs))
        rights = right.texts if operator == "MATCHES" else self.operand(right, True)
        pairs = [(one, other) for one in self.operand(left, False) for other in rights]
        return _agreed(tuple(_compare(operator, one, other, self.meter) for one, other in pairs))

    def operand(self, term: Term, on_the_right: bool) -> tuple[str, ...]:
        """The values of one side. An unknown name written on the left is a variable, elsewhere it is a text."""
        values: list[str] = []
        for text in term.texts:
            found: Value = (text,) if term.quoted or _NUMBER.match(text) else self.state.get(text)
            if found == UNKNOWN_VALUE and (on_the_right or not term.written):
                found = (text,)
            values += [text if value is None else value for value in found]
        return tuple(dict.fromkeys(values))


def _agreed(answers: tuple[Answer, ...]) -> Answer:
    return answers[0] if answers and all(answer is answers[0] for answer in answers) else None


def _is_set(value: str | None) -> Answer:
    """Whether the value of a variable counts as true."""
    if value is None:
        return False
    if UNKNOWN in value:
        return None
    return value.upper() not in _FALSE and not value.upper().endswith("-NOTFOUND")


def _in_list(item: str, text: str) -> Answer:
    if UNKNOWN in item or len(text) > 20_000:
        return None
    found = items(text)
    return True if item in found else None if UNKNOWN in text else False


def _compare(operator: str, left: str, right: str, meter: Meter) -> Answer:
    if UNKNOWN in left or UNKNOWN in right or len(left) > 1000:
        return None
    if operator == "MATCHES":
        return matches(right, left, meter)
    if operator.startswith("STR"):
        return _ordered(operator[3:], left, right)
    if operator.startswith("VERSION_"):
        if not (_VERSION.match(left) and _VERSION.match(right)):
            return None
        return _ordered(operator[8:], _version(left), _version(right))
    if operator in _ORDER:
        numbers = _NUMBER.match(left) and _NUMBER.match(right)
        return _ordered(operator, float(left), float(right)) if numbers else False
    return None


def _version(text: str) -> tuple[int, ...]:
    numbers = [int(part) for part in text.split(".")]
    return (*numbers, *[0] * (8 - len(numbers)))


def _ordered(word: str, left: T, right: T) -> bool:
    smaller = left < right
    return {
        "EQUAL": left == right,
        "LESS": smaller,
        "GREATER": not smaller and left != right,
        "LESS_EQUAL": smaller or left == right,
        "GREATER_EQUAL": not smaller,
    }[word]
