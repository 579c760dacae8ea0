"""From the messages of a topic to record batches.

Decides how many messages make a batch: until their bytes are `batch_bytes`, so that memory is bounded whatever the
messages are. They are read all at once by `rows`; where that refuses, one by one by the reader, which names what is
wrong or leaves it out, in small portions, as objects take many times the bytes they are made of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.definition_lookup import described
from rosidl_py_gen.bags.storage.storage_api import MessageBlock
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import arrow_builders
from rosidl_py_gen.tables.arrow import from_numpy, pa
from rosidl_py_gen.tables.batch_decoder import BatchUnsupportedError, run
from rosidl_py_gen.tables.columns import select_columns
from rosidl_py_gen.tables.message_batch import MessageBlocks, MessageList, detach_block, detach_message, parts
from rosidl_py_gen.tables.object_columns import column
from rosidl_py_gen.tables.read_program import read_program_for
from rosidl_py_gen.tables.schema import NANOSECONDS, schema_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.common import BagMessage, BagTopic
    from rosidl_py_gen.bags.definition_lookup import TopicDefinition
    from rosidl_py_gen.bags.storage.storage_api import BagChannel, Raw, TableInput
    from rosidl_py_gen.tables.batch_decoder import BatchCursor
    from rosidl_py_gen.tables.columns import ColumnNode

    Times = NDArray[np.uint64]
    Decoded = Callable[[Iterable[Raw]], Iterator[BagMessage]]

MOST_ROWS = 1 << 16
_PORTION = 1 << 18
_MOST_TIME = (1 << 63) - 1
_PADDING = 4


class Bag(Protocol):
    """What is asked of a `BagReader`."""

    path: Path

    def message_class(self, topic: str | BagTopic) -> type[Any]: ...

    def definition(self, topic: str | BagTopic) -> TopicDefinition: ...


class BatchBuilder:
    """The columns of a topic, for one definition of its messages; makes batches.

    Args:
        decoded: for messages that have to be read one by one.

    Raises:
        BagError: as `chosen`, and as `BagReader.message_class`.
    """

    def __init__(self, bag: Bag, channel: BagTopic, columns: Sequence[str] | str | None, decoded: Decoded) -> None:
        self._where, self._decoded = f"{bag.path}: {channel.name}", decoded
        self.cls, found = bag.message_class(channel), bag.definition(channel)
        self._is_certain = found.is_recorded
        try:
            self._chosen = select_columns(self.cls, columns)
            self.schema = schema_of(self.cls, self._chosen, _told(channel, found))
        except BagError as error:
            raise BagError(f"{self._where}: {error}") from None
        self._program = read_program_for(self.cls)
        self._wanted: set[ColumnNode] = set()
        for one in self._chosen:
            self._want(one.node)

    def _want(self, node: ColumnNode) -> None:
        self._wanted.add(node)
        if node.length is None:
            for child in node.children:
                self._want(child)

    def batches(self, messages: MessageList | MessageBlocks) -> Iterator[Any]:
        """The messages as one record batch, or several small ones where they have to be read one by one."""
        try:
            yield self._at_once(messages)
        except BatchUnsupportedError:
            for portion in _portions(messages.raw()):
                found = list(self._decoded(portion))
                if found:
                    columns = [column(one, [item.message for item in found]) for one in self._chosen]
                    log_times = np.array([one.log_time for one in found], np.uint64)
                    yield self._batch(log_times, np.array([one.publish_time for one in found], np.uint64), columns)

    def _at_once(self, messages: MessageList | MessageBlocks) -> Any:
        if self._program is None:
            raise BatchUnsupportedError
        cursor = messages.cursor()
        log_times, publish_times = messages.times()
        try:
            found = run(cursor, self._program, self._wanted)
            if not self._is_certain:
                _require_ends(cursor)
            columns = [arrow_builders.assembled(one.node, found, len(messages)) for one in self._chosen]
        except BagError as error:
            raise BagError(f"{self._where} from {log_times[0]} to {log_times[-1]} ns: {error}") from None
        return self._batch(log_times, publish_times, columns)

    def _batch(self, log_times: Times, publish_times: Times, columns: list[Any]) -> Any:
        times = [_times(self._where, one) for one in (log_times, publish_times)]
        return pa.RecordBatch.from_arrays([*times, *columns], schema=self.schema)


def _told(channel: BagTopic, found: TopicDefinition) -> BagTopic:
    """With the definition, for the metadata, where there is a text of it."""
    try:
        return described(channel, found)
    except RosidlError:  # parts of services that are not on the search path
        return channel


def _require_ends(cursor: BatchCursor) -> None:
    """Raises `BatchUnsupportedError` where something is behind the last field but what middlewares pad messages
    with.
    """
    rest = cursor.limit - cursor.pos
    padded = (rest < _PADDING) & ((cursor.limit & (_PADDING - 1)) == 0)
    if ((rest != 0) & ~padded).any():
        raise BatchUnsupportedError


def _times(where: str, times: Times) -> Any:
    if (times > _MOST_TIME).any():
        wrong = times[times > _MOST_TIME][0]
        raise BagError(f"{where} at {wrong} ns: tables have times up to {_MOST_TIME} ns")
    return from_numpy(times.view(np.int64), NANOSECONDS)


def _portions(messages: Sequence[Raw]) -> Iterator[Sequence[Raw]]:
    begin, size = 0, 0
    for number, message in enumerate(messages):
        size += len(message[1])
        if size >= _PORTION:
            yield messages[begin : number + 1]
            begin, size = number + 1, 0
    if begin < len(messages):
        yield messages[begin:]


# -------------------------------------------------------------------------------------------------------- one topic


def reader(
    bag: Bag, channels: Sequence[BagTopic], columns: Sequence[str] | str | None, source: TableInput, batch_bytes: int
) -> Any:
    """A ``pyarrow.RecordBatchReader`` of a topic; see `BagReader.batches`.

    Args:
        channels: of the topic, one at least; messages of others are left out.
    """
    by_class: dict[type[Any], BatchBuilder] = {}
    by_key: dict[tuple[str, ...], BatchBuilder] = {}
    for one in channels:
        made = BatchBuilder(bag, one, columns, source.decoded)
        by_key[one.key] = by_class.setdefault(made.cls, made)
    schema = next(iter(by_class.values())).schema
    if not all(made.schema.equals(schema) for made in by_class.values()):
        raise BagError(
            f"{bag.path}: {channels[0].name} was recorded with {len(by_class)} definitions that have other columns; "
            "name columns that all have, or take one of `channels`"
        )
    return pa.RecordBatchReader.from_batches(schema, _batches(by_key, source.found, schema, max(1, batch_bytes)))


def _batches(
    by_key: dict[tuple[str, ...], BatchBuilder],
    found: Iterator[Raw] | Iterator[MessageBlock],
    schema: Any,
    batch_bytes: int,
) -> Iterator[Any]:
    waiting = BatchBuffer(batch_bytes)
    for message in found:
        for columns, messages in waiting.take(message, by_key):
            yield from _alike(columns.batches(messages), schema)
    for columns, messages in waiting.flush():
        yield from _alike(columns.batches(messages), schema)


class BatchBuffer:
    """Messages of one topic until there are enough for a batch."""

    def __init__(self, batch_bytes: int) -> None:
        self._most = batch_bytes
        self._held: list[Any] = []
        self._size = self._rows = 0
        self._channel: BagChannel | None = None
        self._columns: BatchBuilder | None = None

    def take(
        self, message: Raw | MessageBlock, by_key: dict[tuple[str, ...], BatchBuilder]
    ) -> Iterator[tuple[BatchBuilder, MessageList | MessageBlocks]]:
        """Add a message or a block, and give the batches that are full."""
        if message[0] is not self._channel:
            columns = by_key.get(message[0].info.key)
            if columns is not self._columns:
                yield from self.flush()
            self._channel, self._columns = message[0], columns
        if self._columns is None:
            return
        if not isinstance(message, MessageBlock):
            yield from self._add(detach_message(message), len(message[1]), 1)
            return
        for part in parts(message, self._most, MOST_ROWS):
            yield from self._add(detach_block(part), int(part.size.sum()), len(part.size))

    def _add(
        self, message: Raw | MessageBlock, size: int, rows: int
    ) -> Iterator[tuple[BatchBuilder, MessageList | MessageBlocks]]:
        self._held.append(message)
        self._size += size
        self._rows += rows
        if self._size >= self._most or self._rows >= MOST_ROWS:
            yield from self.flush()

    def flush(self) -> Iterator[tuple[BatchBuilder, MessageList | MessageBlocks]]:
        """What waits, as a batch."""
        if self._held:
            assert self._columns is not None
            held, self._held, self._size, self._rows = self._held, [], 0, 0
            yield self._columns, MessageBlocks(held) if isinstance(held[0], MessageBlock) else MessageList(held)


def _alike(batches: Iterator[Any], schema: Any) -> Iterator[Any]:
    """With the metadata of the first definition."""
    for batch in batches:
        yield batch if batch.schema is schema else pa.RecordBatch.from_arrays(batch.columns, schema=schema)
