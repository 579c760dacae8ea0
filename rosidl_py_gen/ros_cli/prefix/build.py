"""An ament prefix of source packages: planned from their install rules, which are read but not run, and written."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SkippedPackage:
    """A package with C++ code, which is not built.

    Attributes:
        name: name of the package.
        folder: its source folder.
        executables: names of the executables that are missing.
        usable: what the prefix has of the package, for display.
    """

    name: str
    folder: Path
    executables: tuple[str, ...]
    usable: str


@dataclass(frozen=True)
class Prefix:
    """An ament prefix.

    Attributes:
        folder: the prefix.
        packages: source folders of its packages by name.
        skipped: packages with C++ code.
        problems: texts about files that could not be read or installed.
        created: number of files that this call created or changed.
        removed: number of files that this call removed.
    """

    folder: Path
    packages: dict[str, Path]
    skipped: tuple[SkippedPackage, ...]
    problems: tuple[str, ...]
    created: int
    removed: int

    def environment(self) -> dict[str, str]:
        """Return the environment variables that a process needs to find the packages, with current values appended."""
        raise NotImplementedError


def build_prefix(sources: Iterable[Path], out: Path | None = None) -> Prefix:
    """Create or update the prefix of all packages below some folders.

    Args:
        sources: package folders, folders of packages, or workspaces.
        out: folder of the prefix; None for a folder of the cache that belongs to `sources`.

    Raises:
        CommandError: a source does not exist or contains no package, or the prefix cannot be written.
    """
    raise NotImplementedError
