"""An MCAP file, with the index it has or one that is made by walking through it.

Decides the order: parts are read by the time of their first message, and what is later than the beginning of the next
one waits for it. The package's own reader orders message by message, and its objects cost twice as much as decoding.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from heapq import heapify, heappop, heappush
from io import SEEK_END
from itertools import pairwise
from operator import attrgetter
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError, BagTopic, DamagedPart
from rosidl_py_gen.bags.remote import BagUnreachableError, opened
from rosidl_py_gen.bags.storage.damage import Damage
from rosidl_py_gen.bags.storage.mcap_chunks import (
    MAX_WHOLE_CHUNK_BYTES,
    MIN_MESSAGE_BYTES,
    RECORD,
    ChunkDecompressor,
    TooLargeError,
    is_large,
    iter_chunk_blocks,
    read_chunk_header,
)
from rosidl_py_gen.bags.storage.mcap_index import Index, MessageSegment, read_index
from rosidl_py_gen.bags.storage.storage_api import (
    LOG_TIME,
    MAX_UNPACKED_BYTES,
    BagChannel,
    MessageBlock,
    library_errors_as_bag_error,
)
from rosidl_py_gen.bags.storage.waiting import Waiting
from rosidl_py_gen.bags.storage.walk import Walk

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
    from pathlib import Path

    from mcap.records import Channel as ChannelRecord
    from mcap.records import Schema
    from numpy.typing import NDArray

    from rosidl_py_gen.bags.storage.mcap_chunks import ChunkHeader
    from rosidl_py_gen.bags.storage.storage_api import Raw


T = TypeVar("T")


class McapFile:
    """An MCAP file; without an index, as after a crash, it is read from the beginning to where it ends.

    Args:
        max_decompressed_bytes: the most that a chunk may become, and that messages of chunks which overlap in time
            may take while they wait for their turn.
        on_skipped: called with each damaged part, which is skipped then; None raises `BagError`.
    """

    def __init__(
        self,
        path: Path,
        validate_crcs: bool,
        max_decompressed_bytes: int = MAX_UNPACKED_BYTES,
        on_skipped: Callable[[DamagedPart], None] | None = None,
    ) -> None:
        self._path = path
        self._on_skipped = on_skipped
        self._max_bytes = max_decompressed_bytes
        self._unpacker = ChunkDecompressor(path, max_decompressed_bytes, validate_crcs)
        self._reading = Lock()  # of `_stream`, which several iterations may read from
        self._stream = opened(path)
        self._ordered: dict[int, bool] = {}  # of large chunks, by where they are
        try:
            with library_errors_as_bag_error(path):
                self._size = self._stream.seek(0, SEEK_END)
                self._stream.seek(0)
                if not MCAP0_MAGIC.startswith(self._stream.read(len(MCAP0_MAGIC))):  # shorter: nothing was written yet
                    raise BagError(f"{path}: damaged: it does not begin as MCAP files do")
                self._own = read_index(self._stream, self._size)
        except BaseException:
            self._stream.close()
            raise
        self.is_whole = self._own is not None

    @cached_property
    def _index(self) -> Index:
        """What the file says of itself, or else what is in it."""
        if self._own is not None:
            return self._own
        index = Index()
        self._walk(index, len(MCAP0_MAGIC), self._size)
        return index

    @cached_property
    def _parts(self) -> list[MessageSegment]:
        """Everything with messages. An index speaks of chunks only, but messages may lie outside of them."""
        index = self._index
        if index.unindexed_ranges:
            loose = Index(channels=index.channels, schemas=index.schemas, parts=index.parts)
            for start, end in index.unindexed_ranges:
                if start < end:
                    self._walk(loose, start, end)
            if not any(part.is_chunk for part in index.parts):
                self._require_counts(index, loose)
            index.unindexed_ranges = []
            spans = [one for one in (index.time_range, loose.time_range) if one is not None]
            index.time_range = (min(one[0] for one in spans), max(one[1] for one in spans)) if spans else None
        return sorted(index.parts, key=attrgetter("first"))

    def _require_counts(self, index: Index, loose: Index) -> None:
        """Raises `BagError` when no message is in a chunk, and there are not as many as the statistics say."""
        told = {number: count for number, count in (index.counts or {}).items() if count}
        if index.counts is not None and told != loose.counts:
            raise BagError(
                f"{self._path}: damaged: it says it has {sum(told.values())} messages, and "
                f"{sum((loose.counts or {}).values())} were found"
            )

    def _walk(self, index: Index, start: int, end: int) -> None:
        found: list[Damage] = []  # reported at the end, as topics may be known only then
        skips = self._on_skipped is not None
        on_damage = found.append if skips else lambda one: self._damaged(one, index)
        with library_errors_as_bag_error(self._path), self._reading:
            try:
                Walk(self._stream, self._size, self._unpacker, index, on_damage, skips).run(start, end)
            except BagError as error:
                raise error if str(self._path) in str(error) else BagError(f"{self._path}: {error}") from None
        for one in found:
            self._damaged(one, index)

    def _damaged(self, damage: Damage, index: Index) -> None:
        """Report a damaged part, or raise `BagError` if the reader does not skip it."""
        names = None
        if damage.channels is not None:
            names = tuple(sorted({index.channels[one].topic for one in damage.channels if one in index.channels}))
        reason = str(damage.error).removeprefix(f"{self._path}: ").removeprefix("damaged: ")
        size = damage.end - damage.offset
        part = DamagedPart(self._path, damage.offset, size, reason, names, damage.first, damage.last)
        if self._on_skipped is None:
            raise BagError(f"{self._path}: damaged: {reason} ({part.place})") from None
        self._on_skipped(part)

    def _guarded(self, part: MessageSegment, contents: Iterator[T]) -> Iterator[T]:
        """Pass on what a part contains; a damaged one is reported."""
        try:
            with library_errors_as_bag_error(self._path):
                yield from contents
        except (BagUnreachableError, TooLargeError):
            raise
        except BagError as error:
            begin = part.offset - RECORD.size if part.is_chunk else part.offset
            self._damaged(Damage(begin, part.end, error, part.first, part.last, part.channels), self._index)

    # ------------------------------------------------------------------------------------------------------ contents

    @property
    def unread_bytes(self) -> int:
        return self._index.truncated_bytes

    def channels(self) -> list[BagTopic]:
        index = self._index
        with library_errors_as_bag_error(self._path):
            return joined(channel.info for channel in self._channels(index).values())

    def _channels(self, index: Index) -> dict[int, BagChannel]:
        counts = index.counts
        return {
            number: BagChannel(
                _topic(one, index.schemas.get(one.schema_id), None if counts is None else counts.get(number, 0))
            )
            for number, one in index.channels.items()
        }

    def span(self) -> tuple[int, int] | None:
        if self._index.counts is None:  # no statistics: what lies outside of chunks is looked for
            with library_errors_as_bag_error(self._path):
                return self._index.time_range if self._parts else None
        return self._index.time_range

    def parts(self) -> list[tuple[int, int]]:
        if self._own is None:
            return []
        with library_errors_as_bag_error(self._path):
            return [(one.first, one.end - one.offset) for one in self._parts]

    # ------------------------------------------------------------------------------------------------------ messages

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        with library_errors_as_bag_error(self._path):
            parts = [one for one in self._parts if one.first < end and one.last >= start]
            known = self._channels(self._index)
            wanted = {number: one for number, one in known.items() if topics is None or one.topic in topics}
            if topics is not None:
                parts = [one for one in parts if one.channels is None or not wanted.keys().isdisjoint(one.channels)]
            yield from self._merge_by_time(parts, wanted, known, start, end)

    def _merge_by_time(
        self, parts: list[MessageSegment], wanted: Mapping[int, BagChannel], known: Container[int], start: int, end: int
    ) -> Iterator[Raw]:
        waiting = Waiting()
        due = [
            (part.first, number, self._guarded(part, self._blocks(part, wanted, known)))
            for number, part in enumerate(parts)
        ]
        heapify(due)
        while due:
            since, number, blocks = heappop(due)
            if (block := next(blocks, None)) is None:
                continue
            found, size, has_more = block
            if has_more:
                heappush(due, (found[-1][2] if found else since, number, blocks))
            if found and (found[0][2] < start or found[-1][2] >= end):
                found = [one for one in found if start <= one[2] < end]
            del block
            before = due[0][0] if due else None
            if waiting.is_empty and (before is None or not found or found[-1][2] < before):
                yield from found
            else:
                waiting.add(found)
                yield from waiting.before(before)
                self._check_buffered_bytes(waiting.size)
            if (
                size > MAX_WHOLE_CHUNK_BYTES
            ):  # not kept while the next is unpacked, as small ones are, whose memory is not new then
                del found
        yield from waiting.before(None)

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        with library_errors_as_bag_error(self._path):
            parts = [one for one in self._parts if one.first < end and one.last >= start]
            known = self._channels(self._index)
            wanted = {number: one.topic for number, one in known.items() if topics is None or one.topic in topics}
            if len(set(wanted.values())) < len(wanted):  # two channels of a topic, whose messages may be mixed
                return None
            parts = [one for one in parts if one.channels is None or not wanted.keys().isdisjoint(one.channels)]
            if any(one.last > other.first for one, other in pairwise(parts)):
                return None
        return self._in_blocks(parts, wanted, known, start, end)

    def _in_blocks(
        self, parts: list[MessageSegment], wanted: Container[int], known: Mapping[int, BagChannel], start: int, end: int
    ) -> Iterator[MessageBlock]:
        for part in parts:
            yield from self._guarded(part, self._part_blocks(part, wanted, known, start, end))

    def _part_blocks(
        self, part: MessageSegment, wanted: Container[int], known: Mapping[int, BagChannel], start: int, end: int
    ) -> Iterator[MessageBlock]:
        for data, size in self._contents(part, known):
            heads, begin = self._unpacker.message_headers(data, known, size)
            by_channel = np.argsort(heads["channel"], kind="stable")
            bounds = np.flatnonzero(np.diff(heads["channel"][by_channel])) + 1
            for mine in np.split(by_channel, bounds) if len(heads) else ():
                number = int(heads["channel"][mine[0]])
                if number in wanted:
                    block = MessageBlock(known[number], data, begin[mine], *_columns(heads[mine]))
                    yield from self._select_rows(block, part, start, end)

    def _select_rows(self, block: MessageBlock, part: MessageSegment, start: int, end: int) -> Iterator[MessageBlock]:
        """The messages of a part that are asked for, by log time."""
        times = block.log_times
        self._require_span(part, int(times.min()), int(times.max()))
        rows = np.arange(len(times))
        if start > part.first or end <= part.last:
            rows = np.flatnonzero((times >= start) & (times <= min(end, 1 << 64) - 1))
        if (times[1:] < times[:-1]).any():
            rows = rows[np.argsort(times[rows], kind="stable")]
        if len(rows):
            whole = len(rows) == len(times) and rows[0] == 0 and (np.diff(rows) == 1).all()
            yield block if whole else block.rows(rows)

    def _contents(self, part: MessageSegment, known: Container[int]) -> Iterator[tuple[bytes | bytearray, int]]:
        """The records of a part, at once or piece by piece, and how many bytes of each are whole records."""
        head = read_chunk_header(self._read, part.offset, part.end, str(self._path)) if part.is_chunk else None
        if head is not None and self._reads_in_blocks(head, known):
            yield from iter_chunk_blocks(self._read, head, False)  # its checksum was compared
            return
        data = self._data(part, head)
        yield data, len(data)

    # --------------------------------------------------------------------------------------------------------- parts

    def _blocks(
        self, part: MessageSegment, wanted: Mapping[int, BagChannel], known: Container[int]
    ) -> Iterator[tuple[list[Raw], int, bool]]:
        """The messages of a part, at once or piece by piece, each with its size and whether more may follow."""
        head = read_chunk_header(self._read, part.offset, part.end, str(self._path)) if part.is_chunk else None
        if head is None or not self._reads_in_blocks(head, known):
            data = self._data(part, head)
            found = self._unpacker.messages(data, wanted, known)
            size = len(data)
            del data
            self._sort(part, found)
            yield found, size, False
            return
        for some, whole in iter_chunk_blocks(self._read, head, False):  # its checksum was compared
            found = self._unpacker.messages(some, wanted, known, whole)
            self._sort(part, found)
            yield found, len(some), True

    def _data(self, part: MessageSegment, head: ChunkHeader | None) -> bytes:
        """Return the records of a part that is read at once."""
        if head is not None:
            return self._unpacker.decompress(self._read, head)
        return self._read(part.offset, max(0, part.end - part.offset))

    def _reads_in_blocks(self, head: ChunkHeader, known: Container[int]) -> bool:
        """Whether a chunk is read in pieces: it is large, and its messages are in order, which takes reading it all."""
        self._unpacker.require_size(self._read, head)
        if not is_large(self._read, head):
            return False
        is_ordered = self._ordered.get(head.at)
        if is_ordered is None:
            last, is_ordered = 0, True
            everything = self._channels(self._index)
            for some, whole in iter_chunk_blocks(self._read, head, self._unpacker.validate_crcs):
                for _, _, log_time, _ in self._unpacker.messages(some, everything, known, whole):
                    is_ordered, last = is_ordered and log_time >= last, log_time
            self._ordered[head.at] = is_ordered
        return is_ordered

    def _sort(self, part: MessageSegment, found: list[Raw]) -> None:
        """By log time. Raises `BagError`: parts are chosen and ordered by the times that are told of them."""
        if found:
            found.sort(key=LOG_TIME)
            self._require_span(part, found[0][2], found[-1][2])

    def _require_span(self, part: MessageSegment, first: int, last: int) -> None:
        if first < part.first or last > part.last:
            raise BagError(
                f"{self._path}: damaged: a chunk says its messages are from {part.first} to {part.last} ns, and "
                f"has some from {first} to {last} ns"
            )

    def _read(self, at: int, size: int) -> bytes:
        with self._reading:
            self._stream.seek(at)
            return self._stream.read(size)

    def _check_buffered_bytes(self, held: int) -> None:
        if held > self._max_bytes:
            raise BagError(
                f"{self._path}: its chunks overlap in time so much that {held} bytes of messages have to wait for "
                f"earlier ones; expected at most {self._max_bytes}, unless max_decompressed_bytes is more"
            )

    def close(self) -> None:
        self._stream.close()


def _columns(heads: NDArray[np.void]) -> tuple[NDArray[Any], ...]:
    """Sizes, log times and publish times of messages."""
    return heads["length"].astype(np.int64) - MIN_MESSAGE_BYTES, heads["log"], heads["publish"]


def _topic(channel: ChannelRecord, schema: Schema | None, count: int | None) -> BagTopic:
    told = channel.metadata
    return BagTopic(
        channel.topic,
        schema.name if schema else "",
        schema.data.decode(errors="replace") if schema else "",
        schema.encoding if schema else "",
        channel.message_encoding,
        told.get("topic_type_hash", ""),
        told.get("offered_qos_profiles", ""),
        count,
    )


def joined(rows: Iterable[BagTopic]) -> list[BagTopic]:
    """One row for each topic and definition: files may have several channels of them."""
    found: dict[Any, BagTopic] = {}
    for row in rows:
        key = row.key
        before = found.get(key)
        both = None if before is None or before.count is None or row.count is None else before.count + row.count
        found[key] = row if before is None else replace(before, count=both)
    return sorted(found.values(), key=attrgetter("name"))


def by_name(channels: Iterable[BagTopic]) -> dict[str, BagTopic]:
    """One for each topic: of one with several definitions the first, with the number of all."""
    found: dict[str, BagTopic] = {}
    for topic in channels:
        before = found.get(topic.name)
        found[topic.name] = topic if before is None else _added(before, topic)
    return dict(sorted(found.items()))


def _added(one: BagTopic, two: BagTopic) -> BagTopic:
    both = None if one.count is None or two.count is None else one.count + two.count
    return replace(one if one.definition else two, count=both)
