"""Repair of bags: ``metadata.yaml`` of a folder that lost it, and the index of an MCAP file whose recorder was killed.

Messages are never changed: a folder gets a metadata file, and the old form of a rewritten file stays in the folder.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from rosidl_py_gen.bags.common import BagError, written_durably
from rosidl_py_gen.bags.definition_lookup import has_definition
from rosidl_py_gen.bags.mcap_writer import BagWriter
from rosidl_py_gen.bags.metadata import FILE, FileStatistics, metadata_text, write_metadata
from rosidl_py_gen.bags.reader import BagReader
from rosidl_py_gen.bags.splitting_writer import compress_file
from rosidl_py_gen.bags.storage.bag_files import SUFFIX, bag_files, compression_of
from rosidl_py_gen.bags.storage.storage_api import ReadingProgress, topics_by_name
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.bags.common import BagTopic, DamagedPart, RawMessage

UNINDEXED = ".unindexed"
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
_WORDS = {"": "not compressed", "file": "compressed", "message": "of compressed messages"}
_NUMBER = re.compile(r"(\d+)(?=\.)")


class Reindexed(NamedTuple):
    """Result of a repair.

    Attributes:
        path: the file that was written.
        files: number of files of the bag.
        unindexed_files: names of files without an index, which are read completely whenever they are opened.
        backup: the old form of the file, if it was replaced.
        damaged: parts of the files that were skipped.
    """

    path: Path
    files: int
    messages: int
    topics: int
    unindexed_files: tuple[str, ...] = ()
    backup: Path | None = None
    damaged: tuple[DamagedPart, ...] = ()


OnProgress: TypeAlias = "Callable[[int, int], object]"
"""Function that is called with the number of bytes that are read, and of all."""
_MESSAGES_PER_REPORT = 64


def _open(file: Path, progress: ReadingProgress, size: int) -> BagReader:
    """Open a file; without an index it is read twice, and opening is the first half."""
    return BagReader(
        file, skip_damaged=True, on_progress=lambda done, total: progress.show(size * done // (2 * max(1, total)))
    )


def _messages(reader: BagReader, progress: ReadingProgress, end: int) -> Iterator[RawMessage]:
    """Yield all messages, and report progress from the present position to `end`."""
    messages = reader.raw_messages()  # may read parts of the file that are not in the index, which is progress too
    start, total = progress.position, max(1, sum(channel.count or 0 for channel in reader.channels))
    for count, message in enumerate(messages):
        if not count % _MESSAGES_PER_REPORT:
            progress.show(min(start + (end - start) * count // total, end))
        yield message


def reindex_folder(folder: Path, on_progress: OnProgress | None = None) -> Reindexed:
    """Write ``metadata.yaml`` for the files in a folder, in the order of the numbers in their names.

    Raises:
        BagError: the folder has no bag files, files of several storages or compressions, or a damaged one; nothing is
            written then.
        OSError: a file cannot be read or written.
    """
    files = sorted(bag_files(folder), key=_file_number)
    statistics: list[FileStatistics] = []
    channels: list[BagTopic] = []
    damaged: list[DamagedPart] = []
    unindexed = []
    storage = _single_kind(folder, {_STORAGES[Path(file.name.removesuffix(SUFFIX)).suffix] for file in files})
    kinds = {file: kind for file in files if (kind := compression_of(file)) is not None}
    if len(files) > 1 and [kinds.get(file, "") for file in files] == ["file"] * (len(files) - 1) + [""]:
        files[-1] = compress_file(files[-1])  # the recorder was killed before it did
        kinds = dict.fromkeys(files, "file")
    compression = _single_kind(folder, {*kinds.values()} or {""})
    progress = ReadingProgress(on_progress)
    progress.total = sum(file.stat().st_size for file in files)
    for file in files:
        size = file.stat().st_size
        with _open(file, progress, size) as reader:
            counted = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
            for message in _messages(reader, progress, size):  # all: some may be damaged
                counted.add(message.channel.name, message.log_time)
            statistics.append(counted)
            damaged += reader.damaged
            channels += (_with_hash(reader, channel) for channel in reader.channels)
            if not reader.has_index:
                unindexed.append(file.name)
        progress.end_file(size)
    topics = topics_by_name(channels)
    text = metadata_text(storage, statistics, topics.values(), compression_mode=compression)
    write_metadata(folder, text)
    count = sum(file.total for file in statistics)
    return Reindexed(folder / FILE, len(files), count, len(topics), tuple(unindexed), damaged=tuple(damaged))


def reindex_file(file: Path, on_progress: OnProgress | None = None) -> Reindexed:
    """Rewrite an MCAP file that has no index or damaged parts, and rename the old one to ``FILE.unindexed``.

    Raises:
        BagError: the file has an index and no damage, is not an MCAP file, or is damaged beyond reading.
        OSError: a file cannot be read or written.
    """
    backup = file.with_name(file.name + UNINDEXED)
    size = file.stat().st_size if file.exists() else 0
    progress = ReadingProgress(on_progress)
    progress.total = size
    with written_durably(file) as partial:
        with _open(file, progress, size) as reader:
            if file.suffix != ".mcap":
                raise BagError(f"{file}: only MCAP files have an index; pass the folder of the file")
            if reader.has_index:
                for _ in _messages(reader, progress, size // 2):
                    pass
                if not reader.damaged:
                    raise BagError(f"{file} already has an index, and no damage; it needs no reindexing")
            if backup.exists():
                raise BagError(f"{backup} exists already; remove it, as {file} is renamed to it")
            partial.unlink(missing_ok=True)  # of a run that was killed
            count = 0
            with BagWriter(partial) as writer:
                for channel in reader.channels:
                    writer.add_raw_topic(channel)
                for message in _messages(reader, progress, size):
                    writer.write_raw(message)
                    count += 1
        file.rename(backup)
    return Reindexed(file, 1, count, len(reader.topics), backup=backup, damaged=tuple(reader.damaged))


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
    """Sort key of a file: rosbag2 numbers files without leading zeros."""
    numbers = _NUMBER.findall(file.name.removesuffix(SUFFIX))  # so that the 3 in .db3 is not matched
    return (int(numbers[-1][:18]) if numbers else -1), file.name
