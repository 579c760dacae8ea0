"""Put generated files into a folder, and nothing else.

A file is ours when its first line carries the mark. Only changed files are written, each through a temporary file
beside it, so an interrupted run leaves whole files. Files of ours whose definition vanished are removed. Anything else
is never touched.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rosidl_py_gen.base.generated_files import is_generated
from rosidl_py_gen.errors import OutputError


@dataclass(frozen=True, slots=True)
class Changes:
    """What a run changes, as paths relative to the output folder, in order."""

    written: tuple[str, ...]
    removed: tuple[str, ...]
    unchanged: int


def plan_changes(folder: Path, files: dict[str, str], vanished: list[str]) -> Changes:
    """Compare a folder with what it should hold.

    Args:
        folder: may not exist yet.
        files: relative path -> text.
        vanished: relative paths of files of ours that no definition stands for any more.

    Raises:
        OutputError: a target exists that this tool did not write; lists all of them.
    """
    written: list[str] = []
    foreign: list[str] = []
    for name, text in files.items():
        target = folder / name
        blocker = next((one for one in _parents(folder, name) if os.path.lexists(one) and not os.path.isdir(one)), None)
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
    return Changes(tuple(written), tuple(vanished), len(files) - len(written))


def _parents(folder: Path, name: str) -> list[Path]:
    parts = name.split("/")[:-1]
    return [folder, *(folder.joinpath(*parts[: count + 1]) for count in range(len(parts)))]


def apply_changes(folder: Path, files: dict[str, str], changes: Changes) -> None:
    """Carry out what `plan_changes` found.

    Raises:
        OutputError: the folder cannot be written to.
    """
    try:
        for name in changes.written:
            _write(folder / name, files[name])
        for name in changes.removed:
            path = folder / name
            path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # not empty, or holds files of others
                path.parent.rmdir()
    except OSError as error:
        raise OutputError(f"cannot write {error.filename or folder}: {error.strerror or error}") from error


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=".rosidl-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def generated_files_below(folder: Path, packages: Iterable[str]) -> list[str]:
    """Relative paths of the files of ours in the given packages, innermost first.

    Raises:
        OutputError: a folder cannot be read.
    """
    found: list[str] = []
    try:
        for package in packages:
            for part in (f"{package}/msg", f"{package}/srv", f"{package}/action", package):
                below = folder / part
                if os.path.isdir(below):
                    names = sorted(os.listdir(below))
                    found += [f"{part}/{name}" for name in names if _is_source(name) and is_generated(below / name)]
    except OSError as error:
        raise OutputError(f"cannot read {error.filename or folder}: {error.strerror or error}") from error
    return found


def generated_packages(folder: Path) -> list[str]:
    """Packages in a folder whose ``__init__`` is ours."""
    if not os.path.isdir(folder):
        return []
    return [name for name in sorted(os.listdir(folder)) if is_generated(folder / name / "__init__.py")]


def _is_source(name: str) -> bool:
    return name.endswith(".py") or name == "py.typed"
