"""Interface packages of ROS distributions that are bundled with the product.

`interfaces/` has the definitions of the default distribution; `interfaces/distributions/<name>` has the files of
another distribution that differ or are new, and ``absent.txt`` with the packages and interfaces that it lacks.
"""

from __future__ import annotations

import os
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend.model import IMPLIED

_BASES = {"humble": Distribution.DEFAULT, "kilted": Distribution.DEFAULT, "lyrical": "kilted"}
"""Distribution by distribution name: the stored definitions of the key are differences from the definitions of the
value."""
_NEEDED = frozenset(package for packages in IMPLIED.values() for package in packages)
"""Packages that services and actions need in every distribution, because the classes of service events refer to
`service_msgs`."""


class BundledFiles(NamedTuple):
    """Files of a bundled package: its folder, and the interface files if they are not exactly the files of
    the folder.
    """

    folder: Path
    files: dict[RosName, Path] | None


class _Difference(NamedTuple):
    """Stored difference between a distribution and the distribution on which its stored definitions are based.

    Attributes:
        files: interface files that are new or changed.
        folders: folders of the packages with such files.
        absent: names of packages and interfaces that the distribution lacks.
    """

    files: dict[RosName, Path]
    folders: dict[str, Path]
    absent: frozenset[str]


class BundledInterfaces:
    """Bundled interfaces of a distribution; `of` creates and caches them."""

    def __init__(self, distro: str) -> None:
        self._distro = distro

    @classmethod
    @cache
    def of(cls, distro: str) -> BundledInterfaces:
        """Return the bundled interfaces of a distribution."""
        return cls(distro)

    @cached_property
    def packages(self) -> dict[str, BundledFiles]:
        """Bundled packages by name.

        Packages that every service or action refers to are included even if the distribution lacks them; `is_absent` is
        True for their interfaces. The dictionary is shared; callers must not change it.
        """
        top = DataFolders.interfaces()
        packages = {name: BundledFiles(top / name, None) for name in _package_folders(top)}
        for layer in self._layers:
            difference = _difference(layer)
            absent_names = difference.absent
            for name in absent_names - _NEEDED:
                packages.pop(name, None)
            changed = {name.package for name in difference.files} | {name.partition("/")[0] for name in absent_names}
            for package in sorted(changed):
                old = packages.get(package)
                if old is None and package not in difference.folders:
                    continue
                folder = old.folder if old else difference.folders[package]
                files = dict((old.files or files_below(package, old.folder)) if old else {})
                files.update({name: path for name, path in difference.files.items() if name.package == package})
                files = {name: path for name, path in files.items() if str(name) not in absent_names}
                packages[package] = BundledFiles(folder, dict(sorted(files.items())))
        return packages

    def is_absent(self, name: RosName) -> bool:
        """Return True for an interface in `packages` whose package the distribution lacks."""
        return any(name.package in _difference(layer).absent for layer in self._layers)

    @cached_property
    def changed(self) -> frozenset[RosName]:
        """Interfaces that the distribution added, removed or changed relative to the default distribution."""
        if self._distro == Distribution.DEFAULT:
            return frozenset()
        own, default = self.paths, self.of(Distribution.DEFAULT).paths
        return frozenset(name for name in own.keys() | default.keys() if own.get(name) != default.get(name))

    @cached_property
    def paths(self) -> dict[RosName, Path]:
        """Files of all interfaces by name."""
        found: dict[RosName, Path] = {}
        for package, (folder, files) in self.packages.items():
            found.update(files_below(package, folder) if files is None else files)
        return {name: path for name, path in found.items() if not self.is_absent(name)}

    @property
    def _layers(self) -> list[str]:
        """Distributions whose stored differences, applied in this order to the default definitions, give the
        definitions of this distribution.
        """
        found: list[str] = []
        distro = self._distro
        while distro != Distribution.DEFAULT:
            found.insert(0, distro)
            distro = _BASES[distro]
        return found


def other_distributions_note(package: str, name: RosName | None = None) -> str:
    """Return a text for errors that names the other distributions with a package, or with its interface `name`.

    Returns "" if no distribution has it.
    """
    having = []
    for distro in Distribution.BUNDLED:
        paths = BundledInterfaces.of(distro).paths
        if name in paths if name else any(one.package == package for one in paths):
            having.append(distro)
    if not having:
        return ""
    *others, last = having
    names = f"{', '.join(others)} and {last}" if others else last
    return f"; it is part of {names} only: select that with --distro, distro= or ROS_DISTRO"


def files_below(package: str, folder: Path) -> dict[RosName, Path]:
    """Return the .msg, .srv and .action files of a package's folder by interface name."""
    return {
        RosName(package, kind, path.stem): path
        for kind in RosName.KINDS
        for path in sorted((folder / kind).glob(f"*.{kind}"))
    }


@cache
def _difference(distro: str) -> _Difference:
    top = DataFolders.interfaces() / "distributions" / distro
    folders = {name: top / name for name in _package_folders(top)}
    files: dict[RosName, Path] = {}
    for package, folder in folders.items():
        files.update(files_below(package, folder))
    lines = (top / "absent.txt").read_text(encoding="utf-8").split()
    return _Difference(files, folders, frozenset(str(RosName.parse(one)) if "/" in one else one for one in lines))


def _package_folders(top: Path) -> list[str]:
    return sorted(entry.name for entry in os.scandir(top) if entry.is_dir() and entry.name != "distributions")
