"""Creation of an ament prefix of source packages, with setup scripts; install rules are read, but not run."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from stat import S_IMODE, S_ISREG

from rosidl_py_gen.base import folder_trust
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.compiler.frontend import BundledInterfaces, PackageFiles, Workspace
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.prefix import executables
from rosidl_py_gen.prefix.environment import (
    FIXED,
    PROGRAMS,
    SITE_PACKAGES,
    Executable,
    folders,
    of_distribution,
    variables,
)
from rosidl_py_gen.prefix.package_plan import COMPANIONS, INDEX, PROGRAM, PackagePlan, PrefixFile
from rosidl_py_gen.type_loading import CacheFolder

STATE = ".rosidl-py-prefix"
"""File of a prefix with the paths of the files that this module has written, one on a line."""
_ON_PACKAGE_INDEX = ("xacro",)
"""Names of packages on the Python package index that are used if installed, because launch files run their executables
by the ROS name."""
_NAME = re.compile(r"[A-Za-z0-9][\w-]{1,200}", re.ASCII)
"""Regular expression for package names that ament_index_python accepts, of at most 201 characters, so that they fit
into a file name."""
NAME_RULE = "2 to 201 ASCII letters, digits, _ and -, of which the first is a letter or digit"


@dataclass(frozen=True)
class Prefix:
    """Ament prefix that `build_prefix` has created or updated.

    Attributes:
        packages: source folders of its packages by name.
        skipped: plans of the packages with C++ code, which is not built: `missing` executables, and `text`.
        problems: texts about files that could not be read or installed.
        notes: texts about packages whose files are linked because their install rules are not known.
        unsafe: why other users can change the files of the prefix, and with them run code as its user; else empty.
        created: number of files that the call has created or changed.
        removed: number of obsolete files that the call has removed.
    """

    folder: Path
    packages: dict[str, Path]
    skipped: tuple[PackagePlan, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    unsafe: str
    created: int
    removed: int

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables for a process that uses the prefix; variables with lists keep their current entries."""
        return variables(self.folder)


def build_prefix(sources: Iterable[Path] | None, out: Path | None = None, *, runs_setup: bool = False) -> Prefix:
    """Create or update an ament prefix of all packages below some folders, and return the prefix.

    Args:
        sources: package folders, folders of packages, or workspaces; None for the workspace of the current folder.
        out: folder of the prefix; None for a folder of the cache that belongs to `sources`.
        runs_setup: run each setup.py that cannot be read completely, for a command that runs code of the workspace.

    Raises:
        CommandError: a source does not exist or contains no package, or the prefix cannot be written.
    """
    if os.name == "nt":
        raise CommandError("a prefix needs links and executable scripts; use WSL, or rosidl-py run without a prefix")
    if sources is None:
        around = Workspace.around(Path.cwd())
        if around is None or not around.packages:
            raise CommandError("there is no package in or around the current folder; give the folder of a workspace")
        sources = around.roots
    searched = [*dict.fromkeys(Path(os.path.abspath(source)) for source in sources)]
    problems: list[str] = []
    packages = _find_packages(searched, problems)
    prefix = _cached_prefix(searched) if out is None else Path(os.path.abspath(out))
    plans = [PackagePlan(name, folder, runs_setup=runs_setup) for name, folder in packages.items()]
    files = _own_files(prefix, plans)
    owners = dict.fromkeys(files, "the prefix itself")
    for plan in plans:
        problems += plan.problems
        for place, file in plan.files.items():
            if files.setdefault(place, file) != file:
                problems.append(f"{plan.name}: {place} is a file of {owners[place]}, too; that one is used")
            owners.setdefault(place, plan.name)
    files = _bundled_files() | files
    try:
        created, removed = _Writer(prefix, is_private=out is None).write(files, problems)
    except OSError as error:
        raise CommandError(f"{display_path(prefix)}: cannot be written: {error.strerror or error}") from error
    for plan in plans:
        plan.missing = [name for name in plan.missing if f"lib/{plan.name}/{name}" not in files]
    skipped = tuple(plan for plan in plans if plan.has_targets)
    notes = tuple(text for plan in plans for text in plan.notes)
    unsafe = "" if out is None else folder_trust.tree_reason(prefix)
    return Prefix(prefix, packages, skipped, tuple(problems), notes, unsafe, created, removed)


def is_ament_name(name: str) -> bool:
    """Return True if ament accepts the name of a package; packages with interfaces have a stricter rule."""
    return _NAME.fullmatch(name) is not None


def _cached_prefix(searched: Iterable[Path]) -> Path:
    try:
        return CacheFolder.create("prefix", (sys.executable, *searched)).path
    except OSError as error:
        raise CommandError(f"the prefix cannot be written: {error.strerror or error}") from error


def _find_packages(searched: list[Path], problems: list[str]) -> dict[str, Path]:
    packages: dict[str, Path] = {}
    for folder in searched:
        if not folder.is_dir():
            raise CommandError(f"{display_path(folder)}: expected a folder of packages, found none")
        workspace = Workspace(folder)
        if not (folder / "package.xml").exists() and (folder / "src").is_dir():
            inside = Workspace(folder / "src")  # may be a folder of sources that is not part of a workspace
            workspace = inside if inside.all_packages else workspace
        if workspace.limit_text:
            problems.append(workspace.limit_text)
        if not workspace.all_packages:
            raise CommandError(f"{display_path(folder)}: expected packages with a package.xml, found none")
        for name, place in workspace.all_packages:
            if not is_ament_name(name):
                text = f'"{name[:200]}" is not the name of a package; expected {NAME_RULE}'
                problems.append(f"{display_path(place / 'package.xml')}: {text}")
            elif (used := packages.setdefault(name, place)) != place:
                text = f"two packages are called {name}: {display_path(used)} is used, {display_path(place)} is not"
                problems.append(f"{text}; put an empty file COLCON_IGNORE into one of them")
    return packages


def _own_files(prefix: Path, plans: Iterable[PackagePlan]) -> dict[str, PrefixFile]:
    """Return the files that this package adds to a prefix, by relative path: setup scripts, ``sitecustomize`` and a
    program ``ros2``.
    """
    if os.pathsep in str(prefix):
        raise CommandError(f'{prefix}: a prefix must not have "{os.pathsep}" in its path, which separates folders')
    names = {name for distro in Distribution.BUNDLED for name in BundledInterfaces.of(distro).packages}
    names |= {plan.name for plan in plans if f"{INDEX}/rosidl_interfaces/{plan.name}" in plan.files}
    names |= {*COMPANIONS, "rosidl_parser"}
    template = Path(__file__).with_name("sitecustomize_template.py").read_text(encoding="utf-8")
    texts = {
        "COLCON_IGNORE": "",
        **dict.fromkeys(("setup.sh", "setup.bash", "setup.zsh"), _posix_script(prefix)),
        "setup.fish": _fish_script(prefix),
        f"{SITE_PACKAGES}/sitecustomize.py": template.replace("frozenset(())", f"frozenset({sorted(names)})"),
    }
    files = {place: PrefixFile(content=os.fsencode(text)) for place, text in texts.items()}
    package = Path(__file__).parents[2]
    ros2 = Executable("ros2", package, module="rosidl_py_gen.ros_cli.ros2", function="main")
    return files | {f"{PROGRAMS}/ros2": PrefixFile(content=ros2.program(), mode=PROGRAM)}


def _posix_script(prefix: Path) -> str:
    lines = [f"export {name}={value}" for name, value in FIXED.items()]
    for name, value in of_distribution().items():
        lines.append(f'[ -n "${{{Distribution.VARIABLE}:-}}" ] || export {name}={value}')
    for name, folder in folders(prefix).items():
        quoted, old = shlex.quote(str(folder)), f"${{{name}:+:${{{name}}}}}"
        lines.append(f'case "{old}:" in *:{quoted}:*) ;; *) export {name}={quoted}"{old}" ;; esac')
    return "\n".join(lines) + "\n"


def _fish_script(prefix: Path) -> str:
    lines = [f"set -gx {name} {value}" for name, value in FIXED.items()]
    for name, value in of_distribution().items():
        lines.append(f'test -n "${Distribution.VARIABLE}"; or set -gx {name} {value}')
    for name, folder in folders(prefix).items():
        quoted = "'" + str(folder).replace("\\", "\\\\").replace("'", "\\'") + "'"
        value = f"{quoted} $PATH" if name == "PATH" else f"(string join : -- {quoted} ${name})"
        lines.append(f'contains -- {quoted} (string split : -- "${name}"); or set -gx {name} {value}')
    return "\n".join(lines) + "\n"


def _bundled_files() -> dict[str, PrefixFile]:
    """Return the files for ROS packages whose executables are part of this package or installed by pip.

    Keys are paths below the install prefix that `rosidl-py prefix` makes.
    """
    found: dict[str, PrefixFile] = {}
    for package in (*executables.BUNDLED, *_ON_PACKAGE_INDEX):
        for name, one in (executables.of_bundled(package) or executables.of_distribution(package)).items():
            manifest = f'<package format="3">\n  <name>{package}</name>\n  <version>0.0.0</version>\n</package>\n'
            program = PrefixFile(None, one.program(), PROGRAM)
            found[f"{INDEX}/packages/{package}"] = PrefixFile(content=b"")
            found[f"share/{package}/package.xml"] = PrefixFile(content=manifest.encode())
            found[f"lib/{package}/{name}"] = program
            if package in _ON_PACKAGE_INDEX:  # launch files also run $(find-pkg-prefix xacro)/bin/xacro
                found[f"bin/{name}"] = program
    return found


class _Writer:
    """Writer of the files of a prefix that differ; removes obsolete files of an earlier call, but no other file.

    Every folder of a path is a real folder below the prefix, so that nothing is written elsewhere. A prefix in
    the cache is private; other users may use a prefix whose path the user has given, if the umask permits.
    """

    def __init__(self, prefix: Path, *, is_private: bool) -> None:
        folder_trust.make_folder(prefix, is_private=is_private)
        self._is_private = is_private
        self._prefix = prefix = Path(os.path.realpath(prefix))
        self._new = prefix / f".new-{os.getpid()}"
        self._state = prefix / STATE
        self._old: set[str] = set()
        self._made: set[Path] = set()
        if self._state.is_file() and not self._state.is_symlink():
            places = os.fsdecode(self._state.read_bytes()).split("\n")
            self._old = {place for place in places if PackageFiles.inside(place) == place}
        elif any(not one.name.startswith(".new-") for one in prefix.iterdir()):
            text = "the folder is not empty, and rosidl-py prefix has not written it"
            raise CommandError(f"{display_path(prefix)}: {text}; choose another one with --out")

    def write(self, files: dict[str, PrefixFile], problems: list[str]) -> tuple[int, int]:
        """Write files by their paths and remove obsolete files; returns the numbers of written and removed files."""
        removed = sum(self._remove(place) for place in sorted(self._old - files.keys(), reverse=True))
        if not files.keys() <= self._old:  # first, so that an interrupted call leaves no unknown files
            self._write_state(self._old | files.keys())
        created = 0
        for place, file in files.items():
            try:
                created += self._write_file(place, file)
            except OSError as error:
                problems.append(f"{place} cannot be written: {error.strerror or error}")
        if self._old != files.keys():
            self._write_state(files.keys())
        self._new.unlink(missing_ok=True)
        return created, removed

    def _write_state(self, places: Iterable[str]) -> None:
        self._write_in_one_step(self._state, PrefixFile(content=os.fsencode("\n".join(sorted(places)))))

    def _write_file(self, place: str, file: PrefixFile) -> bool:
        """Write a file of the prefix; returns False if the file is up to date."""
        path = self._prefix / place
        if path.parent not in self._made:
            if os.path.realpath(path.parent) != str(path.parent):  # a link, which may lead out of the prefix
                raise OSError(0, f"{os.path.dirname(place)} is not a folder")
            folder_trust.make_folder(path.parent, is_private=self._is_private)
            self._made.add(path.parent)
        exists = os.path.lexists(path)  # before the content, as another process may create it in between
        if exists and _is_current(path, file):
            return False
        if exists and place not in self._old:
            raise OSError(0, "there is another file of this name, which is left alone")
        self._write_in_one_step(path, file)
        return True

    def _write_in_one_step(self, path: Path, file: PrefixFile) -> None:
        """Write a file, so that other processes that use the prefix never see an incomplete file."""
        self._new.unlink(missing_ok=True)
        if file.content is not None:
            self._new.write_bytes(file.content)
            self._new.chmod(file.mode)
        elif file.source is not None:
            self._new.symlink_to(file.source)
        self._new.replace(path)

    def _remove(self, place: str) -> bool:
        """Remove a file of the prefix and empty folders above it; returns False if the file remains."""
        path = self._prefix / place
        if os.path.realpath(path.parent) != str(path.parent):
            return False
        with suppress(OSError):
            path.unlink()
            for folder in path.parents[: place.count("/")]:
                folder.rmdir()
            return True
        return not os.path.lexists(path)


def _is_current(path: Path, file: PrefixFile) -> bool:
    try:
        if file.content is None:
            return os.readlink(path) == str(file.source)
        found = os.lstat(path)
        return S_ISREG(found.st_mode) and S_IMODE(found.st_mode) == file.mode and path.read_bytes() == file.content
    except OSError:
        return False
