"""Copier of everything in one or several bags except messages, with counts of what the new bag cannot store.

Attachments, metadata records and schemas without a channel belong to the whole recording. They are copied whatever
topics and times are selected, as by ``mcap filter``. Metadata records are written first and attachments last, so that
chunks stay together. Each writer writes a new record ``rosbag2``, which contains the user's data of the old record
(docs/internals/protocol.md 16).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.common import OFFERED_QOS, TYPE_HASH, BagError
from rosidl_py_gen.bags.mcap_writer import BagWriter
from rosidl_py_gen.bags.metadata import qos_profiles, qos_text, recorder_data
from rosidl_py_gen.bags.reader import find_all_channels as find_all_channels
from rosidl_py_gen.bags.reader import stated_metadata, stored_channels, stored_files

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

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


def has_attachments(reader: BagReader) -> bool:
    """Return True if a bag has attachments that are not damaged."""
    return any(True for file in stored_files(reader) for _ in file.attachments())


class BagCopy:
    """Copy of the contents of open bags, except for their messages, into a new bag.

    Call `begin` before messages are written, and `end` after that.

    Attributes:
        recording: data about the whole recordings, from their files and ``metadata.yaml``.
        omitted: number of things that are not in the copy, by kind. Complete after `end`.
    """

    def __init__(self, readers: Sequence[BagReader], writer: BagWriter | SqliteWriter) -> None:
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
        files = [file for reader in self._readers for file in stored_files(reader)]
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
        for file in (file for reader in self._readers for file in stored_files(reader)):
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

    def _pass_on_metadata(self) -> None:
        """Pass the recorder's profile and distribution, and the user's custom data, from the old bags to the writer of
        the new bag.
        """
        recording = self.recording
        self.omitted += recording.omitted
        for reader in self._readers:
            metadata = stated_metadata(reader)
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
                by_profiles.setdefault(repr(qos_profiles(text) or text), text)
            texts = [*by_profiles.values()]
            hashes = [text for text in dict.fromkeys(one.type_hash for one in group) if text]
            qos = texts[0] if texts else ""
            if len(texts) > 1:  # all profiles, as in a bag that `ros2 bag convert` writes
                profiles = {text: qos_profiles(text) for text in texts}
                readable = [text for text in texts if profiles[text]]
                self.omitted["qos_profiles"] += len(texts) - max(1, len(readable))
                qos = qos_text([one for text in readable for one in profiles[text]]) if readable else qos
            self.omitted["type_hashes"] += max(0, len(hashes) - 1)
            merged[key] = replace(group[0], offered_qos=qos, type_hash=hashes[0] if hashes else "")
        return [{key: merged[target.key] for key, target in each.items()} for each in targets]


def _targets(reader: BagReader, channels: Mapping[tuple[str, ...], BagTopic]) -> dict[tuple[object, ...], BagTopic]:
    targets = {}
    for channel in stored_channels(reader):
        known = channels.get(channel.key)
        if known is not None:
            targets[channel.channel_key] = with_listed_values(stated_metadata(reader), _with_definition(channel, known))
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
            qos = qos_profiles(target.offered_qos) or target.offered_qos  # releases write one profile differently
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
    def of_bags(cls, readers: Iterable[BagReader]) -> RecordingData:
        """Return the data about the recordings of bags, from all their files; later bags override earlier ones."""
        recording = cls()
        for reader in readers:
            for file in stored_files(reader):
                recording.add_file(file)
            recording.add_metadata(stated_metadata(reader))
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


def omission_lines(omitted: Mapping[str, int]) -> list[str]:
    """Return lines of text for the user, one for each reason, about what the copy of a bag does not contain."""
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
