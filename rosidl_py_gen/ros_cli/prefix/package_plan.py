"""Files of a prefix that one source package installs, read from its setup.py or CMakeLists.txt, which are not run.

Folders are real, and files are links (docs/internals/protocol.md 14.1). Python packages are links to their source
folders. If install rules cannot be read, the files of the source folder are linked instead.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rosidl_py_gen.base.names import is_package_name
from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.compiler.frontend.cmake_reader import UNKNOWN, CMakeScript, inside
from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, files_below, mentions_interfaces, read_text
from rosidl_py_gen.compiler.frontend.search_path import Package, holds_interfaces
from rosidl_py_gen.errors import RosidlError, display_path
from rosidl_py_gen.ros_cli.prefix import executables
from rosidl_py_gen.ros_cli.prefix.executable import Executable
from rosidl_py_gen.ros_cli.prefix.variables import SITE_PACKAGES
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR
from rosidl_py_gen.type_loading.setup_py import setup_calls
from rosidl_py_gen.type_loading.share_folder import Install, cmake_installs, setup_installs

INDEX = "share/ament_index/resource_index"
COMPANIONS = frozenset(entry.name for entry in RCLPY_COMPAT_DIR.iterdir())
"""Python packages that the import hook provides, in place of those of the workspace."""
MAX_FILES = 20_000
"""Maximum number of files that a package installs; as many directory entries are read for them."""
MAX_COPY_BYTES = 16 << 20
_CODE_FOLDERS = ("include", "src", "test", "tests")
"""Folders that are not linked if the install rules are unknown."""
_BUILD_TYPE = re.compile(r"<build_type(?![^>]*ROS_VERSION\s*==\s*1)[^>]*>\s*(\w+)\s*<")
"""Not that of ROS 1: packages for both have one build type with the condition `$ROS_VERSION == 1`."""
_LAUNCH_FILE = re.compile(r"(launch\.(py|xml|ya?ml)|\.launch)\Z")
_SCRIPTS_FOLDER = re.compile(r"^\s*(?:install[_-]scripts|script[_-]dir)\s*=\s*(?:\$\{?base\}?/)?(\S+)", re.MULTILINE)
_NOT_IN_NAMES = re.compile(r"[^\w.]+")
_VERSION = re.compile(r"<version[^>]*>\s*([\w.+-]+)\s*<")


class PrefixFile(NamedTuple):
    """A file of a prefix: a link to `source`, or a file with `content` and the permissions `mode`."""

    source: Path | None = None
    content: bytes | None = None
    mode: int = 0o644


PROGRAM = 0o755
"""Permissions of a program."""


class PackagePlan:
    """Files that a package installs.

    Attributes:
        files: files by their paths below the prefix.
        problems: texts about what could not be read or installed.
        missing: names of the executables that need a build.
        has_targets: there is C++ code.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self._folder = name, folder
        self.files: dict[str, PrefixFile] = {}
        self.problems: list[str] = []
        self.missing: list[str] = []
        self.has_targets = False
        self._left = 2 * MAX_FILES
        self._read(self._add_interfaces)
        manifest = _text(folder, "package.xml")
        version, kind = _VERSION.search(manifest), _BUILD_TYPE.search(manifest)
        self._version = version[1] if version else "0.0.0"
        is_cmake = (folder / "CMakeLists.txt").is_file()
        is_python = any((folder / name).is_file() for name in ("setup.py", "pyproject.toml", "setup.cfg"))
        if is_cmake and is_python and kind:
            is_cmake, is_python = "python" not in kind[1], "python" in kind[1]
        self._is_complete = is_cmake or is_python  # all install rules were read
        if is_python:
            self._read(self._read_setup)
        if is_cmake:
            self._read(self._read_cmake)
        if not self._is_complete:
            self._read(self._link_sources)
        self.files.setdefault(f"{INDEX}/packages/{name}", PrefixFile(content=b""))
        self.files.setdefault(f"share/{name}/package.xml", PrefixFile(folder / "package.xml"))

    @property
    def text(self) -> str:
        """Line about a package with C++ code: the missing executables, and what the prefix has of it."""
        share = [place for place in self.files if place.startswith(f"share/{self.name}/")]
        launch = sum(_LAUNCH_FILE.search(place) is not None for place in share)
        programs = sum(file.mode == PROGRAM for file in self.files.values())
        counts = {"launch file": launch, "share file": len(share) - launch, "Python program": programs}
        usable = ", ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)
        return f"{self.name}: without {', '.join(self.missing) or 'its libraries'}; with {usable}"

    def _problem(self, text: str) -> None:
        text = f"{self.name} ({display_path(self._folder)}): {text}"
        self.problems += [text] if text not in self.problems else []

    def _read(self, rules: Callable[[], None]) -> None:
        """Call a function that reads rules; an error is a problem."""
        try:
            rules()
        except (RosidlError, OSError) as error:
            self._is_complete = False
            text = f"{error.filename} cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error)
            self._problem(text)

    def _link_sources(self) -> None:
        """Link the files of the source folder below ``share``, except those that known rules install there."""
        share = f"share/{self.name}/"
        installed = {file.source for place, file in self.files.items() if place.startswith(share)}
        for path in files_below(self._folder):
            is_code = path.split("/")[0] in _CODE_FOLDERS or "/" not in path
            if not is_code and self._folder / path not in installed and share + path not in self.files:
                self._add(share + path, PrefixFile(self._folder / path))

    # --- adding files -------------------------------------------------------------------------------------------------

    def _add(self, place: str, file: PrefixFile) -> None:
        """Add a file at a path below the prefix; other paths, and paths of other files, are problems."""
        self._spend(1)
        if UNKNOWN in place:
            self._is_complete = False
            return None
        path = inside(place)
        if path is None or not path.isprintable():
            return self._problem(f'"{place[:200]}" is not a path below the prefix; the file is skipped')
        old, self.files[path] = self.files.get(path, file), file
        if old.source != file.source:
            self._problem(f"two files would be {path}; the last one is used, {display_path(file.source or path)}")

    def _spend(self, count: int) -> None:
        self._left -= count
        if self._left < 0:
            raise UnreadableError(f"it installs more than {MAX_FILES} files; the others are skipped")

    def _source(self, path: str) -> Path | None:
        """Return a file or folder of the package that is installed; None, and a problem, if it is elsewhere."""
        if UNKNOWN in path:
            self._is_complete = False
        elif (place := "." if posixpath.normpath(path) == "." else inside(path)) is not None:
            return self._folder / place
        else:
            self._problem(f'"{path[:200]}" is not in the package folder; it is skipped')
        return None

    def _add_interfaces(self) -> None:
        if not is_package_name(self.name) or not (holds_interfaces(self._folder) or mentions_interfaces(self._folder)):
            return
        found = Package(self.name, self._folder, "", from_source=True).files
        places = {f"{interface.kind}/{path.name}": path for interface, path in found.items()}
        for place, path in places.items():
            self._add(f"share/{self.name}/{place}", PrefixFile(path))
        if places:
            lines = os.fsencode("\n".join(sorted(places)))
            self._add(f"{INDEX}/rosidl_interfaces/{self.name}", PrefixFile(content=lines))

    def _add_file(self, place: str, source: Path, is_program: bool = False) -> None:
        """Add a file; scripts below ``lib`` become programs that run with this Python."""
        is_below_lib = place.startswith(("lib/", "bin/")) and not place.startswith(SITE_PACKAGES)
        if is_below_lib or is_program:
            note(source)
        file, is_executable = PrefixFile(source), os.access(source, os.X_OK)
        is_named = source.suffix == ".py" and (is_program or (is_below_lib and is_executable))
        if is_named or (is_below_lib and executables.is_python_program(source)):
            file = PrefixFile(source, Executable(source.name, source.parent, source).program(), PROGRAM)
        elif is_program and not is_executable:
            if source.stat().st_size > MAX_COPY_BYTES:
                return self._problem(f"{display_path(source)} is too large for a copy, and is not executable: chmod +x")
            file = PrefixFile(source, source.read_bytes(), PROGRAM)
        return self._add(place, file)

    def _add_entry_points(self, scripts_folder: str) -> dict[str, list[str]]:
        """Add programs of console scripts; returns the entry points by group."""
        groups, scripts = executables.entry_points(self._folder, self._problem)
        for one in scripts:
            self._add(f"{scripts_folder}/{one.name}", PrefixFile(None, one.program(), PROGRAM))
        return groups

    def _add_metadata(self, name: object, version: object, groups: dict[str, list[str]]) -> None:
        """Add the metadata of a Python distribution, in which other programs find entry points."""
        used = [str(name or self.name), str(version or self._version)]
        folder = f"{SITE_PACKAGES}/{'-'.join(re.sub(_NOT_IN_NAMES, '_', one)[:80] for one in used)}.dist-info"
        texts = {
            "METADATA": "Metadata-Version: 2.1\nName: {}\nVersion: {}\n".format(*used),
            "entry_points.txt": "\n".join("\n".join((f"[{group}]", *lines, "")) for group, lines in groups.items()),
        }
        for file, text in texts.items():
            self._add(f"{folder}/{file}", PrefixFile(content=text.encode(errors="replace")))

    # --- setup.py, setup.cfg and pyproject.toml -----------------------------------------------------------------------

    def _read_setup(self) -> None:
        found = _SCRIPTS_FOLDER.search(_text(self._folder, "setup.cfg"))
        scripts_folder = found[1] if found else "bin"
        groups = self._add_entry_points(scripts_folder)
        given: dict[str, object] = {}
        for call in setup_calls(_text(self._folder, "setup.py"), self._folder):
            given |= call
        if given.get("entry_points", {}) is None:
            self._problem("the entry points of setup.py cannot be read without running it; they are skipped")
        self._add_metadata(given.get("name"), given.get("version"), groups)
        self._add_modules(given)
        scripts = Install(self._folder, "PROGRAMS", tuple(_texts(given.get("scripts"))), scripts_folder)
        for install in (scripts, *setup_installs(self._folder, given)):
            self._install(install)

    def _add_modules(self, given: dict[str, object]) -> None:
        """Add links to the Python packages and modules."""
        found = given.get("package_dir")
        folders = {key: path for key, path in found.items() if isinstance(path, str)} if isinstance(found, dict) else {}
        root = folders.get("", "src" if not given and (self._folder / "src").is_dir() else "")
        if isinstance(given.get("packages"), list):
            names = {*_texts(given["packages"])}
        else:
            names = {file.parent.name for file in (self._folder / root).glob("*/__init__.py")} - {"test", "tests"}
        names |= {*_texts(given.get("py_modules"))}
        for name in sorted({name.partition(".")[0] for name in names} - COMPANIONS):
            source = self._source(folders.get(name) or posixpath.join(root, name))
            if source is not None and source.is_dir():
                self._add(f"{SITE_PACKAGES}/{name}", PrefixFile(source))
            elif source is not None and (module := source.with_name(f"{source.name}.py")).is_file():
                self._add(f"{SITE_PACKAGES}/{name}.py", PrefixFile(module))

    # --- CMakeLists.txt -----------------------------------------------------------------------------------------------

    def _read_cmake(self) -> None:
        script = CMakeScript(self._folder, read_text(self._folder, "CMakeLists.txt"))
        for install in cmake_installs(self._folder, script):
            self._install(install)
        calls = [(command, [word.text for word in words]) for command, words in script.calls]
        installed = {
            text for command, texts in calls if (command, *texts[:1]) == ("install", "TARGETS") for text in texts
        }
        for command, texts in calls:
            if command.endswith(("add_executable", "add_library")):
                self.has_targets |= {"INTERFACE", "IMPORTED", "ALIAS"}.isdisjoint(texts[1:])
                is_installed = command.startswith("ament_auto") or not installed.isdisjoint((*texts[:1], UNKNOWN))
                self.missing += texts[:1] if is_installed and command.endswith("executable") else []
            elif command == "add_subdirectory":
                self._is_complete = False
            else:
                self._read_command(command, texts)
        self.missing = [name for name in dict.fromkeys(self.missing) if UNKNOWN not in name]

    def _read_command(self, command: str, texts: list[str]) -> None:
        options = dict(pairwise(texts[1:]))
        match command, texts:
            case "ament_python_install_package", [name, *_]:
                source = self._source(options.get("PACKAGE_DIR", name))
                if source is not None and source.is_dir() and name not in COMPANIONS:
                    scripts = options.get("SCRIPTS_DESTINATION")
                    self._add_metadata(name, "", self._add_entry_points(scripts) if scripts else {})
                    self._add(f"{SITE_PACKAGES}/{name}", PrefixFile(source))
            case "ament_python_install_module", [path, *_]:
                place = posixpath.join(SITE_PACKAGES, options.get("DESTINATION_SUFFIX", ""))
                self._install(Install(self._folder, "FILES", (path,), place))
            case "ament_auto_package", _ if "INSTALL_TO_SHARE" in texts:
                paths = tuple(texts[texts.index("INSTALL_TO_SHARE") + 1 :])
                self._install(Install(self._folder, "DIRECTORY", paths, f"share/{self.name}"))
            case "ament_index_register_resource", [kind, *_]:
                content = options.get("CONTENT", "")
                if "CONTENT_FILE" in options and (file := self._source(options["CONTENT_FILE"])) is not None:
                    content = _text(self._folder, str(file.relative_to(self._folder)))
                place = f"{INDEX}/{kind}/{options.get('PACKAGE_NAME', self.name)}"
                self._add(place, PrefixFile(content=content.replace(UNKNOWN, "").encode(errors="replace")))
            case "pluginlib_export_plugin_description_file", [kind, path] if UNKNOWN not in kind + path:
                self._install(Install(self._folder, "FILES", (path,), f"share/{self.name}"))
                place = f"{INDEX}/{kind}__pluginlib__plugin/{self.name}"
                before = self.files.get(place, PrefixFile(content=b"")).content or b""
                self._add(place, PrefixFile(content=before + f"share/{self.name}/{path}\n".encode(errors="replace")))

    def _install(self, install: Install) -> None:
        if (install.destination + "/").startswith("include/"):
            return  # headers are for compilers
        for path in install.paths:
            source = self._source(path)
            if source is not None and install.kind != "DIRECTORY" and source.is_file():
                place = posixpath.join(install.destination, install.rename or source.name)
                self._add_file(place, source, is_program=install.kind == "PROGRAMS")
            elif source is not None and install.kind == "DIRECTORY" and source.is_dir():
                below = "" if path.endswith(("/", ".")) else source.name
                self._install_folder(install, source, posixpath.join(install.destination, below))

    def _install_folder(self, install: Install, top: Path, destination: str) -> None:
        waiting = [("", top)]
        for below, folder in waiting:  # grows inside the loop
            note(folder)
            with os.scandir(folder) as scan:
                entries = sorted(scan, key=lambda entry: entry.name)
            self._spend(len(entries))
            for entry in entries:
                path = posixpath.join(below, entry.name)
                is_folder = entry.is_dir(follow_symlinks=False)
                if not _accepts(install, path, is_folder):
                    continue
                if is_folder:
                    waiting.append((path, folder / entry.name))
                elif entry.is_symlink() or entry.is_file():  # in this order: is_file raises for a link to itself
                    self._add_file(posixpath.join(destination, path), folder / entry.name)


def _text(folder: Path, name: str) -> str:
    try:
        return read_text(folder, name)
    except UnreadableError:
        return ""


def _texts(values: object) -> list[str]:
    return [value for value in values if isinstance(value, str)] if isinstance(values, list) else []


def _accepts(install: Install, path: str, is_folder: bool) -> bool:
    """Return True if a file or folder below an installed folder passes its patterns."""
    matched = [
        excluded
        for pattern, excluded in install.filters
        if fnmatchcase("/".join(path.split("/")[-1 - pattern.count("/") :]), pattern.lstrip("/"))
    ]
    return not any(matched) if matched else is_folder or not install.only_matching
