"""Executables of a package, read from its sources, which are not run.

They are the console scripts of setup.py (read as syntax tree), setup.cfg and pyproject.toml, the files that
CMakeLists.txt installs as PROGRAMS, and Python files that it installs into ``lib/<package>``. An installed package has
the console scripts of its distribution, and the executable files in ``lib/<package>`` of its prefix.
"""

from __future__ import annotations

import configparser
import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, read_text
from rosidl_py_gen.ros_cli import CommandError, terminal_output
from rosidl_py_gen.ros_cli.prefix.bundled import BUNDLED
from rosidl_py_gen.type_loading.setup_py import SetupSyntaxError, setup_calls
from rosidl_py_gen.type_loading.share_folder import cmake_installs

_ENTRY = re.compile(r"\s*([^\s=]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*(?:\[.*\])?\s*")
_TOML_LINE = re.compile(r"""\s*(?:"([^"]+)"|'([^']+)'|([\w-]+))\s*=\s*(?:"([^"\\]*)"|'([^']*)')\s*(?:#.*)?""")
_GROUP = "console_scripts"
_PYPROJECT_PREFIX = "project.entry-points."
_PYPROJECT_GROUPS = {"project.scripts": _GROUP, "project.gui-scripts": "gui_scripts"}


@dataclass(frozen=True)
class Executable:
    """Script, or function of a module.

    Attributes:
        name: name for `ros2 run`.
        folder: first folder of `sys.path`.
        source: file that declares the executable.
        file: the script, or None.
        module: the module of the function, or None.
        function: name of the function, with dots for attributes, or None.
    """

    name: str
    folder: Path
    source: Path
    file: Path | None = None
    module: str | None = None
    function: str | None = None


def of_sources(folder: Path) -> dict[str, Executable]:
    """Return the executables of a source package by name. Raises `CommandError` if a file cannot be read."""
    executables: dict[str, Executable] = {}
    for source, groups, root in entry_points(folder):
        for one in console_scripts(groups, source, folder / root, _warn):
            executables.setdefault(one.name, one)
    if (folder / "CMakeLists.txt").is_file():
        for one in _programs(folder):
            executables.setdefault(one.name, one)
    return executables


def _warn(text: str) -> None:
    terminal_output.note(f"warning: {text}")


def entry_points(folder: Path) -> Iterator[tuple[Path, dict[str, list[str]], str]]:
    """Yield the entry points of a source package.

    For each of its setup.py, setup.cfg and pyproject.toml, yield the file, the lines ``name = module:function`` by
    group, and the folder of the modules relative to `folder`. Raises `CommandError` if a file cannot be read.
    """
    for reader, name in ((_setup_py, "setup.py"), (_setup_cfg, "setup.cfg"), (_pyproject, "pyproject.toml")):
        if (folder / name).is_file():
            yield folder / name, *reader(_text(folder, name), folder / name)


def console_scripts(
    groups: dict[str, list[str]], source: Path, folder: Path, problem: Callable[[str], None]
) -> Iterator[Executable]:
    """Yield the console scripts of `entry_points`; calls `problem` with an error text for each other line."""
    return _scripts(groups.get(_GROUP, ()), folder, source, problem)


def of_distribution(package: str) -> dict[str, Executable]:
    """Return the console scripts of a package that pip has installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        installed = distribution(package)
    except PackageNotFoundError:
        return {}
    folder = Path(str(installed.locate_file("")))
    texts = [f"{one.name} = {one.value}" for one in installed.entry_points if one.group == _GROUP]
    return {one.name: one for one in _scripts(texts, folder, folder)}


def of_bundled(package: str) -> dict[str, Executable]:
    """Return the executables that this package has for a ROS package."""
    folder = Path(__file__).parents[3]
    texts = [f"{name} = {value}" for name, value in BUNDLED.get(package, {}).items()]
    return {one.name: one for one in _scripts(texts, folder, Path(__file__).parents[2])}


def of_prefixes(package: str) -> dict[str, Executable]:
    """Return the executable files in ``lib/<package>`` of the prefixes in AMENT_PREFIX_PATH."""
    executables: dict[str, Executable] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folder = Path(prefix, "lib", package)
        try:
            names = sorted(os.listdir(folder))
        except OSError:
            continue
        for name in names:
            path = folder / name
            if path.is_file() and os.access(path, os.X_OK):
                executables.setdefault(name, Executable(name, folder, folder, file=path))
    return executables


def _text(folder: Path, name: str) -> str:
    try:
        return read_text(folder, name)
    except UnreadableError as error:
        raise CommandError(f"{folder / name}: {error.reason}") from error


def _scripts(
    texts: Iterable[str], folder: Path, source: Path, problem: Callable[[str], None] = lambda text: None
) -> Iterator[Executable]:
    for text in texts:
        if match := _ENTRY.fullmatch(text):
            yield Executable(match[1], folder, source, module=match[2], function=match[3])
        elif text.strip():
            problem(f'{source}: expected "name = module:function", found "{text.strip()[:200]}"; it is skipped')


def _setup_py(text: str, source: Path) -> tuple[dict[str, list[str]], str]:
    try:
        calls = setup_calls(text, source.parent)
    except SetupSyntaxError as error:
        raise CommandError(f"{source}: {error}") from error
    groups: dict[str, list[str]] = {}
    root = ""
    for arguments in calls:
        points = arguments.get("entry_points")
        given = _sections(points) if isinstance(points, str) else points
        for group, lines in given.items() if isinstance(given, dict) else ():
            lines = lines.splitlines() if isinstance(lines, str) else lines
            known = [one for one in lines if isinstance(one, str)] if isinstance(lines, list | tuple) else []
            groups.setdefault(group, []).extend(known)
        folders = arguments.get("package_dir")
        if isinstance(folders, dict) and isinstance(folders.get(""), str):
            root = folders[""]
    return groups, root


def _setup_cfg(text: str, source: Path) -> tuple[dict[str, list[str]], str]:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise CommandError(f"{source}: {error}".replace("\n", " ")) from error
    root = re.search(r"^\s*=\s*(\S+)", parser.get("options", "package_dir", fallback=""), re.MULTILINE)
    points = parser["options.entry_points"].items() if "options.entry_points" in parser else ()
    return {group: lines.splitlines() for group, lines in points}, root[1] if root else ""


def _pyproject(text: str, source: Path) -> tuple[dict[str, list[str]], str]:
    """Return the entry points of ``[project]``; Python 3.10 has no TOML parser."""
    groups = {}
    for section, texts in _sections(text).items():
        group = _PYPROJECT_GROUPS.get(section, section.removeprefix(_PYPROJECT_PREFIX).strip("\"'"))
        if section in _PYPROJECT_GROUPS or section.startswith(_PYPROJECT_PREFIX):
            lines = (_TOML_LINE.fullmatch(line) for line in texts)
            groups[group] = [f"{one[1] or one[2] or one[3]} = {one[4] or one[5] or ''}" for one in lines if one]
    return groups, "" if not (source.parent / "src").is_dir() else "src"


def _sections(text: str) -> dict[str, list[str]]:
    """Return the lines below each ``[name]``."""
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if line.lstrip().startswith("["):
            lines = sections.setdefault(line.strip().partition("]")[0].lstrip("[").strip(), [])
        else:
            lines.append(line)
    return sections


def _programs(folder: Path) -> Iterator[Executable]:
    """Yield files that are installed as PROGRAMS, and Python files that are installed into ``lib/<package>``."""
    source = folder / "CMakeLists.txt"
    try:
        installs = cmake_installs(folder)
    except UnreadableError as error:
        raise CommandError(f"{source}: {error.reason}") from error
    for one in installs:
        is_program = one.kind == "PROGRAMS"
        if is_program or (one.kind in ("FILES", "DIRECTORY") and one.destination.startswith("lib/")):
            for name, path in one.files():
                file = folder / path
                if is_program or (file.suffix == ".py" and "/" not in name):
                    yield Executable(name, folder, source, file=file)
