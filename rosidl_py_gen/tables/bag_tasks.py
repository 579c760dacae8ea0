"""Tasks that write a dataset, and their execution by Dask: on this machine, or on a scheduler that the caller names.

A task writes one bag, or the messages of a large bag between two log times. A repeated run executes only the missing
tasks. It finds them by existing files: the metadata of each file names its task, and the number of files of the task. A
task is complete if all its files exist. Files get their final names when their contents are complete, and have the same
names in each run, so that a repeated task replaces them. A failure of a task is reported in its result, not as an
exception.

Dask's scheduler "processes" uses an executor of loky, which connects the processes by pipes. A local cluster of
`distributed` would listen on a port of the loopback interface: every user of the machine could send it tasks, that is,
run code. A process runs one task at a time, whose memory is bounded by `StagedDataset`.

Anyone who can connect to a scheduler without TLS can run code on its workers, and in this process, which reads their
results with pickle. Therefore this module starts no scheduler.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sys
import warnings
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from hashlib import sha256
from itertools import pairwise
from multiprocessing.connection import Connection, Pipe
from threading import Thread
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

from rosidl_py_gen.bags import BagError, BagLocation, BagReader, BagWarning, DamagedPart
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.arrow import pa, parquet
from rosidl_py_gen.tables.dataset_writer import BAG, PARTIAL, TOPIC, DatasetFile, StagedDataset, file_system

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from typing import TypeAlias

    TaskFunction: TypeAlias = "Callable[[Task], TaskResult]"
    ResultFunction: TypeAlias = "Callable[[Task, TaskResult], None]"
    TaskRunner: TypeAlias = "Callable[[TaskFunction, list[Task], ResultFunction], None]"

_METADATA_KEY = "rosidl_py_gen.task"
_READERS = 16
"""Number of files whose metadata is read at the same time; a file in an object store takes from 10 to 100 ms."""


@dataclass(frozen=True, slots=True)
class TaskRecord:
    """Identity of the task that wrote a dataset file, which is stored in the metadata of the file.

    Attributes:
        bag: digest of the path or URL of the bag.
        version: version of the bag's files.
        options: digest of the options.
        number, task_count: index of the slice of the bag that the task writes, and number of slices.
        file_count: number of files of the task.
    """

    bag: str
    version: str
    options: str
    number: int = 0
    task_count: int = 1
    file_count: int = 0

    def metadata(self, file_count: int) -> dict[str, str]:
        """Return the Parquet metadata of one of the task's `file_count` files."""
        return {_METADATA_KEY: json.dumps(asdict(replace(self, file_count=file_count)))}

    def may_replace(self, place: str) -> bool:
        """Return True if the file at a place was written by a task for the same bag with the same options."""
        record = _read_record(*file_system(place))
        return record is not None and (record.bag, record.options) == (self.bag, self.options)


def _read_record(system: Any, path: str) -> TaskRecord | None:
    """Return the task that wrote a Parquet file, from the file's metadata.

    Returns None if another program wrote the file, or it cannot be read. Tasks do not replace such files.
    """
    try:
        with system.open(path, "rb") as stream:
            metadata = parquet().read_metadata(stream).metadata or {}
        record = TaskRecord(**json.loads(metadata[_METADATA_KEY.encode()]))
        has_types = all(type(getattr(record, one.name)).__name__ == one.type for one in fields(record))
        return record if has_types else None
    except (OSError, ValueError, TypeError, KeyError, pa.ArrowException):
        return None


@dataclass(frozen=True, slots=True)
class TaskFile:
    """Existing file in a dataset that a task has written; `name` is the name of the bag in the dataset."""

    path: str
    name: str
    record: TaskRecord


def find_task_files(out: str, names: Collection[str]) -> list[TaskFile]:
    """Return the files in a dataset that tasks have written for bags with these names.

    Raises:
        BagError: the place does not respond.
        OSError: the place cannot be read.
    """
    system, root = file_system(out)
    with BagLocation(out).unreachable_as_error():
        system.invalidate_cache()
        found: dict[str, str] = {}
        for path in system.find(root):
            topic, bag, file = (["", "", "", *path.split("/")])[-3:]
            name = unquote(bag.removeprefix(f"{BAG}="))
            if topic.startswith(f"{TOPIC}=") and bag.startswith(f"{BAG}=") and file.endswith(".parquet"):
                found.update({path: name} if name in names else {})
        with ThreadPoolExecutor(_READERS) as threads:
            records = threads.map(partial(_read_record, system), found)
            pairs = zip(found.items(), records, strict=True)
            return [TaskFile(path, name, record) for (path, name), record in pairs if record is not None]


def complete_parts(files: Iterable[TaskFile]) -> set[int]:
    """Return the numbers of a bag's tasks that are complete, which means that all files of the task exist."""
    return {
        record.number for record, count in Counter(one.record for one in files).items() if count == record.file_count
    }


def remove_files(out: str, paths: Iterable[str]) -> None:
    """Remove dataset files with paths from `find_task_files`.

    Raises:
        BagError: the place does not respond.
        OSError: a file cannot be removed.
    """
    with BagLocation(out).unreachable_as_error():
        system = file_system(out)[0]
        for path in paths:
            system.rm(path)


def remove_partial_files(out: str, names: Iterable[str]) -> None:
    """Remove the partial files of bags with these names, which killed processes have left in a dataset."""
    system, root = file_system(out)
    with BagLocation(out).unreachable_as_error():
        folders = {f"{BAG}={quote(name, safe='')}" for name in names}
        for path in system.find(root):
            if path.endswith(PARTIAL) and not folders.isdisjoint(path.split("/")):
                system.rm(path)


# ---------------------------------------------------------------------------------------------------------------- tasks


def digest(values: Any) -> str:
    """Return 12 hexadecimal digits of the hash of a value that JSON can represent."""
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class TaskOptions:
    """Options of `write_datasets` that apply to every bag."""

    topics: tuple[str, ...] | None = None
    include_large: bool = False
    start_offset_s: float = 0.0
    duration_s: float | None = None
    on_error: str = "raise"
    search_path: tuple[str, ...] = ()
    range_bytes: int = 1 << 28
    distro: str | None = None
    """Distribution that the user selected by a command option, which worker processes select as well."""

    @property
    def digest(self) -> str:
        """Short digest of all options, which does not depend on the order of the topics."""
        return digest({**asdict(self), "topics": self.topics and sorted(self.topics)})


@dataclass(frozen=True, slots=True)
class Task:
    """Task to write messages of a bag with ``start_ns <= log_time < end_ns``; None means the selection's start or end.

    Attributes:
        place, name: path or URL of the bag, and its name in the dataset.
        size: approximate stored bytes of the messages.
    """

    place: str
    name: str
    record: TaskRecord
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
        cuts: log times at which a large bag is split into tasks.
        damaged: skipped parts of the bag's files.
    """

    files: tuple[DatasetFile, ...] = ()
    skipped_topics: dict[str, str] = field(default_factory=dict)
    error: str = ""
    warnings: tuple[str, ...] = ()
    cuts: tuple[int, ...] = ()
    damaged: tuple[DamagedPart, ...] = ()


def run_task(task: Task, on_progress: Callable[[float], None] | None = None) -> TaskResult:
    """Write the messages of a task to the dataset; `on_progress` is called with the completed fraction from 0 to 1.

    Errors are in the result.
    """
    return _run(partial(_write, on_progress=on_progress), task)


def split_times_of(task: Task) -> TaskResult:
    """Read a large bag, and return a result with the log times at which its task is split into several tasks."""
    return _run(_find_cuts, task)


def _run(function: Callable[[Task], TaskResult], task: Task) -> TaskResult:
    distro = task.options.distro
    with (
        nullcontext() if distro is None else Distribution.of_command(distro),
        warnings.catch_warnings(record=True) as caught,  # includes warnings of other threads of a worker
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
    return BagReader(task.place, search_path=options.search_path, skip_damaged=options.on_error == "skip")


def _find_cuts(task: Task) -> TaskResult:
    with _open(task) as reader:
        start, end = _span(reader, task.options)
        cuts = reader._cuts(task.options.range_bytes)
    return TaskResult(cuts=tuple(cut for cut in cuts if start < cut < end))


def split_task(task: Task, cuts: tuple[int, ...]) -> list[Task]:
    """Return the tasks that replace a task if its bag is split at the given log times."""
    spans = [*pairwise([None, *cuts, None])]
    records = [replace(task.record, number=number, task_count=len(spans)) for number in range(len(spans))]
    return [
        replace(task, record=record, start_ns=start, end_ns=end, size=task.size // len(spans))
        for record, (start, end) in zip(records, spans, strict=True)
    ]


def _span(reader: BagReader, options: TaskOptions) -> tuple[int, int]:
    """Return the first log time and the exclusive end of the selected messages of a bag.

    Raises `BagError` if the bag ends before the selection begins.
    """
    start, end = reader.start_ns + round(options.start_offset_s * NS_PER_S), reader.end_ns + 1
    if start >= end:
        length = (reader.end_ns - reader.start_ns) / NS_PER_S
        raise BagError(f"{reader.path} is {length:.3f} s long; the selection begins after its end")
    return start, end if options.duration_s is None else min(end, start + round(options.duration_s * NS_PER_S))


def _write(task: Task, on_progress: Callable[[float], None] | None) -> TaskResult:
    record, options = task.record, task.options
    suffix = f"-{record.number:04}" if record.task_count > 1 else ""
    with _open(task) as reader:
        start, end = _span(reader, options)
        start = start if task.start_ns is None else task.start_ns
        end = end if task.end_ns is None else task.end_ns
        topics = None if options.topics is None else [one for one in options.topics if one in reader.topics]
        if options.topics and not topics:
            near = did_you_mean(options.topics[0], reader.topics)
            raise BagError(f"{reader.path} has no topic {options.topics[0]}{near}")
        count = sum(reader.topics[one].count or 0 for one in topics or reader.topics) / record.task_count
        progress = None if on_progress is None else lambda messages: on_progress(min(1.0, messages / max(1, count)))
        overwrite = True if task.overwrite else record.may_replace
        with StagedDataset(
            reader, task.out, task.name, overwrite, suffix=suffix, metadata_of=record.metadata
        ) as dataset:
            dataset.read_bag(topics, options.include_large, start, end, options.on_error, progress)
            dataset.commit()
            report = dataset.report
    return TaskResult(tuple(report.files), report.skipped_topics, damaged=tuple(reader.damaged))


# ------------------------------------------------------------------------------------------------------------ execution


CONNECT_TIMEOUT_S = 10
"""Time in seconds after which a Dask scheduler that does not respond is reported as not reachable."""
_MAX_WINDOWS_PROCESSES = 61
"""Maximum number of processes of a process pool on Windows."""
_PROCESS_ENDED = (
    "the process that read this bag ended unexpectedly, twice; it may lack memory, or a library crashed; the next run "
    "tries again"
)


@contextmanager
def local_processes(workers: int) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks in up to `workers` processes, and passes each result to its callback.

    Raises:
        BagError: this process must not start processes.
        ExtraMissingError: Dask or loky is not installed.
    """
    try:
        import dask  # noqa: F401
        import loky  # noqa: F401
    except ModuleNotFoundError as missing:
        raise Extra.missing_error(missing) or missing from None
    if multiprocessing.current_process().daemon:
        raise BagError(
            f"workers={workers}: this is a daemonic process, such as a worker of multiprocessing.Pool or of Dask, and "
            "must not start processes; use workers=1"
        )
    if sys.platform == "win32":
        workers = min(workers, _MAX_WINDOWS_PROCESSES)
    processes = _LocalProcesses(workers)
    try:
        yield processes.run
    finally:
        processes.close()


class _LocalProcesses:
    """Pool of worker processes on this machine; if one process ends unexpectedly, all are replaced."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: Any = None  # without types
        self._reader, self._writer = Pipe(duplex=False)

    def run(self, function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
        """Run tasks in the processes, and call `on_result` with each result.

        A task fails if its process ends unexpectedly while no other task runs.
        """
        due = {f"task-{number}": task for number, task in enumerate(tasks)}
        while due:
            count = len(due)
            suspects = self._compute(function, due, due.copy(), on_result)
            if len(due) == count:  # the processes do not start, or end before they have done anything
                suspects = due.copy()
            for key, task in suspects.items():  # each alone, to find the task that ends its process
                if self._compute(function, due, {key: task}, on_result):
                    on_result(due.pop(key), TaskResult(error=_PROCESS_ENDED))

    def _compute(
        self, function: TaskFunction, due: dict[str, Task], tasks: dict[str, Task], on_result: ResultFunction
    ) -> dict[str, Task]:
        """Run `tasks`, and remove completed tasks from `due`.

        Returns the tasks that were running when a process crashed.
        """
        import dask
        import loky

        started: list[str] = []

        def start(key: str, *_: Any) -> None:
            started.append(key)

        def finish(key: str, result: TaskResult, *_: Any) -> None:
            on_result(due.pop(key), result)

        # Unlike processes of multiprocessing, processes of loky do not import the main module, which may lack
        # `if __name__ == "__main__":`.
        if self._pool is None:
            self._pool = loky.ProcessPoolExecutor(self._workers, initializer=_start_process, initargs=(self._reader,))
        api: Any = dask  # without types
        run = api.delayed(_run_without_exception, pure=False)
        try:
            api.compute(
                *[run(function, task, dask_key_name=key) for key, task in tasks.items()],
                scheduler="processes",
                pool=self._pool,
                chunksize=1,  # by default six tasks would be one, which only one process could do
                optimize_graph=False,
                # Callbacks of Dask's `Callback` would be called for the tasks of all threads of this process.
                callbacks=[(None, None, start, finish, None)],
            )
        except BrokenProcessPool:
            self._end_pool()
            return {key: tasks[key] for key in started if key in due}
        return {}

    def _end_pool(self) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(kill_workers=True)  # after an interrupt, tasks may still run

    def close(self) -> None:
        """End the worker processes."""
        self._end_pool()
        self._reader.close()
        self._writer.close()


def _run_without_exception(function: TaskFunction, task: Task) -> TaskResult:
    try:
        return function(task)
    except Exception as error:
        return TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")


def _start_process(reader: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it at once, without a traceback
    Thread(target=_end_with_parent, args=(reader,), daemon=True).start()


def _end_with_parent(reader: Connection) -> None:
    # Executors leave their processes waiting if the process that started them is killed. Only that process has the
    # other end of the pipe, and writes nothing.
    with suppress(EOFError, OSError):
        reader.recv_bytes()
    os._exit(1)


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[TaskRunner]:
    """Yield a function that runs tasks on a Dask scheduler's workers, and passes each result to its callback.

    Raises:
        BagError: the scheduler does not respond.
        ExtraMissingError: Dask's package ``distributed`` is not installed.
    """
    try:
        import distributed
    except ModuleNotFoundError as missing:
        raise Extra.missing_error(missing) or missing from None
    try:
        client: Any = distributed.Client(  # type: ignore[no-untyped-call]
            scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False
        )
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise BagError(f"no scheduler of Dask responds at {scheduler}: {error}") from None
    with client:
        yield partial(_run_on_cluster, client)


def _run_on_cluster(client: Any, function: TaskFunction, tasks: list[Task], on_result: ResultFunction) -> None:
    import distributed

    futures = {client.submit(function, task, pure=False): task for task in tasks}
    completed: Any = distributed.as_completed  # without types
    for future, result in completed(futures, loop=client.loop, with_results=True, raise_errors=False):
        if not isinstance(result, TaskResult):  # an exception, possibly with its type and traceback
            error = result[1] if isinstance(result, tuple) else result
            result = TaskResult(error=f"the worker failed: {type(error).__name__}: {error}")
        on_result(futures.pop(future), result)
        future.release()
