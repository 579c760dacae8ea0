"""Repair of bags: folders that lost ``metadata.yaml``, and files whose recorder was killed.

A file is rewritten if it has no index, damaged parts or a journal. The complete new file is on the disk before it
replaces the old one, which stays in the folder with the ending ``.unindexed``. So a full disk, an error or a power cut
loses nothing, and the repair can be repeated.
"""

from __future__ import annotations

import re
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

from rosidl_py_gen.bags.common import BagError, sync_file, sync_folder
from rosidl_py_gen.bags.copying import BagCopy, RecordingData, listed_topics, with_listed_values
from rosidl_py_gen.bags.definition_lookup import has_definition
from rosidl_py_gen.bags.mcap_writer import BagWriter
from rosidl_py_gen.bags.metadata import FILE, FileStatistics, metadata_text, read_metadata, write_metadata
from rosidl_py_gen.bags.reader import (
    BagReader,
    find_all_channels,
    messages_as_stored,
    set_stated_metadata,
    stored_files,
)
from rosidl_py_gen.bags.splitting_writer import compress_file
from rosidl_py_gen.bags.storage.bag_files import SUFFIX, bag_files, compression_of
from rosidl_py_gen.bags.storage.sqlite_file import JOURNALS, SqliteFile
from rosidl_py_gen.bags.storage.storage_api import ReadingProgress, topics_by_name
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rosidl_py_gen.bags.common import BagTopic, DamagedPart, RawMessage
    from rosidl_py_gen.bags.metadata import BagMetadata

T = TypeVar("T")
UNINDEXED = ".unindexed"
"""Ending of the name of an old bag file whose repaired form has taken its name."""
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
_WORDS = {"": "not compressed", "file": "compressed", "message": "of compressed messages"}
_MAX_SEARCHED_BYTES = 1 << 26
_NUMBER = re.compile(r"(\d+)(?=\.)")
_CUSTOM_DATA = re.compile(rb"custom_data:[ \t]*(?!~|null|\{\}|\r?\n[ \t]*ros_distro|\r?\n?\Z)")


class RepairedFile(NamedTuple):
    """Bag file that was rewritten, and the renamed old file in `backup`."""

    path: Path
    backup: Path


class Reindexed(NamedTuple):
    """Result of a bag's repair.

    Attributes:
        path: the file that was written: the repaired file, or ``metadata.yaml`` of a folder.
        files: number of files of the bag.
        messages: number of messages of the bag.
        topics: number of topics of the bag.
        unindexed_files: names of files that had no index.
        repaired: files that were rewritten.
        damaged: parts of the files that were skipped.
        unread_bytes: size of unfinished records at the end of files.
        omitted: number of things that the repaired files cannot store, by kind.
    """

    path: Path
    files: int
    messages: int
    topics: int
    unindexed_files: tuple[str, ...]
    repaired: tuple[RepairedFile, ...]
    damaged: tuple[DamagedPart, ...]
    unread_bytes: int
    omitted: Counter[str]


OnProgress: TypeAlias = "Callable[[int, int], object]"
"""Callback for the progress of a repair, which receives the number of bytes read so far and the number of all bytes."""
_MESSAGES_PER_REPORT = 64


def _open(file: Path, progress: ReadingProgress, size: int) -> BagReader:
    """Open a bag file for repair and read all of its channels.

    A file without index is read twice, so opening reports the first half of the progress.
    """
    reader = BagReader(
        file, skip_damaged=True, on_progress=lambda done, total: progress.show(size * done // (2 * max(1, total)))
    )
    find_all_channels(reader)
    return reader


def _messages(reader: BagReader, progress: ReadingProgress, end: int) -> Iterator[RawMessage]:
    """Yield all messages of an open bag file as they are stored, and report progress in bytes up to `end` to the
    callback.
    """
    return _with_progress(messages_as_stored(reader), reader, progress, end)


def _with_progress(messages: Iterable[T], reader: BagReader, progress: ReadingProgress, end: int) -> Iterator[T]:
    start, total = None, max(1, sum(channel.count or 0 for channel in reader.channels))
    for count, message in enumerate(messages):
        if start is None:  # before the first message, ranges outside of the index are read, which is progress too
            start = progress.position
        if not count % _MESSAGES_PER_REPORT:
            progress.show(min(start + (end - start) * count // total, end))
        yield message


class _Repairs:
    """Set of repaired bag files, which replace the old files when all repaired files are complete.

    Use it with ``with``.
    """

    def __init__(self) -> None:
        self._resources = ExitStack()
        self._written: list[tuple[Path, Path]] = []
        self.omitted: Counter[str] = Counter()

    def __enter__(self) -> _Repairs:
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def add(
        self, file: Path, reader: BagReader, messages: Callable[[], Iterator[RawMessage]], counted: FileStatistics
    ) -> None:
        """Write the repaired form of a bag file next to it, and count its messages in `counted`.

        Raises:
            BagError: the name for the old file exists already.
            OSError: the file cannot be written.
        """
        backup = _backup_of(file)
        if backup.exists():
            raise BagError(f"{backup} exists already; remove it, as {file} is renamed to it")
        plain = file.with_name(f".{file.name.removesuffix(SUFFIX)}")
        partial = file.with_name(f".{file.name}")
        for path in (plain, partial):
            self._resources.callback(path.unlink, missing_ok=True)
            path.unlink(missing_ok=True)  # of a run that was killed
        (storage,) = stored_files(reader)
        if file.suffix == ".db3":  # a compressed file has no journal
            with closing(SqliteFile(file)) as database:
                database.copy_to(plain)
            for message in messages():
                counted.add(message.channel.name, message.log_time)
        else:
            with BagWriter(plain, compression=storage.chunk_compression()) as writer:
                writer._statistics[-1].path = file.name.removesuffix(SUFFIX)
                copy = BagCopy([reader], writer)
                (targets,) = copy.begin([{channel.key: channel for channel in reader.channels}])
                numbers: dict[int, tuple[BagTopic, BagTopic]] = {}
                for message in messages():
                    known = numbers.get(id(message.channel))
                    if known is None:  # the tuple retains the identity
                        known = numbers[id(message.channel)] = message.channel, targets[message.channel.channel_key]
                    writer.write_raw(message, known[1])
                    counted.add(message.channel.name, message.log_time)
                copy.end()
            self.omitted += copy.omitted - copy.recording.omitted
        if partial != plain:
            compress_file(plain)
        sync_file(partial)
        self._written.append((partial, file))

    def replace_files(self) -> tuple[RepairedFile, ...]:
        """Rename the old bag files to names that end with ``.unindexed``, and move the repaired files to
        the old names.
        """
        return tuple(_replace_file(partial, file) for partial, file in self._written)


def _backup_of(file: Path) -> Path:
    return file.with_name(file.name + UNINDEXED)


def _replace_file(partial: Path, file: Path) -> RepairedFile:
    """Replace the bag file `file` by the repaired file `partial`, and return the new names of both files.

    The old file gets the ending ``.unindexed``. At any moment the original name leads to the old or to the repaired
    file.
    """
    backup = _backup_of(file)
    file = file.resolve()
    try:
        backup.hardlink_to(file)
    except (OSError, NotImplementedError):  # the file system has no hard links
        file.rename(backup)
        try:
            partial.replace(file)
        except OSError:
            backup.rename(file)
            raise
    else:
        partial.replace(file)
    # A journal of the old file changes nothing in the new one, so it may stay until now.
    for end in (*JOURNALS, "-shm"):
        journal = file.with_name(file.name + end)
        if file.suffix == ".db3" and journal.exists():
            journal.replace(backup.with_name(backup.name + end))
    sync_folder(file.parent)
    return RepairedFile(file, backup)


class _Survey:
    """Check of the files of one bag, one file after the other, which also repairs files that need it."""

    def __init__(self, progress: ReadingProgress, repairs: _Repairs) -> None:
        self._progress, self._repairs = progress, repairs
        self.statistics: list[FileStatistics] = []
        self.channels: list[BagTopic] = []
        self.damaged: list[DamagedPart] = []
        self.unindexed: list[str] = []
        self.unread_bytes = 0

    def add(self, reader: BagReader, file: Path, size: int, needs_repair: bool) -> bool:
        """Read all of a bag file and count its messages; return True if the file was repaired."""
        if needs_repair:
            self._write(reader, file, size)
        else:
            counted = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
            (storage,) = stored_files(reader)
            stored = _with_progress(storage.stored_messages(), reader, self._progress, size)
            for channel, _, log_time, _, _ in stored:  # all: some may be damaged
                counted.add(channel.topic, log_time)
            for _ in storage.attachments():
                pass
            for _ in storage.metadata_records():
                pass
            needs_repair = bool(reader.damaged)
            if needs_repair:
                self._write(reader, file, size)
            else:
                self.statistics.append(counted)
        self.damaged += reader.damaged
        self.channels += (_with_hash(reader, channel) for channel in reader.channels)
        self.unread_bytes += reader.unread_bytes
        if not reader.has_index:
            self.unindexed.append(file.name)
        self._progress.end_file(size)
        return needs_repair

    def _write(self, reader: BagReader, file: Path, size: int) -> None:
        counted = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
        self._repairs.add(file, reader, lambda: _messages(reader, self._progress, size), counted)
        self.statistics.append(counted)

    @property
    def messages(self) -> int:
        """Number of messages of all files that were checked."""
        return sum(file.total for file in self.statistics)


def _needs_repair(reader: BagReader) -> bool:
    return not reader.has_index or any(file.has_journal for file in stored_files(reader))


def reindex_folder(folder: Path, on_progress: OnProgress | None = None) -> Reindexed:
    """Write ``metadata.yaml`` for the bag files in a folder, in the order of the numbers in their names.

    Files without an index, with damaged parts or with a journal are rewritten; the old file gets the ending
    ``.unindexed``.

    Raises:
        BagError: the folder has no bag files, files of several storages or compressions, or one that is damaged beyond
            reading; nothing is changed then.
        OSError: a file cannot be read or written.
    """
    files = sorted(bag_files(folder), key=_file_number)
    storage = _single_kind(folder, {_STORAGES[Path(file.name.removesuffix(SUFFIX)).suffix] for file in files})
    kinds = {file: kind for file in files if (kind := compression_of(file)) is not None}
    if len(files) > 1 and [kinds.get(file, "") for file in files] == ["file"] * (len(files) - 1) + [""]:
        files[-1] = compress_file(files[-1])  # the recorder was killed before it did
        kinds = dict.fromkeys(files, "file")
    compression = _single_kind(folder, {*kinds.values()} or {""})
    previous, omitted = _previous_metadata(folder)
    recording = RecordingData()
    progress = ReadingProgress(on_progress)
    progress.total = sum(file.stat().st_size for file in files)
    with _Repairs() as repairs:
        survey = _Survey(progress, repairs)
        for file in files:
            size = file.stat().st_size
            with _open(file, progress, size) as reader:
                set_stated_metadata(reader, previous)  # what the file itself does not state
                survey.add(reader, file, size, _needs_repair(reader))
                recording.add_file(*stored_files(reader))
        recording.add_metadata(previous)
        topics = topics_by_name(with_listed_values(previous, channel) for channel in survey.channels)
        if previous is not None:
            omitted["listed_topics"] += len(listed_topics(previous) - topics.keys())
        text = metadata_text(
            storage,
            survey.statistics,
            topics.values(),
            compression_mode=compression,
            custom_data=recording.custom_data,
            ros_distro=recording.ros_distro,
        )
        repaired = repairs.replace_files()
        write_metadata(folder, text)
    return Reindexed(
        folder / FILE,
        len(files),
        survey.messages,
        len(topics),
        tuple(survey.unindexed),
        repaired,
        tuple(survey.damaged),
        survey.unread_bytes,
        omitted + recording.omitted + repairs.omitted,
    )


def reindex_file(file: Path, on_progress: OnProgress | None = None) -> Reindexed:
    """Rewrite a bag file that has no index, damaged parts or a journal; rename the old one to ``FILE.unindexed``.

    Raises:
        BagError: the file needs no repair, or is damaged beyond reading.
        OSError: a file cannot be read or written.
    """
    size = file.stat().st_size if file.exists() else 0
    progress = ReadingProgress(on_progress)
    progress.total = size
    with _Repairs() as repairs:
        survey = _Survey(progress, repairs)
        with _open(file, progress, size) as reader:
            needs_repair = _needs_repair(reader)
            if not needs_repair and file.suffix == ".db3":
                raise BagError(f"{file}: only MCAP files have an index; pass the folder of the file")
            if not survey.add(reader, file, size, needs_repair):
                raise BagError(f"{file} already has an index, and no damage; it needs no reindexing")
            topics = len(reader.topics)
            recording = RecordingData.of_bags([reader])
        repaired = repairs.replace_files()
    return Reindexed(
        file,
        1,
        survey.messages,
        topics,
        tuple(survey.unindexed),
        repaired,
        tuple(survey.damaged),
        survey.unread_bytes,
        recording.omitted + repairs.omitted,
    )


def _previous_metadata(folder: Path) -> tuple[BagMetadata | None, Counter[str]]:
    """Return the contents of a folder's ``metadata.yaml``, None if missing or unreadable, and a count of lost data.

    The count has the key ``unreadable_metadata`` if the unreadable file has custom data.
    """
    path = folder / FILE
    if not path.exists():
        return None, Counter()
    try:
        return read_metadata(folder), Counter()
    except BagError:
        with path.open("rb") as stream:
            has_custom_data = _CUSTOM_DATA.search(stream.read(_MAX_SEARCHED_BYTES)) is not None
        return None, Counter(unreadable_metadata=1 if has_custom_data else 0)


def _with_hash(reader: BagReader, channel: BagTopic) -> BagTopic:
    if channel.type_hash or not has_definition(channel):
        return channel
    try:
        return replace(channel, type_hash=reader.definition(channel).type_hash)
    except RosidlError:
        return channel


def _single_kind(folder: Path, kinds: set[str]) -> str:
    if len(kinds) > 1:
        names = " and ".join(sorted(_WORDS.get(kind, kind) for kind in kinds))
        raise BagError(f"{folder}: its files are {names}; expected files of one kind, so move the others elsewhere")
    return next(iter(kinds))


def _file_number(file: Path) -> tuple[int, str]:
    """Return the number in the name of a bag file, by which files are sorted, because rosbag2 writes it without leading
    zeros.
    """
    numbers = _NUMBER.findall(file.name.removesuffix(SUFFIX))  # so that the 3 in .db3 is not matched
    return (int(numbers[-1][:18]) if numbers else -1), file.name
