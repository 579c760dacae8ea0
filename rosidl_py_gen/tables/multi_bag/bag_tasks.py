"""Task of a dataset: a bag, or a part of a large one between two log times, so that each message is in one task.

The manifest has an entry for each finished task, so that another run does only the missing ones. Content exists if an
entry names it and all its files exist. An entry is written before its files are renamed, which marks them as its own,
and again afterwards. Files have the same names in each run, so that a repeated task replaces incomplete content. The
entries are in ``_manifest``, a folder that readers of datasets ignore, by name of the bag.

A failure of a task is a result, not an exception.
"""

from __future__ import annotations

import json
import os
import warnings
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import pairwise
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.common import BagError, BagWarning, DamagedPart
from rosidl_py_gen.bags.remote import is_url, unreachable_as_error
from rosidl_py_gen.base.distributions import distribution_of_command
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.dataset_writer import BAG, DatasetFile, StagedDataset
from rosidl_py_gen.tables.output_files import PARTIAL, file_system, joined

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from typing import TypeAlias

    TaskFunction: TypeAlias = "Callable[..., TaskResult]"
    TaskRunner: TypeAlias = "Callable[[TaskFunction, list[Task]], Iterator[tuple[Task, TaskResult]]]"

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
    def folder(self) -> str:
        """Folder of the entries of the bag, below the dataset."""
        return f"{FOLDER}/{BAG}={quote(self.name, safe='')}"

    @property
    def path(self) -> str:
        """Path of the entry below the dataset."""
        return f"{self.folder}/{self.options}-{self.version}-{self.number:04}-{self.task_count:04}.json"


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
            for other in self._entries(self._find(f"{self._root}/{entry.folder}") - {entry.path}):
                if not own.isdisjoint(one.path for one in other.files):
                    self._system.rm(f"{self._root}/{other.path}")
        self.write(entry)

    def write(self, entry: ManifestEntry) -> None:
        """Write the entry."""
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


# ---------------------------------------------------------------------------------------------------------------- tasks


def digest(values: Any) -> str:
    """Return a short digest of values of JSON."""
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class TaskOptions:
    """Options that apply to every bag; see `write_datasets`."""

    topics: tuple[str, ...] | None = None
    include_large: bool = False
    start_offset_s: float = 0.0
    duration_s: float | None = None
    on_error: str = "raise"
    search_path: tuple[str, ...] = ()
    range_bytes: int = 1 << 28
    distro: str | None = None
    """Distribution that the command selects, for its worker processes."""

    @property
    def digest(self) -> str:
        """Short digest of the options, the same for any order of the topics."""
        return digest({**asdict(self), "topics": self.topics and sorted(self.topics)})


@dataclass(frozen=True, slots=True)
class Task:
    """Messages of a bag with ``start_ns <= log_time < end_ns``; None is the start or end of the selection.

    Attributes:
        size: about the stored bytes of the messages.
    """

    entry: ManifestEntry
    out: str
    options: TaskOptions
    overwrite: bool
    start_ns: int | None = None
    end_ns: int | None = None
    size: int = 0


@dataclass(frozen=True, slots=True)
class TaskResult:
    """Result of a task.

    Attributes:
        error: reason of a failure, or an empty text.
        warnings: warnings of the reader.
        cuts: log times at which a large bag is split.
        damaged: skipped parts of the bag's files.
    """

    files: tuple[DatasetFile, ...] = ()
    skipped_topics: dict[str, str] = field(default_factory=dict)
    error: str = ""
    warnings: tuple[str, ...] = ()
    cuts: tuple[int, ...] = ()
    damaged: tuple[DamagedPart, ...] = ()


def run_task(task: Task, on_progress: Callable[[float], None] | None = None) -> TaskResult:
    """Run a task; `on_progress` is called with its completed fraction, from 0 to 1."""
    return _run(partial(_write, on_progress=on_progress), task)


def split_times_of(task: Task) -> TaskResult:
    """Return the log times at which a large bag is split."""
    return _run(_find_cuts, task)


def _run(function: Callable[[Task], TaskResult], task: Task) -> TaskResult:
    distro = task.options.distro
    with (
        nullcontext() if distro is None else distribution_of_command(distro),
        warnings.catch_warnings(record=True) as caught,  # includes those of other threads of a worker
    ):
        warnings.simplefilter("always", BagWarning)
        try:
            result = function(task)
        except (RosidlError, OSError) as error:
            result = TaskResult(error=str(error))
        except Exception as error:  # a bug must not stop the other bags
            result = TaskResult(error=f"{type(error).__name__}: {error}")
    texts = (str(one.message) for one in caught if issubclass(one.category, BagWarning))
    return replace(result, warnings=tuple(dict.fromkeys(texts)))


def _open(task: Task) -> BagReader:
    options = task.options
    return BagReader(task.entry.place, search_path=options.search_path, skip_damaged=options.on_error == "skip")


def _find_cuts(task: Task) -> TaskResult:
    with _open(task) as reader:
        start, end = _span(reader, task.options)
        cuts = reader._cuts(task.options.range_bytes)
    return TaskResult(cuts=tuple(cut for cut in cuts if start < cut < end))


def split_task(task: Task, cuts: tuple[int, ...]) -> list[Task]:
    """Return the parts of a task between the cuts."""
    spans = [*pairwise([None, *cuts, None])]
    entries = [replace(task.entry, number=number, task_count=len(spans)) for number in range(len(spans))]
    return [
        replace(task, entry=entry, start_ns=start, end_ns=end, size=task.size // len(spans))
        for entry, (start, end) in zip(entries, spans, strict=True)
    ]


def _span(reader: BagReader, options: TaskOptions) -> tuple[int, int]:
    """Return the log times of the selection; raises `BagError` if the bag ends before it."""
    start, end = reader.start_ns + round(options.start_offset_s * NS_PER_S), reader.end_ns + 1
    if start >= end:
        length = (reader.end_ns - reader.start_ns) / NS_PER_S
        raise BagError(f"{reader.path} is {length:.3f} s long; the selection begins after its end")
    return start, end if options.duration_s is None else min(end, start + round(options.duration_s * NS_PER_S))


def _write(task: Task, on_progress: Callable[[float], None] | None) -> TaskResult:
    entry, options = task.entry, task.options
    manifest = DatasetManifest(task.out)
    suffix = f"-{entry.number:04}" if entry.task_count > 1 else ""
    with _open(task) as reader:
        start, end = _span(reader, options)
        start = start if task.start_ns is None else task.start_ns
        end = end if task.end_ns is None else task.end_ns
        topics = None if options.topics is None else [one for one in options.topics if one in reader.topics]
        if options.topics and not topics:
            near = did_you_mean(options.topics[0], reader.topics)
            raise BagError(f"{reader.path} has no topic {options.topics[0]}{near}")
        may_replace = task.overwrite or manifest.has(entry)
        count = sum(reader.topics[one].count or 0 for one in topics or reader.topics) / entry.task_count
        progress = None if on_progress is None else lambda messages: on_progress(min(1.0, messages / max(1, count)))
        with StagedDataset(reader, task.out, entry.name, may_replace, suffix=suffix) as dataset:
            dataset.read_bag(topics, options.include_large, start, end, options.on_error, progress)
            report = dataset.report
            prefix = len(joined(task.out, ""))
            files = tuple(replace(one, path=one.path[prefix:].replace(os.sep, "/")) for one in report.files)
            manifest.begin(replace(entry, files=files))
            dataset.commit()
            manifest.write(replace(entry, files=files, is_done=True))
    return TaskResult(tuple(report.files), report.skipped_topics, damaged=tuple(reader.damaged))
