"""Many bags as one dataset: what is to be done, done here, by processes of this machine, or by workers of Dask.

Decides what is left as it is, as the manifest says; which bags are large enough for several tasks; and whether there is
enough to do for several processes. A bag that fails stops nothing else.
"""

from __future__ import annotations

import os
import warnings
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.common import BagError, BagWarning, DamagedPart
from rosidl_py_gen.bags.remote import is_url
from rosidl_py_gen.tables.dataset import DatasetFile
from rosidl_py_gen.tables.multi_bag.bag_sources import BagSource, find, names_of
from rosidl_py_gen.tables.multi_bag.bag_tasks import Task, TaskOptions, TaskResult, run_task, split_task, split_times_of
from rosidl_py_gen.tables.multi_bag.manifest import DatasetManifest, ManifestEntry
from rosidl_py_gen.tables.multi_bag.pool import IS_POSIX, running

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from contextlib import AbstractContextManager

    from rosidl_py_gen.tables.multi_bag.bag_tasks import Function, Run

RANGE_BYTES = 1 << 28
"""Stored bytes of a bag that are one task."""
POOL_BYTES = 1 << 26
"""So many bytes are worth starting processes for."""


@dataclass(frozen=True, slots=True)
class DatasetsReport:
    """What `write_datasets` has done.

    Attributes:
        files: those written, by name of the bag.
        left_out: topics that were not written, or not wholly, with the reason, by name of the bag.
        failed: why a bag could not be written, by its path or URL. Of a large one, parts may be there.
        unchanged: names of bags that the dataset had already.
        damaged: parts of MCAP files that were skipped with ``on_error="skip"``, by name of the bag.
    """

    files: dict[str, list[DatasetFile]] = field(default_factory=dict)
    skipped_topics: dict[str, dict[str, str]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    unchanged: list[str] = field(default_factory=list)
    damaged: dict[str, list[DamagedPart]] = field(default_factory=dict)


def write_datasets(
    bags: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    topics: Collection[str] | None = None,
    include_large: bool = False,
    start_offset_s: float = 0.0,
    duration_s: float | None = None,
    on_error: str = "raise",
    overwrite: bool = False,
    scheduler: str | None = None,
    workers: int | None = None,
    search_path: Iterable[str] = (),
    progress: Callable[[float, int], None] | None = None,
) -> DatasetsReport:
    """Write many bags as one Parquet dataset, each as `write_dataset` does; large ones as several files for each topic.

    What the dataset has already is left as it is: another run does what is missing, and what has changed.

    Args:
        bags: paths, and URLs of fsspec, which may have ``*``.
        out: a folder, or a URL; of all processes.
        topics: those to write; a bag has to have one of them.
        start_offset_s: seconds that are left out at the beginning of each bag.
        duration_s: only so long.
        on_error: ``"skip"`` leaves damaged messages out, and damaged parts of MCAP files.
        overwrite: do all of it once more, and replace files that are there.
        scheduler: URL of a Dask scheduler, whose workers have this package: ``tls://10.0.0.1:8786`` with certificates
            that Dask's configuration names. With ``tcp://`` everybody who reaches the scheduler or a worker can run
            code on all of them, and in this process. Needs the extra ``cluster``.
        workers: number of processes of this machine; 1 is this one. None: one for each core if there is enough to do,
            else 1. The processes open no port, and need POSIX.
        search_path: folders with the packages of the recordings, as of `BagReader`.
        progress: called with the number of tasks done, and of all.

    Raises:
        ValueError: both `scheduler` and `workers`. BagError: the place is none, no scheduler answers, or several
            `workers` without POSIX. OSError: the place cannot be read or written. What is wrong with a bag is in the
            report.
    """
    if scheduler is not None and workers is not None:
        raise ValueError("a scheduler has its own workers: expected one of scheduler and workers")
    wish = TaskOptions(
        None if topics is None else tuple(topics),
        include_large,
        start_offset_s,
        duration_s,
        on_error,
        tuple(map(str, search_path)),
        RANGE_BYTES,
    )
    place = str(out) if is_url(str(out)) else os.path.abspath(out)
    job = _DatasetJob(place, wish, overwrite, progress or (lambda done, all_: None))
    found, missing = find(map(str, bags))
    job.report.failed.update(missing)
    due = job.missing_bags(found)
    own = [one for one in (place, *(bag.place for bag, _ in due)) if "memory://" in one]
    if own and (scheduler is not None or (workers or 1) > 1):
        raise BagError(
            f"{own[0]}: other processes do not have the memory of this one; expected workers=1, no scheduler"
        )
    workers = 1 if own else workers
    with _runner(scheduler, workers, [one.size for one, _ in due]) as run:
        job.do(job.tasks(due, run), run)
    job.clean_up()
    return job.report


class _DatasetJob:
    def __init__(self, out: str, wish: TaskOptions, overwrite: bool, progress: Callable[[float, int], None]) -> None:
        self._out, self._wish, self._overwrite, self._progress = out, wish, overwrite, progress
        self._manifest = DatasetManifest(out)
        self._name_of: dict[str, str] = {}
        self._existing: set[str] = set()
        self.report = DatasetsReport()

    def missing_bags(self, found: list[BagSource]) -> list[tuple[BagSource, list[ManifestEntry]]]:
        """Bags that the dataset does not have, with the entries of parts that it has."""
        entries, self._existing = self._manifest.read()
        names = names_of((one.place for one in found), {one.place: one.name for one in entries})
        self._name_of = {place: name for name, place in names.items()}
        mine: dict[str, list[ManifestEntry]] = {}
        for entry in entries:
            if entry.wish == self._wish.short:
                mine.setdefault(entry.place, []).append(entry)
        due = []
        for one in found:
            known = mine.get(one.place, [])
            self._manifest.remove([entry for entry in known if entry.version != one.version], self._existing)
            done = [entry for entry in known if entry.version == one.version and self._is_there(entry)]
            if not self._overwrite and done and {entry.number for entry in done} == set(range(done[0].task_count)):
                self.report.unchanged.append(self._name_of[one.place])
                continue
            due.append((one, [] if self._overwrite else done))
        return due

    def _is_there(self, entry: ManifestEntry) -> bool:
        return entry.is_done and all(one.path in self._existing for one in entry.files)

    def tasks(self, due: list[tuple[BagSource, list[ManifestEntry]]], run: Run) -> list[Task]:
        """What has to be done; large bags are looked into for that."""
        made: list[Task] = []
        large: dict[str, tuple[Task, set[int]]] = {}
        for one, done in due:
            entry = ManifestEntry(one.place, self._name_of[one.place], one.version, self._wish.short, 0, 1)
            task = Task(entry, self._out, self._wish, self._overwrite)
            if one.size > self._wish.range_bytes:
                large[one.place] = task, {part.number for part in done}
            else:
                made.append(task)
        for task, outcome in run(split_times_of, [task for task, _ in large.values()]):
            self._tell(task, outcome)
            if not outcome.error:
                parts = split_task(task, outcome.cuts)
                made += [one for one in parts if one.entry.number not in large[task.entry.place][1]]
        return made

    def do(self, tasks: list[Task], run: Run) -> None:
        """Do the tasks, and keep what came of them."""
        count, self._done = len(tasks), 0
        self._progress(0, count)
        here = partial(run_task, on_progress=lambda part: self._progress(self._done + part, count))
        for task, outcome in run(here if run is one_by_one else run_task, tasks):
            self._done += 1
            self._tell(task, outcome)
            self._progress(self._done, count)

    def _tell(self, task: Task, outcome: TaskResult) -> None:
        entry, report = task.entry, self.report
        if outcome.error:
            told = outcome.error if entry.place in outcome.error else f"{entry.place}: {outcome.error}"
            report.failed.setdefault(entry.place, told)
        if outcome.files:
            report.files.setdefault(entry.name, []).extend(outcome.files)
        if outcome.skipped_topics:
            report.skipped_topics.setdefault(entry.name, {}).update(outcome.skipped_topics)
        if outcome.damaged:  # two tasks may have read a chunk
            known = report.damaged.get(entry.name, [])
            report.damaged[entry.name] = [*dict.fromkeys([*known, *outcome.damaged])]
        for text in outcome.warnings:
            warnings.warn(text, BagWarning, stacklevel=4)

    def clean_up(self) -> None:
        """Put files in order, and remove what is left of processes that were killed."""
        for files in self.report.files.values():
            files.sort(key=lambda one: one.path)
        if not is_url(self._out):
            self._manifest.remove_partial(self._name_of.values())


def _runner(scheduler: str | None, workers: int | None, sizes: list[int]) -> AbstractContextManager[Run]:
    """Return the function that runs tasks: in this process, in others of this machine, or in workers of Dask."""
    if scheduler is None and workers is None:
        parts = sum(max(1, -(-size // RANGE_BYTES)) for size in sizes)
        workers = min(os.cpu_count() or 1, parts) if sum(sizes) >= POOL_BYTES and IS_POSIX else 1
    if not sizes or (scheduler is None and workers == 1):
        return nullcontext(one_by_one)
    if workers is not None:
        return running(workers)
    from rosidl_py_gen.tables.multi_bag import dask_cluster

    assert scheduler is not None
    return dask_cluster.running(scheduler)


def one_by_one(function: Function, tasks: list[Task]) -> Iterator[tuple[Task, TaskResult]]:
    for task in tasks:
        yield task, function(task)
