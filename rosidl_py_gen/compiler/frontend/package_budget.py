"""Limit of the time and memory that reading the files of one package takes.

The readers of CMakeLists.txt, package.xml, setup.py, setup.cfg and pyproject.toml share one budget for each package. A
reader spends work before it does the work, so that a file of a few hundred bytes cannot request more. The files of the
package add to the budget. The budget is renewed for another step, such as another file or the installation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from typing import TypeVar

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError

_MAX_WORK = 2_000_000
"""Maximum work for one package, in characters of values and names; the maximum takes Python about 1 s."""
_ACCESS_WORK = 500
"""Work, in characters, of one access to a file or folder, which takes at least one system call."""
_ENTRY_WORK = 20
"""Work, in characters, of reading one directory entry."""
_STEP_WORK = 8
"""Work, in characters, of one command, statement or expression, in addition to the characters of its value."""
_LINK_WORK = 60
"""Work, in characters, of installing one file of the package as a link."""
_CREATION_WORK = 1000
"""Work, in characters, of creating one installed file that does not come from the package."""
_OWN_FILE_WORK = 1200
"""Work, in characters, that one file of a package adds to its budget: for one test of the file, and some steps that
compute its paths."""
_MAX_OWN_FILES = 20_000
"""Maximum number of files of a package that add work to its budget."""
_T = TypeVar("_T")


class BudgetError(UnreadableError):
    """Error of a package whose reading would take more work than any package can need."""


class PackageBudget:
    """Remaining work for reading one package; methods that spend more than remains raise `BudgetError`."""

    def __init__(self, work: int = _MAX_WORK) -> None:
        self._work = self._start = work
        self._folders: set[str] = set()
        self._own_files = 0

    def renew(self) -> None:
        """Restore the initial work for another step, such as another file or the installation."""
        self._work = max(self._work, self._start)

    def entries(self, folder: str, scan: Iterable[_T]) -> Iterator[_T]:
        """Yield the entries of a folder of the package; at the first reading of the folder, each entry adds work.

        `folder` is the real path: through links, one folder could have many paths.
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
        """Return `fnmatchcase(name, pattern)` after spending its work; each star may search the rest of the name."""
        self.spend(len(name) * len(pattern) // 20 if "*" in pattern else 0)
        return fnmatchcase(name, pattern)

    def access(self, entries: int = 0) -> None:
        """Spend the work for one access to a file, or to a folder with this many entries."""
        self.spend(_ACCESS_WORK + _ENTRY_WORK * entries)

    def step(self) -> None:
        """Spend the work for one command, expression or statement."""
        self.spend(_STEP_WORK)

    def install(self, place: str, *, is_new_source: bool) -> None:
        """Spend the work for one installed file at `place`.

        A file that is not the first copy of a package file, and a deep folder, cost more: a short text can list many.
        """
        depth = max(0, place.count("/") - 8)
        self.spend(len(place) + (_LINK_WORK if is_new_source else _CREATION_WORK) + depth * _ACCESS_WORK)
