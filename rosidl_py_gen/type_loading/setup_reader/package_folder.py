"""Files of a package as `glob`, `os.walk`, `pathlib` and `find_packages` return them, for a reader that does not run
setup.py.

The order is the order of the operating system. Links to folders are followed once, and only inside the package folder.
A `Gap` stands for unknown files, for example in a folder to which another link leads. All accesses spend the budget of
the package.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from rosidl_py_gen.compiler.frontend import PackageBudget, PackageFiles, ReadPaths
from rosidl_py_gen.type_loading.setup_reader.values import Gap, ListValue

_MAGIC = re.compile(r"[*?[]")
_MAX_PATH = 4096
"""Maximum characters of a path in a setup.py: PATH_MAX of Linux."""
_DEPTH_WORK = 200
"""Work that each folder in a path counts as when the path is resolved, in characters of text."""
PATTERN_WORK = 40
"""Work that one character of a file pattern counts as, in characters of text; a pattern becomes a regular expression.
"""


class PackageFolder:
    """Read access to the files below a package folder, which is the working folder of its setup.py.

    Attributes:
        path: absolute path of the folder.
        real: path without links, which `os.getcwd` returns.
        changes: reason why the files may differ while setup.py runs, or empty.
    """

    def __init__(self, folder: Path, budget: PackageBudget) -> None:
        self.path = os.path.abspath(folder).replace(os.sep, "/")
        self.real = os.path.realpath(folder).replace(os.sep, "/")
        self._budget = budget
        self.changes = ""

    def place(self, path: str) -> str | None:
        """Return a path in setup.py relative to the package folder; None if the path is outside of the folder."""
        if len(path) > _MAX_PATH or "\0" in path:
            return None
        top = self._top(path)
        if top is None and os.path.isabs(path):
            return None
        path = path if top is None else path[len(top) :].strip("/")
        place = posixpath.normpath(path)
        if ".." in path.split("/"):  # after a link, it leads to the parent of the target
            self._budget.access()
            real, other = (os.path.realpath(os.path.join(self.path, one)) for one in (path, place))
            if real != other:
                return None
        return None if place == ".." or place.startswith("../") else place

    def _top(self, path: str) -> str | None:
        """Return the package folder (`path` or `real`) with which an absolute path begins; None for other paths."""
        return next((top for top in (self.path, self.real) if path == top or path.startswith(f"{top}/")), None)

    def read(self, path: str, keeps_line_ends: bool = False) -> str | None:
        """Return the text of a file in the package folder; None for a file elsewhere, not in UTF-8, or that may change.

        Raises `UnreadableError` if the file cannot be read.
        """
        place = self.place(path)
        if place is None or self.changes:
            return None
        self._budget.access()
        text = PackageFiles(Path(self.path)).read_text(place)
        self._budget.spend(len(text))
        if "\ufffd" in text:
            return None
        return text if keeps_line_ends else text.replace("\r\n", "\n").replace("\r", "\n")  # as `open` does

    def check(self, kind: str, path: str) -> bool | None:
        """Return the result of `os.path.exists`, `isfile`, `isdir`, `islink` or `lexists` for a path in setup.py.

        Returns None if the result is not known, because the path is outside of the package folder or files may change.
        """
        place = self.place(path)
        if place is None or self.changes:
            return None
        if not path:
            return False
        self._budget.access()
        file = os.path.join(self.path, place)
        ReadPaths.note(file)
        return bool(getattr(os.path, kind)(file))

    def names(self, path: str) -> Iterator[str | Gap]:
        """Yield the names that `os.listdir` returns for a folder; a `Gap` stands for unknown names."""
        place = self.place(path)
        yield from self._gap()
        yield from (entry if isinstance(entry, Gap) else entry[0] for entry in self.entries(place, path))

    def walk(self, top: str) -> Iterator[ListValue | Gap]:
        """Yield the tuples of `os.walk`; a `Gap` stands for unknown ones. The caller may change the lists
        of folders.
        """
        yield from self._gap()
        waiting = [(top, self.place(top))] if top else []
        while waiting:
            top, place = waiting.pop()
            folders, files = ListValue(), ListValue()
            for entry in self.entries(place, top):
                if isinstance(entry, Gap):
                    yield entry
                else:
                    (folders if entry[1] else files).items.append(entry[0])
            if place is None or not os.path.isdir(os.path.join(self.path, place)):
                continue
            yield ListValue([top, folders, files], is_tuple=True)
            if folders.why:
                yield Gap(folders.why)
            for name in reversed(folders.items):
                if isinstance(name, str) and not os.path.islink(os.path.join(self.path, place, name)):
                    waiting.append((posixpath.join(top, name), posixpath.normpath(posixpath.join(place, name))))

    def glob(self, pattern: str, is_recursive: bool, all_names: bool = False) -> Iterator[str | Gap]:
        """Yield the paths that `glob.glob` returns; a `Gap` stands for unknown paths.

        With `all_names`, hidden files are included.
        """
        yield from self._gap()
        base, shown = ".", ""
        top = self._top(pattern)
        if top is not None:
            shown, pattern = f"{top}/", pattern[len(top) :].lstrip("/")
        elif os.path.isabs(pattern):
            yield Gap(f"{pattern[:80]} is not in the package folder")
            return
        parts = pattern.split("/")
        if len(pattern) > _MAX_PATH:
            yield Gap("a pattern is too long")
            return
        self._budget.spend(PATTERN_WORK * len(pattern))
        yield from filter(None, _Glob(self, is_recursive, all_names).matches(shown, base, parts))

    def glob_paths(self, top: PurePosixPath, pattern: str) -> Iterator[PurePosixPath | Gap]:
        """Yield the paths that `pathlib.Path.glob` returns, which follows no links below ``**``.

        A `Gap` stands for unknown paths.
        """
        if pattern.endswith("**") or pattern.startswith("/") or self.place(str(top)) is None:
            yield Gap(f"the pattern {pattern[:80]}")
            return
        yield from self._gap()
        self._budget.spend(PATTERN_WORK * len(pattern))
        shown = "" if str(top) == "." else f"{top}/"
        seen = set()
        matcher = _Glob(self, True, True, follows_links=False)
        for path in matcher.matches(shown, self.place(str(top)) or ".", [*PurePosixPath(pattern).parts]):
            if isinstance(path, Gap):
                yield path
            elif path not in seen:
                seen.add(path)
                yield PurePosixPath(path)

    def packages(self, where: str, excluded: list[str], included: list[str], is_namespace: bool) -> Iterator[str | Gap]:
        """Yield the names that `setuptools.find_packages` or `find_namespace_packages` returns.

        A `Gap` stands for unknown names.
        """
        yield from self._gap()
        top = self.place(where)
        if top is None:
            yield Gap(f"the folder {where[:80]} is not in the package folder")
            return
        self._budget.spend(PATTERN_WORK * sum(map(len, (*excluded, *included))))
        waiting = [("", top)]
        visited = {os.path.realpath(os.path.join(self.path, top))}
        while waiting:
            above, place = waiting.pop()
            for entry in self.entries(place, place):
                if isinstance(entry, Gap):
                    yield entry
                    continue
                name, is_folder = entry
                if not is_folder or "." in name:
                    continue
                folder = posixpath.normpath(posixpath.join(place, name))
                if not is_namespace and not os.path.isfile(os.path.join(self.path, folder, "__init__.py")):
                    continue
                self._budget.access(len(excluded) + len(included))
                package = f"{above}{name}"
                is_included = any(self._budget.matches(package, pattern) for pattern in included)
                if is_included and not any(self._budget.matches(package, pattern) for pattern in excluded):
                    yield package
                real = os.path.realpath(os.path.join(self.path, folder))
                if real in visited or not self._is_inside(real):
                    yield Gap(f"the link {folder[:80]}")
                else:
                    visited.add(real)
                    waiting.append((f"{package}.", folder))

    def real_folder(self, place: str) -> str | None:
        """Return the real path of a folder in the package; None if a link leads out of the package."""
        real = os.path.realpath(os.path.join(self.path, place))
        return real if self._is_inside(real) else None

    def entries(self, place: str | None, shown: str) -> Iterator[tuple[str, bool] | Gap]:
        """Yield the names in a folder, each with True if it is a folder; yield nothing if the folder cannot be read.

        A `Gap` stands for the names in a folder outside of the package.
        """
        if place is not None and (problem := self._budget.depth_problem(place)):
            yield Gap(problem)
            return
        real = self.real_folder(place) if place is not None else None
        if place is None or real is None:
            yield Gap(f"the folder {shown[:80]} is not in the package folder")
            return
        path = os.path.join(self.path, place)
        self._budget.access()
        self._budget.spend(_DEPTH_WORK * place.count("/"))
        ReadPaths.note(path)
        found = []
        try:
            with os.scandir(path) as scan:
                for entry in self._budget.entries(real, scan):
                    self._budget.spend(len(entry.name) + 20)
                    found.append((entry.name, _is_folder(entry)))
        except OSError:
            return
        yield from found

    def access(self) -> None:
        self._budget.access()

    def matches(self, name: str, pattern: str) -> bool:
        return self._budget.matches(name, pattern)

    def _is_inside(self, real: str) -> bool:
        real = real.replace(os.sep, "/")
        return real == self.real or real.startswith(f"{self.real}/")

    def _gap(self) -> Iterator[Gap]:
        if self.changes:
            yield Gap(self.changes)


class _Glob:
    """Search for the files that match one pattern, which follows each link to a folder once."""

    def __init__(self, folder: PackageFolder, is_recursive: bool, all_names: bool, follows_links: bool = True) -> None:
        self._folder, self._is_recursive = folder, is_recursive
        self._all_names, self._follows_links = all_names, follows_links
        self._followed: set[str] = set()

    def matches(self, shown: str, place: str, parts: list[str]) -> Iterator[str | Gap]:
        """Yield the files below the folder `place` whose path matches the parts of a pattern.

        Each path gets the prefix `shown`.
        """
        part, *rest = parts
        if part == "**" and self._is_recursive:
            yield from self._below(shown, place, rest)
        elif _MAGIC.search(part):
            for entry in self._folder.entries(place, shown):
                if isinstance(entry, Gap):
                    yield entry
                elif self._accepts(entry[0], part) and self._folder.matches(entry[0], part):
                    yield from self._continue(shown, place, *entry, rest)
        elif part == "..":
            yield Gap(f"the folder {shown[:80]}..")
        elif rest:
            below = posixpath.normpath(posixpath.join(place, part))
            yield from self.matches(f"{shown}{part}/", below, rest)
        else:
            self._folder.access()
            path = os.path.join(self._folder.path, place, part)
            if os.path.lexists(path) if part else os.path.isdir(path):
                yield shown + part

    def _accepts(self, name: str, pattern: str) -> bool:
        return self._all_names or name[0] != "." or pattern[0] == "."

    def _continue(self, shown: str, place: str, name: str, is_folder: bool, rest: list[str]) -> Iterator[str | Gap]:
        if not rest:
            yield shown + name
        elif is_folder:
            if (below := self._enter(place, name)) is None:
                yield Gap(f"the link {shown[:80]}{name}")
            else:
                yield from self.matches(f"{shown}{name}/", below, rest)

    def _enter(self, place: str, name: str) -> str | None:
        """Return the path of a subfolder that the search should enter.

        Returns None for a link out of the package, or a folder searched before.
        """
        below = posixpath.normpath(posixpath.join(place, name))
        path = os.path.join(self._folder.path, below)
        if not os.path.islink(path):
            return below
        real = self._folder.real_folder(below)
        here = os.path.realpath(os.path.dirname(path))
        if real is None or real in self._followed or here == real or here.startswith(f"{real}/"):
            return None
        self._followed.add(real)
        return below

    def _below(self, shown: str, place: str, rest: list[str]) -> Iterator[str | Gap]:
        """Yield the paths that match the pattern ``**/rest`` below the folder `place`."""
        if rest:
            yield from self.matches(shown, place, rest)
        elif shown:
            yield shown
        for entry in self._folder.entries(place, shown):
            if isinstance(entry, Gap):
                yield entry
                continue
            name, is_folder = entry
            if not (self._all_names or name[0] != "."):
                continue
            if not rest:
                yield shown + name
            if not is_folder:
                continue
            is_link = os.path.islink(os.path.join(self._folder.path, place, name))
            if is_link and not self._follows_links:
                continue
            below = self._enter(place, name)
            if below is None:
                yield Gap(f"the link {shown[:80]}{name}")
            elif rest:
                yield from self._below(f"{shown}{name}/", below, rest)
            else:
                yield from (path for path in self._below(f"{shown}{name}/", below, rest) if path != f"{shown}{name}/")


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a link to itself
        return False
