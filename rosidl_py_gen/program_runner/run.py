"""Search for the program of ``rosidl-py run`` (file, module, or executable of a package), and set-up of its imports."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import takewhile
from pathlib import Path

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.prefix import Executable, make_importable, set_environment, workspaces
from rosidl_py_gen.program_runner.program import start as start_program
from rosidl_py_gen.type_loading import workspace_packages


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
    set_environment(program.place, paths)
    _note_misplaced_option(program, next(iter(arguments), ""))
    return partial(start_program, program, arguments)


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


def _executable_program(
    package: str, words: Sequence[str], paths: Sequence[str], runs_setup: bool
) -> tuple[Executable, Sequence[str]]:
    from rosidl_py_gen.prefix import find_executables

    found = workspaces(paths)
    by_name, places = find_executables(package, found, runs_setup=runs_setup)
    if not by_name and not places:
        searched = ", ".join(str(one.folder) for one in found)
        known = {name for workspace in found for name in workspace_packages(workspace)}
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
    if not one.is_python:
        raise CommandError(f"{one.file} is not a Python program")
    return replace(one, name=str(one.file), folder=one.place.parent), arguments


def _list(words: Sequence[str], paths: Sequence[str], as_json: bool) -> int:
    """Print the executables of a package, or of all packages, as `ros2 pkg executables` does; returns 0."""
    from rosidl_py_gen.prefix import find_executables

    found = workspaces(paths)
    packages = words or sorted({name for workspace in found for name in workspace_packages(workspace)})
    rows = []
    for package in packages:
        by_name, places = find_executables(package, found)
        if words and not by_name and not places:
            _executable_program(package, (), paths, runs_setup=False)
        rows += [{"package": package, "executable": name} for name in sorted(by_name)]
    if as_json:
        terminal_output.document(rows)
    else:
        terminal_output.lines(f"{row['package']} {row['executable']}" for row in rows)
    return 0
