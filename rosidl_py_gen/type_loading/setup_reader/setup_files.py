"""Install rules of a Python package: the arguments of setup.py, completed by setup.cfg and pyproject.toml.

INI files such as setup.cfg are parsed as `configparser` reads them, in time that is linear in the file's size.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rosidl_py_gen.base.project import parse_toml
from rosidl_py_gen.compiler.frontend import PackageBudget, PackageFiles, ReadPaths, UnreadableError
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.install_rules import Install
from rosidl_py_gen.type_loading.setup_reader.package_folder import PackageFolder
from rosidl_py_gen.type_loading.setup_reader.setup_py import SetupArguments, SetupSyntaxError, read_setup_py
from rosidl_py_gen.type_loading.setup_reader.values import Gap


class IniSyntaxError(RosidlError):
    """Error of a line in an INI file that is neither a section nor an option."""


def parse_ini(text: str) -> dict[str, dict[str, str]]:
    """Return the options of an INI file by section and name, with the lines of a value joined by line breaks.

    Raises `IniSyntaxError` for a line that is neither a section nor an option.
    """
    sections: dict[str, dict[str, list[str]]] = {}
    options: dict[str, list[str]] | None = None
    lines: list[str] | None = None
    indent = 0
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if stripped.startswith(("#", ";")):
            continue
        if not stripped:
            if lines is not None:
                lines.append("")
            continue
        margin = len(line) - len(line.lstrip())
        if lines is not None and margin > indent:
            lines.append(stripped)
            continue
        indent = margin
        if stripped.startswith("[") and "]" in stripped:
            options = sections.setdefault(stripped[1 : stripped.rindex("]")], {})
            lines = None
            continue
        name, value = _option(stripped)
        if options is None:
            raise IniSyntaxError(f"line {number}: got {stripped[:80]!r}; expected a section such as [install]")
        if not name:
            raise IniSyntaxError(f"line {number}: got {stripped[:80]!r}; expected NAME = VALUE")
        lines = options[name] = [value]
    return {
        section: {name: "\n".join(lines).rstrip() for name, lines in values.items()}
        for section, values in sections.items()
    }


def _option(line: str) -> tuple[str, str]:
    """Return name and value of an option line in an INI file; both are "" if the line has no delimiter."""
    positions = [position for position in (line.find("="), line.find(":")) if position >= 0]
    if not positions:
        return "", ""
    return line[: min(positions)].strip(), line[min(positions) + 1 :].strip()


_MAX_TOML = 64 << 10
"""Maximum characters of a pyproject.toml."""
_INSTALLED = ("data_files", "entry_points", "scripts", "packages", "py_modules", "package_dir")
"""Arguments of setuptools' `setup` that determine installed files. If one is uncertain, setup.py is run, provided that
running is allowed."""
RunSetup = Callable[[Path, str], Sequence[Mapping[str, object]]]
"""Function that runs the setup.py in a folder, for a reason, and returns the arguments of each call of `setup`.

The function raises `RosidlError`.
"""


class SetupFilesError(RosidlError):
    """Error of a setup.py, setup.cfg or pyproject.toml that cannot be read; the text begins with the file's path."""


@dataclass
class PackageSetup:
    """Install rules of a Python package, from its setup.py, setup.cfg and pyproject.toml.

    Attributes:
        folder: folder of the package.
        values: arguments of `setup` by name, with None for unknown parts; entry points are lists of lines by group.
        uncertain: reasons why an argument is uncertain, by argument.
        unread: name of the file whose reading took too much work, so that arguments are uncertain; else empty.
        scripts_folder: folder of the prefix for console scripts and scripts.
        problems: texts about a setup.py that could not be run.
    """

    folder: Path
    values: dict[str, Any] = field(default_factory=dict)
    uncertain: dict[str, str] = field(default_factory=dict)
    unread: str = ""
    scripts_folder: str = "bin"
    problems: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, folder: Path, budget: PackageBudget, run: RunSetup | None = None) -> PackageSetup:
        """Return the install rules of a package.

        Args:
            folder: folder of the package.
            budget: work that reading the package may take.
            run: function that runs a setup.py which cannot be read completely; None if no code may run.

        Raises:
            SetupFilesError: a file cannot be read.
        """
        found = cls(folder)
        readers: dict[str, Callable[[PackageSetup, str, PackageFolder], None]] = {
            "setup.py": lambda found, text, _: _add_setup_py(found, text, folder, budget, run),
            "setup.cfg": _add_setup_cfg,
            "pyproject.toml": _add_pyproject,
        }
        for name, read in readers.items():
            ReadPaths.note(folder / name)
            if not os.path.isfile(folder / name):
                continue
            try:
                text = PackageFiles(folder).read_text(name)
                budget.spend(len(text))
                read(found, text, PackageFolder(folder, budget))
            except PackageBudget.ExceededError as error:  # what other files say remains
                budget.renew()
                unknown = [one for one in _INSTALLED if one not in found.uncertain and not found.values.get(one)]
                found.uncertain |= dict.fromkeys(unknown, str(error))
                found.unread = name if unknown else found.unread
            except (UnreadableError, SetupSyntaxError, IniSyntaxError, ValueError) as error:
                raise SetupFilesError(f"{folder / name}: {error}".replace("\n", " ")) from error
        found.values["entry_points"] = _groups(found.values.get("entry_points"))
        is_explicit = found.values.get("packages") or found.values.get("py_modules") or found.folders
        if not is_explicit and any((folder / "src").glob("*/__init__.py")):
            found.values["package_dir"] = {"": "src"}  # as setuptools finds packages automatically
        return found

    def texts(self, name: str) -> list[str]:
        """Return the known texts in a list-valued argument of `setup`."""
        value = self.values.get(name)
        value = value.replace(",", " ").split() if name == "scripts" and isinstance(value, str) else value
        return [one for one in value if isinstance(one, str)] if isinstance(value, list) else []

    @property
    def data_files(self) -> list[Install]:
        """Install rules of the argument `data_files`."""
        return Install.of_data_files(self.folder, self.values.get("data_files"))

    @property
    def folders(self) -> dict[str, str]:
        """Known source folders of Python packages by package name; the empty name stands for all other packages."""
        found = self.values.get("package_dir")
        return {key: path for key, path in found.items() if isinstance(path, str)} if isinstance(found, dict) else {}

    @property
    def groups(self) -> dict[str, list[str]]:
        """Known entry point lines ``name = module:function``, by group."""
        points = self.values.get("entry_points")
        return points if isinstance(points, dict) else {}


def _add_setup_py(found: PackageSetup, text: str, folder: Path, budget: PackageBudget, run: RunSetup | None) -> None:
    error: RosidlError | None = None
    try:
        arguments = read_setup_py(text, folder, budget)
    except (SetupSyntaxError, UnreadableError) as raised:
        arguments, error = SetupArguments(), raised
    reasons = [(name, arguments.uncertain[name]) for name in _INSTALLED if name in arguments.uncertain]
    if run is not None and (error is not None or reasons):
        why = str(error) if error is not None else f"{reasons[0][0]} are not known without it: {reasons[0][1]}"
        try:
            arguments, error = SetupArguments.of_calls(run(folder, why)), None
            budget.renew()
        except RosidlError as failure:
            found.problems.append(str(failure))
    if error is not None:
        raise error
    found.values.update(arguments.values)
    options = arguments.values.get("options")
    if isinstance(options, dict):
        found.scripts_folder = _scripts_folder(options) or found.scripts_folder
    found.uncertain.update(arguments.uncertain)


def _add_setup_cfg(found: PackageSetup, text: str, folder: PackageFolder) -> None:
    sections = parse_ini(text)
    found.scripts_folder = _scripts_folder(sections) or found.scripts_folder
    options = {key.replace("-", "_").lower(): value for key, value in sections.get("options", {}).items()}
    given: dict[str, Any] = {name: _words(options[name]) for name in ("scripts", "py_modules") if name in options}
    kind = options.get("packages", "").strip()
    is_searched = kind in ("find:", "find_namespace:")
    if kind and not is_searched:
        given["packages"] = _words(kind)
    if "package_dir" in options:
        pairs = (line.partition("=")[::2] for line in _words(options["package_dir"]))
        given["package_dir"] = {key.strip(): path.strip() for key, path in pairs}
    if "options.entry_points" in sections:
        given["entry_points"] = sections["options.entry_points"]
    elif (points := options.get("entry_points", "")).strip().startswith("file:"):
        texts = [folder.read(path) for path in _words(points.strip().removeprefix("file:"))]
        given["entry_points"] = "\n".join(text for text in texts if text is not None)
        if None in texts:
            found.uncertain.setdefault("entry_points", "a file of setup.cfg that is not in the package folder")
    for name in ("name", "version"):
        value = sections.get("metadata", {}).get(name, "")
        if value and not value.startswith(("attr:", "file:")):
            given[name] = value
    _complete(found, given)
    # What takes work comes last.
    if is_searched and not found.values.get("packages"):
        finder = {key: _words(value) for key, value in sections.get("options.packages.find", {}).items()}
        _complete(found, {"packages": _packages(folder, finder, kind == "find_namespace:")})
    if "options.data_files" in sections and not found.values.get("data_files"):
        rows = {place: _words(value) for place, value in sections["options.data_files"].items()}
        _complete(found, {"data_files": _data_files(folder, rows)})


def _add_pyproject(found: PackageSetup, text: str, folder: PackageFolder) -> None:
    if len(text) > _MAX_TOML:
        raise SetupSyntaxError(f"the file is longer than {_MAX_TOML} characters")
    data = parse_toml(text)
    project, tool = _table(data, "project"), _table(_table(data, "tool"), "setuptools")
    points = {key: _lines(value) for key, value in _table(project, "entry-points").items()}
    for key, group in (("scripts", "console_scripts"), ("gui-scripts", "gui_scripts")):
        if lines := _lines(project.get(key)):
            points[group] = lines
    known = _groups(found.values.get("entry_points"))
    for group, lines in points.items():
        known[group] = [*known.get(group, []), *lines]
    found.values["entry_points"] = known
    given = {name: project[name] for name in ("name", "version") if isinstance(project.get(name), str)}
    for key, name in (("packages", "packages"), ("py-modules", "py_modules"), ("script-files", "scripts")):
        if isinstance(tool.get(key), list):
            given[name] = [one for one in tool[key] if isinstance(one, str)]
    if isinstance(tool.get("package-dir"), dict):
        given["package_dir"] = tool["package-dir"]
    _complete(found, given)
    packages = tool.get("packages")
    if isinstance(packages, dict) and not found.values.get("packages"):
        finder = _table(packages, "find")
        _complete(found, {"packages": _packages(folder, finder, finder.get("namespaces", True) is True)})
    if isinstance(tool.get("data-files"), dict) and not found.values.get("data_files"):
        files = {place: paths for place, paths in tool["data-files"].items() if isinstance(paths, list)}
        rows = {place: [str(one) for one in paths] for place, paths in files.items()}
        _complete(found, {"data_files": _data_files(folder, rows)})


def _scripts_folder(sections: Mapping[str, Any]) -> str:
    """Return the prefix folder for scripts that command options set; "" if no option sets it.

    `sections` has the options by command.
    """
    found = ""
    for section, name in (("develop", "script_dir"), ("install", "install_scripts")):
        given = sections.get(section)
        options = {str(key).replace("-", "_"): value for key, value in given.items()} if isinstance(given, dict) else {}
        place = str(options.get(name) or "").strip().partition("\n")[0]
        for base in ("$base/", "${base}/"):
            place = place.removeprefix(base)
        found = place or found
    return found


def _complete(found: PackageSetup, given: dict[str, Any]) -> None:
    """Add values from `found` for missing arguments of `setup`, by the rules of setuptools for setup.cfg and
    pyproject.toml.
    """
    for name, value in given.items():
        if not found.values.get(name):
            found.values[name] = value


def _packages(folder: PackageFolder, finder: dict[str, Any], is_namespace: bool) -> list[str]:
    where, excluded, included = (finder.get(name) for name in ("where", "exclude", "include"))
    places = [one for one in where if isinstance(one, str)] if isinstance(where, list) else [where or "."]
    names: list[str] = []
    for place in places:
        patterns = [[str(one) for one in part] if isinstance(part, list) else [] for part in (excluded, included)]
        found = folder.packages(str(place), patterns[0], patterns[1] or ["*"], is_namespace)
        names += (name for name in found if not isinstance(name, Gap))
    return names


def _data_files(folder: PackageFolder, rows: dict[str, list[str]]) -> list[list[object]]:
    """Return data files as pairs of target folder and paths, with file patterns resolved.

    A part that is not known is None.
    """
    found: list[list[object]] = []
    for place, patterns in rows.items():
        paths = (path for pattern in patterns for path in folder.glob(pattern, True))
        found.append([place, [None if isinstance(path, Gap) else path for path in paths]])
    return found


def _groups(points: object) -> dict[str, list[str]]:
    """Return the known entry points as lines by group, from one INI text, or from texts or lists by group."""
    groups: dict[str, list[str]] = {}
    if isinstance(points, str):
        lines: list[str] = []
        for line in _entry_lines(points):
            if line.startswith("[") and line.endswith("]"):
                lines = groups.setdefault(line.strip("[]").strip(), [])
            else:
                lines.append(line)
    elif isinstance(points, dict):
        groups = {group: [*_entry_lines(given)] for group, given in points.items()}
    return groups


def _entry_lines(given: object) -> Iterator[str]:
    """Yield the lines of entry points without comments.

    The value may be a text, a list of texts, or a dict with texts as keys.
    """
    if isinstance(given, str):
        stripped = (line.strip() for line in given.splitlines())
        yield from (line for line in stripped if line and not line.startswith("#"))
    elif isinstance(given, list | dict):
        for one in given:
            yield from _entry_lines(one)


def _table(data: dict[str, Any], name: str) -> dict[str, Any]:
    found = data.get(name)
    return found if isinstance(found, dict) else {}


def _lines(table: object) -> list[str]:
    items: Iterable[tuple[str, object]] = table.items() if isinstance(table, dict) else ()
    return [f"{name} = {value}" for name, value in items if isinstance(value, str)]


def _words(value: str) -> list[str]:
    """Return the words of a list value in setup.cfg, which are on lines or separated by commas."""
    parts = value.splitlines() if "\n" in value else value.split(",")
    return [part.strip() for part in parts if part.strip()]
