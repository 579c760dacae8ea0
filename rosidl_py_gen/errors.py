"""Every error this package raises on purpose, as one tree.

Each class says in one sentence whose problem it is. Messages say where, what was found and what was expected.
This file imports nothing of ours, so that generated code, the compiler and the runtime can all share it.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_MAX_TEXT = 4000
"""Characters of a problem: names in definitions have any length."""
_INVISIBLE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180d\u2800\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]"
)
"""Characters that Python regards as printable and that no font shows."""


class RosidlError(Exception):
    """Base of every error this package raises on purpose."""


class ExtraMissingError(RosidlError, ModuleNotFoundError):
    """The user has to install an extra of this package; the text has the command, `name` the module that is missing."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding in a definition file: where it is and what is wrong.

    Attributes:
        path: the file as the user named it, or a name in angle brackets for text that came from no file.
        line: 1-based line, 0 when the whole file is meant.
        column: 1-based column in characters, 0 when the whole line is meant.
        text: what was found and what was expected.
        source: the offending line, empty when there is none to show.
    """

    path: str
    line: int
    column: int
    text: str
    source: str = ""

    def __str__(self) -> str:
        where = self.path
        if self.line:
            where += f":{self.line}:{self.column or 1}"
        return printable(_with_code_points(f"{where}: {self.text}"[: _MAX_TEXT + 1]), _MAX_TEXT)

    def with_caret(self, width: int = 100) -> str:
        """The problem, the source line and a caret under the column; very long lines are cut around the column."""
        if not self.source:
            return str(self)
        start = max(0, self.column - 1 - width // 2) if len(self.source) > width else 0
        shown = _with_code_points(self.source[start : start + width])
        left = "..." if start else ""
        right = "..." if start + width < len(self.source) else ""
        before = _with_code_points(self.source[start : max(start, self.column - 1)])
        caret = " " * (len(left) + len(before)) + "^"
        return f"{self}\n    {left}{shown}{right}\n    {caret}"


def _with_code_points(text: str) -> str:
    """Return the text with invisible characters as ``<U+200B>``: they are the mistake in many a definition."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        char if char.isprintable() and not _INVISIBLE.match(char) else f"<U+{ord(char):04X}>" for char in text
    )


def printable(text: str, max_length: int | None = None) -> str:
    """Return the text without what could steer a terminal, at most `max_length` characters of it.

    Definition files, names in them, and what peers send are not trusted.
    """
    if max_length is not None and len(text) > max_length:
        text = f"{text[: max_length - 3]}..."
    return text if text.isprintable() else "".join(char if char.isprintable() else "\ufffd" for char in text)


def display_path(path: str | os.PathLike[str]) -> str:
    """A path as errors show it: relative when it is below the current folder."""
    try:
        relative = os.path.relpath(path)
    except (OSError, ValueError):  # the current folder is gone, or on another drive
        return os.fspath(path)
    return os.fspath(path) if relative.startswith("..") else relative


class DefinitionError(RosidlError):
    """The author of an interface file has to change it; `diagnostics` holds every finding with its location.

    Attributes:
        problems: what is wrong.
        notes: what was assumed where a CMakeLists.txt does not tell.
        partial: other interfaces of the run are right and could be generated without the wrong ones.
    """

    def __init__(
        self, diagnostics: Sequence[Diagnostic] | Diagnostic, notes: Sequence[Diagnostic] = (), partial: bool = False
    ) -> None:
        self.diagnostics: tuple[Diagnostic, ...] = (
            (diagnostics,) if isinstance(diagnostics, Diagnostic) else tuple(diagnostics)
        )
        self.notes = tuple(notes)
        self.partial = partial
        super().__init__("\n".join(problem.with_caret() for problem in self.diagnostics))


class TypeNotFoundError(RosidlError, LookupError):
    """The caller asked for an interface that is neither importable nor on the search path."""


class OutputError(RosidlError):
    """The output folder holds something this tool did not write, or cannot be written."""


class EncodeError(RosidlError, ValueError):
    """The caller's value does not fit its type; `path` names the field.

    Attributes:
        path: for example ``geometry_msgs/msg/PoseArray.poses[3].position.x``.
        reason: what was expected and what was found.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")

    def __reduce__(self) -> tuple[type[EncodeError], tuple[str, str]]:
        return type(self), (self.path, self.reason)


class DecodeError(RosidlError, ValueError):
    """The peer's bytes are not a message of this type; `path` names the field and `offset_bytes` the place.

    Attributes:
        path: the field that could not be read.
        offset_bytes: offset from the start of the data, the 4-byte encapsulation header included.
        reason: what was expected and what was found.
    """

    def __init__(self, path: str, offset_bytes: int, reason: str) -> None:
        self.path = path
        self.offset_bytes = offset_bytes
        self.reason = reason
        super().__init__(f"{path}: at byte {offset_bytes}: {reason}")

    def __reduce__(self) -> tuple[type[DecodeError], tuple[str, int, str]]:
        return type(self), (self.path, self.offset_bytes, self.reason)


class InvalidNameError(RosidlError, ValueError):
    """The caller gave a name that ROS does not allow."""

    def __init__(self, text: str, *, name: str = "", index: int | None = None, reason: str = "") -> None:
        self.name = name
        """As it was given; empty where it was no text."""
        self.index = index
        """Of the first character that is wrong, from 0; None where the whole name is."""
        self.reason = reason
        """What is wrong, in words, without name and place; empty where the text says it all."""
        super().__init__(text)


class ClosedError(RosidlError):
    """The caller used something that is already closed."""
