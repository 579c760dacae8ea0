"""One task of many: a bag, or a part of a large one between two log times, so that each message is in one task.

Decides how it is done wherever it is done: all files are written, and then get their names, as `manifest` says. What
fails is an answer, not an exception.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.common import BagError, BagWarning, DamagedPart
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.dataset import DatasetFile, StagedDataset
from rosidl_py_gen.tables.multi_bag.bag_sources import digest
from rosidl_py_gen.tables.multi_bag.manifest import DatasetManifest, ManifestEntry
from rosidl_py_gen.tables.output_files import joined

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import TypeAlias

    Within = Callable[[float], None]
    Function: TypeAlias = "Callable[..., TaskResult]"
    Run: TypeAlias = "Callable[[Function, list[Task]], Iterator[tuple[Task, TaskResult]]]"


@dataclass(frozen=True, slots=True)
class TaskOptions:
    """What is asked of each bag; as of `write_datasets`."""

    topics: tuple[str, ...] | None = None
    include_large: bool = False
    start_offset_s: float = 0.0
    duration_s: float | None = None
    on_error: str = "raise"
    search_path: tuple[str, ...] = ()
    range_bytes: int = 1 << 28

    @property
    def short(self) -> str:
        """A name for it."""
        told = asdict(self)
        return digest({**told, "topics": self.topics and sorted(self.topics)})


@dataclass(frozen=True, slots=True)
class Task:
    """Messages of a bag with ``start_ns <= log_time < end_ns``; None where the bag, or what is asked of it, ends."""

    entry: ManifestEntry
    out: str
    wish: TaskOptions
    overwrite: bool
    start_ns: int | None = None
    end_ns: int | None = None


@dataclass(frozen=True, slots=True)
class TaskResult:
    """What came of a task.

    Attributes:
        error: why it could not be done, or nothing.
        warnings: what its reader warned of.
        damaged: parts of the bag's files that were skipped.
    """

    files: tuple[DatasetFile, ...] = ()
    skipped_topics: dict[str, str] = field(default_factory=dict)
    error: str = ""
    warnings: tuple[str, ...] = ()
    cuts: tuple[int, ...] = ()
    damaged: tuple[DamagedPart, ...] = ()


def run_task(task: Task, on_progress: Within | None = None) -> TaskResult:
    """Do a task, wherever this is called; `on_progress` is told how much of it is done, from 0 to 1."""
    return _answered(partial(_write, on_progress=on_progress), task)


def split_times_of(task: Task) -> TaskResult:
    """Where a large bag is cut into parts."""
    return _answered(_cut, task)


def _answered(function: Callable[[Task], TaskResult], task: Task) -> TaskResult:
    with warnings.catch_warnings(record=True) as caught:  # of all threads, where a worker has several
        warnings.simplefilter("always", BagWarning)
        try:
            made = function(task)
        except (RosidlError, OSError) as error:
            made = TaskResult(error=str(error))
        except Exception as error:  # of ours, or of a library: other bags shall be done all the same
            made = TaskResult(error=f"{type(error).__name__}: {error}")
    texts = (str(one.message) for one in caught if issubclass(one.category, BagWarning))
    return replace(made, warnings=tuple(dict.fromkeys(texts)))


def _opened(task: Task) -> BagReader:
    wish = task.wish
    return BagReader(task.entry.place, search_path=wish.search_path, skip_damaged=wish.on_error == "skip")


def _cut(task: Task) -> TaskResult:
    with _opened(task) as reader:
        start, end = _span(reader, task.wish)
        cuts = reader._cuts(task.wish.range_bytes)
    return TaskResult(cuts=tuple(cut for cut in cuts if start < cut < end))


def split_task(task: Task, cuts: tuple[int, ...]) -> list[Task]:
    """A task as several, each up to a cut."""
    bounds = [None, *cuts, None]
    return [
        replace(
            task,
            entry=replace(task.entry, number=number, task_count=len(cuts) + 1),
            start_ns=bounds[number],
            end_ns=bounds[number + 1],
        )
        for number in range(len(cuts) + 1)
    ]


def _span(reader: BagReader, wish: TaskOptions) -> tuple[int, int]:
    """Log times of what is asked for. Raises `BagError`: the bag ends before."""
    start, behind = reader.start_ns + round(wish.start_offset_s * NS_PER_S), reader.end_ns + 1
    if start >= behind:
        length = (reader.end_ns - reader.start_ns) / NS_PER_S
        raise BagError(f"{reader.path} is {length:.3f} s long; nothing is left of it")
    return start, behind if wish.duration_s is None else min(behind, start + round(wish.duration_s * NS_PER_S))


def _write(task: Task, on_progress: Within | None) -> TaskResult:
    entry, wish = task.entry, task.wish
    manifest = DatasetManifest(task.out)
    suffix = f"-{entry.number:04}" if entry.task_count > 1 else ""
    with _opened(task) as reader:
        start, end = _span(reader, wish)
        start = start if task.start_ns is None else task.start_ns
        end = end if task.end_ns is None else task.end_ns
        topics = None if wish.topics is None else [one for one in wish.topics if one in reader.topics]
        if wish.topics and not topics:
            near = did_you_mean(wish.topics[0], reader.topics)
            raise BagError(f"{reader.path} has no topic {wish.topics[0]}{near}")
        may_replace = task.overwrite or manifest.has(entry)
        count = sum(reader.topics[one].count or 0 for one in topics or reader.topics)
        progress = None if on_progress is None else lambda done: on_progress(min(1.0, done / max(1, count)))
        with StagedDataset(reader, task.out, entry.name, may_replace, suffix=suffix) as draft:
            draft.read_bag(topics, wish.include_large, start, end, wish.on_error, progress)
            report = draft.report
            below = len(joined(task.out, ""))
            files = tuple(replace(one, path=one.path[below:].replace(os.sep, "/")) for one in report.files)
            manifest.begin(replace(entry, files=files))
            draft.publish()
            manifest.end(replace(entry, files=files, is_done=True))
    return TaskResult(tuple(report.files), report.skipped_topics, damaged=tuple(reader.damaged))
