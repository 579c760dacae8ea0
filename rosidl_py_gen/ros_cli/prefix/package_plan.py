"""Files of a prefix that one source package installs, read from its setup.py or CMakeLists.txt, which are not run.

Folders are real, and files are links: tools of ROS do not follow links to folders below ``share``. Python packages are
links to their source folders. If install rules cannot be read, the files of the source folder are linked instead.
"""

from __future__ import annotations

import os
import posixpath
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.cmake_reader import UNKNOWN, CMakeScript, inside
from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, files_below, read_text
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.prefix import executables, wrappers
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR
from rosidl_py_gen.type_loading.setup_py import SetupSyntaxError, setup_calls
from rosidl_py_gen.type_loading.share_folder import Install, installs_of

SITE_PACKAGES = f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
INDEX = "share/ament_index/resource_index"
COMPANIONS = frozenset(entry.name for entry in RCLPY_COMPAT_DIR.iterdir())
"""Python packages that the import hook provides, in place of those of the workspace."""
_MAX_FILES = 20_000
"""Maximum number of files that a package installs, and of directory entries that are read for them."""
_MAX_COPY_BYTES = 16 << 20
_MAX_PLACE = 1024
_UNENCODABLE = re.compile("[\ud800-\udc7f\udd00-\udfff]")
"""Characters that no file name has; others in this range are bytes that are not UTF-8."""
_CODE_FOLDERS = ("include", "src", "test", "tests")
"""Folders that are not linked if the install rules are unknown."""
_TARGETS = ("add_executable", "add_library", "ament_auto_add_executable", "ament_auto_add_library")
_BUILD_TYPE = re.compile(r"<build_type(?![^>]*ROS_VERSION\s*==\s*1)[^>]*>\s*(\w+)\s*<")
"""Not that of ROS 1: packages for both have one build type with the condition `$ROS_VERSION == 1`."""
_LAUNCH_FILE = re.compile(r"(launch\.(py|xml|ya?ml)|\.launch)\Z")
_VERSION = re.compile(r"<version[^>]*>\s*([\w.+-]+)\s*<")


class PrefixFile(NamedTuple):
    """A file of a prefix: a link to `source`, or a file with `content`."""

    source: Path | None = None
    content: bytes | None = None
    is_program: bool = False

    @property
    def mode(self) -> int:
        """Permissions of a file with `content`."""
        return 0o755 if self.is_program else 0o644


@dataclass
class PackagePlan:
    """What a package installs.

    Attributes:
        name: name of the package.
        folder: its source folder.
        files: files by their paths below the prefix.
        problems: texts about what could not be read or installed.
        missing: names of the executables that need a build.
        has_targets: there is C++ code.
        is_complete: all install rules were read.
    """

    name: str
    folder: Path
    files: dict[str, PrefixFile] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    has_targets: bool = False
    is_complete: bool = True

    def problem(self, text: str) -> None:
        self.problems.append(f"{self.name} ({display_path(self.folder)}): {text}")

    def add(self, place: str, file: PrefixFile) -> None:
        """Add a file at a path below the prefix; other paths, and paths of other files, are problems."""
        if UNKNOWN in place:
            self.is_complete = False
            return
        path = inside(place)
        if path is None or len(path) > _MAX_PLACE or "\n" in path or _UNENCODABLE.search(path):
            self.problem(f'"{place[:200]}" is not a path below the prefix; the file is skipped')
            return
        old, self.files[path] = self.files.get(path, file), file
        if old.source != file.source:
            self.problem(f"two files would be {path}; the last one is used, {display_path(file.source or path)}")
        if len(self.files) > _MAX_FILES:
            raise _TooManyError

    @property
    def text(self) -> str:
        """Line about a package with C++ code: the missing executables, and what the prefix has of it."""
        share = [place for place in self.files if place.startswith(f"share/{self.name}/")]
        launch = sum(_LAUNCH_FILE.search(place) is not None for place in share)
        programs = sum(file.is_program for file in self.files.values())
        counts = {"launch file": launch, "share file": len(share) - launch, "Python program": programs}
        usable = ", ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)
        return f"{self.name}: without {', '.join(self.missing) or 'its libraries'}; with {usable}"


class _TooManyError(Exception):
    """A package installs too many files."""


def plan_package(name: str, folder: Path, interfaces: dict[RosName, Path]) -> PackagePlan:
    """Return what a source package installs; errors of its files are `problems`."""
    plan = PackagePlan(name, folder)
    try:
        _plan(plan, interfaces)
    except _TooManyError:
        plan.problem(f"it installs more than {_MAX_FILES} files; the others are skipped")
    except OSError as error:
        plan.problem(f"{error.filename or folder} cannot be read: {error.strerror or error}")
    plan.files.setdefault(f"{INDEX}/packages/{name}", PrefixFile(content=b""))
    plan.files.setdefault(f"share/{name}/package.xml", PrefixFile(folder / "package.xml"))
    return plan


def _plan(plan: PackagePlan, interfaces: dict[RosName, Path]) -> None:
    name, folder = plan.name, plan.folder
    for interface, path in interfaces.items():
        plan.add(f"share/{name}/{interface.kind}/{path.name}", PrefixFile(path))
    if interfaces:
        lines = sorted(f"{interface.kind}/{path.name}" for interface, path in interfaces.items())
        plan.add(f"{INDEX}/rosidl_interfaces/{name}", PrefixFile(content=os.fsencode("\n".join(lines))))
    manifest = _text(folder, "package.xml")
    found = _BUILD_TYPE.search(manifest)
    is_cmake = (folder / "CMakeLists.txt").is_file()
    is_python = any((folder / name).is_file() for name in ("setup.py", "pyproject.toml", "setup.cfg"))
    if is_cmake and is_python and found:
        is_cmake, is_python = "python" not in found[1], "python" in found[1]
    version = _VERSION.search(manifest)
    plan.is_complete = is_cmake or is_python
    try:
        if is_python:
            _PythonRules(plan, version[1] if version else "0.0.0").read()
        if is_cmake:
            _CMakeRules(plan, version[1] if version else "0.0.0").read()
    except UnreadableError as error:
        plan.is_complete = False
        plan.problem(error.reason)
    except (CommandError, SetupSyntaxError) as error:
        plan.is_complete = False
        plan.problems.append(f"{name}: {error}")
    if not plan.is_complete:
        _link_sources(plan)


def _text(folder: Path, name: str) -> str:
    try:
        return read_text(folder, name)
    except UnreadableError:
        return ""


def _link_sources(plan: PackagePlan) -> None:
    """Link the files of the source folder below ``share``, except those that known rules install there."""
    share = f"share/{plan.name}/"
    installed = {file.source for place, file in plan.files.items() if place.startswith(share)}
    try:
        paths = files_below(plan.folder)
    except UnreadableError as error:
        plan.problem(error.reason)
        return
    for path in paths:
        is_code = path.split("/")[0] in _CODE_FOLDERS or "/" not in path
        if not is_code and plan.folder / path not in installed and share + path not in plan.files:
            plan.add(share + path, PrefixFile(plan.folder / path))


class _Rules:
    def __init__(self, plan: PackagePlan, version: str) -> None:
        self._plan, self._version = plan, version

    def _source(self, path: str) -> Path | None:
        """Return a file or folder of the package that is installed; None, and a problem, if it is elsewhere."""
        if UNKNOWN in path:
            self._plan.is_complete = False
            return None
        place = inside(path.removeprefix(f"{self._plan.folder}/"))
        if place is None:
            self._plan.problem(f'"{path[:200]}" is not in the package folder; it is skipped')
            return None
        return self._plan.folder / place

    def _add_file(self, place: str, source: Path, is_program: bool = False) -> None:
        """Add a file; scripts below ``lib`` become programs that run with this Python."""
        is_below_lib = place.startswith(("lib/", "bin/")) and not place.startswith(SITE_PACKAGES)
        file = PrefixFile(source)
        if is_program or (is_below_lib and wrappers.is_program(source)):
            file = self._program(source)
        self._plan.add(place, file)

    def _program(self, source: Path) -> PrefixFile:
        if wrappers.is_python(source):
            return PrefixFile(source, wrappers.of_file(source), is_program=True)
        if os.access(source, os.X_OK):
            return PrefixFile(source)
        with source.open("rb") as file:
            return PrefixFile(source, file.read(_MAX_COPY_BYTES), is_program=True)

    def _add_entry_points(self, scripts_folder: str) -> dict[str, list[str]]:
        """Add programs of console scripts; returns the entry points by group."""
        groups: dict[str, list[str]] = {}
        for source, found, root in executables.entry_points(self._plan.folder):
            for group, lines in found.items():
                groups.setdefault(group, []).extend(line.strip() for line in lines if "=" in line)
            for one in executables.console_scripts(found, source, self._plan.folder / root, self._plan.problem):
                content = wrappers.of_function(one.module or "", one.function or "")
                if inside(one.name) and "/" not in one.name:
                    self._plan.add(f"{scripts_folder}/{one.name}", PrefixFile(content=content, is_program=True))
                else:
                    self._plan.problem(f'"{one.name[:200]}" is not the name of an executable; it is skipped')
        return groups

    def _add_metadata(self, name: str, version: str, groups: dict[str, list[str]]) -> None:
        """Add the metadata of a Python distribution, in which other programs find entry points."""
        folder = f"{SITE_PACKAGES}/{re.sub(r'[^A-Za-z0-9.]+', '_', name)}-{version}.dist-info"
        text = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
        self._plan.add(f"{folder}/METADATA", PrefixFile(content=text.encode()))
        sections = (f"[{group}]\n" + "".join(f"{line}\n" for line in lines) for group, lines in groups.items())
        if text := "\n".join(sections):
            self._plan.add(f"{folder}/entry_points.txt", PrefixFile(content=text.encode(errors="replace")))


class _PythonRules(_Rules):
    """Rules of setup.py, setup.cfg and pyproject.toml."""

    def read(self) -> None:
        folder = self._plan.folder
        given: dict[str, object] = {}
        if (folder / "setup.py").is_file():
            try:
                calls = setup_calls(read_text(folder, "setup.py"), folder)
            except SetupSyntaxError as error:
                raise CommandError(f"{folder / 'setup.py'}: {error}") from error
            for call in calls:
                given |= call
        scripts_folder = self._scripts_folder()
        name, version = given.get("name"), given.get("version")
        groups = self._add_entry_points(scripts_folder)
        if given.get("entry_points", {}) is None:
            self._plan.problem("the entry points of setup.py cannot be read without running it; they are skipped")
        self._add_metadata(
            name if isinstance(name, str) and re.fullmatch(r"[\w.-]{1,200}", name) else self._plan.name,
            version if isinstance(version, str) and re.fullmatch(r"[\w.+!-]{1,100}", version) else self._version,
            groups,
        )
        for module, source in self._modules(given):
            self._plan.add(f"{SITE_PACKAGES}/{module}", PrefixFile(source))
        for path in self._texts(given, "scripts"):
            if (script := self._source(path)) is not None and script.is_file():
                self._plan.add(f"{scripts_folder}/{script.name}", self._program(script))
        rows = given.get("data_files", [])
        self._plan.is_complete &= isinstance(rows, list)
        for row in rows if isinstance(rows, list) else ():
            match row:
                case [str(place), list(paths)]:
                    self._add_data_files(re.sub(r"[\\/]+", "/", place), paths)
                case _:
                    self._plan.is_complete = False

    def _add_data_files(self, place: str, paths: list[object]) -> None:
        for path in paths:
            if not isinstance(path, str):
                self._plan.is_complete = False
            elif (source := self._source(path)) is not None and source.is_file():
                self._add_file(posixpath.join(place, source.name), source)

    def _texts(self, given: dict[str, object], name: str) -> list[str]:
        values = given.get(name)
        return [value for value in values if isinstance(value, str)] if isinstance(values, list) else []

    def _scripts_folder(self) -> str:
        """Return the folder of console scripts: that of setup.cfg, else ``bin``."""
        if not (self._plan.folder / "setup.cfg").is_file():
            return "bin"
        source = self._plan.folder / "setup.cfg"
        parser = executables.read_setup_cfg(read_text(self._plan.folder, "setup.cfg"), source)
        names = (("install", "install_scripts"), ("develop", "script_dir"))
        for section, option in ((one, spelled) for one, name in names for spelled in (name, name.replace("_", "-"))):
            if folder := parser.get(section, option, fallback=""):
                return re.sub(r"^\$base/|^\$\{base\}/", "", folder)
        return "bin"

    def _modules(self, given: dict[str, object]) -> Iterator[tuple[str, Path]]:
        """Yield the paths below site-packages, and the sources, of the Python packages and modules."""
        folder = self._plan.folder
        given_folders = given.get("package_dir")
        folders: dict[str, str] = {}
        for package, path in given_folders.items() if isinstance(given_folders, dict) else ():
            if isinstance(path, str):
                folders[package] = path
        root = folders.get("", "src" if not given and (folder / "src").is_dir() else "")
        if isinstance(given.get("packages"), list):
            names = {name.partition(".")[0] for name in self._texts(given, "packages")}
        else:
            names = {file.parent.name for file in (folder / root).glob("*/__init__.py")} - {"test", "tests"}
        for name in sorted(names):
            source = folders.get(name) or posixpath.join(root, name)
            path = folder if posixpath.normpath(source) == "." else self._source(source)
            if path is not None and path.is_dir() and name not in COMPANIONS:
                yield name, path
        for name in self._texts(given, "py_modules"):
            if name.partition(".")[0] in names:
                continue  # it is in the folder of that package
            path = self._source(posixpath.join(root, name.replace(".", "/") + ".py"))
            if path is not None and path.is_file():
                yield name.replace(".", "/") + ".py", path


class _CMakeRules(_Rules):
    """Rules of CMakeLists.txt."""

    def read(self) -> None:
        plan = self._plan
        script = CMakeScript(plan.folder, read_text(plan.folder, "CMakeLists.txt"))
        for install in installs_of(script, plan.folder):
            self._install(install)
        executable: list[str] = []
        installed: set[str] = set()
        for command, words in script.calls:
            texts = [word.text for word in words]
            if command in _TARGETS:
                plan.has_targets |= not {"INTERFACE", "IMPORTED", "ALIAS"} & {*texts[1:]}
                executable += texts[:1] if command.endswith("executable") else []
                installed |= {*texts[:1]} if command.startswith("ament_auto") else set()
            elif command == "install" and texts[:1] == ["TARGETS"]:
                installed |= {*texts[1:]}
            elif command == "add_subdirectory":
                plan.is_complete = False
            else:
                self._read(command, texts)
        are_known = UNKNOWN not in installed
        plan.missing += dict.fromkeys(
            name for name in executable if UNKNOWN not in name and (name in installed or not are_known)
        )

    def _read(self, command: str, texts: list[str]) -> None:
        plan = self._plan
        match command, texts:
            case "ament_python_install_package", [name, *options]:
                given = _options(options, "PACKAGE_DIR", "SCRIPTS_DESTINATION")
                source = self._source(given.get("PACKAGE_DIR", name))
                if source is not None and source.is_dir() and name not in COMPANIONS:
                    groups = self._add_entry_points(given["SCRIPTS_DESTINATION"]) if len(given) > 1 else {}
                    self._add_metadata(name, self._version, groups)
                    plan.add(f"{SITE_PACKAGES}/{name}", PrefixFile(source))
            case "ament_python_install_module", [path, *options]:
                suffix = _options(options, "DESTINATION_SUFFIX").get("DESTINATION_SUFFIX", "")
                self._install(Install(plan.folder, "FILES", (path,), posixpath.join(SITE_PACKAGES, suffix)))
            case "ament_auto_package", _ if "INSTALL_TO_SHARE" in texts:
                paths = tuple(texts[texts.index("INSTALL_TO_SHARE") + 1 :])
                self._install(Install(plan.folder, "DIRECTORY", paths, f"share/{plan.name}"))
            case "ament_index_register_resource", [kind, *options]:
                given = _options(options, "PACKAGE_NAME", "CONTENT", "CONTENT_FILE")
                content = given.get("CONTENT", "")
                if "CONTENT_FILE" in given and (file := self._source(given["CONTENT_FILE"])) is not None:
                    content = _text(plan.folder, str(file.relative_to(plan.folder)))
                place = f"{INDEX}/{kind}/{given.get('PACKAGE_NAME', plan.name)}"
                plan.add(place, PrefixFile(content=content.replace(UNKNOWN, "").encode()))
            case "pluginlib_export_plugin_description_file", [kind, path] if UNKNOWN not in kind + path:
                self._install(Install(plan.folder, "FILES", (path,), f"share/{plan.name}"))
                place = f"{INDEX}/{kind}__pluginlib__plugin/{plan.name}"
                before = plan.files.pop(place, PrefixFile(content=b"")).content or b""
                plan.add(place, PrefixFile(content=before + f"share/{plan.name}/{path}\n".encode()))

    def _install(self, install: Install) -> None:
        if (install.destination + "/").startswith("include/"):
            return  # headers are for compilers
        for path in install.paths:
            is_whole = inside(path) is None and posixpath.normpath(path) in (".", self._plan.folder.as_posix())
            source = self._plan.folder if is_whole else self._source(path)
            if source is None:
                continue
            if install.kind != "DIRECTORY" and source.is_file():
                place = posixpath.join(install.destination, install.rename or source.name)
                self._add_file(place, source, is_program=install.kind == "PROGRAMS")
            elif install.kind == "DIRECTORY" and source.is_dir():
                below = "" if path.endswith("/") else source.name
                self._install_folder(install, source, posixpath.join(install.destination, below))

    def _install_folder(self, install: Install, top: Path, destination: str) -> None:
        left = _MAX_FILES
        waiting = [("", top)]
        for below, folder in waiting:  # grows inside the loop
            with os.scandir(folder) as scan:
                entries = sorted(scan, key=lambda entry: entry.name)
            left -= len(entries)
            if left < 0:
                raise _TooManyError
            for entry in entries:
                path = posixpath.join(below, entry.name)
                is_folder = entry.is_dir(follow_symlinks=False)
                if not _accepts(install, path, is_folder):
                    continue
                if is_folder:
                    waiting.append((path, folder / entry.name))
                elif entry.is_symlink() or entry.is_file():
                    self._add_file(posixpath.join(destination, path), folder / entry.name)


def _options(texts: Sequence[str], *names: str) -> dict[str, str]:
    return {word: text for word, text in pairwise(texts) if word in names}


def _accepts(install: Install, path: str, is_folder: bool) -> bool:
    """Return True if a file or folder below an installed folder passes its patterns."""
    matched = [
        excluded
        for pattern, excluded in install.filters
        if fnmatchcase("/".join(path.split("/")[-1 - pattern.count("/") :]), pattern.lstrip("/"))
    ]
    return not any(matched) if matched else is_folder or not install.only_matching
