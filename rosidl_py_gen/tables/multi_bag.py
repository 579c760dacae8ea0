"""Conversion of all bags that patterns match to one dataset, in this process, or in several processes by Dask.

Bags whose files exist are skipped, large bags are split into several tasks, and processes are started only for enough
data. A bag that fails does not stop the conversion of other bags.
"""

from __future__ import annotations

import multiprocessing
import os
import warnings
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags import BagError, BagLocation, BagWarning, DamagedPart
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.bag_tasks import (
    Task,
    TaskOptions,
    TaskRecord,
    TaskResult,
    complete_parts,
    dask_cluster,
    digest,
    find_task_files,
    local_processes,
    remove_files,
    remove_partial_files,
    run_task,
    split_task,
    split_times_of,
)
from rosidl_py_gen.tables.dataset_writer import DatasetFile, bag_name, file_system, url_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping
    from contextlib import AbstractContextManager

    from rosidl_py_gen.tables.bag_tasks import ResultFunction, TaskFile, TaskFunction, TaskRunner

_TAG_KEYS = ("ETag", "etag", "md5Hash", "content_md5", "generation", "checksum")
_TIME_KEYS = ("mtime", "LastModified", "last_modified", "updated", "modified", "created")
_WILDCARDS = frozenset("*?[")
RANGE_BYTES = 1 << 28
"""Size in bytes of stored data that one task converts; a larger bag is split into several tasks."""
PROCESSES_BYTES = 1 << 26
"""Minimum stored bytes of all bags for which processes are started."""


@dataclass(frozen=True, slots=True)
class DatasetsReport:
    """Result of `write_datasets`.

    Attributes:
        files: written files, by name of the bag.
        skipped_topics: topics that were not written, or not completely, each with the reason, by name of the bag.
        failed: error of a bag, by its path or URL; some parts of a large bag may have been written.
        unchanged: names of bags all of whose files exist; bags without messages for the dataset have no files.
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
    on_bytes: Callable[[float, int], None] | None = None,
) -> DatasetsReport:
    """Write many bags as one Parquet dataset, each as `write_dataset` does; large bags as several files for each topic.

    Existing files are not written again: another run adds missing bags and replaces changed ones. A bag has changed if
    the size, modification time or tag of one of its files is another.

    Args:
        bags: paths, and URLs of fsspec, which may have ``*``.
        out: a folder, or a URL that all processes can reach.
        topics: topics to write; a bag must have at least one of them.
        include_large: without `topics`, write images and clouds as well.
        start_offset_s: seconds to skip at the start of each bag.
        duration_s: maximum duration of the selection in seconds.
        on_error: ``"skip"`` skips damaged messages, and damaged parts of MCAP files.
        overwrite: write all bags again, and replace existing files.
        scheduler: URL of a Dask scheduler, whose workers have this package: ``tls://10.0.0.1:8786`` with certificates
            that Dask's configuration names. With ``tcp://``, every host that reaches the scheduler or a worker can run
            code on all of them, and in this process. Needs the extra ``cluster``.
        workers: number of processes of this machine; 1 is this process. None: one for each core if there is enough
            data, else 1. The processes open no port, and do not import the main module.
        search_path: folders with the packages of the recordings, as in `BagReader`.
        progress: called with the number of completed tasks, and the number of all tasks.
        on_bytes: called with about the number of stored bytes that are read, and the number of all bytes.

    Raises:
        ValueError: both `scheduler` and `workers` are set.
        BagError: the place is not valid, or the scheduler does not respond.
        OSError: the place cannot be read or written. Errors of a bag are in the report.
    """
    if scheduler is not None and workers is not None:
        raise ValueError("expected either scheduler or workers, as a scheduler has its own workers")
    choice = Distribution.selected()
    options = TaskOptions(
        None if topics is None else tuple(topics),
        include_large,
        start_offset_s,
        duration_s,
        on_error,
        tuple(map(str, search_path)),
        RANGE_BYTES,
        choice.name if choice.is_explicit else None,
    )
    place = str(out) if BagLocation(str(out)).is_url else os.path.abspath(out)
    job = _DatasetJob(place, options, overwrite, progress or _ignore, on_bytes or _ignore)
    sources, missing = find_bags(map(str, bags))
    job.report.failed.update(missing)
    due = job.missing_bags(sources)
    in_memory = [one for one in (place, *(bag.place for bag, _ in due)) if "memory://" in one]
    if in_memory and (scheduler is not None or (workers or 1) > 1):
        raise BagError(f"{in_memory[0]} exists only in this process; expected workers=1 and no scheduler")
    workers = 1 if in_memory else workers
    with select_runner(scheduler, workers, [one.size for one, _ in due]) as run:
        job.run(job.tasks(due, run), run)
    job.clean_up()
    for text in job.warnings:
        warnings.warn(text, BagWarning, stacklevel=2)
    return job.report


def _ignore(done: float, total: int) -> None:
    pass


class _DatasetJob:
    def __init__(
        self,
        out: str,
        options: TaskOptions,
        overwrite: bool,
        progress: Callable[[float, int], None],
        on_bytes: Callable[[float, int], None] = _ignore,
    ) -> None:
        self._out, self._options, self._overwrite = out, options, overwrite
        self._progress, self._on_bytes = progress, on_bytes
        self._name_of: dict[str, str] = {}
        self._due: list[str] = []
        self.report = DatasetsReport()
        self.warnings: list[str] = []

    def missing_bags(self, sources: list[BagSource]) -> list[tuple[BagSource, set[int]]]:
        """Return the bags of which the dataset has no files or not all files, each with the numbers of its complete
        tasks.
        """
        place_of = {digest(one.place): one.place for one in sources}
        files = find_task_files(self._out, possible_names(place_of.values()))
        known = {place_of[one.record.bag]: one.name for one in files if one.record.bag in place_of}
        names = names_of(place_of.values(), known, {one.name for one in files})
        self._name_of = {place: name for name, place in names.items()}
        by_place: dict[str, list[TaskFile]] = {}
        for file in files:
            if file.record.options == self._options.digest and file.record.bag in place_of:
                by_place.setdefault(place_of[file.record.bag], []).append(file)
        due = []
        for one in sources:
            own = by_place.get(one.place, [])
            remove_files(self._out, [file.path for file in own if file.record.version != one.version])
            own = [file for file in own if file.record.version == one.version]
            complete = set() if self._overwrite else complete_parts(own)
            if complete and len(complete) == own[0].record.task_count:
                self.report.unchanged.append(self._name_of[one.place])
                continue
            due.append((one, complete))
            self._due.append(one.place)
        return due

    def tasks(self, due: list[tuple[BagSource, set[int]]], run: TaskRunner) -> list[Task]:
        """Return the tasks for bags that are missing completely or partly.

        The function `run` reads large bags to find out where to split them.
        """
        tasks: list[Task] = []
        large: list[Task] = []
        complete_of = {one.place: complete for one, complete in due}

        def split(task: Task, result: TaskResult) -> None:
            self._add_result(task, result)
            if not result.error:
                parts = split_task(task, result.cuts)
                tasks.extend(one for one in parts if one.record.number not in complete_of[task.place])

        for one, _ in due:
            record = TaskRecord(digest(one.place), one.version, self._options.digest)
            name = self._name_of[one.place]
            task = Task(one.place, name, record, self._out, self._options, self._overwrite, size=one.size)
            (large if one.size > self._options.range_bytes else tasks).append(task)
        run(split_times_of, large, split)
        return tasks

    def run(self, tasks: list[Task], run: TaskRunner) -> None:
        """Run the tasks with the function `run`, and add their results to the report."""
        total, count = len(tasks), 0
        total_bytes, done_bytes, size = sum(task.size for task in tasks), 0, 0

        def show(fraction: float) -> None:
            self._progress(count + fraction, total)
            self._on_bytes(done_bytes + fraction * size, total_bytes)

        def run_here(task: Task) -> TaskResult:
            nonlocal size
            size = task.size
            return run_task(task, on_progress=show)

        def finish(task: Task, result: TaskResult) -> None:
            nonlocal count, done_bytes
            count += 1
            done_bytes += task.size
            self._add_result(task, result)
            show(0)

        show(0)
        run(run_here if run is one_by_one else run_task, tasks, finish)

    def _add_result(self, task: Task, result: TaskResult) -> None:
        report = self.report
        if result.error:
            text = result.error if task.place in result.error else f"{task.place}: {result.error}"
            report.failed.setdefault(task.place, text)
        if result.files:
            report.files.setdefault(task.name, []).extend(result.files)
        if result.skipped_topics:
            report.skipped_topics.setdefault(task.name, {}).update(result.skipped_topics)
        if result.damaged:  # two tasks may read the same chunk
            known = report.damaged.get(task.name, [])
            report.damaged[task.name] = [*dict.fromkeys([*known, *result.damaged])]
        self.warnings += result.warnings

    def clean_up(self) -> None:
        """Complete the report, and remove the partial files that killed processes have left in the dataset."""
        report = self.report
        for files in report.files.values():
            files.sort(key=lambda one: one.path)
        for place in self._due:  # a bag or part without messages for the dataset has no files
            if place not in report.failed and self._name_of[place] not in report.files:
                report.unchanged.append(self._name_of[place])
        if not BagLocation(self._out).is_url:
            remove_partial_files(self._out, self._name_of.values())


def select_runner(scheduler: str | None, workers: int | None, sizes: list[int]) -> AbstractContextManager[TaskRunner]:
    """Return a context manager with the function that runs tasks: in this process, in local processes, or on a Dask
    scheduler.

    `sizes` has the stored bytes of the bags. They decide the number of processes if neither `scheduler` nor `workers`
    is set.
    """
    if scheduler is None and workers is None and multiprocessing.current_process().daemon:
        workers = 1  # daemonic processes must not start processes
    if scheduler is None and workers is None:
        tasks = sum(max(1, -(-size // RANGE_BYTES)) for size in sizes)
        workers = min(os.cpu_count() or 1, tasks) if sum(sizes) >= PROCESSES_BYTES else 1
    if not sizes or (scheduler is None and workers == 1):
        return nullcontext(one_by_one)
    if workers is not None:
        return local_processes(workers)
    assert scheduler is not None
    return dask_cluster(scheduler)


def one_by_one(function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
    for task in tasks:
        on_result(task, function(task))


# -------------------------------------------------------------------------------------------------------------- sources


@dataclass(frozen=True, slots=True)
class BagSource:
    """Bag that is written to a dataset.

    Attributes:
        place: an absolute path, or a URL.
        version: digest of the sizes of its files and their tags or modification times.
    """

    place: str
    size: int
    version: str


def find_bags(bags: Iterable[str]) -> tuple[list[BagSource], dict[str, str]]:
    """Return the bags that match paths and URLs, which may have ``*``, and the errors of those without a bag."""
    sources: dict[str, BagSource] = {}
    failed: dict[str, str] = {}
    for bag in bags:
        try:
            with BagLocation(bag).unreachable_as_error():
                matches = _matches(bag)
        except (RosidlError, OSError) as error:
            failed[bag] = f"{bag}: there is no such bag" if isinstance(error, FileNotFoundError) else str(error)
            continue
        sources.update((one.place, one) for one in matches)
    return list(sources.values()), failed


def _matches(bag: str) -> list[BagSource]:
    place = bag if BagLocation(bag).is_url else os.path.abspath(bag)
    system, path = file_system(place)
    system.invalidate_cache()
    if _WILDCARDS.isdisjoint(path) or system.exists(path):
        return [_source(system, place, system.info(path))]
    matches = system.glob(path, detail=True)
    if not matches:
        raise BagError(f"{bag}: no bag matches")
    return [_source(system, url_of(place, path), info) for path, info in sorted(matches.items())]


def _source(system: Any, place: str, info: Mapping[str, Any]) -> BagSource:
    if info["type"] == "directory":
        files = sorted(system.find(info["name"], detail=True).values(), key=lambda one: str(one["name"]))
        if not files:
            raise BagError(f"{place}: the folder has no files")
    else:
        files = [dict(info)]
    versions = [(PurePath(one["name"]).name, int(one["size"] or 0), _tag_or_time(one)) for one in files]
    return BagSource(place, sum(size for _, size, _ in versions), digest(versions))


def _tag_or_time(info: Mapping[str, Any]) -> str:
    return str(next((info[key] for key in (*_TAG_KEYS, *_TIME_KEYS) if info.get(key)), ""))


def names_of(
    places: Iterable[str], known: Mapping[str, str] | None = None, reserved: Collection[str] = ()
) -> dict[str, str]:
    """Return the place (path or URL) of each bag by a unique name: the name of its file, with parent folders if
    necessary.

    Args:
        known: existing names by place, which stay the same.
        reserved: names that bags without a known name must not get.
    """
    known = known or {}
    places = list(dict.fromkeys(places))
    paths = {place: _path_names(place) for place in (*places, *known)}
    names: dict[str, str] = {}
    reserved = {*reserved, *known.values()}
    for place in places:
        own, length = paths[place], 1
        if place in known:
            names[known[place]] = place
            continue
        while length < len(own) and (
            sum(own[-length:] == other[-length:] for other in paths.values()) > 1 or "/".join(own[-length:]) in reserved
        ):
            length += 1
        name = "/".join(own[-length:])
        names[name if name not in names and name not in reserved else place] = place
    return names


def possible_names(places: Iterable[str]) -> set[str]:
    """Return all names that `names_of` may choose for the bags at these places."""
    names = set(places)
    for place in places:
        own = _path_names(place)
        names.update("/".join(own[-length:]) for length in range(1, len(own) + 1))
    return names


def _path_names(place: str) -> list[str]:
    path = place.partition("://")[2] if BagLocation(place).is_url else os.path.abspath(place)
    return [bag_name(part) for part in PurePath(path).parts if part.strip("/\\")] or ["bag"]
