"""Search for the program of ``rosidl-py run`` (file, module, or executable of a package), and set-up of its imports."""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.machinery import ModuleSpec, PathFinder
from itertools import takewhile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.resources import RUN_PREFIX
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.compiler.frontend import UnreadableError, Workspace, files_below, note
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, Executable, make_importable, roots, variables, workspaces
from rosidl_py_gen.program_runner.program import start as start_program
from rosidl_py_gen.type_loading import cached, is_usable, workspace_packages

if TYPE_CHECKING:
    from rosidl_py_gen.type_loading import SetupArguments


def start(
    words: Sequence[str], paths: Sequence[str], check: bool, listed: bool, as_json: bool
) -> Callable[[], None] | int:
    """Find a program and return a function that runs it; for --list and --check, print and return the exit code."""
    if listed:
        return _list(words, paths, as_json)
    program, arguments = _program(words, paths, runs_setup=not check)
    if program.warning and not check:
        terminal_output.note(f"warning: {program.warning}")
    make_importable(program.place, paths)
    if check:
        from rosidl_py_gen.program_runner.check import check as check_program

        return check_program(program, partial(_packages, paths, program.place), as_json)
    _set_environment(program.place, paths)
    _note_misplaced_option(program, next(iter(arguments), ""))
    return partial(start_program, program, arguments)


def _set_environment(place: Path, paths: Sequence[str]) -> None:
    """Set environment variables of ROS, with a prefix in which child processes of the program find all packages."""
    prefix = None
    if os.name != "nt":  # it cannot have links
        try:
            prefix = _cached_prefix(workspaces(paths, place))
        except CommandError as error:
            terminal_output.note(f"warning: programs that this one starts will not find rclpy: {error}")
    os.environ.update(variables(prefix) | {RUN_PREFIX: str(prefix or "")})
    if prefix is not None:
        sys.meta_path.append(_PrefixFinder(prefix))


class _PrefixFinder:
    """Import finder for modules that are in a prefix, such as modules that a package installs as data files."""

    def __init__(self, prefix: Path) -> None:
        self._places = [str(prefix / SITE_PACKAGES)]

    def find_spec(self, name: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, self._places, target) if path is None else None


def _cached_prefix(workspaces: Sequence[Workspace]) -> Path:
    """Return a prefix of workspaces in the cache; it is built again only if files or folders have changed."""
    built = []

    def build() -> list[str]:
        # Slow to import.
        from rosidl_py_gen.prefix.build import STATE, build_prefix

        for place in sys.path:
            note(place)
        copies = [replace(one) for one in workspaces]  # a workspace that was read before notes no paths
        prefix = build_prefix(roots(copies), runs_setup=True)
        for folder in prefix.packages.values():
            with suppress(UnreadableError):
                files_below(folder)
        note(prefix.folder / STATE)
        built.append(prefix)
        return [str(prefix.folder), *prefix.notes]

    folder, *notes = cached(("prefix", sys.executable, sys.path, workspaces), build)
    if not built and not is_usable(Path(folder)):
        # The temporary prefix of another process, or other users have been able to enter the prefix.
        folder, *notes = build()
    for text in notes:
        terminal_output.note_once(f"warning: {text}")
    return Path(folder)


def _note_misplaced_option(program: Executable, first: str) -> None:
    """Print a note if the first argument of the program is an option of ``run`` that the program does not mention."""
    if first in ("--check", "--list") and (program.file is None or first.encode() not in program.file.read_bytes()):
        text = f"note: {first} is passed to the program; for the option use rosidl-py run {first} PROGRAM"
        terminal_output.note(text)


def _program(words: Sequence[str], paths: Sequence[str], runs_setup: bool) -> tuple[Executable, Sequence[str]]:
    """Return the executable that the words of a command line name, and its arguments.

    Raises `CommandError` if there is none.
    """
    first, *rest = words
    if first == "-m":
        return Executable("-m", Path.cwd(), module=rest[0]), rest[1:]
    path = Path(first)
    if path.is_file():
        return _file_program(path), rest
    if first.endswith(".py") or "/" in first or os.sep in first:
        kind = "it is a folder" if path.is_dir() else "no such file"
        raise CommandError(f"{first}: expected a Python file, {kind}")
    return _executable_program(first, rest, paths, runs_setup)


def _file_program(path: Path) -> Executable:
    """Return the executable of a Python file; a file with relative imports is run as a module of its package."""
    real = path.resolve()
    inside = [*takewhile(lambda folder: (folder / "__init__.py").is_file(), real.parents)]
    if inside and _has_relative_imports(real):
        names = [*(folder.name for folder in reversed(inside)), real.stem]
        if all(name.isidentifier() for name in names):
            return Executable(str(path), inside[-1].parent, real, ".".join(names))
    return Executable(str(path), real.parent, path)


def _has_relative_imports(file: Path) -> bool:
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return False  # the error appears when it runs
    return any(isinstance(node, ast.ImportFrom) and node.level for node in ast.walk(tree))


def _packages(paths: Sequence[str], place: Path) -> dict[str, Path]:
    """Return the source folders of the packages of some workspaces by name; the first workspace has precedence."""
    return {
        name: folder for one in reversed(workspaces(paths, place)) for name, folder in workspace_packages(one).items()
    }


def _run_setup_py(folder: Path, why: str) -> SetupArguments:
    # Slow to import, and rarely needed.
    from rosidl_py_gen.prefix.setup_process import run_setup_py

    return run_setup_py(folder, why)


def _executables(
    package: str, paths: Sequence[str], runs_setup: bool = False
) -> tuple[dict[str, Executable], list[str]]:
    """Return the executables of a package by name, from its sources, pip or a prefix, and the folders with them."""
    from rosidl_py_gen.prefix import executables

    run = _run_setup_py if runs_setup else None
    places: list[str] = []
    for workspace in workspaces(paths):
        if folder := workspace_packages(workspace).get(package):
            places.append(str(folder))
            if by_name := executables.of_sources(folder, package, run):
                return by_name, places
    for find in (executables.of_distribution, executables.of_bundled, executables.of_prefixes):
        if by_name := find(package):
            return by_name, [str(next(iter(by_name.values())).folder)]
    return {}, places


def _executable_program(
    package: str, words: Sequence[str], paths: Sequence[str], runs_setup: bool
) -> tuple[Executable, Sequence[str]]:
    from rosidl_py_gen.prefix.executables import is_python_program

    by_name, places = _executables(package, paths, runs_setup)
    if not by_name and not places:
        searched = ", ".join(str(one.folder) for one in workspaces(paths))
        known = {name for workspace in workspaces(paths) for name in workspace_packages(workspace)}
        text = f'no file and no package "{package}"{did_you_mean(package, known)}'
        raise CommandError(f"{text}; searched {searched}, the packages of pip, and AMENT_PREFIX_PATH")
    names = ", ".join(sorted(by_name)) or "none in Python"
    if not words:
        raise CommandError(f"expected an executable of {package} ({places[0]}); it has: {names}")
    name, *arguments = words
    if name not in by_name:
        raise CommandError(
            f'{package} ({places[0]}) has no executable "{name}"{did_you_mean(name, by_name)}; it has: {names}'
        )
    one = by_name[name]
    if one.file is None:
        return replace(one, name=str(one.folder / name)), arguments
    if one.file.suffix != ".py" and not is_python_program(one.file):
        raise CommandError(f"{one.file} is not a Python program")
    return replace(one, name=str(one.file), folder=one.place.parent), arguments


def _list(words: Sequence[str], paths: Sequence[str], as_json: bool) -> int:
    """Print the executables of a package, or of all packages, as `ros2 pkg executables` does; returns 0."""
    packages = words or sorted({name for workspace in workspaces(paths) for name in workspace_packages(workspace)})
    rows = []
    for package in packages:
        by_name, places = _executables(package, paths)
        if words and not by_name and not places:
            _executable_program(package, (), paths, runs_setup=False)
        rows += [{"package": package, "executable": name} for name in sorted(by_name)]
    if as_json:
        terminal_output.document(rows)
    else:
        terminal_output.lines(f"{row['package']} {row['executable']}" for row in rows)
    return 0
