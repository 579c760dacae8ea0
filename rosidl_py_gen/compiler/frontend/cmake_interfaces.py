"""Interface files of a source package, from its CMakeLists.txt or from its folder.

A CMakeLists.txt passes a list of files to `rosidl_generate_interfaces`. If the list can be determined without a build,
its files are used. Otherwise all interface files below the package's folder are used, so that no file is lost.
"""

from __future__ import annotations

import os
import posixpath
from pathlib import Path

from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.base.resources import GeneratedCode
from rosidl_py_gen.compiler.frontend.cmake_reader import GENERATE, CMakeArgument, CMakeScript
from rosidl_py_gen.compiler.frontend.interface_parser import parse_interface, read_source
from rosidl_py_gen.compiler.frontend.model import MAX_PROBLEMS, Diagnostics, Location, SourceText, nested_types
from rosidl_py_gen.compiler.frontend.package_files import PackageFiles, UnreadableError, interface_name
from rosidl_py_gen.errors import Diagnostic, display_path


class CMakeInterfaceList:
    """Interface files of a source package.

    Attributes:
        files: files by interface name, in name order.
        complete: True if `files` is the list of CMakeLists.txt; False if it has all files below the package folder.
        problems: errors: listed files that do not exist or are not interface files.
        notes: assumptions about CMakeLists.txt, and skipped files.
    """

    def __init__(self, package: str, folder: Path) -> None:
        self.complete = True
        self.problems: list[Diagnostic] = []
        self.notes: list[Diagnostic] = []
        self._package, self._folder = package, folder
        self._package_files = PackageFiles(folder)
        self._text = ""
        self._paths: dict[RosName, dict[str, int]] = {}  # paths of an interface, and where they are listed
        try:
            self._text = self._package_files.read_text("CMakeLists.txt")
            self._add_listed()
        except UnreadableError as error:
            # A wrong entry of a list that is not used is no problem.
            self.problems.clear()
            self._add_all(error)
        self.files = self._select_files()

    def _add_listed(self) -> None:
        script = CMakeScript(self._folder, self._text)
        calls = [words for name, words in script.calls if name == GENERATE]
        # A call with SKIP_INSTALL is for the package's tests.
        own = [words for words in calls if all(word.text != "SKIP_INSTALL" for word in words)]
        listed = [(words[0].certain, _files_of_call(words)) for words in own or calls if words]
        texts = [{word.text for word in files} for _, files in listed]
        in_all = set.intersection(*texts) if texts else set()
        doubts: list[tuple[int, str]] = []
        for is_certain, files in listed:
            for word in files:
                if word.text == CMakeScript.UNKNOWN:
                    doubts.append((word.offset, f"{GENERATE}() has no list of literal names and globs"))
                    continue
                # If a build skips one of several calls, their lists have to agree.
                if not word.certain or not (is_certain or word.text in in_all):
                    doubts.append((word.offset, f"{GENERATE}() has a list that depends on the build"))
                self._add(word, script.creates_files)
        if doubts:
            raise UnreadableError(doubts[0][1], doubts[0][0])
        if not (self._paths or self.problems):
            raise UnreadableError(f"{GENERATE}() has no list of literal names and globs")

    def _add(self, word: CMakeArgument, may_be_created: bool) -> None:
        base, colon, relative = word.text.rpartition(":")  # an absolute base folder may precede
        path = PackageFiles.inside(posixpath.join(base, relative) if colon else relative)
        name = interface_name(self._package, relative)
        if path is None or not self._package_files.owns(path):
            self._report(self.notes, word.offset, f'"{path or word.text[:80]}" is not in the package folder; skipped')
        elif name is None and not GeneratedCode.is_generated(self._folder / path):  # a glob may match generated files
            self._report(self.problems, word.offset, f'"{path}" is not an interface file (.msg, .srv, .action or .idl)')
        elif name is not None and os.path.isfile(self._folder / path):
            self._paths.setdefault(name, {}).setdefault(path, word.offset)
        elif name is not None and may_be_created:
            raise UnreadableError(f'"{path}" may be made by the build', word.offset)
        elif name is not None and word.certain and len(self.problems) < MAX_PROBLEMS:
            holder, file = os.path.split(self._folder / path)
            hint = did_you_mean(
                file, os.listdir(holder) if os.path.isdir(holder) and os.access(holder, os.R_OK) else ()
            )
            self._report(self.problems, word.offset, f'"{path}" is listed here, but there is no such file{hint}')

    def _add_all(self, reason: UnreadableError) -> None:
        self.complete = False
        self._report(self.notes, reason.offset, f"{reason}; all interface files below the package folder are used")
        try:
            for path in self._package_files.paths():
                if (name := interface_name(self._package, path)) and self._package_files.owns(path):
                    self._paths.setdefault(name, {}).setdefault(path, -1)
        except UnreadableError as error:
            self._report(self.problems, -1, str(error))

    def _select_files(self) -> dict[RosName, Path]:
        """Return one file for each interface; if several files define an interface, preferably one that compiles."""
        chosen = {name: min(paths, key=lambda path: self._rank(name, path)) for name, paths in self._paths.items()}
        rest = [(path, name) for name, paths in self._paths.items() for path in paths if path != chosen[name]]
        for path, name in [one for one in rest if not one[0].endswith(".idl")][:1]:
            more = f" and {len(rest) - 1} more are" if len(rest) > 1 else " is"
            text = f'"{path}"{more} skipped: "{chosen[name]}" defines the same interface'
            self._report(self.notes, self._paths[name][path], text)
        return {name: self._folder / path for name, path in sorted(chosen.items())}

    def _rank(self, name: RosName, path: str) -> tuple[bool | str, ...]:
        diagnostics = Diagnostics()
        source = read_source(self._folder / path, path, diagnostics) if len(self._paths[name]) > 1 else None
        interface = parse_interface(name, source, diagnostics) if source is not None else None
        needs = map(RosName.parse, nested_types(interface) if interface else ())
        is_incomplete = any(need.package == self._package and need not in self._paths for need in needs)
        is_wrong = bool(diagnostics.items) or is_incomplete
        is_elsewhere = posixpath.dirname(path) not in RosName.KINDS
        return path.endswith(".idl"), is_wrong, self._paths[name][path] < 0, is_elsewhere, "ros1" in path, path

    def _report(self, problems: list[Diagnostic], offset: int, text: str) -> None:
        if len(problems) < MAX_PROBLEMS:
            line, start = self._text.count("\n", 0, offset) + 1, self._text.rfind("\n", 0, max(0, offset)) + 1
            source = SourceText(display_path(self._folder / "CMakeLists.txt"), self._text, "txt")
            problems.append(Location(source, line * (offset >= 0), offset - start + 1).diagnostic(text))


def _files_of_call(words: list[CMakeArgument]) -> list[CMakeArgument]:
    """Return the interface files among the arguments of a call of `rosidl_generate_interfaces`.

    The first argument is the target's name.
    """
    files: list[CMakeArgument] = []
    keyword = ""
    for word in words[1:]:
        if word.text.isupper():
            keyword = word.text if word.text in ("DEPENDENCIES", "LIBRARY_NAME") else ""
        elif keyword:
            keyword = "" if keyword == "LIBRARY_NAME" else keyword
        else:
            files.append(word)
    return files
