"""Copy of everything in a bag besides messages, and counts of what the copy cannot store.

Attachments, metadata records and schemas without a channel belong to the whole recording, so they are copied whatever
topics and times are selected, as by ``mcap filter``. Metadata records come first and attachments last, so that chunks
stay together. The record ``rosbag2`` is rewritten by each writer, with the user's data of the old record
(docs/internals/protocol.md 16).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.common import OFFERED_QOS, TYPE_HASH, BagError
from rosidl_py_gen.bags.mcap_writer import BagWriter
from rosidl_py_gen.bags.metadata import qos_profiles, qos_text, recorder_data

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.bags.common import BagTopic
    from rosidl_py_gen.bags.metadata import BagMetadata
    from rosidl_py_gen.bags.reader import BagReader
    from rosidl_py_gen.bags.sqlite_writer import SqliteWriter
    from rosidl_py_gen.bags.storage.mcap_extras import StoredMetadata
    from rosidl_py_gen.bags.storage.storage_api import Storage

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
"""Kinds of omitted things: keys of counts, with the noun that texts use."""
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
    "custom_data": "files of the bag state different values for a key; the last one is used",
    "distributions": "files of the bag state several; a bag has one",
    "listed_topics": "only metadata.yaml lists them",
    "unreadable_metadata": "its custom_data cannot be read",
}
"""Reasons why a copy in any storage format lacks things of a kind."""
_IN_SQLITE = "SQLite bags have no place for them; convert to MCAP to keep them"


def find_all_channels(reader: BagReader) -> None:
    """Add the channels that the indexes of the bag's files do not list to an open reader, by reading the files."""
    reader._read_unindexed()


class BagCopy:
    """Copy of the contents of an open bag, except for its messages, into a new bag.

    Call `begin` before messages are written, and `end` after that.

    Attributes:
        recording: data about the whole recording, from its files and ``metadata.yaml``.
        omitted: number of things that are not in the copy, by kind. Complete after `end`.
    """

    def __init__(self, reader: BagReader, writer: BagWriter | SqliteWriter) -> None:
        self._reader, self._writer = reader, writer
        self.recording = RecordingData.of_bag(reader)
        self.omitted: Counter[str] = Counter()

    def begin(self, channels: Mapping[tuple[str, ...], BagTopic]) -> dict[tuple[object, ...], BagTopic]:
        """Copy metadata records, channels and unused schemas to the new bag.

        Args:
            channels: the topics of the copy by the `key` of the original topic; the copy gets their types and
                definitions.

        Returns:
            The channels of the copy, by the `channel_key` of the original.
        """
        writer, files = self._writer, self._reader._files
        self._pass_on_metadata()
        for record in self._metadata_records():
            if record.name != ROSBAG2:
                if isinstance(writer, BagWriter):
                    writer._copy_metadata(record)
                else:
                    self.omitted["metadata_records"] += 1
        targets = self._targets(channels)
        for target in targets.values():
            writer.add_raw_topic(target)
        for file in files:  # after the topics: SQLite bags have one definition for a type
            for schema in file.unused_schemas():
                writer._add_schema(schema)
        return targets

    def end(self) -> None:
        """Copy attachments to the new bag, and complete the counts in `omitted`."""
        writer = self._writer
        for file in self._reader._files:
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

    def _metadata_records(self) -> Iterator[StoredMetadata]:
        for file in self._reader._files:
            yield from file.metadata_records()

    def _pass_on_metadata(self) -> None:
        """Pass the profile, distribution and custom data of the recording to the writer."""
        recording = self.recording
        self.omitted += recording.omitted
        metadata = self._reader._metadata
        if metadata is not None and self._reader.path.is_dir():
            self.omitted["listed_topics"] += len(listed_topics(metadata) - self._reader.topics.keys())
        profiles = recording.profiles
        profile = profiles[0] if profiles else "ros2"
        if isinstance(self._writer, BagWriter):
            self.omitted["profiles"] += len(set(profiles) - {profile, ""})
        else:
            self.omitted["profiles"] += len(set(profiles) - {"ros2", ""})
        self._writer._inherit(profile, recording.ros_distro, recording.custom_data, recording.values)

    def _targets(self, channels: Mapping[tuple[str, ...], BagTopic]) -> dict[tuple[object, ...], BagTopic]:
        targets = {}
        for channel in self._reader._stored_channels:
            known = channels.get(channel.key)
            if known is not None:
                targets[channel.channel_key] = with_listed_values(
                    self._reader._metadata, _with_definition(channel, known)
                )
        return targets if isinstance(self._writer, BagWriter) else self._one_of_each_topic(targets)

    def _one_of_each_topic(self, targets: dict[tuple[object, ...], BagTopic]) -> dict[tuple[object, ...], BagTopic]:
        """Return the channels of a SQLite copy by original key: channels of one topic and definition become one."""
        groups: dict[tuple[str, ...], list[BagTopic]] = {}
        for target in targets.values():
            groups.setdefault(target.key, []).append(target)
            self.omitted["channel_metadata"] += len((target.metadata or {}).keys() - {OFFERED_QOS, TYPE_HASH})
        merged = {}
        for key, group in groups.items():
            texts = [text for text in dict.fromkeys(one.offered_qos for one in group) if text]
            hashes = [text for text in dict.fromkeys(one.type_hash for one in group) if text]
            qos = texts[0] if texts else ""
            if len(texts) > 1:  # all profiles, as in a bag that `ros2 bag convert` writes
                profiles = {text: qos_profiles(text) for text in texts}
                readable = [text for text in texts if profiles[text]]
                self.omitted["qos_profiles"] += len(texts) - max(1, len(readable))
                qos = qos_text([one for text in readable for one in profiles[text]]) if readable else qos
            self.omitted["type_hashes"] += max(0, len(hashes) - 1)
            merged[key] = replace(group[0], offered_qos=qos, type_hash=hashes[0] if hashes else "")
        return {key: merged[target.key] for key, target in targets.items()}


class RecordingData:
    """Data about a whole recording, from the files of a bag and its ``metadata.yaml``.

    Attributes:
        profiles: profiles that the headers of MCAP files state, each once.
        ros_distro: distribution of the recorder; empty if it is not known.
        custom_data: texts of the user. ``metadata.yaml`` overrides files, and later files override earlier ones.
        values: entries of rosbag2's metadata records that rosbag2 itself does not know.
        omitted: number of values that are not among these, by kind.
    """

    def __init__(self) -> None:
        self.profiles: list[str] = []
        self.ros_distro = ""
        self.custom_data: dict[str, str] = {}
        self.values: dict[str, str] = {}
        self.omitted: Counter[str] = Counter()

    @classmethod
    def of_bag(cls, reader: BagReader) -> RecordingData:
        """Return the data about a recording from all files of a bag and its ``metadata.yaml``."""
        recording = cls()
        for file in reader._files:
            recording.add_file(file)
        recording.add_metadata(reader._metadata)
        return recording

    def add_file(self, file: Storage) -> None:
        """Add the data about the recording that a file of the bag contains."""
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
    """Return the channel with type hash and QoS of ``metadata.yaml`` where the bag file does not state them."""
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
    """Return `channel` with the type and definition of `known`; unchanged if both are equal."""
    if (channel.type_name, channel.definition, channel.encoding) == (known.type_name, known.definition, known.encoding):
        return channel
    return replace(
        channel,
        type_name=known.type_name,
        definition=known.definition,
        encoding=known.encoding,
        type_hash=known.type_hash,
    )


def omission_lines(omitted: Mapping[str, int]) -> list[str]:
    """Return the lines that explain what is not in a copy: one line for each reason."""
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
