"""Limit of the time and memory that reading the files of one package takes.

The readers of CMakeLists.txt, package.xml, setup.py, setup.cfg and pyproject.toml share one budget for each package. A
reader spends work before it does the work, so that a file of a few hundred bytes cannot request more. Each file of the
package enlarges the budget. The budget is restored for another purpose, such as another file or the installation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from typing import TypeVar

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError

_MAX_WORK = 2_000_000
"""Maximum work for reading one package, measured in characters of values and names; the maximum takes Python about 1 s.
"""
_ACCESS_WORK = 500
"""Work that one access to a file or folder counts as, in characters of text; the access takes at least one system call.
"""
_ENTRY_WORK = 20
"""Work that reading one directory entry counts as, in characters of text."""
_STEP_WORK = 8
"""Work that one command, statement or expression counts as, in characters of text, in addition to the characters of its
value."""
_LINK_WORK = 60
"""Work that installing one file of the package as a link counts as, in characters of text."""
_CREATION_WORK = 1000
"""Work that creating one installed file that does not come from the package counts as, in characters of text."""
_OWN_FILE_WORK = 1200
"""Work, in characters of text, by which each file of a package enlarges the package's budget: for one test of the file,
and for computing its paths."""
_MAX_OWN_FILES = 20_000
"""Maximum number of files of a package that add work to its budget."""
_T = TypeVar("_T")


class BudgetError(UnreadableError):
    """Error of a package whose reading would take more work than any package can need."""


class PackageBudget:
    """Remaining work for reading the files of one package.

    A method that would spend more than remains raises `BudgetError`.
    """

    def __init__(self, work: int = _MAX_WORK) -> None:
        self._work = self._start = work
        self._folders: set[str] = set()
        self._own_files = 0

    def renew(self) -> None:
        """Restore the initial work of the budget for another purpose, such as another file or the installation."""
        self._work = max(self._work, self._start)

    def entries(self, folder: str, scan: Iterable[_T]) -> Iterator[_T]:
        """Yield the entries of a folder of the package.

        When a folder is read for the first time, each entry enlarges the budget. `folder` is the real path: through
        links, one folder could have many paths.
        """
        is_new = folder not in self._folders
        self._folders.add(folder)
        for entry in scan:
            if is_new and self._own_files < _MAX_OWN_FILES:
                self._own_files += 1
                self._work += _OWN_FILE_WORK
            yield entry

    def spend(self, characters: int) -> None:
        """Spend the work for reading or building values of this many characters."""
        self._work -= characters + 1
        if self._work < 0:
            raise BudgetError("reading it takes more work than a package can need")

    def matches(self, name: str, pattern: str) -> bool:
        """Return `fnmatchcase(name, pattern)` after spending work for it.

        Each star in the pattern may search the rest of the name.
        """
        self.spend(len(name) * len(pattern) // 20 if "*" in pattern else 0)
        return fnmatchcase(name, pattern)

    def access(self, entries: int = 0) -> None:
        """Spend the work for one access to a file, or to a folder with this many entries."""
        self.spend(_ACCESS_WORK + _ENTRY_WORK * entries)

    def step(self) -> None:
        """Spend the work for one command, expression or statement."""
        self.spend(_STEP_WORK)

    def install(self, place: str, *, is_new_source: bool) -> None:
        """Spend the work for one installed file at the path `place`.

        A second copy of a package file, and a file in a deep folder, cost more, because a short text can list many of
        them.
        """
        depth = max(0, place.count("/") - 8)
        self.spend(len(place) + (_LINK_WORK if is_new_source else _CREATION_WORK) + depth * _ACCESS_WORK)
