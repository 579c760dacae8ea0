"""Names of ROS interfaces and what they become in Python.

Decides which names are legal (docs/internals/protocol.md 1.2) and how they are spelled in Python. Knows nothing of
files, DDS, nodes.
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

PACKAGE_RULE = "lower case letters, digits and single underscores, a letter first, no underscore last"
CONSTANT_RULE = "upper case letters, digits and single underscores, a letter first, no underscore last"
INTERFACE_RULE = "letters and digits, an upper case letter first"

_LOWER = re.compile(r"(?!.*__)(?!.*_\Z)[a-z][a-z0-9_]*\Z", re.ASCII)
# Written without nested quantifiers: the reference pattern backtracks exponentially on hostile names.
_CONSTANT = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*\Z", re.ASCII)
_INTERFACE = re.compile(r"[A-Z][A-Za-z0-9]*\Z", re.ASCII)
_DERIVED_SUFFIXES = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
_MAX_SHOWN = 300
"""Characters of a wrong name in an error text."""


class RosName(NamedTuple):
    """A full interface name such as ``std_msgs/msg/Header``, taken apart."""

    package: str
    kind: str
    name: str

    def __str__(self) -> str:
        return f"{self.package}/{self.kind}/{self.name}"


def is_package_name(text: str) -> bool:
    """Source: docs/internals/protocol.md 1.2."""
    return _LOWER.match(text) is not None


def is_field_name(text: str) -> bool:
    """Source: docs/internals/protocol.md 1.2; the rule of package names."""
    return _LOWER.match(text) is not None


def is_constant_name(text: str) -> bool:
    """Source: docs/internals/protocol.md 1.2."""
    return _CONSTANT.match(text) is not None


def is_interface_name(text: str) -> bool:
    """Whether a file may carry this stem; ``Sample_`` in front and one derived suffix behind are allowed."""
    text = text.removeprefix("Sample_")
    for suffix in _DERIVED_SUFFIXES:
        text = text.removesuffix(suffix)
    return _INTERFACE.match(text) is not None


def split_ros_name(text: str, default_kind: str = "") -> RosName:
    """Take ``pkg/msg/Name`` apart; ``pkg/Name`` is understood when `default_kind` is given.

    Raises:
        InvalidNameError: the text has another shape or a part breaks its rule.
    """
    shown, parts = printable(text, _MAX_SHOWN), text.split("/")
    if len(parts) == 2 and default_kind:
        parts.insert(1, default_kind)
    if len(parts) != 3:
        raise InvalidNameError(f'"{shown}" is not an interface name; expected package/msg/Name (or /srv/, /action/)')
    package, kind, name = parts
    if not is_package_name(package):
        raise InvalidNameError(
            f'"{shown}": "{printable(package, _MAX_SHOWN)}" is not a package name; expected {PACKAGE_RULE}'
        )
    if kind not in KINDS:
        raise InvalidNameError(
            f'"{shown}": "{printable(kind, _MAX_SHOWN)}" is not a kind of interface; expected msg, srv or action'
        )
    if not all(_INTERFACE.match(part) for part in name.split("_")):
        raise InvalidNameError(
            f'"{shown}": "{printable(name, _MAX_SHOWN)}" is not an interface name; expected {INTERFACE_RULE}'
        )
    return RosName(package, kind, name)


def snake_case(name: str) -> str:
    """The module name rosidl derives from an interface name: AddTwoInts -> add_two_ints.

    Source: docs/internals/protocol.md 1.2 (two successive substitutions).
    """
    name = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", name)
    return re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name).lower()


def py_name(name: str) -> str:
    """The Python spelling of a field, constant or class: keywords get a trailing underscore."""
    return name + "_" if keyword.iskeyword(name) else name


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``; did you mean "x"?`` for the closest known word, or an empty string."""
    from difflib import get_close_matches  # slow to import, and only errors need it

    word = word[:256]  # comparing costs the product of the lengths
    close = get_close_matches(word, known, n=1, cutoff=0.7)
    return f'; did you mean "{printable(close[0])}"?' if close else ""


def similar_name(name: str, known: Iterable[str]) -> str:
    """Return `did_you_mean` of names of ROS, where the same name in another namespace is the closest.

    At most 1000 names, and 256 characters of each, are compared.
    """
    names = [one[:256] for one in islice(known, 1000) if one != name]
    below = f"/{name.strip('/')}"
    elsewhere = [one for one in names if "/" not in (below, one) and (one.endswith(below) or below.endswith(one))]
    if elsewhere:
        return f'; did you mean "{min(elsewhere, key=len)}"?'
    return did_you_mean(name, names)
