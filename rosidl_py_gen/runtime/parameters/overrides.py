"""Parameter values that a command line or a file gives to nodes, and which node gets them.

Decides what a node pattern matches (docs/internals/protocol.md 10.5); reading YAML is `files.py`'s, which takes a while
to import and is not needed without parameters.
"""

from __future__ import annotations

import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError, WrongParameterTypeError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from rosidl_py_gen.runtime.parameters.values import ParameterValue


class ParameterFileError(RosidlError, ValueError):
    """The user's parameter YAML has to change; the text says where."""


@dataclass(frozen=True, slots=True)
class ParameterOverrides:
    """Values for the nodes whose fully qualified name `pattern` matches; `pattern` begins with ``/``."""

    pattern: str
    values: Mapping[str, ParameterValue]
    source: str = ""
    """What gave them, for warnings: a file's name, or an argument."""

    def matches(self, fully_qualified_name: str) -> bool:
        """``/*`` stands for one part of a name, ``/**`` for any number of them."""
        regex = re.escape(self.pattern).replace(r"/\*", r"(/\w+)")
        # What is left of "/**" is the second star, which now repeats the group.
        return re.fullmatch(regex.replace(r"\*", "*"), fully_qualified_name) is not None


class InitialSources(dict[str, str]):
    """File or argument that the initial value of each parameter of a node is from.

    Attributes:
        was_refused: one of these values was refused, which ends most programs before they declare the other parameters.
    """

    was_refused = False

    @contextmanager
    def declaring(self, name: str, ignored: bool) -> Iterator[None]:
        """Add the source to the error of a declaration that refuses an initial value."""
        try:
            yield
        except (InvalidParameterValueError, WrongParameterTypeError) as error:
            if not ignored and name in self:
                self.was_refused, error.source = True, self[name]
                error.args = (f"{error}; the value is from {error.source}",)
            raise


def sources_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> InitialSources:
    """Return the source of each value of `overrides_for`."""
    return InitialSources(
        {name: one.source for one in entries if one.matches(fully_qualified_name) for name in one.values}
    )


def overrides_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> dict[str, ParameterValue]:
    """The values for one node: all entries that match, later ones override earlier ones."""
    found: dict[str, ParameterValue] = {}
    for entry in entries:
        if entry.matches(fully_qualified_name):
            found.update(entry.values)
    return found
