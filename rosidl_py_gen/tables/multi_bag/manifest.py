"""Manifest of a dataset: an entry for each finished task, so that another run does only the missing ones.

Content exists if an entry names it and all its files exist. An entry is written before its files are renamed, which
marks them as its own, and again afterwards. Files have the same names in each run, so that a repeated task replaces
incomplete content.

The entries are in ``_manifest``, a folder that readers of datasets ignore, by name of the bag.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.bags.remote import is_url, unreachable_as_error
from rosidl_py_gen.tables.dataset_writer import BAG, DatasetFile
from rosidl_py_gen.tables.output_files import PARTIAL, file_system

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

FOLDER = "_manifest"


@dataclass(frozen=True, slots=True)
class ManifestEntry:
    """Result of a task for a bag.

    Attributes:
        place, name: path or URL of the bag, and its name.
        version: version of its files.
        options: digest of the options.
        number, task_count: index of the part, and number of parts.
        files: files with paths below the dataset.
        is_done: True when the files have their final names.
    """

    place: str
    name: str
    version: str
    options: str
    number: int
    task_count: int
    files: tuple[DatasetFile, ...] = ()
    is_done: bool = False

    @property
    def path(self) -> str:
        """Path of the entry below the dataset."""
        return f"{_folder(self.name)}/{self.options}-{self.version}-{self.number:04}-{self.task_count:04}.json"


def _folder(name: str) -> str:
    return f"{FOLDER}/{BAG}={quote(name, safe='')}"


class DatasetManifest:
    """Entries of a dataset. All methods raise BagError or OSError if the place cannot be read or written."""

    def __init__(self, out: str) -> None:
        self._out = out
        self._system, path = file_system(out)
        self._root = path.rstrip("/")

    def read(self) -> tuple[list[ManifestEntry], set[str]]:
        """Return all entries, and the paths of all files of the dataset."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()
            files = self._find(self._root)
            return self._entries(path for path in files if path.startswith(f"{FOLDER}/")), files

    def _find(self, folder: str) -> set[str]:
        return {path[len(self._root) + 1 :] for path in self._system.find(folder)}

    def _entries(self, paths: Iterable[str]) -> list[ManifestEntry]:
        paths = [f"{self._root}/{path}" for path in paths if path.endswith(".json")]
        contents = self._system.cat(paths, on_error="omit") if paths else {}
        return [entry for entry in map(_parse, contents.values()) if entry is not None]

    def has(self, entry: ManifestEntry) -> bool:
        """Return True if an entry of this task exists, complete or not: its files belong to the task."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()  # another process may have written it since
            return bool(self._system.exists(f"{self._root}/{entry.path}"))

    def begin(self, entry: ManifestEntry) -> None:
        """Write the entry before its files are renamed, and remove entries of other tasks for the same files."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()
            own = {one.path for one in entry.files}
            for other in self._entries(self._find(f"{self._root}/{_folder(entry.name)}") - {entry.path}):
                if not own.isdisjoint(one.path for one in other.files):
                    self._system.rm(f"{self._root}/{other.path}")
        self._write(entry)

    def end(self, entry: ManifestEntry) -> None:
        """Write the entry after its files were renamed."""
        self._write(entry)

    def _write(self, entry: ManifestEntry) -> None:
        with unreachable_as_error(self._out):
            path = f"{self._root}/{entry.path}"
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            text = json.dumps(asdict(entry), indent=1).encode()
            if is_url(self._out):
                self._system.pipe_file(path, text)
            else:
                self._system.pipe_file(path + PARTIAL, text)
                os.replace(path + PARTIAL, path)

    def remove(self, entries: Iterable[ManifestEntry], existing: Collection[str]) -> None:
        """Remove entries and their files, files first."""
        with unreachable_as_error(self._out):
            for entry in entries:
                for path in (*(one.path for one in entry.files), entry.path):
                    if path in existing:
                        self._system.rm(f"{self._root}/{path}")

    def remove_partial(self, names: Iterable[str]) -> None:
        """Remove partial files of bags with these names, left by processes that were killed."""
        with unreachable_as_error(self._out):
            folders = {f"{BAG}={quote(name, safe='')}" for name in names}
            for path in self._system.find(self._root):
                if path.endswith(PARTIAL) and not folders.isdisjoint(path.split("/")):
                    self._system.rm(path)


def _parse(text: bytes) -> ManifestEntry | None:
    """Return None for an entry that is incomplete or invalid, so that its task is repeated."""
    try:
        values: dict[str, Any] = json.loads(text)
        files = tuple(DatasetFile(**one) for one in values.pop("files"))
        return ManifestEntry(**values, files=files)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
