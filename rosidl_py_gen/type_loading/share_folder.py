"""Share folder of a source package, with the files that its setup.py and CMakeLists.txt install.

No code is run. Programs expect files below ``share/<package>`` at their installed paths: `glob("launch/*")` of setup.py
installs them without their folder. If an installation only copies folders, the source folder is the share folder.
Otherwise the share folder is a folder of links in the user's cache, to the contents of the source folder and to the
installed files.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise, takewhile
from pathlib import Path

from rosidl_py_gen.base.folder_trust import make_folder
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import RUN_PREFIX
from rosidl_py_gen.compiler.frontend import UNKNOWN, CMakeScript, PackageBudget, UnreadableError, inside, read_text
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.type_loading.disk_cache import cached_folder
from rosidl_py_gen.type_loading.setup_reader.setup_files import SetupFilesError, read_setup_files

_LIST_END = re.compile(
    "DESTINATION|((FILE|DIRECTORY|USE_SOURCE)_)?PERMISSIONS|CONFIGURATIONS|COMPONENT|RENAME|OPTIONAL|TYPE|PATTERN|REGEX"
    "|FILES_MATCHING|EXCLUDE_FROM_ALL|MESSAGE_NEVER"
)
_MAX_ENTRIES = 20_000
"""Maximum number of links in one share folder."""
_Tree = dict[str, "Path | _Tree"]


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
            place = inside(path)
            exists = Path.exists if self.kind == "DIRECTORY" else Path.is_file
            if place is None or not exists(self.folder / place):
                continue
            if self.kind == "DIRECTORY" and path.endswith("/"):
                yield from ((name, posixpath.join(place, name)) for name in _names(self.folder / place))
            else:
                yield self.rename or posixpath.basename(place), place


def cmake_installs(folder: Path, script: CMakeScript) -> list[Install]:
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
        destination = options.get("DESTINATION", UNKNOWN)
        named = zip(texts, texts[1:], [*texts[2:], ""], strict=False)
        filters = tuple((pattern, after == "EXCLUDE") for word, pattern, after in named if word == "PATTERN")
        only_matching = "FILES_MATCHING" in texts and "REGEX" not in texts
        place, rename = posixpath.normpath(destination), options.get("RENAME", "")
        found.append(Install(folder, texts[0], paths, place, rename, filters, only_matching))
    return found


def setup_installs(folder: Path, rows: object) -> list[Install]:
    """Return the install rules for the argument `data_files` of a setup.py, whose value is `rows`.

    Paths that cannot be determined are UNKNOWN.
    """
    tops = [os.path.join(os.path.abspath(folder), ""), os.path.join(os.path.realpath(folder), "")]

    def source(path: object) -> str:
        if not isinstance(path, str):
            return UNKNOWN
        return next((path[len(top) :] for top in tops if path.startswith(top)), path)

    found = []
    for row in rows if isinstance(rows, list) else [] if rows is None else [None]:
        match row:
            case [str(place), list(paths)]:
                place = posixpath.normpath(re.sub(r"[\\/]+", "/", place))
                found.append(Install(folder, "FILES", tuple(map(source, paths)), place))
            case str(path):  # a file at the top of the prefix
                found.append(Install(folder, "FILES", (source(path),), "."))
            case _:
                found.append(Install(folder, "FILES", (UNKNOWN,), UNKNOWN))
    return found


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
    tree: _Tree = {entry: folder / entry for entry in _names(folder)}
    is_same = interfaces is None
    for kind in {interface.kind for interface in interfaces or ()}:
        tree[kind] = {path.name: path for interface, path in (interfaces or {}).items() if interface.kind == kind}
    for place, source in _installed(name, folder, problem):
        is_same &= _insert(tree, [part for part in place.split("/") if part not in ("", ".")], source)
    if is_same:
        return folder
    try:
        made = cached_folder("share", (folder, *(interfaces or {}).values())) / name
        make_folder(made)
        _link(tree, made, [_MAX_ENTRIES])
    except OSError:  # links are not permitted, as on Windows
        return folder
    return made


def _names(folder: Path) -> list[str]:
    with suppress(OSError):
        return sorted(entry for entry in os.listdir(folder) if not entry.startswith("."))
    return []


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
            installs += cmake_installs(folder, CMakeScript(folder, read_text(folder, "CMakeLists.txt"), budget))
    except UnreadableError as error:
        text = f"{name}: what {display_path(folder / 'CMakeLists.txt')} installs is not known: {error}"
        problem(f"{text}; the share folder has all files of the package at their places in the sources")
        budget.renew()
    try:
        setup = read_setup_files(folder, budget)
        installs += setup_installs(folder, setup.values.get("data_files"))
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
            below = {entry: below / entry for entry in _names(below)}
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
            make_folder(place)
            _link(source if isinstance(source, dict) else {one: source / one for one in _names(source)}, place, left)
    for entry in folder.iterdir():
        if entry.is_symlink() and entry.name not in tree:
            entry.unlink(missing_ok=True)
