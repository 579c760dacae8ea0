"""Executables of a package, read from its sources, which are not run.

They are the console scripts of setup.py (read as syntax tree), setup.cfg and pyproject.toml, the files that
CMakeLists.txt installs as PROGRAMS, and Python files that it installs into ``lib/<package>``. An installed package has
the console scripts of its distribution, and the executable files in ``lib/<package>`` of its prefix.
"""

from __future__ import annotations

import configparser
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, read_text
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.type_loading.setup_py import SetupSyntaxError, setup_calls
from rosidl_py_gen.type_loading.share_folder import cmake_installs

_ENTRY = re.compile(r"\s*([^\s=]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*(?:\[.*\])?\s*")
_TOML_LINE = re.compile(r"""\s*(?:"([^"]+)"|'([^']+)'|([\w-]+))\s*=\s*(?:"([^"\\]*)"|'([^']*)')\s*(?:#.*)?""")
_GROUP = "console_scripts"


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
    for reader, name in ((_setup_py, "setup.py"), (_setup_cfg, "setup.cfg"), (_pyproject, "pyproject.toml")):
        if (folder / name).is_file():
            texts, root = reader(_text(folder, name), folder / name)
            for one in _scripts(texts, folder / root, folder / name):
                executables.setdefault(one.name, one)
    if (folder / "CMakeLists.txt").is_file():
        for one in _programs(folder):
            executables.setdefault(one.name, one)
    return executables


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


def _scripts(texts: Iterable[str], folder: Path, source: Path) -> Iterator[Executable]:
    for text in texts:
        if match := _ENTRY.fullmatch(text):
            yield Executable(match[1], folder, source, module=match[2], function=match[3])
        elif text.strip():
            raise CommandError(f'{source}: expected "name = module:function", found "{text.strip()[:200]}"')


def _setup_py(text: str, source: Path) -> tuple[list[str], str]:
    """Return the console scripts, and the folder of the modules relative to that of the package."""
    try:
        calls = setup_calls(text, source.parent)
    except SetupSyntaxError as error:
        raise CommandError(f"{source}: {error}") from error
    texts: list[str] = []
    root = ""
    for arguments in calls:
        points = arguments.get("entry_points")
        scripts = points.get(_GROUP) if isinstance(points, dict) else None
        if isinstance(points, str):
            scripts = _section(points, _GROUP)
        if isinstance(scripts, str):
            scripts = scripts.splitlines()
        texts += [one for one in scripts if isinstance(one, str)] if isinstance(scripts, list | tuple) else []
        folders = arguments.get("package_dir")
        if isinstance(folders, dict) and isinstance(folders.get(""), str):
            root = folders[""]
    return texts, root


def _setup_cfg(text: str, source: Path) -> tuple[list[str], str]:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise CommandError(f"{source}: {error}".replace("\n", " ")) from error
    root = re.search(r"^\s*=\s*(\S+)", parser.get("options", "package_dir", fallback=""), re.MULTILINE)
    return parser.get("options.entry_points", _GROUP, fallback="").splitlines(), root[1] if root else ""


def _pyproject(text: str, source: Path) -> tuple[list[str], str]:
    """Return the lines of ``[project.scripts]``; Python 3.10 has no TOML parser."""
    lines = (_TOML_LINE.fullmatch(line) for line in _section(text, "project.scripts"))
    texts = [f"{one[1] or one[2] or one[3]} = {one[4] or one[5] or ''}" for one in lines if one]
    return texts, "" if not (source.parent / "src").is_dir() else "src"


def _section(text: str, name: str) -> list[str]:
    """Return the lines below ``[name]``."""
    lines: list[str] = []
    is_inside = False
    for line in text.splitlines():
        if line.lstrip().startswith("["):
            is_inside = line.strip().partition("]")[0].lstrip("[").strip() == name
        elif is_inside:
            lines.append(line)
    return lines


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
