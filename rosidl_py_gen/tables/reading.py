"""Conversion of the messages of a topic to Arrow record batches.

A batch ends when its messages reach `batch_bytes`, which bounds memory for all kinds of messages. Its messages are
decoded together by `batch_decoder`. If that is not possible, they are decoded one by one, and wrong messages are named
or skipped. This is done in small portions, as message objects need many times the memory of their bytes.

A message that waits for a full batch and is a small slice of its chunk is copied, because it would otherwise keep the
chunk in memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.bags import BagError, MessageBlock, described
from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.cdr.layout import Alignment
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import arrow_columns
from rosidl_py_gen.tables.arrow import from_numpy, pa
from rosidl_py_gen.tables.arrow_columns import NANOSECONDS, Kind, element_type, schema_of, select_columns
from rosidl_py_gen.tables.batch_decoder import (
    BatchCursor,
    BatchUnsupportedError,
    concatenate,
    cursor_at,
    read_program_for,
    run,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from rosidl_py_gen.bags import BagMessage, BagReader, BagTopic, RawTuple
    from rosidl_py_gen.tables.arrow_columns import ColumnNode, SelectedColumn

    Times = NDArray[np.uint64]
    Decode = Callable[[Iterable[RawTuple]], Iterator[BagMessage]]
    Batches = Iterator[tuple["BatchBuilder", "_MessageList | _MessageBlocks"]]

MAX_ROWS = 1 << 16
_PORTION_BYTES = 1 << 18
_MAX_TIME_NS = (1 << 63) - 1
_MAX_RATIO = 4
"""Ratio of a chunk's size to a message's size above which a message that waits for a full batch is copied out of the
chunk."""


class BatchBuilder:
    """Builder of the record batches of a topic, for one definition of its messages.

    Args:
        columns: paths of columns; None means all fields.
        decode: function that decodes messages one by one.

    Raises:
        BagError: a column does not exist or has no Arrow type, or no definition of the topic is known.
    """

    def __init__(self, bag: BagReader, channel: BagTopic, columns: Sequence[str] | str | None, decode: Decode) -> None:
        self._where, self._decode = f"{bag.path}: {channel.name}", decode
        self.cls, definition = bag.message_class(channel), bag.definition(channel)
        self._is_certain = definition.is_recorded
        with suppress(RosidlError):  # the text may be unknown, as of parts of services that are not on the search path
            channel = described(channel, definition)
        try:
            self._columns = select_columns(self.cls, columns)
            self.schema = schema_of(self.cls, self._columns, channel)
        except BagError as error:
            raise BagError(f"{self._where}: {error}") from None
        self._program = read_program_for(self.cls)
        self._selected_nodes = {node for column in self._columns for node in _with_descendants(column.node)}

    def batches(self, messages: _MessageList | _MessageBlocks) -> Iterator[Any]:
        """Yield messages as one record batch, or as several small batches if the messages cannot be decoded
        together.
        """
        try:
            yield self._at_once(messages)
        except BatchUnsupportedError:
            for portion in _portions(messages.raw()):
                decoded = list(self._decode(portion))
                if decoded:
                    columns = [column(one, [item.message for item in decoded]) for one in self._columns]
                    log_times = np.array([one.log_time for one in decoded], np.uint64)
                    yield self._batch(log_times, np.array([one.publish_time for one in decoded], np.uint64), columns)

    def _at_once(self, messages: _MessageList | _MessageBlocks) -> Any:
        if self._program is None:
            raise BatchUnsupportedError
        cursor = messages.cursor()
        log_times, publish_times = messages.times()
        try:
            arrays = run(cursor, self._program, self._selected_nodes)
            if not self._is_certain:
                _require_ends(cursor)
            columns = [arrow_columns.assembled(one.node, arrays, len(messages)) for one in self._columns]
        except BagError as error:
            raise BagError(f"{self._where} from {log_times[0]} to {log_times[-1]} ns: {error}") from None
        return self._batch(log_times, publish_times, columns)

    def _batch(self, log_times: Times, publish_times: Times, columns: list[Any]) -> Any:
        for times in (log_times, publish_times):
            if (times > _MAX_TIME_NS).any():
                wrong = times[times > _MAX_TIME_NS][0]
                raise BagError(f"{self._where} at {wrong} ns: expected a time of at most {_MAX_TIME_NS} ns in a table")
        times_ns = [from_numpy(times.view(np.int64), NANOSECONDS) for times in (log_times, publish_times)]
        return pa.RecordBatch.from_arrays([*times_ns, *columns], schema=self.schema)


def _with_descendants(node: ColumnNode) -> Iterator[ColumnNode]:
    yield node
    for child in node.children:
        yield from _with_descendants(child)


def _require_ends(cursor: BatchCursor) -> None:
    """Raise `BatchUnsupportedError` if a message has bytes other than padding after its last field."""
    rest = cursor.limit - cursor.pos
    is_padding = (rest < Alignment.NETWORK) & ((cursor.limit & (Alignment.NETWORK - 1)) == 0)
    if ((rest != 0) & ~is_padding).any():
        raise BatchUnsupportedError


def _portions(messages: Sequence[RawTuple]) -> Iterator[Sequence[RawTuple]]:
    begin, size = 0, 0
    for number, message in enumerate(messages, 1):
        size += len(message[1])
        if size >= _PORTION_BYTES:
            yield messages[begin:number]
            begin, size = number, 0
    if begin < len(messages):
        yield messages[begin:]


# -------------------------------------------------------------------------------------------------------- one topic


def reader(
    bag: BagReader,
    channels: Sequence[BagTopic],
    columns: Sequence[str] | str | None,
    messages: Iterator[RawTuple] | Iterator[MessageBlock],
    decode: Decode,
    batch_bytes: int,
) -> Any:
    """Return a ``pyarrow.RecordBatchReader`` of a topic, with the messages of `channels`.

    Args:
        columns: paths of columns; None means all fields.
        messages: the messages by log time, or blocks of messages that are ordered for each topic.
        decode: function that decodes messages one by one.
        batch_bytes: size of the messages of a batch.

    Raises:
        BagError: a column does not exist, or the channels have different columns.
    """
    by_class: dict[type[Any], BatchBuilder] = {}
    by_key: dict[tuple[str, ...], BatchBuilder] = {}
    for channel in channels:
        builder = BatchBuilder(bag, channel, columns, decode)
        by_key[channel.key] = by_class.setdefault(builder.cls, builder)
    schema = next(iter(by_class.values())).schema
    if not all(builder.schema.equals(schema) for builder in by_class.values()):
        raise BagError(
            f"{bag.path}: {channels[0].name} was recorded with {len(by_class)} definitions with different columns; "
            "select columns that all of them have, or read one of `channels`"
        )
    return pa.RecordBatchReader.from_batches(schema, _batches(by_key, messages, schema, max(1, batch_bytes)))


def _batches(
    by_key: dict[tuple[str, ...], BatchBuilder], source: Iterator[Any], schema: Any, batch_bytes: int
) -> Iterator[Any]:
    buffer = BatchBuffer(batch_bytes)
    full = (batch for message in source for batch in buffer.take(message, by_key))
    for builder, messages in chain(full, buffer.flush()):
        for batch in builder.batches(messages):  # with the metadata of the first definition
            yield batch if batch.schema is schema else pa.RecordBatch.from_arrays(batch.columns, schema=schema)


class BatchBuffer:
    """Buffer of the messages of one topic until they fill a batch."""

    def __init__(self, batch_bytes: int) -> None:
        self._max_bytes = batch_bytes
        self._messages: list[Any] = []
        self._size = self._rows = 0
        self._channel: object = None
        self._builder: BatchBuilder | None = None

    def take(self, message: RawTuple | MessageBlock, by_key: dict[tuple[str, ...], BatchBuilder]) -> Batches:
        """Add a message or a block of messages, and yield full batches, each with the builder for its definition.

        `by_key` has the builders by channel key (topic and definition); messages of other channels are ignored.
        """
        if message[0] is not self._channel:
            builder = by_key.get(message[0].info.key)
            if builder is not self._builder:
                yield from self.flush()
            self._channel, self._builder = message[0], builder
        if self._builder is None:
            return
        if not isinstance(message, MessageBlock):
            yield from self._add(_detach_message(message), len(message[1]), 1)
            return
        for block in _split_block(message, self._max_bytes, MAX_ROWS):
            yield from self._add(_detach_block(block), int(block.size.sum()), len(block.size))

    def _add(self, message: RawTuple | MessageBlock, size: int, rows: int) -> Batches:
        self._messages.append(message)
        self._size += size
        self._rows += rows
        if self._size >= self._max_bytes or self._rows >= MAX_ROWS:
            yield from self.flush()

    def flush(self) -> Batches:
        """Yield the collected messages as one batch, with the builder for their definition."""
        if self._messages:
            assert self._builder is not None
            messages, self._messages, self._size, self._rows = self._messages, [], 0, 0
            is_block = isinstance(messages[0], MessageBlock)
            yield self._builder, _MessageBlocks(messages) if is_block else _MessageList(messages)


# ------------------------------------------------------------------------------------------------- batches of messages


class _MessageList:
    """Messages of a batch, stored as a list."""

    def __init__(self, messages: list[RawTuple]) -> None:
        self._messages = messages

    def __len__(self) -> int:
        return len(self._messages)

    def raw(self) -> Sequence[RawTuple]:
        return self._messages

    def cursor(self) -> BatchCursor:
        """Return a cursor after the header of each message; raises `BatchUnsupportedError` for an unusual header."""
        return concatenate([message[1] for message in self._messages])

    def times(self) -> tuple[Times, Times]:
        _, _, log_times, publish_times, _ = zip(*self._messages, strict=True)
        return np.array(log_times, np.uint64), np.array(publish_times, np.uint64)


class _MessageBlocks:
    """Messages of a batch, stored as blocks of messages of one channel."""

    def __init__(self, blocks: list[MessageBlock]) -> None:
        self._blocks = blocks

    def __len__(self) -> int:
        return sum(len(block.begin) for block in self._blocks)

    def raw(self) -> Sequence[RawTuple]:
        return [
            (block.channel, *row, 0)
            for block in self._blocks
            for row in zip(_slices(block), block.log_times.tolist(), block.publish_times.tolist(), strict=True)
        ]

    def cursor(self) -> BatchCursor:
        size = int(self._blocks[0].size[0])
        if not all((block.size == size).all() for block in self._blocks):
            return concatenate([data for block in self._blocks for data in _slices(block)])
        width = Alignment.up(size, Alignment.MAX)
        rows = np.empty((len(self), width), np.uint8)
        count = 0
        for block in self._blocks:
            rows[count : count + len(block.begin), :size] = _rows(block, size)
            count += len(block.begin)
        rows[:, size:] = 0
        return cursor_at(rows.reshape(-1).data, np.arange(count) * width, np.full(count, size))

    def times(self) -> tuple[Times, Times]:
        blocks = self._blocks
        log_times = np.concatenate([block.log_times for block in blocks])
        return log_times, np.concatenate([block.publish_times for block in blocks])


def _rows(block: MessageBlock, size: int) -> Any:
    """Return the bytes of equally long messages as a two-dimensional array with one message in each row.

    The array shares memory with the data if the messages have equal distances, else it is a copy.
    """
    begin, count = block.begin, len(block.begin)
    step = int(begin[1] - begin[0]) if count > 1 else size
    if step >= size and (count < 3 or (np.diff(begin) == step).all()):
        return np.ndarray((count, size), np.uint8, block.data, int(begin[0]), (step, 1))
    windows: Any = np.ndarray((len(block.data) - size + 1,), f"V{size}", block.data, 0, (1,))
    return windows[begin].view(np.uint8).reshape(count, size)


def _slices(block: MessageBlock) -> list[bytes | memoryview]:
    view = memoryview(block.data)
    ends = (block.begin + block.size).tolist()
    return [view[at:end] for at, end in zip(block.begin.tolist(), ends, strict=True)]


def _split_block(block: MessageBlock, max_bytes: int, max_rows: int) -> list[MessageBlock]:
    """Return a block of messages divided into blocks with at most `max_rows` messages and `max_bytes` bytes.

    A single message that is larger is a block by itself.
    """
    ends = np.cumsum(block.size)
    if len(ends) <= max_rows and ends[-1] <= max_bytes:
        return [block]
    slices, begin, size = [], 0, 0
    while begin < len(ends):
        end = min(begin + max_rows, max(begin + 1, int(np.searchsorted(ends, size + max_bytes, "right"))))
        slices.append(slice(begin, end))
        begin, size = end, int(ends[end - 1])
    return [block.rows(rows) for rows in slices]


def _detach_block(block: MessageBlock) -> MessageBlock:
    """Return the block of messages, or a copy if its messages are a small fraction of their chunk, so that the chunk
    can be freed.
    """
    if len(block.data) <= _MAX_RATIO * int(block.size.sum()):
        return block
    return block._replace(data=b"".join(_slices(block)), begin=np.cumsum(block.size) - block.size)


def _detach_message(message: RawTuple) -> RawTuple:
    """Return the message, or a copy if its bytes are a small fraction of a chunk in memory, so that the chunk can be
    freed.
    """
    data = message[1]
    if type(data) is memoryview and len(data.obj) > _MAX_RATIO * len(data):  # type: ignore[arg-type]
        return message[0], bytes(data), *message[2:]
    return message


# ------------------------------------------------------------------------------------------ messages decoded one by one


def column(selected: SelectedColumn, messages: Sequence[Any]) -> Any:
    """Return the Arrow array of one selected column for a list of decoded messages."""
    for node in selected.path:
        messages = _field_values(node, messages)
    return _column(selected.node, messages)


def _field_values(node: ColumnNode, messages: Sequence[Any]) -> list[Any]:
    name = node.field.py_name
    return [getattr(message, name) for message in messages]


def _column(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.length is None:
        return _elements(node, values)
    counts = np.fromiter(map(len, values), np.int64, len(values))
    if node.kind is Kind.NUMBER:
        return arrow_columns.sequences(node, counts, np.concatenate([np.empty(0, DTYPES[node.code]), *values]))
    return arrow_columns.lists(node, counts, _elements(node, [*chain.from_iterable(values)]))


def _elements(node: ColumnNode, values: Sequence[Any]) -> Any:
    if node.kind is Kind.STRUCT:
        return arrow_columns.struct(node, [_column(child, _field_values(child, values)) for child in node.children])
    if node.kind is Kind.EMPTY:
        return pa.nulls(len(values))
    if node.kind is Kind.TIME or node.kind is Kind.DURATION:
        sec = np.fromiter((one.sec for one in values), np.int64, len(values))
        return arrow_columns.times(node, sec, np.fromiter((one.nanosec for one in values), np.int64, len(values)))
    return pa.array(values, element_type(node))
