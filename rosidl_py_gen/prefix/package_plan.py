"""List of the files that one source package installs into a prefix, read from its setup.py or CMakeLists.txt, which are
not run.

Folders of the prefix are real, and files are links (docs/internals/protocol.md 14.1). Python packages are links to
their source folders. If install rules cannot be read, the files of the source folder are linked instead.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.compiler.frontend import (
    CMakeScript,
    Package,
    PackageBudget,
    PackageFiles,
    ReadPaths,
    UnreadableError,
)
from rosidl_py_gen.errors import RosidlError, display_path
from rosidl_py_gen.prefix import executables
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, Executable, is_python_program
from rosidl_py_gen.type_loading import (
    RCLPY_COMPAT_DIR,
    Install,
    PackageSetup,
)

INDEX = "share/ament_index/resource_index"
COMPANIONS = frozenset(entry.name for entry in RCLPY_COMPAT_DIR.iterdir())
"""Names of Python packages that the import hook provides, so that packages of these names in the workspace are not
used."""
MAX_FILES = 20_000
"""Maximum number of files that a package installs, and of directory entries that are read to find the files."""
MAX_COPY_BYTES = 16 << 20
_CODE_FOLDERS = ("include", "src", "test", "tests")
"""Folders at the top of a package that are not linked if the install rules are unknown."""
_LAUNCH_FILE = re.compile(r"(launch\.(py|xml|ya?ml)|\.launch)\Z")
_NOT_DATA = ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "CMakeLists.txt", "MANIFEST.in")
"""Files at the top of a package that are not linked if its data files are unknown."""
_SITE_PACKAGES = re.compile(r"lib(64)?/python3(\.\d+)?/(site|dist)-packages(?=/|\Z)")
"""Pattern of the folder of modules for any version of Python, which becomes the folder of this Python."""
_NOT_IN_NAMES = re.compile(r"[^\w.]+")
_VERSION = re.compile(r"[\w.+-]+")


class PrefixFile(NamedTuple):
    """File of a prefix: a link to `source`, or a file with `content` and the permissions `mode`."""

    source: Path | None = None
    content: bytes | None = None
    mode: int = 0o644


PROGRAM = 0o755
"""File mode (permissions) of a program in a prefix."""


class PackagePlan:
    """Plan of the files that a package installs into a prefix.

    Attributes:
        files: files by their paths below the prefix.
        problems: texts about what could not be read or installed.
        notes: texts about a setup.py that could not be run, and what is linked instead of unknown files.
        missing: names of the executables that need a build.
        has_targets: True if the package has C++ code.
    """

    def __init__(self, name: str, folder: Path, *, runs_setup: bool = False) -> None:
        """Read the install rules of a package.

        Args:
            name: name of the package.
            folder: source folder of the package.
            runs_setup: run a setup.py that cannot be read completely; ``lib/<package>`` then also has the executables
                that a build installs elsewhere.
        """
        self.name, self._folder, self._runs_setup = name, folder, runs_setup
        self.files: dict[str, PrefixFile] = {}
        self.notes: list[str] = []
        self._problems: dict[str, None] = {}
        self.missing: list[str] = []
        self.has_targets = False
        self._left = 2 * MAX_FILES
        self._links_top = False  # files at the top of the package may be data files
        self._budget = PackageBudget()
        self._setup: PackageSetup | None = None
        self._sources: set[Path | None] = {None}
        self._read(self._add_interfaces)
        manifest = PackageFiles(folder).manifest()
        self._version = manifest.version if _VERSION.fullmatch(manifest.version) else "0.0.0"
        is_cmake = (folder / "CMakeLists.txt").is_file()
        is_python = any((folder / name).is_file() for name in ("setup.py", "pyproject.toml", "setup.cfg"))
        if is_cmake and is_python and manifest.build_type:
            is_python = "python" in manifest.build_type
            is_cmake = not is_python
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
    def modules(self) -> dict[str, Path]:
        """Source files and folders of the modules that the package installs, by name of the module."""
        found: dict[str, Path] = {}
        for place, file in self.files.items():
            parent, _, name = place.rpartition("/")
            if parent == SITE_PACKAGES and file.source is not None:
                found.setdefault(name.removesuffix(".py"), file.source)
        return found

    @property
    def problems(self) -> list[str]:
        return [*self._problems]

    @property
    def text(self) -> str:
        """Line about a package with C++ code: its missing executables, and the numbers of files in the prefix."""
        share = [place for place in self.files if place.startswith(f"share/{self.name}/")]
        launch = sum(_LAUNCH_FILE.search(place) is not None for place in share)
        programs = sum(file.mode == PROGRAM for file in self.files.values())
        counts = {"launch file": launch, "share file": len(share) - launch, "Python program": programs}
        usable = ", ".join(pluralize(count, name) for name, count in counts.items() if count)
        return f"{self.name}: without {', '.join(self.missing) or 'its libraries'}; with {usable}"

    def _problem(self, text: str) -> None:
        text = f"{self.name} ({display_path(self._folder)}): {text}"
        self._problems[text] = None

    def _read(self, rules: Callable[[], None]) -> None:
        """Call a function that reads install rules; an error becomes a problem of the package."""
        try:
            rules()
        except (RosidlError, OSError) as error:
            self._is_complete = False
            self._budget = PackageBudget()  # for the links to the files instead
            text = f"{error.filename} cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error)
            self._problem(text)

    def _link_sources(self) -> None:
        """Link the files of the source folder below ``share`` of the prefix, except files that known rules install
        there.
        """
        share = f"share/{self.name}/"
        installed = {file.source for place, file in self.files.items() if place.startswith(share)}
        modules = {file.source for place, file in self.files.items() if place.startswith(SITE_PACKAGES)}
        for path in self._budget.entries("", PackageFiles(self._folder).paths()):
            source = self._folder / path
            if path.endswith(".py") and not modules.isdisjoint((source, *source.parents)):
                continue
            is_code = path.split("/")[0] in _CODE_FOLDERS or (path in _NOT_DATA if self._links_top else "/" not in path)
            if not is_code and self._folder / path not in installed and share + path not in self.files:
                self._add(share + path, PrefixFile(self._folder / path))

    # --- adding files -------------------------------------------------------------------------------------------------

    def _add(self, place: str, file: PrefixFile) -> None:
        """Add a file at a path below the prefix; add a problem if the path is outside or of another file."""
        self._spend(1)
        self._budget.install(place, is_new_source=file.source not in self._sources)
        self._sources.add(file.source)
        if CMakeScript.UNKNOWN in place:
            self._is_complete = False
            return None
        path = PackageFiles.inside(place)
        if path is None or not path.isprintable():
            return self._problem(f'"{place[:200]}" is not a path below the prefix; the file is skipped')
        path = _SITE_PACKAGES.sub(SITE_PACKAGES, path)
        self._expand_folders(path)
        is_package = path.startswith(SITE_PACKAGES) and file.source is not None and file.source.is_dir()
        inner = [other for other in self.files if other.startswith(f"{path}/")] if is_package else []
        old, self.files[path] = self.files.get(path, file), file
        if old.source != file.source:
            self._problem(f"two files would be {path}; the last one is used, {display_path(file.source or path)}")
        for other in inner:
            self._expand_folders(other)
        return None

    def _spend(self, count: int) -> None:
        self._left -= count
        if self._left < 0:
            raise UnreadableError(f"it installs more than {MAX_FILES} files; the others are skipped")

    def _source(self, path: str) -> Path | None:
        """Return a path in the package folder; if the path is outside of the folder, add a problem and return None."""
        if CMakeScript.UNKNOWN in path:
            self._is_complete = False
        elif (place := "." if posixpath.normpath(path) == "." else PackageFiles.inside(path)) is not None:
            return self._folder / place
        else:
            self._problem(f'"{path[:200]}" is not in the package folder; it is skipped')
        return None

    def _add_interfaces(self) -> None:
        package = Package.of_sources(self.name, self._folder)
        if package is None:
            return
        places = {f"{interface.kind}/{path.name}": path for interface, path in package.files.items()}
        for place, path in places.items():
            self._add(f"share/{self.name}/{place}", PrefixFile(path))
        if places:
            lines = os.fsencode("\n".join(sorted(places)))
            self._add(f"{INDEX}/rosidl_interfaces/{self.name}", PrefixFile(content=lines))

    def _add_file(self, place: str, source: Path, is_program: bool = False) -> None:
        """Add a file to the prefix; scripts below ``lib`` become programs that run with this Python."""
        is_below_lib = place.startswith(("lib/", "bin/")) and not _SITE_PACKAGES.match(place)
        if is_below_lib or is_program:
            ReadPaths.note(source)
        file, is_executable = PrefixFile(source), os.access(source, os.X_OK)
        is_named = source.suffix == ".py" and (is_program or (is_below_lib and is_executable))
        if is_named or (is_below_lib and is_python_program(source)):
            file = PrefixFile(source, Executable(source.name, source.parent, source).program(), PROGRAM)
        elif is_program and not is_executable:
            if source.stat().st_size > MAX_COPY_BYTES:
                return self._problem(f"{display_path(source)} is too large for a copy, and is not executable: chmod +x")
            file = PrefixFile(source, source.read_bytes(), PROGRAM)
        return self._add(place, file)

    def _expand_folders(self, path: str) -> None:
        """Replace the link to a Python package that is above `path` by links to its files, so that `path`
        can be added.
        """
        parts = path.split("/")
        for end in range(len(SITE_PACKAGES.split("/")) + 1, len(parts)):
            above = "/".join(parts[:end])
            source = self.files[above].source if above in self.files else None
            if source is not None and source.is_dir():
                with os.scandir(source) as scan:
                    names = sorted(entry.name for entry in scan if entry.name != "__pycache__")
                self._spend(len(names))
                del self.files[above]
                for name in names:
                    self.files.setdefault(f"{above}/{name}", PrefixFile(source / name))

    def _read_setup_files(self) -> PackageSetup:
        if self._setup is None:
            self._setup = executables.read_setup(self._folder, self._budget, self._runs_setup)
            self.notes += self._setup.problems
            self._budget.renew()  # for the files that are installed
        return self._setup

    def _add_entry_points(self, setup: PackageSetup, scripts_folder: str) -> None:
        """Add a program to `scripts_folder` for each console script of the package."""
        package = self.name if self._runs_setup and scripts_folder == setup.scripts_folder else ""
        for one in executables.console_scripts(setup, self._folder, package, self._problem):
            file = PrefixFile(None, replace(one, warning="").program(), PROGRAM)
            self._add(f"{scripts_folder}/{one.name}", file)
            if one.warning and f"lib/{self.name}/{one.name}" not in self.files:
                self._add(f"lib/{self.name}/{one.name}", PrefixFile(None, one.program(), PROGRAM))

    def _add_metadata(self, name: object, version: object, groups: dict[str, list[str]]) -> None:
        """Add the metadata of a Python distribution, in which other programs find entry points."""
        used = [str(name or self.name), str(version or self._version)]
        folder = f"{SITE_PACKAGES}/{'-'.join(re.sub(_NOT_IN_NAMES, '_', one)[:80] for one in used)}.dist-info"
        texts = {
            "METADATA": "Metadata-Version: 2.1\nName: {}\nVersion: {}\n".format(*used),
            "entry_points.txt": "\n".join(
                "\n".join((f"[{group}]", *(line.strip() for line in lines if "=" in line), ""))
                for group, lines in groups.items()
            ),
        }
        for file, text in texts.items():
            self._add(f"{folder}/{file}", PrefixFile(content=text.encode(errors="replace")))

    # --- setup.py, setup.cfg and pyproject.toml -----------------------------------------------------------------------

    def _read_setup(self) -> None:
        self._links_top = True  # until the files are read
        setup = self._read_setup_files()
        self._links_top = False
        self._add_entry_points(setup, setup.scripts_folder)
        self._note_uncertain(setup)
        self._add_metadata(setup.values.get("name"), setup.values.get("version"), setup.groups)
        self._add_modules(setup)
        scripts = tuple(setup.texts("scripts"))
        places = {setup.scripts_folder, *([f"lib/{self.name}"] if self._runs_setup else [])}
        for install in (
            *(Install(self._folder, "PROGRAMS", scripts, place) for place in sorted(places)),
            *setup.data_files,
        ):
            self._install(install)

    def _note_uncertain(self, setup: PackageSetup) -> None:
        """Note unknown arguments of ``setup()``: executables may be missing, or all files are linked instead."""
        self._note_executables(setup)
        ask = self._advice(setup)
        if text := executables.uncertain_text(setup, self._folder, "data_files"):
            self._is_complete, self._links_top = False, True
            linked = f"share/{self.name} has all files of the package, at their paths in the sources"
            self.notes.append(f"{self.name}: {text}; {linked}{ask}")

    def _note_executables(self, setup: PackageSetup) -> None:
        if text := executables.uncertain_text(setup, self._folder, "entry_points", "scripts"):
            self._problem(f"{text}; executables may be missing{self._advice(setup)}")

    def _advice(self, setup: PackageSetup) -> str:
        is_run = self._runs_setup or setup.unread
        return "" if is_run else "; rosidl-py run, launch and test run setup.py to know them"

    def _add_modules(self, setup: PackageSetup) -> None:
        """Add links to the Python packages and modules that setup.py installs."""
        folders = setup.folders
        root = folders.get("", "")
        names = {*setup.texts("packages")}
        if not isinstance(setup.values.get("packages"), list) or "packages" in setup.uncertain:
            names |= {file.parent.name for file in (self._folder / root).glob("*/__init__.py")} - {"test", "tests"}
        for name in sorted(name for name in names if "." in name and name in folders):
            self._problem(f"the Python package {name} is in {folders[name][:200]}, and not importable in a prefix")
        names |= {*setup.texts("py_modules")}
        for name in sorted({name.partition(".")[0] for name in names} - COMPANIONS):
            source = self._source(folders.get(name) or posixpath.join(root, name))
            if source is not None and source.is_dir():
                self._add(f"{SITE_PACKAGES}/{name}", PrefixFile(source))
            elif source is not None and (module := source.with_name(f"{source.name}.py")).is_file():
                self._add(f"{SITE_PACKAGES}/{name}.py", PrefixFile(module))

    # --- CMakeLists.txt -----------------------------------------------------------------------------------------------

    def _read_cmake(self) -> None:
        script = CMakeScript.read(self._folder, self._budget)
        self._budget.renew()  # for the files that are installed
        for install in Install.of_cmake(self._folder, script):
            self._install(install)
        calls = [(command, [word.text for word in words]) for command, words in script.calls]
        installed = {
            text for command, texts in calls if (command, *texts[:1]) == ("install", "TARGETS") for text in texts
        }
        for command, texts in calls:
            if command.endswith(("add_executable", "add_library")):
                self.has_targets |= {"INTERFACE", "IMPORTED", "ALIAS"}.isdisjoint(texts[1:])
                targets = {*texts[:1], CMakeScript.UNKNOWN}
                is_installed = command.startswith("ament_auto") or not installed.isdisjoint(targets)
                self.missing += texts[:1] if is_installed and command.endswith("executable") else []
            elif command == "add_subdirectory":
                self._is_complete = False
            else:
                self._read_command(command, texts)
        self.missing = [name for name in dict.fromkeys(self.missing) if CMakeScript.UNKNOWN not in name]

    def _read_command(self, command: str, texts: list[str]) -> None:
        options = dict(pairwise(texts[1:]))
        match command, texts:
            case "ament_python_install_package", [name, *_]:
                source = self._source(options.get("PACKAGE_DIR", name))
                if source is not None and source.is_dir() and name not in COMPANIONS:
                    groups: dict[str, list[str]] = {}
                    if scripts := options.get("SCRIPTS_DESTINATION"):
                        setup = self._read_setup_files()
                        self._note_executables(setup)
                        self._add_entry_points(setup, scripts)
                        groups = setup.groups
                    self._add_metadata(name, "", groups)
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
                self._add(place, PrefixFile(content=content.replace(CMakeScript.UNKNOWN, "").encode(errors="replace")))
            case "pluginlib_export_plugin_description_file", [kind, path] if CMakeScript.UNKNOWN not in kind + path:
                self._install(Install(self._folder, "FILES", (path,), f"share/{self.name}"))
                place = f"{INDEX}/{kind}__pluginlib__plugin/{self.name}"
                before = self.files.get(place, PrefixFile(content=b"")).content or b""
                self._budget.spend(len(before))
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
            ReadPaths.note(folder)
            with os.scandir(folder) as scan:
                real = os.path.realpath(folder)
                entries = sorted(self._budget.entries(real, scan), key=lambda entry: entry.name)
            self._spend(len(entries))
            for entry in entries:
                path = posixpath.join(below, entry.name)
                is_folder = entry.is_dir(follow_symlinks=False)
                if not self._accepts(install, path, is_folder):
                    continue
                if is_folder:
                    waiting.append((path, folder / entry.name))
                elif entry.is_symlink() or entry.is_file():  # in this order: is_file raises for a link to itself
                    self._add_file(posixpath.join(destination, path), folder / entry.name)

    def _accepts(self, install: Install, path: str, is_folder: bool) -> bool:
        """Return True if the patterns of an install rule select a file or folder below an installed folder."""
        matched = [
            excluded
            for pattern, excluded in install.filters
            if self._budget.matches("/".join(path.split("/")[-1 - pattern.count("/") :]), pattern.lstrip("/"))
        ]
        return not any(matched) if matched else is_folder or not install.only_matching


def _text(folder: Path, name: str) -> str:
    try:
        return PackageFiles(folder).read_text(name)
    except UnreadableError:
        return ""
