"""Initial parameter values from command lines and files: which nodes they are for, and where each came from.

Reading YAML is in `files.py`, because importing PyYAML takes time and is not needed without parameters.
Source: docs/internals/protocol.md 10.5.
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
    """Raised for an invalid parameter file or value, with its position."""


@dataclass(frozen=True, slots=True)
class ParameterOverrides:
    """Values for the nodes whose fully qualified names match `pattern`, which begins with ``/``."""

    pattern: str
    values: Mapping[str, ParameterValue]
    source: str = ""
    """Name of the file, or argument, for warnings."""

    def matches(self, fully_qualified_name: str) -> bool:
        """Return True if the pattern matches: ``/*`` stands for one token of a name, ``/**`` for any number."""
        regex = re.escape(self.pattern).replace(r"/\*", r"(/\w+)")
        # The second star of "/**" is left, and repeats the group.
        return re.fullmatch(regex.replace(r"\*", "*"), fully_qualified_name) is not None


class InitialSources(dict[str, str]):
    """File or argument of the initial value of each parameter of a node.

    Attributes:
        was_refused: one of these values was refused, which ends most programs before they declare other parameters.
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
        {name: entry.source for entry in entries if entry.matches(fully_qualified_name) for name in entry.values}
    )


def overrides_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> dict[str, ParameterValue]:
    """Return the values for one node; later entries override earlier ones."""
    matching = (entry.values for entry in entries if entry.matches(fully_qualified_name))
    return {name: value for values in matching for name, value in values.items()}
