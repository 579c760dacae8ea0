"""Parts shared by the readers and writers of bags: topics, messages, errors, warnings, checks, durable file writing."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from types import GenericAlias
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.errors import RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Generic

    from typing_extensions import TypeVar

    T = TypeVar("T", default=Any)

OFFERED_QOS, TYPE_HASH = "offered_qos_profiles", "topic_type_hash"
"""MCAP metadata keys under which rosbag2 stores the QoS and the type hash of a topic in its channel."""
_MAX_TEXT = 4000


class BagError(RosidlError, ValueError):
    """Error of a bag that is damaged, of an unknown kind, or cannot be written.

    Names in bags and tables are not trusted: the text is printable, and truncated if it is very long.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(printable(text, _MAX_TEXT))


@dataclass(frozen=True, slots=True)
class BagTopic:
    """Topic of a bag, with the definition of its messages.

    Attributes:
        type_name: ``pkg/msg/Name``.
        definition: definition text of the type with all types it uses; empty if the bag does not contain it.
        encoding: language of the definition: ``ros2msg`` or ``ros2idl``.
        message_encoding: serialization of the messages: ``cdr`` for everything of ROS 2.
        type_hash: RIHS01 text; empty if the bag does not contain it.
        offered_qos: YAML in the format of rosbag2; empty if the bag does not contain it.
        count: number of messages; None if not known, as for MCAP files without statistics.
        metadata: all metadata of the MCAP channel; None for channels of other storages.
        schema_data: bytes of the MCAP schema, which may be no text; None without a schema.
    """

    name: str
    type_name: str
    definition: str = field(default="", repr=False)
    encoding: str = "ros2msg"
    message_encoding: str = "cdr"
    type_hash: str = ""
    offered_qos: str = field(default="", repr=False)
    count: int | None = None
    metadata: Mapping[str, str] | None = field(default=None, repr=False, compare=False)
    schema_data: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def definition_bytes(self) -> bytes:
        """Definition of the topic as bytes.

        They are the bytes of the MCAP schema, unless `definition` has been changed to another text.
        """
        data = self.schema_data
        if data is not None and data.decode(errors="replace") == self.definition:
            return data
        return self.definition.encode()

    @property
    def channel_key(self) -> tuple[object, ...]:
        """Key that is equal for two stored channels only if topic, definition, schema bytes, QoS, type hash and all
        metadata are equal.
        """
        metadata = None if self.metadata is None else tuple(sorted(self.metadata.items()))
        return self.key, self.type_hash, self.offered_qos, metadata, self.schema_data

    @property
    def key(self) -> tuple[str, ...]:
        """Key that is equal for two channels if their topic name, and everything that decides how messages are decoded,
        is equal.
        """
        by_hash = "" if self.definition else self.type_hash
        return self.name, self.type_name, self.message_encoding, self.encoding, self.definition, by_hash


def checked_time(nanoseconds: int, topic: str, what: str, bits: int = 63) -> int:
    """Return a time in nanoseconds unchanged if a bag can store it.

    Raises `BagError` for a time below 0, or a time that needs more than `bits` bits.
    """
    if not 0 <= nanoseconds < 1 << bits:
        raise BagError(f"{topic}: {what} time {nanoseconds} is not from 0 to 2**{bits}-1 ns")
    return nanoseconds


def require_printable(topic: str) -> None:
    """Raise `BagError` for a topic name with control characters, which could steer a terminal that prints it."""
    if printable(topic) != topic:
        raise BagError(f"topic {printable(topic)[:200]!r}: expected a name without control characters")


class DurableFile:
    """File that is written at the temporary path `partial`, and replaces `target` after a ``with`` block.

    If the block raises an exception, the temporary file is removed and `target` is unchanged. After a power cut
    `target` is the old or the new file, never an incomplete file.
    """

    def __init__(self, target: Path) -> None:
        self.target = target
        self.partial = target.with_name(f".{target.name}")

    def __enter__(self) -> Path:
        return self.partial

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        is_target = False
        try:
            if kind is None:
                sync_file(self.partial)
                self.partial.replace(self.target)
                is_target = True
        finally:
            if not is_target:
                self.partial.unlink(missing_ok=True)
        if is_target:
            sync_folder(self.target.parent)


def sync_file(file: Path) -> None:
    """Wait until the contents of a file are on the disk."""
    with file.open("r+b") as stream:  # Windows syncs only what is open for writing
        os.fsync(stream.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the directory entries of a folder are on the disk (POSIX only)."""
    if os.name == "posix":  # other systems cannot open a folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


if TYPE_CHECKING:

    class BagMessage(NamedTuple, Generic[T]):
        topic: str
        message: T
        log_time: int
        publish_time: int

else:  # Python 3.10 has no generic named tuples

    class BagMessage(NamedTuple):
        """Message of a bag; times are nanoseconds since 1970.

        Attributes:
            message: an instance of the topic's class; bytes if read with `raw`.
            log_time: when the message was recorded.
            publish_time: when the message was published, as far as the recorder knew.
        """

        topic: str
        message: Any
        log_time: int
        publish_time: int

        __class_getitem__ = classmethod(GenericAlias)


class RawMessage(NamedTuple):
    """Serialized message with the channel that it was written to; times are nanoseconds since 1970.

    Attributes:
        channel: the topic with the definition of this message.
        log_time: when the message was recorded.
        publish_time: when the message was published, as far as the recorder knew.
        sequence: number that the recorder or publisher gave the message; 0 if there is none, as in SQLite bags.
    """

    channel: BagTopic
    data: bytes
    log_time: int
    publish_time: int
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class DamagedPart:
    """Damaged part of an MCAP file, which a reader with ``skip_damaged=True`` skips.

    Attributes:
        offset: start in the file, in bytes; for a compressed file, in the decompressed content.
        size: length in bytes.
        reason: description of the damage.
        topics: names of the topics that have messages there; None if not known.
        start_ns, end_ns: log times of the first and the last of its messages; None if not known.
    """

    file: Path
    offset: int
    size: int
    reason: str
    topics: tuple[str, ...] | None = None
    start_ns: int | None = None
    end_ns: int | None = None

    @property
    def place(self) -> str:
        """Text for error messages that states size, offset, log times and topics of the damaged part."""
        times = "unknown times" if self.start_ns is None else f"log times from {self.start_ns} to {self.end_ns} ns"
        topics = "unknown topics" if self.topics is None else f"topics {', '.join(self.topics) or '(none)'}"
        return f"{self.size} bytes at byte {self.offset}, {times}, {topics}"


@dataclass(frozen=True, slots=True)
class SkippedMessages:
    """Number of messages of one topic that a reader could not decode and therefore skipped, with the reason.

    Attributes:
        count: number of messages so far, in all calls of `BagReader.messages`.
        reason: why the messages cannot be decoded.
    """

    count: int
    reason: str


class BagWarning(UserWarning):
    """Warning about messages that are skipped, or decoded with a definition that the bag does not contain."""
