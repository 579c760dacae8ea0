"""Reader of MCAP files that uses the index of the file, or makes an index by reading the whole file.

A segment is a chunk, or a range of messages outside of chunks. Segments are read in the order of their first log time;
later messages wait until the next segment begins. The reader of the package `mcap` sorts message by message, and its
objects cost twice as much as decoding.
"""

from __future__ import annotations

import contextlib
from bisect import bisect_left, bisect_right
from dataclasses import replace
from functools import cached_property
from heapq import heapify, heappop, heappush
from io import SEEK_END
from itertools import chain, pairwise
from operator import attrgetter
from threading import RLock
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import OFFERED_QOS, TYPE_HASH, BagError, BagTopic, DamagedPart
from rosidl_py_gen.bags.remote import BagUnreachableError, opened
from rosidl_py_gen.bags.storage.mcap_index import DamagedRange, Index, MessageSegment, Walk, read_index, recorded_distro
from rosidl_py_gen.bags.storage.mcap_records import (
    COMPRESSIONS,
    MAX_WHOLE_CHUNK_BYTES,
    MIN_MESSAGE_BYTES,
    RECORD,
    ChunkDecompressor,
    Tally,
    TooLargeError,
    read_attachment,
    read_metadata,
    read_profile,
)
from rosidl_py_gen.bags.storage.storage_api import (
    LOG_TIME,
    MAX_UNPACKED_BYTES,
    BagChannel,
    MessageBlock,
    ReadingProgress,
    Storage,
    library_errors_as_bag_error,
)
from rosidl_py_gen.base.terminal_text import pluralize

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
    from pathlib import Path

    from mcap.records import Channel as ChannelRecord
    from mcap.records import Schema

    from rosidl_py_gen.bags.storage.mcap_records import ChunkHeader, StoredAttachment, StoredMetadata
    from rosidl_py_gen.bags.storage.storage_api import RawTuple

T = TypeVar("T")
_MESSAGE_BYTES = 200
"""Memory in bytes that a message takes while it waits for earlier messages, in addition to its data: a tuple, two
integers and a slice."""


class McapFile(Storage):
    """Reader of an MCAP file. A file without an index, as after a crash, is read from start to end.

    Args:
        max_decompressed_bytes: maximum size of a decompressed chunk, and of the messages that wait for earlier ones
            because chunks overlap in time.
        on_skipped: called with each damaged part that is skipped; None raises `BagError` for damage.
        progress: receives the progress of reading the file from start to end.
    """

    def __init__(
        self,
        path: Path,
        validate_crcs: bool,
        max_decompressed_bytes: int = MAX_UNPACKED_BYTES,
        on_skipped: Callable[[DamagedPart], None] | None = None,
        progress: ReadingProgress | None = None,
    ) -> None:
        self._path = path
        self._progress = progress or ReadingProgress()
        self._on_skipped = on_skipped
        self._max_bytes = max_decompressed_bytes
        self._chunks = ChunkDecompressor(path, self._read, max_decompressed_bytes, validate_crcs)
        self._lock = RLock()  # of `_stream`, which several iterations may read from
        self._stream = opened(path)
        self._is_ordered: dict[int, bool] = {}  # offset of a large chunk -> its messages are in order
        try:
            with library_errors_as_bag_error(path):
                self._size = self._stream.seek(0, SEEK_END)
                self._stream.seek(0)
                if not MCAP0_MAGIC.startswith(self._stream.read(len(MCAP0_MAGIC))):  # shorter: nothing was written yet
                    raise BagError(f"{path}: damaged: does not begin with the magic bytes of MCAP")
                self._stored_index = read_index(self._stream, self._read, self._size)
        except BaseException:
            self._stream.close()
            raise
        self.is_whole = self._stored_index is not None
        if not self.is_whole:
            self._progress.total += max(0, self._size - len(MCAP0_MAGIC))

    @cached_property
    def _index(self) -> Index:
        """Index of the MCAP file; if the file has none, an index made by reading the whole file."""
        if self._stored_index is not None:
            return self._stored_index
        index = Index()
        self._walk(index, len(MCAP0_MAGIC), self._size)
        return index

    @cached_property
    def _segments(self) -> list[MessageSegment]:
        """All segments (chunks, and ranges of messages outside of chunks) that contain messages, by first log time.

        An index lists chunks only, so ranges between chunks are searched for messages outside of chunks.
        """
        index = self._index
        if index.unindexed_ranges:
            unchunked = Index(index.segments, index.channels, index.schemas, other=index.other)
            for start, end in index.unindexed_ranges:
                if start < end:
                    self._progress.total += end - start
                    self._walk(unchunked, start, end)
            if not any(segment.is_chunk for segment in index.segments):
                self._require_counts(index, unchunked)
            index.unindexed_ranges = []
            spans = [one for one in (index.time_range, unchunked.time_range) if one is not None]
            index.time_range = (min(one[0] for one in spans), max(one[1] for one in spans)) if spans else None
        return sorted(index.segments, key=attrgetter("first"))

    def _require_counts(self, index: Index, unchunked: Index) -> None:
        """Raise `BagError` if a file without chunks states other message counts than were found in it."""
        stated = {number: count for number, count in (index.counts or {}).items() if count}
        if index.counts is not None and stated != unchunked.counts:
            raise BagError(
                f"{self._path}: damaged: states {pluralize(sum(stated.values()), 'message')}, and contains "
                f"{sum((unchunked.counts or {}).values())}"
            )

    def _walk(self, index: Index, start: int, end: int) -> None:
        damaged_ranges: list[DamagedRange] = []  # reported at the end, when all topics are known
        skips = self._on_skipped is not None
        on_damage = damaged_ranges.append if skips else lambda one: self._report_damage(one, index)
        with library_errors_as_bag_error(self._path), self._lock:
            try:
                show = self._progress.show
                Walk(self._size, self._chunks, index, on_damage, skips, show).run(start, end)
                self._progress.end_file(end - start)
            except BagError as error:
                raise error if str(self._path) in str(error) else BagError(f"{self._path}: {error}") from None
        for one in damaged_ranges:
            self._report_damage(one, index)

    def _report_damage(self, damage: DamagedRange, index: Index) -> None:
        names = None
        if damage.channels is not None:
            names = tuple(sorted({index.channels[one].topic for one in damage.channels if one in index.channels}))
        reason = str(damage.error).removeprefix(f"{self._path}: ").removeprefix("damaged: ")
        size = damage.end - damage.offset
        part = DamagedPart(self._path, damage.offset, size, reason, names, damage.first, damage.last)
        if self._on_skipped is None:
            raise BagError(f"{self._path}: damaged: {reason} ({part.place})") from None
        self._on_skipped(part)

    def _reporting_damage(self, segment: MessageSegment, contents: Iterator[T]) -> Iterator[T]:
        try:
            with library_errors_as_bag_error(self._path):
                yield from contents
        except (BagUnreachableError, TooLargeError):
            raise
        except BagError as error:
            begin = segment.offset - RECORD.size if segment.is_chunk else segment.offset
            self._report_damage(
                DamagedRange(begin, segment.end, error, segment.first, segment.last, segment.channels), self._index
            )

    @property
    def unread_bytes(self) -> int:
        return self._index.truncated_bytes

    def ros_distro(self) -> str:
        with library_errors_as_bag_error(self._path), self._lock:
            return recorded_distro(self._stream, self._size)

    def stored_channels(self) -> list[BagTopic]:
        index = self._index
        with library_errors_as_bag_error(self._path):
            return [channel.info for channel in self._channels(index).values()]

    def unused_schemas(self) -> list[BagTopic]:
        index = self._walked_index()
        used = {channel.schema_id for channel in index.channels.values()}
        return [_described("", one) for number, one in index.schemas.items() if number not in used]

    def profile(self) -> str | None:
        other = self._walked_index().other
        return None if other.header is None else read_profile(self._read, other.header)

    def chunk_compression(self) -> str:
        """Return the compression of the first chunk with a known compression; "" without such a chunk."""
        with library_errors_as_bag_error(self._path):
            for segment in self._segments:
                if segment.is_chunk and segment.is_finished:
                    with contextlib.suppress(BagError, UnicodeDecodeError):  # a damaged header
                        name = self._chunks.header(segment.offset, segment.end).compression
                        if name in COMPRESSIONS:
                            return name
        return ""

    def metadata_records(self) -> Iterator[StoredMetadata]:
        return self._intact(self._walked_index().other.metadata, lambda at: read_metadata(self._read, at))

    def attachments(self) -> Iterator[StoredAttachment]:
        validates = self._chunks.validate_crcs
        offsets = self._walked_index().other.attachments
        return self._intact(offsets, lambda at: read_attachment(self._read, at, validates))

    def unknown_records(self) -> int:
        other = self._walked_index().other
        return other.unknown + sum(other.unknown_in_chunks.values())

    def _walked_index(self) -> Index:
        """Return the file's index, completed by the records that are between the indexed chunks."""
        with library_errors_as_bag_error(self._path):
            _ = self._segments
        return self._index

    def _intact(self, offsets: Iterable[int], read: Callable[[int], T]) -> Iterator[T]:
        """Yield the records that the function `read` returns for the given offsets.

        Damaged records are reported and skipped.
        """
        for at in offsets:
            try:
                with library_errors_as_bag_error(self._path):
                    record = read(at)
            except BagUnreachableError:
                raise
            except BagError as error:
                end = min(self._size, at + RECORD.size + RECORD.unpack(self._read(at, RECORD.size))[1])
                self._report_damage(DamagedRange(at, end, error, channels=()), self._index)
            else:
                yield record

    def _channels(self, index: Index) -> dict[int, BagChannel]:
        counts = index.counts
        return {
            number: BagChannel(
                _topic_of(
                    one,
                    index.schemas.get(one.schema_id) if one.schema_id else None,
                    None if counts is None else counts.get(number, 0),
                )
            )
            for number, one in index.channels.items()
        }

    def span(self) -> tuple[int, int] | None:
        if self._index.counts is None:  # no statistics, so messages outside of chunks are searched
            with library_errors_as_bag_error(self._path):
                return self._index.time_range if self._segments else None
        return self._index.time_range

    def segments(self) -> list[tuple[int, int]]:
        if self._stored_index is None:
            return []
        with library_errors_as_bag_error(self._path):
            return [(one.first, one.end - one.offset) for one in self._segments]

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
        with library_errors_as_bag_error(self._path):
            yield from self._merge_by_time(topics, start, end)

    def _select(
        self, topics: Collection[str] | None, start: int, end: int
    ) -> tuple[list[MessageSegment], dict[int, BagChannel], dict[int, BagChannel]]:
        """Return the segments of the file that may contain requested messages, the requested channels by id, and all
        channels by id.
        """
        segments = [one for one in self._segments if one.first < end and one.last >= start]
        known = self._channels(self._index)
        requested = {number: one for number, one in known.items() if topics is None or one.topic in topics}
        if topics is not None:
            segments = [
                one for one in segments if one.channels is None or not requested.keys().isdisjoint(one.channels)
            ]
        return segments, requested, known

    def _merge_by_time(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
        segments, requested, known = self._select(topics, start, end)
        buffer = _MergeBuffer()
        due = [
            (segment.first, number, self._reporting_damage(segment, self._blocks(segment, requested, known)))
            for number, segment in enumerate(segments)
        ]
        heapify(due)
        while due:
            since, number, blocks = heappop(due)
            if (block := next(blocks, None)) is None:
                continue
            messages, size, has_more = block
            if has_more:
                heappush(due, (messages[-1][2] if messages else since, number, blocks))
            if messages and (messages[0][2] < start or messages[-1][2] >= end):
                messages = [one for one in messages if start <= one[2] < end]
            del block
            before = due[0][0] if due else None
            if buffer.is_empty and (before is None or not messages or messages[-1][2] < before):
                yield from messages
            else:
                buffer.add(messages)
                yield from buffer.before(before)
                if buffer.size > self._max_bytes:
                    raise BagError(
                        f"{self._path}: chunks overlap in time so much that {buffer.size} bytes of messages have to "
                        f"wait; expected at most {self._max_bytes}, unless max_decompressed_bytes is more"
                    )
            if size > MAX_WHOLE_CHUNK_BYTES:  # memory of smaller ones is reused by the next chunk
                del messages
        yield from buffer.before(None)

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        with library_errors_as_bag_error(self._path):
            segments, requested, known = self._select(topics, start, end)
            if len({one.topic for one in requested.values()}) < len(requested):  # messages of its channels may be mixed
                return None
            if any(one.last > other.first for one, other in pairwise(segments)):
                return None
        return chain.from_iterable(
            self._reporting_damage(segment, self._segment_blocks(segment, requested, known, start, end))
            for segment in segments
        )

    def _segment_blocks(
        self, segment: MessageSegment, requested: Container[int], known: Mapping[int, BagChannel], start: int, end: int
    ) -> Iterator[MessageBlock]:
        for data, size, _ in self._contents(segment, known):
            heads, begin = self._chunks.message_headers(data, known, size)
            by_channel = np.argsort(heads["channel"], kind="stable")
            bounds = np.flatnonzero(np.diff(heads["channel"][by_channel])) + 1
            for rows_of_channel in np.split(by_channel, bounds) if len(heads) else ():
                number = int(heads["channel"][rows_of_channel[0]])
                if number in requested:
                    rows = heads[rows_of_channel]
                    sizes = rows["length"].astype(np.int64) - MIN_MESSAGE_BYTES
                    starts = begin[rows_of_channel]
                    block = MessageBlock(known[number], data, starts, sizes, rows["log"], rows["publish"])
                    yield from self._select_rows(block, segment, start, end)

    def _select_rows(
        self, block: MessageBlock, segment: MessageSegment, start: int, end: int
    ) -> Iterator[MessageBlock]:
        times = block.log_times
        self._require_span(segment, int(times.min()), int(times.max()))
        rows = np.arange(len(times))
        if start > segment.first or end <= segment.last:
            rows = np.flatnonzero((times >= start) & (times <= min(end, 1 << 64) - 1))
        if (times[1:] < times[:-1]).any():
            rows = rows[np.argsort(times[rows], kind="stable")]
        if len(rows):
            whole = len(rows) == len(times) and rows[0] == 0 and (np.diff(rows) == 1).all()
            yield block if whole else block.rows(rows)

    def _contents(
        self, segment: MessageSegment, known: Container[int]
    ) -> Iterator[tuple[bytes | bytearray, int, bool]]:
        """Yield the records of a segment (a chunk, or messages outside of chunks), in blocks if it is a large chunk.

        Each item is a tuple: data, size of the whole records in the data (-1 for all data), True if more blocks may
        follow.
        """
        if not segment.is_finished:
            yield self._chunks.unfinished(segment.offset, segment.end)[0], -1, False
            return
        head = self._chunks.header(segment.offset, segment.end) if segment.is_chunk else None
        if head is None:
            yield self._read(segment.offset, max(0, segment.end - segment.offset)), -1, False
        elif not self._reads_in_blocks(head, known):
            yield self._chunks.decompress(head), -1, False
        else:
            for data, size in self._chunks.blocks(head, False):  # its checksum was compared
                yield data, size, True

    def _blocks(
        self, segment: MessageSegment, requested: Mapping[int, BagChannel], known: Container[int]
    ) -> Iterator[tuple[list[RawTuple], int, bool]]:
        """Yield the requested messages of a segment (a chunk, or messages outside of chunks), sorted by log time within
        a block.

        Each item is a tuple: messages, size of the block's data, True if more blocks may follow.
        """
        unknown = Tally()
        for data, whole, has_more in self._contents(segment, known):
            messages = self._chunks.messages(data, requested, known, whole, unknown)
            size = len(data)
            del data
            if messages:
                messages.sort(key=LOG_TIME)
                self._require_span(segment, messages[0][2], messages[-1][2])
            if unknown.count and segment.is_chunk:  # outside of chunks, the walk counts them
                self._index.other.unknown_in_chunks[segment.offset] = unknown.count
            yield messages, size, has_more

    def _reads_in_blocks(self, head: ChunkHeader, known: Container[int]) -> bool:
        """Return True if a chunk is large and its messages are in order of log time.

        Finding out the order requires reading the chunk once.
        """
        if not self._chunks.is_large(head):
            return False
        is_ordered = self._is_ordered.get(head.at)
        if is_ordered is None:
            last, is_ordered = 0, True
            everything = self._channels(self._index)
            for some, whole in self._chunks.blocks(head, self._chunks.validate_crcs):
                for _, _, log_time, _, _ in self._chunks.messages(some, everything, known, whole):
                    is_ordered, last = is_ordered and log_time >= last, log_time
            self._is_ordered[head.at] = is_ordered
        return is_ordered

    def _require_span(self, segment: MessageSegment, first: int, last: int) -> None:
        if first < segment.first or last > segment.last:
            raise BagError(
                f"{self._path}: damaged: a chunk states messages from {segment.first} to {segment.last} ns, and "
                f"contains some from {first} to {last} ns"
            )

    def _read(self, at: int, size: int) -> bytes:
        with self._lock:
            self._stream.seek(at)
            return self._stream.read(size)

    def close(self) -> None:
        self._stream.close()


def _described(topic: str, schema: Schema | None) -> BagTopic:
    if schema is None:
        return BagTopic(topic, "", "", "")
    text = schema.data.decode(errors="replace")
    return BagTopic(topic, schema.name, text, schema.encoding, schema_data=schema.data)


def _topic_of(channel: ChannelRecord, schema: Schema | None, count: int | None) -> BagTopic:
    stated = channel.metadata
    return replace(
        _described(channel.topic, schema),
        message_encoding=channel.message_encoding,
        type_hash=stated.get(TYPE_HASH, ""),
        offered_qos=stated.get(OFFERED_QOS, ""),
        count=count,
        metadata=stated,
    )


class _MergeBuffer:
    """Heap of messages from chunks that overlap in time; a message waits in it until no earlier message can follow.

    The heap merges runs of messages, each sorted by log time: n messages of m chunks take n log m operations.

    Attributes:
        size: memory of the messages, in bytes.
    """

    def __init__(self) -> None:
        self.size = 0
        self._count = 0
        # Next log time, number, position of the next message, and messages of each run.
        self._runs: list[tuple[int, int, int, list[RawTuple]]] = []

    @property
    def is_empty(self) -> bool:
        return not self._runs

    def add(self, run: list[RawTuple]) -> None:
        """Add messages that are sorted by log time; at equal log times, messages added earlier come first."""
        if run:
            heappush(self._runs, (run[0][2], self._count, 0, run))
            self._count += 1
            self.size += _memory_of(run)

    def before(self, end: int | None) -> Iterator[RawTuple]:
        """Remove and yield the waiting messages with ``log_time < end`` by log time; all of them if `end` is None."""
        runs = self._runs
        while runs and (end is None or runs[0][0] < end):
            _, number, at, run = heappop(runs)
            to = len(run) if end is None else bisect_left(run, end, at, key=LOG_TIME)
            if runs and run[to - 1][2] >= runs[0][0]:
                find = bisect_right if number < runs[0][1] else bisect_left
                to = find(run, runs[0][0], at, to, key=LOG_TIME)
            due = run[at:to]
            if to < len(run):
                heappush(runs, (run[to][2], number, to, run))
            self.size -= _memory_of(due)
            del run
            yield from due


def _memory_of(messages: list[RawTuple]) -> int:
    return _MESSAGE_BYTES * len(messages) + sum(len(message[1]) for message in messages)
