"""Names of ROS interfaces: valid names (docs/internals/protocol.md 1.2), their spelling in Python, and suggestions for
misspelled names.
"""

from __future__ import annotations

import keyword
import re
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import InvalidNameError, printable

if TYPE_CHECKING:
    from collections.abc import Iterable

_MAX_DISPLAYED = 300
"""Maximum characters of an invalid name that an error text quotes."""


class SpellingRule(NamedTuple):
    """Rule for the spelling of names of one kind: its pattern, and its text for errors."""

    pattern: re.Pattern[str]
    text: str

    def __str__(self) -> str:
        return self.text

    def allows(self, name: str) -> bool:
        """Return True if a name follows the rule."""
        return self.pattern.match(name) is not None


class _Components(NamedTuple):
    package: str
    kind: str
    name: str


class RosName(_Components):
    """Components of a full interface name such as ``std_msgs/msg/Header``, and rules for names in definitions."""

    __slots__ = ()

    KINDS = ("msg", "srv", "action")
    """Kinds of interfaces, which are the endings of their files."""
    PACKAGE_RULE = SpellingRule(
        re.compile(r"(?!.*__)(?!.*_\Z)[a-z][a-z0-9_]*\Z", re.ASCII),
        "lower case letters, digits and single underscores, a letter first, no underscore last",
    )
    """Rule for names of packages."""
    FIELD_RULE = PACKAGE_RULE
    """Rule for names of fields, which is the same as for packages."""
    CONSTANT_RULE = SpellingRule(
        # Without nested quantifiers: the pattern of rosidl backtracks exponentially on hostile names.
        re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*\Z", re.ASCII),
        "upper case letters, digits and single underscores, a letter first, no underscore last",
    )
    """Rule for names of constants in interfaces."""
    NAME_RULE = SpellingRule(
        re.compile(r"[A-Z][A-Za-z0-9]*\Z", re.ASCII), "letters and digits, an upper case letter first"
    )
    """Rule for names of interfaces in their package. Names of messages that belong to services and actions consist of
    such names and underscores."""

    @classmethod
    def parse(cls, text: str, default_kind: str = "") -> RosName:
        """Return the components of ``pkg/msg/Name``; with a `default_kind` also of ``pkg/Name``.

        Raises:
            InvalidNameError: the text is not such a name, or a component is invalid.
        """
        parts = text.split("/")
        if len(parts) == 2 and default_kind:
            parts.insert(1, default_kind)
        if len(parts) != 3:
            display = printable(text, _MAX_DISPLAYED)
            raise InvalidNameError(
                f'"{display}" is not an interface name; expected package/msg/Name (or /srv/, /action/)'
            )
        package, kind, name = parts
        has_valid_name = all(map(cls.NAME_RULE.allows, name.split("_")))
        for part, is_valid, rule in (
            (package, cls.PACKAGE_RULE.allows(package), f"a package name; expected {cls.PACKAGE_RULE}"),
            (kind, kind in cls.KINDS, "a kind of interface; expected msg, srv or action"),
            (name, has_valid_name, f"an interface name; expected {cls.NAME_RULE}"),
        ):
            if not is_valid:
                display, wrong = printable(text, _MAX_DISPLAYED), printable(part, _MAX_DISPLAYED)
                raise InvalidNameError(f'"{display}": "{wrong}" is not {rule}')
        return cls(package, kind, name)

    def __str__(self) -> str:
        return f"{self.package}/{self.kind}/{self.name}"

    @property
    def module_name(self) -> str:
        """Name of the interface's module: ``_add_two_ints`` for AddTwoInts (docs/internals/protocol.md 1.2).

        The module is private: users import the class from the package.
        """
        words = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", self.name)
        return "_" + re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", words).lower()


def py_name(name: str) -> str:
    """Return the Python name of a field, constant or class: keywords get a trailing underscore."""
    return name + "_" if keyword.iskeyword(name) else name


def did_you_mean(word: str, known: Iterable[str], *, in_namespaces: bool = False) -> str:
    """Return ``; did you mean "x"?`` for the known word most similar to `word`, or "" if none is similar.

    Args:
        in_namespaces: the words are names of the graph, of which the same name in another namespace is the most
            similar. At most 1000 names, and 256 characters of each, are compared.
    """
    if in_namespaces:
        known = [one[:256] for one in islice(known, 1000) if one != word]
        below = f"/{word.strip('/')}"
        elsewhere = [one for one in known if "/" not in (below, one) and (one.endswith(below) or below.endswith(one))]
        if elsewhere:
            return f'; did you mean "{printable(min(elsewhere, key=len))}"?'
    from difflib import get_close_matches  # slow to import

    word = word[:256]  # comparing costs the product of the lengths
    close = get_close_matches(word, known, n=1, cutoff=0.7)
    return f'; did you mean "{printable(close[0])}"?' if close else ""
