"""Record batches from the messages of a topic.

A batch ends when its messages reach `batch_bytes`, which bounds memory for all kinds of messages. They are decoded at
once by `batch_decoder`. If it does not support them, the reader decodes them one by one, and names or skips wrong ones;
this is done in small portions, as objects need many times the memory of their bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.definition_lookup import described
from rosidl_py_gen.bags.storage.storage_api import MessageBlock
from rosidl_py_gen.cdr.layout import NETWORK_ALIGN
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import arrow_builders
from rosidl_py_gen.tables.arrow import from_numpy, pa
from rosidl_py_gen.tables.batch_decoder import BatchUnsupportedError, run
from rosidl_py_gen.tables.columns import select_columns
from rosidl_py_gen.tables.message_batch import MessageBlocks, MessageList, detach_block, detach_message, split_block
from rosidl_py_gen.tables.object_columns import column
from rosidl_py_gen.tables.read_program import read_program_for
from rosidl_py_gen.tables.schema import NANOSECONDS, schema_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.bags.common import BagMessage, BagTopic
    from rosidl_py_gen.bags.storage.storage_api import BagChannel, RawTuple, TableInput
    from rosidl_py_gen.tables.batch_decoder import BatchCursor
    from rosidl_py_gen.tables.columns import ColumnNode

    Times = NDArray[np.uint64]
    Decode = Callable[[Iterable[RawTuple]], Iterator[BagMessage]]
    Batches = Iterator[tuple["BatchBuilder", MessageList | MessageBlocks]]

MAX_ROWS = 1 << 16
_PORTION_BYTES = 1 << 18
_MAX_TIME_NS = (1 << 63) - 1


class BatchBuilder:
    """Builder of the batches of a topic, for one definition of its messages.

    `decode` decodes messages one by one. Raises BagError as `select_columns` and `BagReader.message_class`.
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

    def batches(self, messages: MessageList | MessageBlocks) -> Iterator[Any]:
        """Yield the messages as one record batch, or as several small ones if they must be decoded one by one."""
        try:
            yield self._at_once(messages)
        except BatchUnsupportedError:
            for portion in _portions(messages.raw()):
                decoded = list(self._decode(portion))
                if decoded:
                    columns = [column(one, [item.message for item in decoded]) for one in self._columns]
                    log_times = np.array([one.log_time for one in decoded], np.uint64)
                    yield self._batch(log_times, np.array([one.publish_time for one in decoded], np.uint64), columns)

    def _at_once(self, messages: MessageList | MessageBlocks) -> Any:
        if self._program is None:
            raise BatchUnsupportedError
        cursor = messages.cursor()
        log_times, publish_times = messages.times()
        try:
            arrays = run(cursor, self._program, self._selected_nodes)
            if not self._is_certain:
                _require_ends(cursor)
            columns = [arrow_builders.assembled(one.node, arrays, len(messages)) for one in self._columns]
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
    """Raise `BatchUnsupportedError` if bytes other than padding follow the last field."""
    rest = cursor.limit - cursor.pos
    is_padding = (rest < NETWORK_ALIGN) & ((cursor.limit & (NETWORK_ALIGN - 1)) == 0)
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
    source: TableInput,
    batch_bytes: int,
) -> Any:
    """Return a ``pyarrow.RecordBatchReader`` of a topic, for messages of `channels`; see `BagReader.batches`."""
    by_class: dict[type[Any], BatchBuilder] = {}
    by_key: dict[tuple[str, ...], BatchBuilder] = {}
    for channel in channels:
        builder = BatchBuilder(bag, channel, columns, source.decoded)
        by_key[channel.key] = by_class.setdefault(builder.cls, builder)
    schema = next(iter(by_class.values())).schema
    if not all(builder.schema.equals(schema) for builder in by_class.values()):
        raise BagError(
            f"{bag.path}: {channels[0].name} was recorded with {len(by_class)} definitions with different columns; "
            "select columns that all of them have, or read one of `channels`"
        )
    return pa.RecordBatchReader.from_batches(
        schema, _batches(by_key, source.messages_or_blocks, schema, max(1, batch_bytes))
    )


def _batches(
    by_key: dict[tuple[str, ...], BatchBuilder], source: Iterator[Any], schema: Any, batch_bytes: int
) -> Iterator[Any]:
    buffer = BatchBuffer(batch_bytes)
    full = (batch for message in source for batch in buffer.take(message, by_key))
    for builder, messages in chain(full, buffer.flush()):
        for batch in builder.batches(messages):  # with the metadata of the first definition
            yield batch if batch.schema is schema else pa.RecordBatch.from_arrays(batch.columns, schema=schema)


class BatchBuffer:
    """Messages of one topic that wait for a full batch."""

    def __init__(self, batch_bytes: int) -> None:
        self._max_bytes = batch_bytes
        self._messages: list[Any] = []
        self._size = self._rows = 0
        self._channel: BagChannel | None = None
        self._builder: BatchBuilder | None = None

    def take(self, message: RawTuple | MessageBlock, by_key: dict[tuple[str, ...], BatchBuilder]) -> Batches:
        """Add a message or a block, and yield the batches that are full."""
        if message[0] is not self._channel:
            builder = by_key.get(message[0].info.key)
            if builder is not self._builder:
                yield from self.flush()
            self._channel, self._builder = message[0], builder
        if self._builder is None:
            return
        if not isinstance(message, MessageBlock):
            yield from self._add(detach_message(message), len(message[1]), 1)
            return
        for block in split_block(message, self._max_bytes, MAX_ROWS):
            yield from self._add(detach_block(block), int(block.size.sum()), len(block.size))

    def _add(self, message: RawTuple | MessageBlock, size: int, rows: int) -> Batches:
        self._messages.append(message)
        self._size += size
        self._rows += rows
        if self._size >= self._max_bytes or self._rows >= MAX_ROWS:
            yield from self.flush()

    def flush(self) -> Batches:
        """Yield the waiting messages as a batch."""
        if self._messages:
            assert self._builder is not None
            messages, self._messages, self._size, self._rows = self._messages, [], 0, 0
            is_block = isinstance(messages[0], MessageBlock)
            yield self._builder, MessageBlocks(messages) if is_block else MessageList(messages)
