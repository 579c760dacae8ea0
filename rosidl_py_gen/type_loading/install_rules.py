"""Install rules of a package, from its CMakeLists.txt and from the argument `data_files` of its setup.py."""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise, takewhile
from pathlib import Path

from rosidl_py_gen.compiler.frontend import CMakeScript, PackageFiles

_LIST_END = re.compile(
    "DESTINATION|((FILE|DIRECTORY|USE_SOURCE)_)?PERMISSIONS|CONFIGURATIONS|COMPONENT|RENAME|OPTIONAL|TYPE|PATTERN|REGEX"
    "|FILES_MATCHING|EXCLUDE_FROM_ALL|MESSAGE_NEVER"
)


@dataclass(frozen=True)
class Install:
    """Install rule: ``install(FILES | PROGRAMS | DIRECTORY ...)`` of CMakeLists.txt, or an element of `data_files` of
    setup.py.

    Attributes:
        folder: folder of the package.
        kind: FILES, PROGRAMS or DIRECTORY.
        paths: files and folders, relative to `folder`; a folder that ends with ``/`` is installed without its name.
        destination: target folder, relative to the prefix.
        rename: the new name of a file, or empty.
        filters: of a DIRECTORY: patterns of file names, and True for patterns that exclude files.
        only_matching: files of a DIRECTORY that match no pattern are not installed.
    """

    folder: Path
    kind: str
    paths: tuple[str, ...]
    destination: str
    rename: str = ""
    filters: tuple[tuple[str, bool], ...] = ()
    only_matching: bool = False

    def files(self) -> Iterator[tuple[str, str]]:
        """Yield two paths for each existing file that the rule installs: below `destination`, and below `folder`."""
        for path in self.paths:
            place = PackageFiles.inside(path)
            exists = Path.exists if self.kind == "DIRECTORY" else Path.is_file
            if place is None or not exists(self.folder / place):
                continue
            if self.kind == "DIRECTORY" and path.endswith("/"):
                yield from ((name, posixpath.join(place, name)) for name in entry_names(self.folder / place))
            else:
                yield self.rename or posixpath.basename(place), place

    @classmethod
    def of_cmake(cls, folder: Path, script: CMakeScript) -> list[Install]:
        """Return the install rules of a package's CMakeLists.txt.

        A regular expression that filters files is assumed to match all files.
        """
        found = []
        for name, words in script.calls:
            texts = [word.text for word in words]
            if name != "install" or texts[:1] not in (["FILES"], ["PROGRAMS"], ["DIRECTORY"]):
                continue
            paths = tuple(takewhile(lambda text: not _LIST_END.fullmatch(text), texts[1:]))
            options = dict(pairwise(texts))
            destination = options.get("DESTINATION", CMakeScript.UNKNOWN)
            named = zip(texts, texts[1:], [*texts[2:], ""], strict=False)
            filters = tuple((pattern, after == "EXCLUDE") for word, pattern, after in named if word == "PATTERN")
            only_matching = "FILES_MATCHING" in texts and "REGEX" not in texts
            place, rename = posixpath.normpath(destination), options.get("RENAME", "")
            found.append(cls(folder, texts[0], paths, place, rename, filters, only_matching))
        return found

    @classmethod
    def of_data_files(cls, folder: Path, rows: object) -> list[Install]:
        """Return the install rules for the argument `data_files` of a setup.py, whose value is `rows`.

        Paths that cannot be determined are `CMakeScript.UNKNOWN`.
        """
        tops = [os.path.join(os.path.abspath(folder), ""), os.path.join(os.path.realpath(folder), "")]

        def source(path: object) -> str:
            if not isinstance(path, str):
                return CMakeScript.UNKNOWN
            return next((path[len(top) :] for top in tops if path.startswith(top)), path)

        found = []
        for row in rows if isinstance(rows, list) else [] if rows is None else [None]:
            match row:
                case [str(place), list(paths)]:
                    place = posixpath.normpath(re.sub(r"[\\/]+", "/", place))
                    found.append(cls(folder, "FILES", tuple(map(source, paths)), place))
                case str(path):  # a file at the top of the prefix
                    found.append(cls(folder, "FILES", (source(path),), "."))
                case _:
                    found.append(cls(folder, "FILES", (CMakeScript.UNKNOWN,), CMakeScript.UNKNOWN))
        return found


def entry_names(folder: Path) -> list[str]:
    """Return the sorted names of the entries of a folder that are not hidden; [] for an unreadable folder."""
    with suppress(OSError):
        return sorted(entry for entry in os.listdir(folder) if not entry.startswith("."))
    return []
