"""Settings of a user's project for commands, and imports of generated packages in the current folder.

The folders of packages are read from ``[tool.rosidl-py]`` of pyproject.toml. `parse_toml` reads untrusted files in time
that is linear in their size.
"""

from __future__ import annotations

import os
import stat
import sys
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.resources import GeneratedCode
from rosidl_py_gen.errors import DefinitionError, Diagnostic, display_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

_MAX_DOTS = 300
"""Maximum number of dots in a line of TOML: the time of `tomllib` is quadratic in the number of parts of a key."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text; raises ValueError for invalid or too deeply nested text."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > _MAX_DOTS:
            raise ValueError(f"line {number} has more than {_MAX_DOTS} dots")
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return data


_FILE = "pyproject.toml"
_TABLE = "rosidl-py"
_KEYS = ("path",)
_MAX_BYTES = 1 << 20


class GeneratedPackages:
    """Import finder that finds the generated message packages of one folder, and no other modules in that folder.

    A folder on `sys.path` would also provide other modules, such as an optional dependency of a library, so a
    downloaded folder could run code in every command that is started in it.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if path is not None or not GeneratedCode.is_generated(Path(self.folder, fullname, "__init__.py")):
            return None
        return PathFinder.find_spec(fullname, [self.folder], target)

    @classmethod
    @contextmanager
    def of_current_folder(cls) -> Iterator[None]:
        """Make the generated packages of the current folder importable inside the block, after all other packages."""
        try:
            finder = cls(os.getcwd())
        except OSError:  # it was deleted
            yield
            return
        sys.meta_path.append(finder)
        try:
            yield
        finally:
            sys.meta_path.remove(finder)


def with_project_path(paths: Sequence[str]) -> tuple[str, ...]:
    """Return the folders of the option ``--path``, then the folders that pyproject.toml lists.

    Raises:
        DefinitionError: pyproject.toml cannot be read, or its table is invalid.
    """
    real = {os.path.realpath(path) for path in paths}
    return (*paths, *(path for path in _project_path() if os.path.realpath(path) not in real))


def _project_path() -> list[str]:
    """Return the folders in ``path`` of the nearest ``[tool.rosidl-py]``, searched from the current folder upwards.

    Raises `DefinitionError` if the table is invalid.
    """
    try:
        here = Path.cwd()
    except OSError:
        return []
    for folder in (here, *here.parents):
        table = _table(folder / _FILE)
        if table is not None:
            return _checked(folder, table)
    return []


def _table(file: Path) -> object:
    try:
        if not stat.S_ISREG(file.stat().st_mode):  # opening a FIFO would wait for a writer
            return None
        with file.open("rb") as opened:
            raw = opened.read(_MAX_BYTES + 1)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return None
    except OSError as error:
        raise _wrong(file, f"cannot be read: {error.strerror or error}") from error
    if _TABLE.encode() not in raw:  # files of other projects are not parsed, so their errors do not matter
        return None
    if len(raw) > _MAX_BYTES:
        raise _wrong(file, f"is longer than {_MAX_BYTES} bytes")
    try:
        data = parse_toml(raw.decode())
    except ValueError as error:
        raise _wrong(file, f"is not valid TOML: {error}") from error
    tool = data.get("tool")
    return tool.get(_TABLE) if isinstance(tool, dict) else None


def _checked(folder: Path, table: object) -> list[str]:
    file = folder / _FILE
    if not isinstance(table, dict):
        raise _wrong(file, f"tool.{_TABLE}: expected a table, got {table!r:.80}")
    for key in table:
        if key not in _KEYS:
            from rosidl_py_gen.base.names import did_you_mean

            hint = did_you_mean(key, _KEYS)
            raise _wrong(file, f"[tool.{_TABLE}]: unknown key {key!r:.80}{hint or '; expected path'}")
    value = table.get("path", [])
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list) or not all(isinstance(entry, str) and entry for entry in entries):
        raise _wrong(file, f"[tool.{_TABLE}] path: expected a folder or a list of folders, got {value!r:.80}")
    for entry in entries:
        if "\0" in entry or not (folder / entry).is_dir():
            raise _wrong(file, f"[tool.{_TABLE}] path: {entry!r:.200} is not a folder")
    return [display_path(folder / entry) for entry in entries]


def _wrong(file: Path, text: str) -> DefinitionError:
    return DefinitionError(Diagnostic(display_path(file), 0, 0, text))
