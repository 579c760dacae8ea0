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

KINDS = ("msg", "srv", "action")

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


PACKAGE_NAME = SpellingRule(
    re.compile(r"(?!.*__)(?!.*_\Z)[a-z][a-z0-9_]*\Z", re.ASCII),
    "lower case letters, digits and single underscores, a letter first, no underscore last",
)
INTERFACE_NAME = SpellingRule(
    re.compile(r"[A-Z][A-Za-z0-9]*\Z", re.ASCII), "letters and digits, an upper case letter first"
)


class RosName(NamedTuple):
    """Components of a full interface name such as ``std_msgs/msg/Header``."""

    package: str
    kind: str
    name: str

    def __str__(self) -> str:
        return f"{self.package}/{self.kind}/{self.name}"

    @property
    def module_name(self) -> str:
        """Name of the interface's module: ``_add_two_ints`` for AddTwoInts (docs/internals/protocol.md 1.2).

        The module is private: users import the class from the package.
        """
        words = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", self.name)
        return "_" + re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", words).lower()


def split_ros_name(text: str, default_kind: str = "") -> RosName:
    """Return the components of ``pkg/msg/Name``; with a `default_kind` also of ``pkg/Name``.

    Raises:
        InvalidNameError: the text is not such a name, or a component is invalid.
    """
    parts = text.split("/")
    if len(parts) == 2 and default_kind:
        parts.insert(1, default_kind)
    if len(parts) != 3:
        display = printable(text, _MAX_DISPLAYED)
        raise InvalidNameError(f'"{display}" is not an interface name; expected package/msg/Name (or /srv/, /action/)')
    package, kind, name = parts
    for part, is_valid, rule in (
        (package, PACKAGE_NAME.allows(package), f"a package name; expected {PACKAGE_NAME}"),
        (kind, kind in KINDS, "a kind of interface; expected msg, srv or action"),
        (name, all(map(INTERFACE_NAME.allows, name.split("_"))), f"an interface name; expected {INTERFACE_NAME}"),
    ):
        if not is_valid:
            display, wrong = printable(text, _MAX_DISPLAYED), printable(part, _MAX_DISPLAYED)
            raise InvalidNameError(f'"{display}": "{wrong}" is not {rule}')
    return RosName(package, kind, name)


def py_name(name: str) -> str:
    """Return the Python name of a field, constant or class: keywords get a trailing underscore."""
    return name + "_" if keyword.iskeyword(name) else name


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean "x"?`` for the known word most similar to `word`, or "" if none is similar."""
    from difflib import get_close_matches  # slow to import

    word = word[:256]  # comparing costs the product of the lengths
    close = get_close_matches(word, known, n=1, cutoff=0.7)
    return f'; did you mean "{printable(close[0])}"?' if close else ""


def similar_name(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean "x"?`` for the known ROS name most similar to `name`, or "" if none is similar.

    The same name in another namespace is the most similar. At most 1000 names, and 256 characters of each, are
    compared.
    """
    names = [one[:256] for one in islice(known, 1000) if one != name]
    below = f"/{name.strip('/')}"
    elsewhere = [one for one in names if "/" not in (below, one) and (one.endswith(below) or below.endswith(one))]
    if elsewhere:
        return f'; did you mean "{min(elsewhere, key=len)}"?'
    return did_you_mean(name, names)
