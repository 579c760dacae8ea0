"""Interface of the readers of bag files, and functions that merge messages and channels of several files.

Every message refers to the channel to which it was written, because a topic may have been recorded with several
definitions. Any exception that a library raises for damaged files becomes a `BagError` that names the file.
"""

from __future__ import annotations

import contextlib
import heapq
from dataclasses import replace
from itertools import chain, pairwise
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, TypeVar

from rosidl_py_gen.bags.common import BagError, BagMessage, BagTopic, RawMessage
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from rosidl_py_gen.bags.storage.mcap_records import StoredAttachment, StoredMetadata

K = TypeVar("K")
MAX_TIME = (1 << 64) - 1
"""Maximum log time in nanoseconds that MCAP can store (2**64 - 1); SQLite stores half of this range."""
MAX_UNPACKED_BYTES = 1 << 30
"""Default limit in bytes of data that is decompressed at once."""
LOG_TIME = itemgetter(2)


class ReadingProgress:
    """Progress of reading or decompressing the files of a bag, with an optional callback.

    Attributes:
        total: number of bytes of all files to read.
        position: number of bytes read of the current file.
    """

    def __init__(self, on_progress: Callable[[int, int], object] | None = None) -> None:
        self._on_progress = on_progress
        self._done = self.total = self.position = 0

    def show(self, position: int) -> None:
        """Report to the callback that the current file is read up to a position."""
        self.position = position
        if self._on_progress is not None:
            self._on_progress(self._done + position, self.total)

    def end_file(self, size: int) -> None:
        """Report to the callback that the current file of `size` bytes is read completely."""
        self._done += size
        self.show(0)


class BagChannel:
    """Topic with the definition of its messages. Compared by identity, as it is a dictionary key for each message."""

    __slots__ = ("info", "topic")

    def __init__(self, info: BagTopic) -> None:
        self.info = info
        self.topic = info.name


_NO_CHANNEL = BagChannel(BagTopic("", ""))
"""Channel of placeholder messages, which keep the merge of several files from reading a file before its first log time.
"""
RawTuple: TypeAlias = "tuple[BagChannel, bytes | memoryview, int, int, int]"
"""Stored message as a tuple of channel, data, log time, publish time and sequence number, which takes a third of the
time of a class. The data of a large message share the memory of their chunk, and so do arrays that are decoded from
them."""


class MessageBlock(NamedTuple):
    """Messages of one channel sorted by log time, as arrays with one element for each message.

    `data` has the bytes of all messages.

    Attributes:
        begin, size: offset of each message in `data`, and its size in bytes.
    """

    channel: BagChannel
    data: bytes | bytearray
    begin: NDArray[np.int64]
    size: NDArray[np.int64]
    log_times: NDArray[np.uint64]
    publish_times: NDArray[np.uint64]

    def rows(self, chosen: slice | NDArray[np.int64]) -> MessageBlock:
        """Return a block that contains only the chosen messages and shares `data` with this block."""
        begin, size, log_times, publish_times = (one[chosen] for one in self[2:])
        return MessageBlock(self.channel, self.data, begin, size, log_times, publish_times)  # type: ignore[arg-type]


class Storage(Protocol):
    """Interface of the reader of one bag file."""

    is_whole: bool = True
    """False if the file has no index, as after a crash."""

    @property
    def unread_bytes(self) -> int:
        """Size in bytes of an unfinished record at the end of the file."""
        return 0

    @property
    def has_journal(self) -> bool:
        """True if the last messages are in a SQLite journal next to the file, as after a crash."""
        return False

    def stored_channels(self) -> list[BagTopic]:
        """Return the channels of the file, with message counts if known; a topic may have several channels."""

    def ros_distro(self) -> str:
        """Return the ROS distribution of the recorder, if the file states it; else ""."""

    def unused_schemas(self) -> list[BagTopic]:
        """Return the schemas of the file that no channel uses, as topics without a name."""
        return []

    def profile(self) -> str | None:
        """Return the profile in the header of an MCAP file; None without a header, and for other storages."""
        return None

    def chunk_compression(self) -> str:
        """Return the compression of the chunks of an MCAP file; "" without compression, and for other storages."""
        return ""

    def metadata_texts(self) -> list[str]:
        """Return the texts of ``metadata.yaml`` that a SQLite file stores in a table."""
        return []

    def metadata_records(self) -> Iterator[StoredMetadata]:
        """Yield the metadata records of an MCAP file; damaged records are reported and skipped."""
        return iter(())

    def attachments(self) -> Iterator[StoredAttachment]:
        """Yield the attachments of an MCAP file; damaged attachments are reported and skipped."""
        return iter(())

    def unknown_records(self) -> int:
        """Return the number of MCAP records of unknown kinds, which is complete after all messages were read."""
        return 0

    def unknown_tables(self) -> int:
        """Return the number of tables of a SQLite file that rosbag2 does not know."""
        return 0

    def span(self) -> tuple[int, int] | None:
        """Return the log times of the first and the last message; None without messages."""

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
        """Yield messages with ``start <= log_time < end`` before decoding, by log time; None means all topics."""

    def stored_messages(self) -> Iterator[RawTuple]:
        """Yield all messages by log time without decompressing messages that rosbag2 compressed one by one."""
        return self.messages(None, 0, MAX_TIME + 1)

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        """Yield messages with ``start <= log_time < end`` in blocks of one channel, ordered by log time for each topic.

        Returns None if the messages cannot be read in this order.
        """
        return None

    def segments(self) -> list[tuple[int, int]]:
        """Return first log time and size of each segment of the file (chunk, or messages outside of chunks).

        Returns [] if that requires reading the file.
        """
        return []

    def close(self) -> None:
        """Close the bag file; may be called repeatedly."""


@contextlib.contextmanager
def library_errors_as_bag_error(path: Path) -> Iterator[None]:
    """Raise exceptions that libraries raise over damaged data as a `BagError` that names the file."""
    try:
        yield
    except (RosidlError, GeneratorExit):
        raise
    except MemoryError:
        raise BagError(f"{path}: damaged: a length in it is larger than memory") from None
    except Exception as error:  # compression libraries, struct, sqlite: arbitrary exceptions for damaged data
        raise BagError(f"{path}: damaged: {type(error).__name__}: {str(error)[:200]}") from None


def as_bag_messages(messages: Iterable[RawTuple]) -> Iterator[BagMessage]:
    """Yield stored messages as `BagMessage` whose message is the CDR bytes.

    No chunk stays in memory while the next is read.
    """
    make = tuple.__new__  # in half the time of a call of the class
    for channel, data, log_time, publish_time, _ in messages:
        made = make(BagMessage, (channel.topic, bytes(data), log_time, publish_time))
        del data
        yield made
        del made


def as_raw_messages(messages: Iterable[RawTuple]) -> Iterator[RawMessage]:
    """Yield stored messages as `RawMessage`; no chunk stays in memory while the next is read."""
    make = tuple.__new__
    for channel, data, log_time, publish_time, sequence in messages:
        made = make(RawMessage, (channel.info, bytes(data), log_time, publish_time, sequence))
        del data
        yield made
        del made


def merge_by_time(files: list[Storage], topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
    """Yield the messages of several bag files, merged by log time; `topics=None` selects all topics."""
    if len(files) == 1:
        return files[0].messages(topics, start, end)
    each = []
    for file in files:
        span = file.span()
        if span is not None and span[0] < end and span[1] >= start:
            each.append(chain(((_NO_CHANNEL, b"", span[0], 0, 0),), _open_when_due(file, topics, start, end)))
    return (one for one in heapq.merge(*each, key=LOG_TIME) if one[0] is not _NO_CHANNEL)


def _open_when_due(file: Storage, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
    """Yield the messages of a bag file.

    The file is read only when the first message is requested, so that few chunks are in memory.
    """
    yield from file.messages(topics, start, end)


class TableInput(NamedTuple):
    """Messages of a bag from which a table is made.

    Attributes:
        messages_or_blocks: messages by log time, or blocks of messages that are ordered for each topic.
        decoded: function that decodes stored messages, and raises or skips errors as the caller requested.
    """

    messages_or_blocks: Iterator[MessageBlock] | Iterator[RawTuple]
    decoded: Callable[[Iterable[RawTuple]], Iterator[BagMessage]]


def as_table_input(
    files: list[Storage], topics: Collection[str] | None, start: int, end: int
) -> Iterator[MessageBlock] | Iterator[RawTuple]:
    """Return the messages of bag files as blocks, or one by one by log time if the files overlap in time."""
    due = [(span, file) for file in files if (span := file.span()) is not None and span[0] < end and span[1] >= start]
    due.sort(key=itemgetter(0))
    if not any(one[0][1] > other[0][0] for one, other in pairwise(due)):
        each = [file.blocks(topics, max(0, start), end) for _, file in due]
        blocks = [one for one in each if one is not None]
        if len(blocks) == len(each):
            return chain.from_iterable(blocks)
    return merge_by_time(files, topics, start, end)


def split_times(files: Iterable[Storage], size: int) -> list[int]:
    """Return log times that split a bag into slices of about `size` stored bytes; [] if the bag is not larger."""
    times: list[int] = []
    slice_bytes, slice_start = 0, None
    for first, stored in sorted(segment for file in files for segment in file.segments()):
        slice_start = first if slice_start is None else slice_start
        if slice_bytes >= size and first > slice_start:
            times.append(first)
            slice_bytes, slice_start = 0, first
        slice_bytes += stored
    return times


def merge_stored_channels(channels: Iterable[BagTopic]) -> list[BagTopic]:
    """Return the stored channels of several files without duplicates; message counts of equal channels are added up."""
    return list(_merged(channels, attrgetter("channel_key")).values())


def merge_channels(channels: Iterable[BagTopic]) -> list[BagTopic]:
    """Return one channel for each topic and definition, with message counts added up.

    A file may have several equal channels.
    """
    return sorted(_merged(channels, attrgetter("key")).values(), key=attrgetter("name"))


def topics_by_name(channels: Iterable[BagTopic]) -> dict[str, BagTopic]:
    """Return one entry for each topic name: its first channel with a definition, and the count of all its messages."""
    return dict(sorted(_merged(channels, attrgetter("name")).items()))


def _merged(channels: Iterable[BagTopic], key_of: Callable[[BagTopic], K]) -> dict[K, BagTopic]:
    merged: dict[K, BagTopic] = {}
    for channel in channels:
        key = key_of(channel)
        previous = merged.get(key)
        if previous is not None:
            counts = previous.count, channel.count
            count = None if None in counts else sum(counts)  # type: ignore[arg-type]
            channel = replace(previous if previous.definition or not channel.definition else channel, count=count)
        merged[key] = channel
    return merged
