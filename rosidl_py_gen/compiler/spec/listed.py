"""Which interface files a package's CMakeLists.txt says belong to it.

Its `rosidl_generate_interfaces` calls decide; ROS builds nothing else. Whatever a build may list counts: what only
conditions decide that cannot be known here is taken in, and where the text does not tell, all files are, with a note.
A file belongs to the kind its suffix says, whatever folder it is in (an .idl to the folder's, as rosidl has it).
"""

from __future__ import annotations

import os
import posixpath
import re
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import KINDS, RosName, did_you_mean
from rosidl_py_gen.base.ownership import owns
from rosidl_py_gen.compiler.spec.cmake import (
    GENERATE,
    MAX_BYTES,
    ROOT,
    UNKNOWN,
    Call,
    Script,
    UnreadableError,
    Word,
    inside,
    read_text,
)
from rosidl_py_gen.errors import Problem, shown_path

if TYPE_CHECKING:
    from collections.abc import Iterator

_MENTIONED = re.compile(rb"\brosidl_(generate_interfaces|default_generators)\b", re.IGNORECASE)
_SUFFIXES = (".msg", ".srv", ".action", ".idl")
_WORD = re.compile(r'[^\s()"#;]+')
_LIST_WORDS = ("DEPENDENCIES",)
_ONE_WORD = ("LIBRARY_NAME",)
_MAX_HINTS = 20  # each compares with a whole folder
_FLAGS = ("SKIP_INSTALL", "SKIP_GROUP_MEMBERSHIP_CHECK", "ADD_LINTER_TESTS")


@dataclass(slots=True)
class Listing:
    """The files a package says it consists of.

    Attributes:
        files: by interface name.
        complete: there are no others; otherwise the files in msg, srv and action belong to the package too.
        problems: listed files that do not exist, in order.
        notes: what could not be known, and what that means for the package, in order.
    """

    files: dict[RosName, Path] = field(default_factory=dict)
    complete: bool = True
    problems: dict[Problem, None] = field(default_factory=dict)
    notes: dict[Problem, None] = field(default_factory=dict)


def mentions_interfaces(folder: Path) -> bool:
    """Whether there is a CMakeLists.txt that has to do with making interfaces."""
    try:
        with open(folder / "CMakeLists.txt", "rb") as file:
            return _MENTIONED.search(file.read(MAX_BYTES + 1)) is not None
    except OSError:
        return False


def read_listing(package: str, folder: Path) -> Listing | None:
    """What the CMakeLists.txt of a source package lists; None when it has none, or makes no interfaces.

    Args:
        package: its name.
        folder: holds CMakeLists.txt.
    """
    if not mentions_interfaces(folder):
        return None
    reader = _Reader(package, folder)
    try:
        calls = Script(folder, reader.read()).calls
    except UnreadableError as error:
        reader.incomplete(error.offset, error.reason)
        return reader.listing
    if not calls:
        return reader.unreached() if GENERATE in reader.text.lower() else None
    reader.take(calls)
    return reader.listing


@dataclass(slots=True)
class _Entry:
    """One listed file: how it is written, where, and whether every build has it."""

    text: str
    offset: int
    certain: bool


class _Reader:
    """Turns calls into files."""

    def __init__(self, package: str, folder: Path) -> None:
        self.package = package
        self.folder = folder
        self.listing = Listing()
        self.text = ""
        self.places: dict[str, int] = {}
        self.starts = [0]  # of lines
        self.lines: dict[int, str] = {}
        self.doubtful: list[_Entry] = []

    def read(self) -> str:
        """The text; raises `UnreadableError`."""
        self.text = read_text(self.folder, "CMakeLists.txt")
        for found in _WORD.finditer(self.text):
            if found[0].endswith(_SUFFIXES):
                self.places.setdefault(posixpath.basename(found[0]), found.start())
        self.starts += [found.end() for found in re.finditer("\n", self.text)]
        return self.text

    def unreached(self) -> Listing:
        self.incomplete(None, f"what {GENERATE}() is called with cannot be known from this file")
        return self.listing

    def take(self, calls: list[Call]) -> None:
        if len(calls) > 1:  # interfaces for the package's own tests
            calls = [call for call in calls if not _is_for_tests(call)] or calls
        for call in calls:
            unknown: list[Word] = []
            for entry in self.entries(call, call.certain or len(calls) == 1, unknown):
                self.add(entry)
            if unknown:
                written = ", ".join(one.text for one in unknown[:5]) + (", ..." if len(unknown) > 5 else "")
                self.incomplete(unknown[0].offset, f"what {written} brings cannot be known from this file")
        if self.doubtful:
            first = self.doubtful[0]
            text = f'whether "{first.text}"{_more(len(self.doubtful) - 1)} is built depends on a condition; taken in'
            self.note(first.offset, text)

    def entries(self, call: Call, certain: bool, unknown: list[Word]) -> Iterator[_Entry]:
        """The files a call lists, in front of and between its keywords; what cannot be known goes into `unknown`."""
        mode = "files"
        for word, values in call.arguments:
            for text, sure in values.items():
                if text in (*_LIST_WORDS, *_ONE_WORD, *_FLAGS):
                    mode = "files" if text in _FLAGS else text
                elif mode in _ONE_WORD:
                    mode = "files"
                elif mode == "files" and UNKNOWN in text:
                    unknown.append(word)
                elif mode == "files":
                    place = self.places.get(posixpath.basename(text), word.offset)
                    yield _Entry(text, word.offset if text in word.text else place, certain and sure)

    def add(self, entry: _Entry) -> None:
        """Take one listed file in, or say what is wrong with it."""
        base, colon, relative = entry.text.rpartition(":")  # an absolute base folder may stand in front
        whole = inside(posixpath.join(base, relative) if colon else relative)
        shown = entry.text.replace(ROOT + "/", "").replace(ROOT, "")
        name = _name(self.package, relative)
        if whole is None or not self.may_read(whole):
            self.note(entry.offset, f'"{shown}" is not in the package folder; it is left out')
        elif name is None and owns(self.folder / whole[len(ROOT) + 1 :]):
            return  # a pattern took our own output for a definition
        elif name is None:
            self.problem(entry, f'"{shown}" is not an interface file; expected .msg, .srv, .action or .idl')
        elif not os.path.isfile(self.folder / whole[len(ROOT) + 1 :]):
            if entry.certain:
                self.problem(entry, f'"{shown}" is listed here, but there is no such file{self.hint(whole)}')
        else:
            self.keep(entry, name, whole[len(ROOT) + 1 :])

    def may_read(self, whole: str) -> bool:
        """Whether a path is one of the package; links lead elsewhere only from msg, srv and action themselves."""
        path = self.folder / whole[len(ROOT) + 1 :]
        if path.parent.name in KINDS and path.parent.parent == self.folder:
            return True
        return whole != ROOT and Path(os.path.realpath(path)).is_relative_to(os.path.realpath(self.folder))

    def keep(self, entry: _Entry, name: RosName, path: str) -> None:
        file = self.folder / path
        first = self.listing.files.setdefault(name, file)
        if first == file:
            if not entry.certain:
                self.doubtful.append(entry)
        elif first.suffix == ".idl" and file.suffix != ".idl":
            self.listing.files[name] = file
        elif file.suffix != ".idl":
            kept = first.relative_to(self.folder).as_posix()
            self.note(entry.offset, f'"{path}" and "{kept}" would both be {name}; the latter is taken')

    def hint(self, whole: str) -> str:
        holder = posixpath.dirname(whole[len(ROOT) + 1 :])
        try:
            names = os.listdir(self.folder / holder) if len(self.listing.problems) < _MAX_HINTS else ()
        except OSError:
            return ""
        return did_you_mean(posixpath.basename(whole), names)

    # --- what the user reads --------------------------------------------------------------------------------------

    def problem(self, entry: _Entry, text: str) -> None:
        self.listing.problems.setdefault(self.at(entry.offset, text))

    def note(self, offset: int | None, text: str) -> None:
        self.listing.notes.setdefault(self.at(offset, text))

    def incomplete(self, offset: int | None, reason: str) -> None:
        self.listing.complete = False
        self.note(offset, f"{reason}; all files in msg, srv and action are taken")

    def at(self, offset: int | None, text: str) -> Problem:
        path = shown_path(self.folder / "CMakeLists.txt")
        if offset is None:
            return Problem(path, 0, 0, text)
        line = bisect_right(self.starts, offset)
        start = self.starts[line - 1]
        if line not in self.lines:  # one text for all that is wrong in a line
            end = self.text.find("\n", start)
            self.lines[line] = self.text[start : end if end >= 0 else len(self.text)].rstrip("\r").replace("\t", " ")
        return Problem(path, line, offset - start + 1, text, self.lines[line])


def _is_for_tests(call: Call) -> bool:
    return any("SKIP_INSTALL" in values for _, values in call.arguments)


def _name(package: str, path: str) -> RosName | None:
    """The interface a file defines; None when it is not an interface file."""
    stem, suffix = posixpath.splitext(posixpath.basename(path))
    if suffix not in _SUFFIXES:
        return None
    kind = suffix[1:]
    if kind == "idl":
        kind = posixpath.basename(posixpath.dirname(path))
    return RosName(package, kind, stem) if kind in KINDS else None


def _more(number: int) -> str:
    return f" and {number} more" if number > 0 else ""
