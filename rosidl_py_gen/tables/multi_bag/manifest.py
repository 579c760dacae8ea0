"""What a dataset has of which bags: an entry for each task, so that another run does only what is missing.

Decides when something is there: an entry says so, and all its files exist. An entry is written before its files get
their names, which says that these are nobody else's, and once more when they have them. Names of files are the same
each time, so whatever was cut off is done once more, and nothing is there twice.

The entries are in ``_manifest``, a name that readers of datasets leave out, by name of the bag.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.bags.remote import is_url, unreachable_as_error
from rosidl_py_gen.tables.dataset import BAG, DatasetFile
from rosidl_py_gen.tables.output_files import PARTIAL, file_system

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

FOLDER = "_manifest"


@dataclass(frozen=True, slots=True)
class ManifestEntry:
    """What was done of a bag.

    Attributes:
        place, name: of the bag.
        version: of its files.
        wish: what was asked for, shortly.
        number, of: which part of how many.
        files: with paths below the dataset.
        is_done: the files have their names.
    """

    place: str
    name: str
    version: str
    wish: str
    number: int
    task_count: int
    files: tuple[DatasetFile, ...] = ()
    is_done: bool = False

    @property
    def path(self) -> str:
        """Of the entry, below the dataset."""
        return f"{_folder(self.name)}/{self.wish}-{self.version}-{self.number:04}-{self.task_count:04}.json"


def _folder(name: str) -> str:
    return f"{FOLDER}/{BAG}={quote(name, safe='')}"


class DatasetManifest:
    """The entries of a dataset.

    Raises:
        BagError: the place is none. OSError: it cannot be read or written. So do all methods.
    """

    def __init__(self, out: str) -> None:
        self._out = out
        self._system, path = file_system(out)
        self._root = path.rstrip("/")

    def read(self) -> tuple[list[ManifestEntry], set[str]]:
        """All entries, and the paths of all files of the dataset."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()
            begin = len(self._root) + 1
            found = {path[begin:] for path in self._system.find(self._root)}
            return self._entries(path for path in found if path.startswith(f"{FOLDER}/")), found

    def _entries(self, paths: Iterable[str]) -> list[ManifestEntry]:
        wanted = [f"{self._root}/{path}" for path in paths if path.endswith(".json")]
        told = self._system.cat(wanted, on_error="omit") if wanted else {}
        return [one for one in map(_parsed, told.values()) if one is not None]

    def has(self, entry: ManifestEntry) -> bool:
        """Whether there is one of this task, be it done or not: the files it names are its own."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()  # another process may have written it since
            return bool(self._system.exists(f"{self._root}/{entry.path}"))

    def begin(self, entry: ManifestEntry) -> None:
        """Its files are about to get their names; others that had files of these names have them no more."""
        with unreachable_as_error(self._out):
            self._system.invalidate_cache()
            mine = {one.path for one in entry.files}
            folder = f"{self._root}/{_folder(entry.name)}"
            paths = [path[len(self._root) + 1 :] for path in self._system.find(folder)]
            for other in self._entries(path for path in paths if path != entry.path):
                if not mine.isdisjoint(one.path for one in other.files):
                    self._system.rm(f"{self._root}/{other.path}")
        self._write(entry)

    def end(self, entry: ManifestEntry) -> None:
        """Its files have their names."""
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
        """Remove what a dataset has of these, the files first."""
        with unreachable_as_error(self._out):
            for entry in entries:
                for path in (*(one.path for one in entry.files), entry.path):
                    if path in existing:
                        self._system.rm(f"{self._root}/{path}")

    def remove_partial(self, names: Iterable[str]) -> None:
        """Remove what processes that were killed have left of bags with these names."""
        with unreachable_as_error(self._out):
            folders = {f"{BAG}={quote(name, safe='')}" for name in names}
            for path in self._system.find(self._root):
                if path.endswith(PARTIAL) and not folders.isdisjoint(path.split("/")):
                    self._system.rm(path)


def _parsed(text: bytes) -> ManifestEntry | None:
    """None for what was cut off while it was written, or is none of ours: that is done once more."""
    try:
        told: dict[str, Any] = json.loads(text)
        files = tuple(DatasetFile(**one) for one in told.pop("files"))
        return ManifestEntry(**told, files=files)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
