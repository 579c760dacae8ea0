"""Writing of generated files to the output folder.

Only changed files are written, each through a temporary file, so an interrupted run leaves complete files. Generated
files are removed if their definition no longer exists. Files without the header of generated files are never changed.
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
    """File changes of a generator run, as sorted paths relative to the output folder."""

    written: tuple[str, ...]
    removed: tuple[str, ...]
    unchanged: int


def plan_changes(folder: Path, files: dict[str, str], removed: list[str]) -> Changes:
    """Return which of the generated `files` (path -> text) differ from the output folder, which may be missing.

    Args:
        removed: generated files to remove.

    Raises:
        OutputError: the folder has files at these paths that the generator did not write.
    """
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
    """Write and remove the files that `plan_changes` returned; raises `OutputError` if a file cannot be written."""
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
    """Return the relative paths of generated files in the packages of a folder.

    The files of a package folder follow after the files of its subfolders.

    Raises:
        OutputError: a folder or file cannot be read.
    """
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
    """Return the names of the packages in an output folder whose ``__init__.py`` the generator wrote."""
    if not os.path.isdir(folder):
        return []
    return [name for name in sorted(os.listdir(folder)) if is_generated(folder / name / "__init__.py")]
