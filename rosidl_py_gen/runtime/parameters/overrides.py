"""Parameter values that a command line or a file gives to nodes, and which node gets them.

Decides what a node pattern matches (docs/internals/protocol.md 10.5); reading YAML is `files.py`'s, which takes a while
to import and is not needed without parameters.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

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


def overrides_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> dict[str, ParameterValue]:
    """The values for one node: all entries that match, later ones override earlier ones."""
    found: dict[str, ParameterValue] = {}
    for entry in entries:
        if entry.matches(fully_qualified_name):
            found.update(entry.values)
    return found
