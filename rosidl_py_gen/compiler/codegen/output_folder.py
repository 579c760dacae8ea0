"""The output folder of the generator.

Only changed files are written, each through a temporary file, so an interrupted run leaves complete files. Generated
files without a definition are removed. Files without the header of generated files are never changed.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rosidl_py_gen.base.generated_classes import is_generated
from rosidl_py_gen.errors import OutputError


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes of a run, as sorted paths relative to the output folder."""

    written: tuple[str, ...]
    removed: tuple[str, ...]
    unchanged: int


def plan_changes(folder: Path, files: dict[str, str], removed: list[str]) -> Changes:
    """Compare a folder, which may be missing, with its files; raises `OutputError` for files of another origin."""
    written: list[str] = []
    foreign: list[str] = []
    for name, text in files.items():
        target = folder / name
        parents = [*reversed(Path(name).parents)]  # of "a/b/c": ".", "a", "a/b"
        blockers = (path for path in map(folder.joinpath, parents) if os.path.lexists(path) and not path.is_dir())
        blocker = next(blockers, None)
        if blocker is not None:
            foreign.append(f"{blocker} is a file; expected a folder")
        elif not os.path.lexists(target):
            written.append(name)
        elif not os.path.isfile(target) or not is_generated(target):
            foreign.append(f"{target} exists and was not written by rosidl-py-gen")
        elif target.read_bytes() != text.encode():
            written.append(name)
    if foreign:
        raise OutputError(
            "\n".join([*dict.fromkeys(foreign), "Choose another folder with --out, or move these files away."])
        )
    return Changes(tuple(written), tuple(removed), len(files) - len(written))


def apply_changes(folder: Path, files: dict[str, str], changes: Changes) -> None:
    """Write and remove the files of `plan_changes`; raises `OutputError`."""
    try:
        for name in changes.written:
            _write(folder / name, files[name])
        for name in changes.removed:
            path = folder / name
            path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # not empty
                path.parent.rmdir()
    except OSError as error:
        raise OutputError(f"cannot write {error.filename or folder}: {error.strerror or error}") from error


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=".rosidl-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode())
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def generated_files_below(folder: Path, packages: Iterable[str]) -> list[str]:
    """Return the relative paths of the generated files in some packages, innermost first; raises `OutputError`."""
    found: list[str] = []
    try:
        for package in packages:
            for place in (f"{package}/msg", f"{package}/srv", f"{package}/action", package):
                if os.path.isdir(folder / place):
                    names = (name for name in sorted(os.listdir(folder / place)) if name.endswith((".py", "py.typed")))
                    found += [f"{place}/{name}" for name in names if is_generated(folder / place / name)]
    except OSError as error:
        raise OutputError(f"cannot read {error.filename or folder}: {error.strerror or error}") from error
    return found


def generated_packages(folder: Path) -> list[str]:
    """Return the packages in a folder whose ``__init__.py`` is generated."""
    if not os.path.isdir(folder):
        return []
    return [name for name in sorted(os.listdir(folder)) if is_generated(folder / name / "__init__.py")]
