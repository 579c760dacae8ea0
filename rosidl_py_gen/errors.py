"""Errors that several packages share, and the base class of all errors of this package.

The class of an error states who can fix it; the text states the subject, what was found, and what was expected. This
module imports no other module of the package, so generated code, the compiler and the runtime can use it.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_MAX_TEXT = 4000
"""Maximum characters of a diagnostic's text, which is limited because names in definitions may have any length."""
_INVISIBLE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180d\u2800\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]"
)
"""Pattern of characters that Python counts as printable, but that are invisible."""


class RosidlError(Exception):
    """Base class of all errors that this package raises."""


class ExtraMissingError(RosidlError, ModuleNotFoundError):
    """Error of an import that needs an extra of this package which is not installed.

    The text has the command that installs it. `name` is the module that could not be imported.
    """


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """Finding about a definition file, with its location.

    Attributes:
        path: path of the file, or a name in angle brackets for text that is not from a file.
        line: 1-based line; 0 for the whole file.
        column: 1-based column in characters; 0 for the whole line.
        text: what was found and what was expected.
        source: the line of the file; empty if there is none to display.
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
        """Return the diagnostic as text, followed by the source line, cut to `width` characters, and a caret under the
        column.
        """
        if not self.source:
            return str(self)
        start = max(0, self.column - 1 - width // 2) if len(self.source) > width else 0
        visible = _with_code_points(self.source[start : start + width])
        left = "..." if start else ""
        right = "..." if start + width < len(self.source) else ""
        before = _with_code_points(self.source[start : max(start, self.column - 1)])
        caret = " " * (len(left) + len(before)) + "^"
        return f"{self}\n    {left}{visible}{right}\n    {caret}"


def _with_code_points(text: str) -> str:
    """Return the text with invisible characters shown as ``<U+200B>``, because they are a common mistake in
    definitions.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        char if char.isprintable() and not _INVISIBLE.match(char) else f"<U+{ord(char):04X}>" for char in text
    )


def printable(text: str, max_length: int | None = None) -> str:
    """Return at most `max_length` characters of a text, with U+FFFD in place of characters that could control a
    terminal.

    Definition files, their names, and messages of peers are not trusted.
    """
    if max_length is not None and len(text) > max_length:
        text = f"{text[: max_length - 3]}..."
    return text if text.isprintable() else "".join(char if char.isprintable() else "\ufffd" for char in text)


def display_path(path: str | os.PathLike[str]) -> str:
    """Return a path for display: relative if it is below the current folder, else unchanged."""
    try:
        relative = os.path.relpath(path)
    except (OSError, ValueError):  # the current folder was removed, or is on another drive
        return os.fspath(path)
    return os.fspath(path) if relative.startswith("..") else relative


class DefinitionError(RosidlError):
    """Error of an interface file with problems, which the author of the file must correct.

    Attributes:
        diagnostics: all problems with their locations.
        notes: assumptions about a CMakeLists.txt.
        partial: other interfaces of the run are valid and could be generated.
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


class UnknownDistributionError(RosidlError, ValueError):
    """Error of a ROS distribution whose definitions are not bundled; the text names the bundled distributions."""


class DistributionWarning(UserWarning):
    """Warning that ROS_DISTRO names a distribution without bundled definitions, so the default distribution is used."""


class TypeNotFoundError(RosidlError, LookupError):
    """Error of a requested interface that is neither importable nor on the search path."""


class OutputError(RosidlError):
    """Error of an output folder that contains files of another tool, or cannot be written."""


class EncodeError(RosidlError, ValueError):
    """Error of a value that does not fit the type of its message field.

    Attributes:
        path: the field, such as ``geometry_msgs/msg/PoseArray.poses[3].position.x``.
        reason: what was expected and what was found.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")

    def __reduce__(self) -> tuple[type[EncodeError], tuple[str, str]]:
        return type(self), (self.path, self.reason)


class DecodeError(RosidlError, ValueError):
    """Error of data that is not a message of the expected type.

    Attributes:
        path: the field that could not be read.
        offset_bytes: offset in the data, which starts with the 4-byte encapsulation header.
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
    """Error of a name that is not allowed in ROS."""

    def __init__(self, text: str, *, name: str = "", index: int | None = None, reason: str = "") -> None:
        self.name: str = name
        """The invalid name; empty if it is not a text."""
        self.index: int | None = index
        """Index of the first invalid character; None if the whole name is invalid."""
        self.reason: str = reason
        """The rule that the name breaks, without name and index; empty if the error text states the rule."""
        super().__init__(text)


class ClosedError(RosidlError):
    """Error of using an object, such as a node, after it was closed."""
