"""Limit of the time and memory that reading the files of one package takes.

The readers of CMakeLists.txt, package.xml, setup.py, setup.cfg and pyproject.toml share one budget for each package. It
is spent before the work is done, so that a file of a few hundred bytes cannot request more. The files of the package
add to the budget. The budget is renewed for another step, such as another file or the installation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from typing import TypeVar

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError

_MAX_WORK = 2_000_000
"""Maximum work for one package, in characters of values and names. It takes Python about 1 s."""
_ACCESS_WORK = 500
"""Work of one access to a file or folder: at least one system call."""
_ENTRY_WORK = 20
"""Work of one entry of a folder."""
_STEP_WORK = 8
"""Work of one command, statement or expression, in addition to the characters of its value."""
_LINK_WORK = 60
"""Work of one installed file of the package: a link."""
_CREATION_WORK = 1000
"""Work of one other installed file."""
_OWN_FILE_WORK = 1200
"""Work that one file of the package adds: for one test of the file, and some steps that compute its paths."""
_MAX_OWN_FILES = 20_000
"""Maximum number of files that add work."""
_T = TypeVar("_T")


class BudgetError(UnreadableError):
    """Reading a package would take more work than a package can need."""


class PackageBudget:
    """Work that is left for reading one package; each method raises `BudgetError` if it is too much."""

    def __init__(self, work: int = _MAX_WORK) -> None:
        self._work = self._start = work
        self._folders: set[str] = set()
        self._own_files = 0

    def renew(self) -> None:
        """Allow as much work as at the beginning, for another step, such as another file or the installation."""
        self._work = max(self._work, self._start)

    def entries(self, folder: str, scan: Iterable[_T]) -> Iterator[_T]:
        """Yield the entries of a folder of the package; the first time, each of them adds work.

        `folder` is the real path: by links, a folder could be another one each time.
        """
        is_new = folder not in self._folders
        self._folders.add(folder)
        for entry in scan:
            if is_new and self._own_files < _MAX_OWN_FILES:
                self._own_files += 1
                self._work += _OWN_FILE_WORK
            yield entry

    def spend(self, characters: int) -> None:
        """Spend the work for values of some characters."""
        self._work -= characters + 1
        if self._work < 0:
            raise BudgetError("reading it takes more work than a package can need")

    def matches(self, name: str, pattern: str) -> bool:
        """Return `fnmatchcase`, after spending its work; each star may search the rest of the name."""
        self.spend(len(name) * len(pattern) // 20 if "*" in pattern else 0)
        return fnmatchcase(name, pattern)

    def access(self, entries: int = 0) -> None:
        """Spend the work for an access to a file, or to a folder with some entries."""
        self.spend(_ACCESS_WORK + _ENTRY_WORK * entries)

    def step(self) -> None:
        """Spend the work for an expression or a statement."""
        self.spend(_STEP_WORK)

    def install(self, place: str, *, is_new_source: bool) -> None:
        """Spend the work for an installed file.

        A file without a file of the package as its source, and a deep folder, cost more: a short text can list many.
        """
        depth = max(0, place.count("/") - 8)
        self.spend(len(place) + (_LINK_WORK if is_new_source else _CREATION_WORK) + depth * _ACCESS_WORK)
