"""``metadata.yaml`` of a folder that lost it, and the index of an MCAP file whose recorder was killed.

Decides that messages are never touched: the folder gets a text beside its files, and a file that is written again stays
there under another name.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.bags.common import BagError, replace_durably
from rosidl_py_gen.bags.definition_lookup import has_definition
from rosidl_py_gen.bags.file_splitter import compress_file
from rosidl_py_gen.bags.metadata import FILE, FileStatistics, metadata_text, write_metadata
from rosidl_py_gen.bags.reader import BagReader
from rosidl_py_gen.bags.storage.file_compression import SUFFIX, bag_files, compression_of
from rosidl_py_gen.bags.storage.mcap_file import by_name
from rosidl_py_gen.bags.writer import BagWriter
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.bags.common import BagTopic, DamagedPart

UNINDEXED = ".unindexed"
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
_WORDS = {"": "not compressed", "file": "compressed", "message": "of compressed messages"}
_NUMBER = re.compile(r"(\d+)(?=\.)")


class Reindexed(NamedTuple):
    """What was done.

    Attributes:
        path: the file that was written.
        files: how many files the bag has.
        without_index: names of those that are read once through whenever they are opened.
        kept: what the file was before, if it was replaced.
        damaged: parts of the files that were skipped.
    """

    path: Path
    files: int
    messages: int
    topics: int
    unindexed_files: tuple[str, ...] = ()
    backup: Path | None = None
    damaged: tuple[DamagedPart, ...] = ()


def reindex_folder(folder: Path) -> Reindexed:
    """Write ``metadata.yaml`` of what the files in a folder hold, in the order of the numbers in their names.

    Raises:
        BagError: no bag files, of two storages, compressed or not, or a damaged one: then nothing is written. OSError.
    """
    files = sorted(bag_files(folder), key=_in_order)
    statistics: list[FileStatistics] = []
    channels: list[BagTopic] = []
    damaged: list[DamagedPart] = []
    without_index = []
    storage = _the_one(folder, {_STORAGES[Path(file.name.removesuffix(SUFFIX)).suffix] for file in files})
    kinds = {file: kind for file in files if (kind := compression_of(file)) is not None}
    if len(files) > 1 and [kinds.get(file, "") for file in files] == ["file"] * (len(files) - 1) + [""]:
        files[-1] = compress_file(files[-1])  # the recorder was killed before it did
        kinds = dict.fromkeys(files, "file")
    compression = _the_one(folder, {*kinds.values()} or {""})
    for file in files:
        with BagReader(file, skip_damaged=True) as reader:
            found = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
            for message in reader.raw_messages():  # all of them: some chunks may be damaged
                found.add(message.channel.name, message.log_time)
            statistics.append(found)
            damaged += reader.damaged
            channels += (_with_hash(reader, channel) for channel in reader.channels)
            if not reader.has_index:
                without_index.append(file.name)
    topics = by_name(channels)
    text = metadata_text(storage, statistics, topics.values(), compression_mode=compression)
    write_metadata(folder, text)
    count = sum(one.total for one in statistics)
    return Reindexed(folder / FILE, len(files), count, len(topics), tuple(without_index), damaged=tuple(damaged))


def reindex_file(file: Path) -> Reindexed:
    """Rewrite an MCAP file that has no index or damaged parts, and keep the old one as ``FILE.unindexed``.

    Raises:
        BagError: it has an index and no damage, or cannot have an index; it is damaged beyond reading. OSError.
    """
    kept = file.with_name(file.name + UNINDEXED)
    with BagReader(file, skip_damaged=True) as reader:
        if file.suffix != ".mcap":
            raise BagError(f"{file}: only MCAP files have an index of their own; give the folder it is in")
        if reader.has_index:
            for _ in reader.raw_messages():
                pass
            if not reader.damaged:
                raise BagError(f"{file} already has an index, and no damage; it needs no reindexing")
        if kept.exists():
            raise BagError(f"{kept} exists already, so that there is no room to keep what {file} is now")
        partial = file.with_name(f".{file.stem}.reindexing.mcap")
        partial.unlink(missing_ok=True)  # of a run that was killed
        try:
            with BagWriter(partial) as writer:
                count = 0
                for channel in reader.channels:
                    writer.add_raw_topic(channel)
                for message in reader.raw_messages():
                    writer.write_raw(message)
                    count += 1
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
        topics = len(reader.topics)
    file.rename(kept)
    replace_durably(partial, file)
    return Reindexed(file, 1, count, topics, backup=kept, damaged=tuple(reader.damaged))


def _with_hash(reader: BagReader, channel: BagTopic) -> BagTopic:
    """The channel with the hash of its definition, where the file has only this."""
    if channel.type_hash or not has_definition(channel):
        return channel
    try:
        return replace(channel, type_hash=reader.definition(channel).type_hash)
    except RosidlError:
        return channel


def _the_one(folder: Path, kinds: set[str]) -> str:
    if len(kinds) > 1:
        told = " and ".join(sorted(_WORDS.get(kind, kind) for kind in kinds))
        raise BagError(f"{folder}: some of its files are {told}; a bag is of one kind, so move the others elsewhere")
    return next(iter(kinds))


def _in_order(file: Path) -> tuple[int, str]:
    """rosbag2 numbers files: the tenth comes behind the second."""
    numbers = _NUMBER.findall(file.name.removesuffix(SUFFIX))  # without the 3 of .db3
    return (int(numbers[-1][:18]) if numbers else -1), file.name
