"""Executables of a package, read from its sources, which are not run.

They are console scripts, the files that CMakeLists.txt installs as PROGRAMS, and Python files that it installs into
``lib/<package>``. An installed package has those of its distribution, and the executable files of its prefix.
"""

from __future__ import annotations

import configparser
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, read_text
from rosidl_py_gen.ros_cli import CommandError, terminal_output
from rosidl_py_gen.ros_cli.prefix.executable import Executable
from rosidl_py_gen.type_loading.setup_py import SetupSyntaxError, setup_calls
from rosidl_py_gen.type_loading.share_folder import cmake_installs

_ENTRY = re.compile(r"\s*([^\s=]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*(?:\[.*\])?\s*")
_TOML_LINE = re.compile(r"""\s*(?:"([^"]+)"|'([^']+)'|([\w-]+))\s*=\s*(?:"([^"\\]*)"|'([^']*)')\s*(?:#.*)?""")
_GROUP = "console_scripts"
_PYPROJECT_PREFIX = "project.entry-points."
_PYPROJECT_GROUPS = {"project.scripts": _GROUP, "project.gui-scripts": "gui_scripts"}
BUNDLED: dict[str, dict[str, str]] = {
    "joint_state_publisher": {"joint_state_publisher": "rosidl_py_gen.robot.joint_state_publisher:main"},
    "robot_state_publisher": {"robot_state_publisher": "rosidl_py_gen.robot.robot_state_publisher:main"},
    "tf2_ros": {"static_transform_publisher": "rosidl_py_gen.robot.static_transform_publisher:main"},
}
"""ROS packages whose executables are part of this package, each as ``module:function``."""


def of_sources(folder: Path) -> dict[str, Executable]:
    """Return the executables of a source package by name. Raises `CommandError` if a file cannot be read."""
    _, found = entry_points(folder, lambda text: terminal_output.note(f"warning: {text}"))
    if (folder / "CMakeLists.txt").is_file():
        found += _programs(folder)
    return {one.name: one for one in reversed(found)}


def entry_points(folder: Path, problem: Callable[[str], None]) -> tuple[dict[str, list[str]], list[Executable]]:
    """Return the entry points of a source package, as lines ``name = module:function`` by group, and console scripts.

    Calls `problem` with an error text for each malformed script. Raises `CommandError` if a file cannot be read.
    """
    groups: dict[str, list[str]] = {}
    scripts: list[Executable] = []
    for reader, name in ((_setup_py, "setup.py"), (_setup_cfg, "setup.cfg"), (_pyproject, "pyproject.toml")):
        if not (source := folder / name).is_file():
            continue
        try:
            found, root = reader(read_text(folder, name), folder)
        except (UnreadableError, SetupSyntaxError, configparser.Error) as error:
            raise CommandError(f"{source}: {error}".replace("\n", " ")) from error
        for group, lines in found.items():
            groups.setdefault(group, []).extend(line.strip() for line in lines if "=" in line)
        for text in filter(str.strip, found.get(_GROUP, ())):
            if match := _ENTRY.fullmatch(text):
                scripts.append(Executable(match[1], folder / root, None, match[2], match[3]))
            else:
                problem(f'{source}: expected "name = module:function", found "{text.strip()[:200]}"; it is skipped')
    return groups, scripts


def is_python_program(file: Path) -> bool:
    """Return True for a script that starts with the name of Python."""
    if not file.is_file():  # opening a pipe would wait for its writer
        return False
    with file.open("rb") as opened:
        line = opened.readline(200)
    return line.startswith(b"#!") and b"python" in line


def of_distribution(package: str) -> dict[str, Executable]:
    """Return the console scripts of a package that pip has installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        installed = distribution(package)
    except PackageNotFoundError:
        return {}
    scripts = {one.name: one.value for one in installed.entry_points if one.group == _GROUP}
    return _functions(scripts, Path(str(installed.locate_file(""))))


def of_bundled(package: str) -> dict[str, Executable]:
    """Return the executables that this package has for a ROS package."""
    return _functions(BUNDLED.get(package, {}), Path(__file__).parents[3])


def _functions(values: Mapping[str, str], folder: Path) -> dict[str, Executable]:
    found = {name: _ENTRY.fullmatch(f"{name} = {value}") for name, value in values.items()}
    return {name: Executable(name, folder, None, one[2], one[3]) for name, one in found.items() if one}


def of_prefixes(package: str) -> dict[str, Executable]:
    """Return the executable files in ``lib/<package>`` of the prefixes in AMENT_PREFIX_PATH."""
    executables: dict[str, Executable] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        for path in sorted(Path(prefix, "lib", package).glob("*")):
            if path.is_file() and os.access(path, os.X_OK):
                executables.setdefault(path.name, Executable(path.name, path.parent, path))
    return executables


def _setup_py(text: str, folder: Path) -> tuple[dict[str, list[str]], str]:
    groups: dict[str, list[str]] = {}
    root = ""
    for arguments in setup_calls(text, folder):
        points = arguments.get("entry_points")
        given = _sections(points) if isinstance(points, str) else points
        for group, lines in given.items() if isinstance(given, dict) else ():
            lines = lines.splitlines() if isinstance(lines, str) else lines
            groups.setdefault(group, []).extend(one for one in lines or () if isinstance(one, str))
        folders = arguments.get("package_dir")
        if isinstance(folders, dict) and isinstance(folders.get(""), str):
            root = folders[""]
    return groups, root


def _setup_cfg(text: str, folder: Path) -> tuple[dict[str, list[str]], str]:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.read_string(text)
    root = re.search(r"^\s*=\s*(\S+)", parser.get("options", "package_dir", fallback=""), re.MULTILINE)
    points = parser["options.entry_points"].items() if "options.entry_points" in parser else ()
    return {group: lines.splitlines() for group, lines in points}, root[1] if root else ""


def _pyproject(text: str, folder: Path) -> tuple[dict[str, list[str]], str]:
    """Return the entry points of ``[project]``; Python 3.10 has no TOML parser."""
    groups = {}
    for section, texts in _sections(text).items():
        group = _PYPROJECT_GROUPS.get(section, section.removeprefix(_PYPROJECT_PREFIX).strip("\"'"))
        if section in _PYPROJECT_GROUPS or section.startswith(_PYPROJECT_PREFIX):
            lines = (_TOML_LINE.fullmatch(line) for line in texts)
            groups[group] = [f"{one[1] or one[2] or one[3]} = {one[4] or one[5] or ''}" for one in lines if one]
    return groups, "src" if (folder / "src").is_dir() else ""


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
    try:
        installs = cmake_installs(folder)
    except UnreadableError as error:
        raise CommandError(f"{folder / 'CMakeLists.txt'}: {error.reason}") from error
    for one in installs:
        is_program = one.kind == "PROGRAMS"
        if is_program or one.destination.startswith("lib/"):
            for name, path in one.files():
                if is_program or (path.endswith(".py") and "/" not in name):
                    yield Executable(name, folder, folder / path)
