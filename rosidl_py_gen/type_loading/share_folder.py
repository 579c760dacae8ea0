"""Share folder of a source package, with the files that its setup.py and CMakeLists.txt install.

No code is run. Programs expect files below ``share/<package>`` at their installed paths: `glob("launch/*")` of setup.py
installs them without their folder. If an installation only copies folders, the source folder is the share folder.
Otherwise the share folder is a folder of links in the user's cache, to the contents of the source folder and to the
installed files.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from rosidl_py_gen.base import folder_trust
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import RUN_PREFIX
from rosidl_py_gen.compiler.frontend import CMakeScript, PackageBudget, UnreadableError
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.type_loading.disk_cache import CacheFolder
from rosidl_py_gen.type_loading.install_rules import Install, entry_names
from rosidl_py_gen.type_loading.setup_reader.setup_files import PackageSetup, SetupFilesError

_MAX_ENTRIES = 20_000
"""Maximum number of links in one share folder."""
_Tree = dict[str, "Path | _Tree"]


def share_folder(
    name: str,
    folder: Path,
    interfaces: Mapping[RosName, Path] | None = None,
    problem: Callable[[str], None] = lambda text: None,
) -> Path:
    """Return the share folder of a source package: `folder` itself, or a folder of links to installed files.

    Args:
        name: name of the package.
        folder: source folder of the package.
        interfaces: its interface files, if some are in other folders.
        problem: called with a text if setup.py computes paths that are not known, or a file cannot be read.
    """
    tree: _Tree = {entry: folder / entry for entry in entry_names(folder)}
    is_same = interfaces is None
    for kind in {interface.kind for interface in interfaces or ()}:
        tree[kind] = {path.name: path for interface, path in (interfaces or {}).items() if interface.kind == kind}
    for place, source in _installed(name, folder, problem):
        is_same &= _insert(tree, [part for part in place.split("/") if part not in ("", ".")], source)
    if is_same:
        return folder
    try:
        made = CacheFolder.create("share", (folder, *(interfaces or {}).values())).path / name
        folder_trust.make_folder(made)
        _link(tree, made, [_MAX_ENTRIES])
    except OSError:  # links are not permitted, as on Windows
        return folder
    return made


def _installed(name: str, folder: Path, problem: Callable[[str], None]) -> Iterator[tuple[str, Path]]:
    """Yield each file or folder that the package installs into its share folder: path below ``share/<name>`` and source
    path.
    """
    share = f"share/{name}"
    installs: list[Install] = []
    budget = PackageBudget()
    uncertain = ""
    try:
        if (folder / "CMakeLists.txt").is_file():
            installs += Install.of_cmake(folder, CMakeScript.read(folder, budget))
    except UnreadableError as error:
        text = f"{name}: what {display_path(folder / 'CMakeLists.txt')} installs is not known: {error}"
        problem(f"{text}; the share folder has all files of the package at their places in the sources")
        budget.renew()
    try:
        setup = PackageSetup.read(folder, budget)
        installs += setup.data_files
        if "data_files" in setup.uncertain:
            place = display_path(folder / (setup.unread or "setup.py"))
            how = "" if setup.unread else " without running it"
            uncertain = f"data_files of {place} are not known{how}: {setup.uncertain['data_files']}"
    except SetupFilesError as error:
        uncertain = f"data_files are not known: {error}"
    prefix = os.environ.get(RUN_PREFIX)
    if uncertain and prefix and os.path.isdir(os.path.join(prefix, share)):
        yield from _linked(Path(prefix, share))
    elif uncertain:
        problem(f"{name}: {uncertain}; the share folder has all files of the package at their places in the sources")
    for one in installs:
        if (one.destination + "/").startswith(f"{share}/"):
            for below, path in one.files():
                yield posixpath.join(one.destination[len(share) :].lstrip("/"), below), folder / path


def _linked(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the path and the target of each link below a folder."""
    count = 0
    for place, _, files in os.walk(folder):
        for name in files:
            path = os.path.join(place, name)
            if os.path.islink(path) and (count := count + 1) < _MAX_ENTRIES:
                yield os.path.relpath(path, folder), Path(os.readlink(path))


def _insert(tree: _Tree, parts: list[str], source: Path) -> bool:
    """Insert a file or folder into the tree of the entries of a share folder; return True if it was there already."""
    for index, part in enumerate(parts[:-1], 1):
        below = tree.get(part, {})
        if isinstance(below, Path):
            if below.joinpath(*parts[index:]) == source:
                return True
            below = {entry: below / entry for entry in entry_names(below)}
        tree[part] = tree = below
    if tree.get(parts[-1]) == source:
        return True
    tree[parts[-1]] = source
    return False


def _link(tree: _Tree, folder: Path, left: list[int]) -> None:
    """Create or update the links of a share folder from a tree of entries; files that programs have written there stay.

    `left` has the number of links that may still be created. Raises OSError if more are needed.
    """
    for name, source in tree.items():
        left[0] -= 1
        if left[0] < 0:
            raise OSError("more files than a package installs")
        place = folder / name
        if place.is_symlink():
            if isinstance(source, Path) and os.readlink(place) == str(source):
                continue
            place.unlink(missing_ok=True)
        if isinstance(source, Path) and not place.exists():
            with suppress(FileExistsError):  # another process was faster
                place.symlink_to(source)
        elif isinstance(source, dict) or (place.is_dir() and source.is_dir()):
            folder_trust.make_folder(place)
            _link(
                source if isinstance(source, dict) else {one: source / one for one in entry_names(source)}, place, left
            )
    for entry in folder.iterdir():
        if entry.is_symlink() and entry.name not in tree:
            entry.unlink(missing_ok=True)
