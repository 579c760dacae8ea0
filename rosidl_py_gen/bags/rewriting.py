"""Copies of everything in bags except messages, with counts of what the new bag cannot store, and repair of bags.

Attachments, metadata records and schemas without a channel belong to the whole recording. A copy of selected topics or
times contains all of them, as with ``mcap filter``. Metadata records are written first and attachments last, so that
chunks stay together. Each writer writes a new record ``rosbag2``, which contains the user's data of the old record
(docs/internals/protocol.md 16).

The repair is for folders that lost ``metadata.yaml``, and for files whose recorder was killed. A file is rewritten if
it has no index, damaged parts or a journal. The complete new file is on the disk before it replaces the old one, which
stays in the folder with the ending ``.unindexed``. So a full disk, an error or a power cut loses nothing, and the
repair can be repeated.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

from rosidl_py_gen.bags.common import OFFERED_QOS, TYPE_HASH, BagError, BagWarning, sync_file, sync_folder
from rosidl_py_gen.bags.definition_lookup import has_definition
from rosidl_py_gen.bags.metadata import (
    FILE,
    FileStatistics,
    OfferedQoS,
    metadata_text,
    read_metadata,
    recorder_data,
    write_metadata,
)
from rosidl_py_gen.bags.reader import BagReader
from rosidl_py_gen.bags.storage.bag_files import SUFFIX, bag_files, compression_of
from rosidl_py_gen.bags.storage.sqlite_file import JOURNALS, SqliteFile
from rosidl_py_gen.bags.storage.storage_api import ReadingProgress, as_raw_messages, topics_by_name
from rosidl_py_gen.bags.writer import BagWriter, compress_file
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.bags.common import BagTopic, DamagedPart, RawMessage
    from rosidl_py_gen.bags.metadata import BagMetadata
    from rosidl_py_gen.bags.storage.mcap_records import StoredMetadata
    from rosidl_py_gen.bags.storage.storage_api import Storage
    from rosidl_py_gen.bags.writer import SqliteWriter
    from rosidl_py_gen.type_loading import SearchFolders

ROSBAG2 = "rosbag2"
"""Name of the MCAP metadata record that rosbag2 writes into each file."""
_SERIALIZED, _DISTRO = "serialized_metadata", "ROS_DISTRO"
_KINDS = {
    "attachments": "attachment",
    "metadata_records": "metadata record",
    "sequence_numbers": "sequence number",
    "publish_times": "publish time",
    "channel_metadata": "value of channel metadata",
    "schemas": "schema without a topic",
    "qos_profiles": "QoS profile",
    "type_hashes": "type hash",
    "profiles": "profile",
    "unknown_records": "record of an unknown kind",
    "unknown_tables": "table",
    "rosbag2_records": "metadata record of rosbag2",
    "custom_data": "value of custom_data",
    "distributions": "name of a distribution",
    "listed_topics": "topic without a channel",
    "unreadable_metadata": "metadata.yaml",
}
"""Nouns for things that a copy of a bag could not store, by the name under which `BagCopy.omitted` counts them."""
_PLURALS = {
    "value of channel metadata": "values of channel metadata",
    "schema without a topic": "schemas without a topic",
    "type hash": "type hashes",
    "record of an unknown kind": "records of unknown kinds",
    "metadata record of rosbag2": "metadata records of rosbag2",
    "value of custom_data": "values of custom_data",
    "name of a distribution": "names of distributions",
    "topic without a channel": "topics without a channel",
}
_REASONS = {
    "unknown_records": "only the program that wrote them knows their meaning",
    "unknown_tables": "rosbag2 has no such tables in SQLite files",
    "rosbag2_records": "they are not in the format of rosbag2",
    "custom_data": "the files state different values for a key; the last one is used",
    "distributions": "the files state several; a bag has one",
    "listed_topics": "only metadata.yaml lists them",
    "unreadable_metadata": "its custom_data cannot be read",
}
"""Reasons why no storage format can store a kind of thing when a bag is copied, by the name under which it is counted.
"""
_IN_SQLITE = "SQLite bags have no place for them; convert to MCAP to keep them"


class SourceBag(BagReader):
    """Open bag that is copied or repaired: every record is read, also those that no index describes."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        search_path: SearchFolders = (),
        on_progress: Callable[[int, int], object] | None = None,
    ) -> None:
        super().__init__(path, search_path=search_path, skip_damaged=True, on_progress=on_progress)
        try:
            for file in self._files:
                file.unused_schemas()  # reads the parts of the file that no index describes
            self._stored_channels, self.channels, self.topics, self.start_ns, self.end_ns = self._contents()
        except BaseException:
            self.close()
            raise

    @property
    def metadata(self) -> BagMetadata | None:
        """Contents of ``metadata.yaml``, or of the record that rosbag2 writes into a file; None without them."""
        return self._metadata

    @metadata.setter
    def metadata(self, metadata: BagMetadata | None) -> None:
        self._metadata = metadata

    @property
    def stored_files(self) -> Sequence[Storage]:
        """Readers of the files of the bag."""
        return self._files

    @property
    def stored_channels(self) -> Sequence[BagTopic]:
        """Channels as the files store them, with one entry for each channel of each file."""
        return self._stored_channels

    def has_attachments(self) -> bool:
        """Return True if the bag has attachments that are not damaged."""
        return any(True for file in self._files for _ in file.attachments())

    def messages_as_stored(self) -> Iterator[RawMessage]:
        """Yield all messages of a bag of one file without decompressing messages that rosbag2 compressed one by one."""
        (file,) = self._files
        return as_raw_messages(file.stored_messages())


class BagCopy:
    """Copy of the contents of open bags, except for their messages, into a new bag.

    Call `begin` before messages are written, and `end` after that.

    Attributes:
        recording: data about the whole recordings, from their files and ``metadata.yaml``.
        omitted: number of things that are not in the copy, by kind. Complete after `end`.
    """

    def __init__(self, readers: Sequence[SourceBag], writer: BagWriter | SqliteWriter) -> None:
        self._readers, self._writer = readers, writer
        self.recording = RecordingData.of_bags(readers)
        self.omitted: Counter[str] = Counter()

    def begin(self, channels: Sequence[Mapping[tuple[str, ...], BagTopic]]) -> list[dict[tuple[object, ...], BagTopic]]:
        """Copy metadata records, channels and unused schemas to the new bag.

        Args:
            channels: for each bag, the topics of the copy by the `key` of the original topic; the copy gets their types
                and definitions.

        Returns:
            For each bag, the channels of the copy by the `channel_key` of the original.
        """
        writer = self._writer
        files = [file for reader in self._readers for file in reader.stored_files]
        self._pass_on_metadata()
        for record in (record for file in files for record in file.metadata_records()):
            if record.name != ROSBAG2:
                if isinstance(writer, BagWriter):
                    writer._copy_metadata(record)
                else:
                    self.omitted["metadata_records"] += 1
        targets = [_targets(reader, known) for reader, known in zip(self._readers, channels, strict=True)]
        if not isinstance(writer, BagWriter):
            targets = self._one_of_each_topic(targets)
        elif len(targets) > 1:
            targets = _joined(targets)
        for target in (target for each in targets for target in each.values()):
            writer.add_raw_topic(target)
        for file in files:  # after the topics of all bags: SQLite bags have one definition for a type
            for schema in file.unused_schemas():
                writer._add_schema(schema)
        return targets

    def end(self) -> None:
        """Copy attachments to the new bag, and complete the counts in `omitted`."""
        writer = self._writer
        for file in (file for reader in self._readers for file in reader.stored_files):
            for attachment in file.attachments():
                if isinstance(writer, BagWriter):
                    writer._copy_attachment(attachment)
                else:
                    self.omitted["attachments"] += 1
            if file.span() is None:  # a reader of messages skips the file, with its chunks of unknown records
                for _ in file.stored_messages():
                    pass
            self.omitted["unknown_records"] += file.unknown_records()
            self.omitted["unknown_tables"] += file.unknown_tables()
        self.omitted = +(self.omitted + writer._omitted)

    def omission_lines(self) -> list[str]:
        """Return lines of text for the user, one for each reason, about what the copy does not contain."""
        return _omission_lines(self.omitted)

    def _pass_on_metadata(self) -> None:
        """Pass the recorder's profile and distribution, and the user's custom data, from the old bags to the writer of
        the new bag.
        """
        recording = self.recording
        self.omitted += recording.omitted
        for reader in self._readers:
            metadata = reader.metadata
            if metadata is not None and reader.path.is_dir():
                self.omitted["listed_topics"] += len(listed_topics(metadata) - reader.topics.keys())
        profiles = recording.profiles
        profile = profiles[0] if profiles else "ros2"
        if isinstance(self._writer, BagWriter):
            self.omitted["profiles"] += len(set(profiles) - {profile, ""})
        else:
            self.omitted["profiles"] += len(set(profiles) - {"ros2", ""})
        self._writer._inherit(profile, recording.ros_distro, recording.custom_data, recording.values)

    def _one_of_each_topic(
        self, targets: list[dict[tuple[object, ...], BagTopic]]
    ) -> list[dict[tuple[object, ...], BagTopic]]:
        """Return the channels of a SQLite bag that replace the channels of the old bags, by the key of the old channel.

        Old channels of one topic and definition share a new channel, because a SQLite bag stores a topic once.
        """
        groups: dict[tuple[str, ...], list[BagTopic]] = {}
        for target in (target for each in targets for target in each.values()):
            groups.setdefault(target.key, []).append(target)
            self.omitted["channel_metadata"] += len((target.metadata or {}).keys() - {OFFERED_QOS, TYPE_HASH})
        merged = {}
        for key, group in groups.items():
            by_profiles: dict[str, str] = {}  # releases write one profile differently
            for text in (one.offered_qos for one in group if one.offered_qos):
                by_profiles.setdefault(repr(OfferedQoS.parse(text) or text), text)
            texts = [*by_profiles.values()]
            hashes = [text for text in dict.fromkeys(one.type_hash for one in group) if text]
            qos = texts[0] if texts else ""
            if len(texts) > 1:  # all profiles, as in a bag that `ros2 bag convert` writes
                profiles = {text: OfferedQoS.parse(text) for text in texts}
                readable = [text for text in texts if profiles[text]]
                self.omitted["qos_profiles"] += len(texts) - max(1, len(readable))
                qos = OfferedQoS([one for text in readable for one in profiles[text]]).text if readable else qos
            self.omitted["type_hashes"] += max(0, len(hashes) - 1)
            merged[key] = replace(group[0], offered_qos=qos, type_hash=hashes[0] if hashes else "")
        return [{key: merged[target.key] for key, target in each.items()} for each in targets]


def _targets(reader: SourceBag, channels: Mapping[tuple[str, ...], BagTopic]) -> dict[tuple[object, ...], BagTopic]:
    targets = {}
    for channel in reader.stored_channels:
        known = channels.get(channel.key)
        if known is not None:
            targets[channel.channel_key] = with_listed_values(reader.metadata, _with_definition(channel, known))
    return targets


def _joined(targets: list[dict[tuple[object, ...], BagTopic]]) -> list[dict[tuple[object, ...], BagTopic]]:
    """Make equal channels of several bags one channel: those with equal topic, definition, type hash, QoS and further
    metadata.

    A channel without type hash, as in SQLite bags, takes the hash of a channel with the same definition.
    """
    hashes: dict[tuple[object, ...], str] = {}
    for target in (target for each in targets for target in each.values()):
        if target.type_hash:
            hashes.setdefault((target.key, target.definition_bytes), target.type_hash)
    first: dict[tuple[object, ...], BagTopic] = {}
    joined = []
    for each in targets:
        channels = {}
        for channel_key, target in each.items():
            definition = target.key, target.definition_bytes
            known_hash = target.type_hash or hashes.get(definition, "")
            qos = OfferedQoS.parse(target.offered_qos) or target.offered_qos  # releases write one profile differently
            others = {key: text for key, text in (target.metadata or {}).items() if key not in (OFFERED_QOS, TYPE_HASH)}
            key = definition, known_hash, repr(qos), tuple(sorted(others.items()))
            channels[channel_key] = first.setdefault(key, replace(target, type_hash=known_hash))
        joined.append(channels)
    return joined


class RecordingData:
    """Data about a whole recording, collected from the files of a bag and its ``metadata.yaml``.

    Attributes:
        profiles: profiles that the headers of MCAP files state, without duplicates.
        ros_distro: distribution of the recorder; empty if it is not known.
        custom_data: texts of the user. ``metadata.yaml`` overrides files, and later files override earlier ones.
        values: entries of rosbag2's metadata records that rosbag2 itself does not know.
        omitted: number of values that could not be collected, by kind.
    """

    def __init__(self) -> None:
        self.profiles: list[str] = []
        self.ros_distro = ""
        self.custom_data: dict[str, str] = {}
        self.values: dict[str, str] = {}
        self.omitted: Counter[str] = Counter()

    @classmethod
    def of_bags(cls, readers: Iterable[SourceBag]) -> RecordingData:
        """Return the data about the recordings of bags, from all their files; later bags override earlier ones."""
        recording = cls()
        for reader in readers:
            for file in reader.stored_files:
                recording.add_file(file)
            recording.add_metadata(reader.metadata)
        return recording

    def add_file(self, file: Storage) -> None:
        """Add what one file of a bag states about the recording: profile, distribution, custom data."""
        profile = file.profile()
        if profile is not None and profile not in self.profiles:
            self.profiles.append(profile)
        self._add_distro(file.ros_distro())
        for text in file.metadata_texts():
            self._add_text(text)
        for record in file.metadata_records():
            if record.name == ROSBAG2:
                self._add_record(record)

    def add_metadata(self, metadata: BagMetadata | None) -> None:
        """Add the data of ``metadata.yaml``, which overrides the data of files."""
        if metadata is not None:
            self._merge(self.custom_data, metadata.custom_data)
            files, self.ros_distro = self.ros_distro, metadata.ros_distro
            self._add_distro(files)

    def _add_distro(self, name: str) -> None:
        self.ros_distro = self.ros_distro or name
        self.omitted["distributions"] += name not in ("", self.ros_distro)

    def _add_record(self, record: StoredMetadata) -> None:
        try:
            values = record.values()
        except BagError:
            self.omitted["rosbag2_records"] += 1
            return
        self._add_text(values.pop(_SERIALIZED, ""))
        values.pop(_DISTRO, None)  # as `ros_distro`
        self._merge(self.values, values)

    def _add_text(self, text: str) -> None:
        try:
            self._merge(self.custom_data, recorder_data(text).custom_data)
        except BagError:
            self.omitted["rosbag2_records"] += 1

    def _merge(self, values: dict[str, str], added: Mapping[str, str]) -> None:
        self.omitted["custom_data"] += sum(values.get(key, text) != text for key, text in added.items())
        values.update(added)


def listed_topics(metadata: BagMetadata) -> set[str]:
    """Return the names of the topics that ``metadata.yaml`` lists."""
    return {topic.name for topic in metadata.topics}


def with_listed_values(metadata: BagMetadata | None, channel: BagTopic) -> BagTopic:
    """Return the channel completed by ``metadata.yaml``, which supplies the type hash and QoS that the bag file does
    not state.
    """
    if metadata is None or (channel.type_hash and channel.offered_qos):
        return channel
    listed = metadata.by_name().get((channel.name, channel.type_name))
    if listed is None:
        return channel
    return replace(
        channel,
        type_hash=channel.type_hash or listed.type_hash,
        offered_qos=channel.offered_qos or listed.offered_qos,
    )


def _with_definition(channel: BagTopic, known: BagTopic) -> BagTopic:
    """Return a copy of `channel` that has the type, definition and hash of `known`."""
    if (channel.type_name, channel.definition, channel.encoding) == (known.type_name, known.definition, known.encoding):
        return channel
    return replace(
        channel,
        type_name=known.type_name,
        definition=known.definition,
        encoding=known.encoding,
        type_hash=known.type_hash,
    )


def _omission_lines(omitted: Mapping[str, int]) -> list[str]:
    lines = []
    groups: dict[str, list[str]] = {}
    for kind in _KINDS:
        if omitted.get(kind):
            groups.setdefault(_REASONS.get(kind, _IN_SQLITE), []).append(kind)
    for reason, kinds in groups.items():
        parts = [f"{omitted[kind]} {_noun(kind, omitted[kind])}" for kind in kinds]
        text = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
        verb = "is" if len(kinds) == 1 and omitted[kinds[0]] == 1 else "are"
        lines.append(f"{text} {verb} not carried over: {reason}")
    return lines


def _noun(kind: str, count: int) -> str:
    name = _KINDS[kind]
    return name if count == 1 else _PLURALS.get(name, f"{name}s")


# --------------------------------------------------------------------------------------------------------------- repair


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

    def omission_lines(self) -> list[str]:
        """Return lines of text for the user, one for each reason, about what the repaired files do not contain."""
        return _omission_lines(self.omitted)


OnProgress: TypeAlias = "Callable[[int, int], object]"
"""Callback for the progress of a repair, which receives the number of bytes read so far and the number of all bytes."""
_MESSAGES_PER_REPORT = 64


def _open(file: Path, progress: ReadingProgress, size: int) -> SourceBag:
    """Open a bag file for repair and read all of its channels.

    A file without index is read twice, so opening reports the first half of the progress.
    """
    return SourceBag(file, on_progress=lambda done, total: progress.show(size * done // (2 * max(1, total))))


def _messages(reader: SourceBag, progress: ReadingProgress, end: int) -> Iterator[RawMessage]:
    """Yield all messages of an open bag file as they are stored, and report progress in bytes up to `end` to the
    callback.
    """
    return _with_progress(reader.messages_as_stored(), reader, progress, end)


def _with_progress(messages: Iterable[T], reader: SourceBag, progress: ReadingProgress, end: int) -> Iterator[T]:
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
        self, file: Path, reader: SourceBag, messages: Callable[[], Iterator[RawMessage]], counted: FileStatistics
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
        (storage,) = reader.stored_files
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

    def add(self, reader: SourceBag, file: Path, size: int, needs_repair: bool) -> bool:
        """Read all of a bag file and count its messages; return True if the file was repaired."""
        if needs_repair:
            self._write(reader, file, size)
        else:
            counted = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
            (storage,) = reader.stored_files
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

    def _write(self, reader: SourceBag, file: Path, size: int) -> None:
        counted = FileStatistics(file.name, counts=dict.fromkeys(reader.topics, 0))
        self._repairs.add(file, reader, lambda: _messages(reader, self._progress, size), counted)
        self.statistics.append(counted)

    @property
    def messages(self) -> int:
        """Number of messages of all files that were checked."""
        return sum(file.total for file in self.statistics)


def _needs_repair(reader: SourceBag) -> bool:
    return not reader.has_index or any(file.has_journal for file in reader.stored_files)


def reindex(path: Path, on_progress: OnProgress | None = None) -> Reindexed:
    """Repair a bag folder or a bag file.

    Files without an index, with damaged parts or with a journal are rewritten; the old file gets the ending
    ``.unindexed``. A folder gets a ``metadata.yaml`` for its bag files, in the order of the numbers in their names.

    Raises:
        BagError: the folder has no bag files, files of several storages or compressions, or one that is damaged beyond
            reading; or the file needs no repair, or is damaged beyond reading. Nothing is changed then.
        OSError: a file cannot be read or written.
    """
    return _reindex_folder(path, on_progress) if path.is_dir() else _reindex_file(path, on_progress)


def _reindex_folder(folder: Path, on_progress: OnProgress | None) -> Reindexed:
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
                reader.metadata = previous  # what the file itself does not state
                survey.add(reader, file, size, _needs_repair(reader))
                recording.add_file(*reader.stored_files)
        recording.add_metadata(previous)
        topics = topics_by_name(with_listed_values(previous, channel) for channel in survey.channels)
        if previous is not None:
            omitted["listed_topics"] += len(listed_topics(previous) - topics.keys())
            found = sum((Counter(file.counts) for file in survey.statistics), Counter[str]())
            if note := previous.loss_note(found):
                warnings.warn(f"{folder}: {note}", BagWarning, stacklevel=3)
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


def _reindex_file(file: Path, on_progress: OnProgress | None) -> Reindexed:
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


def _with_hash(reader: SourceBag, channel: BagTopic) -> BagTopic:
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
