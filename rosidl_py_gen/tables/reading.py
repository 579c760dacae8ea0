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
from rosidl_py_gen.bags.definitions import described
from rosidl_py_gen.bags.files.storage import Block
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables import build
from rosidl_py_gen.tables.arrow import from_numpy, pa
from rosidl_py_gen.tables.batch import Blocks, Single, compact, owned, parts
from rosidl_py_gen.tables.columns import chosen
from rosidl_py_gen.tables.objects import column
from rosidl_py_gen.tables.program import program_of
from rosidl_py_gen.tables.rows import UnsuitedError, run
from rosidl_py_gen.tables.schema import NANOSECONDS, schema_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.common import BagMessage, BagTopic
    from rosidl_py_gen.bags.definitions import TopicDefinition
    from rosidl_py_gen.bags.files.storage import Channel, Raw, Source
    from rosidl_py_gen.tables.columns import Node
    from rosidl_py_gen.tables.rows import Cursor

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


class Columns:
    """The columns of a topic, for one definition of its messages; makes batches.

    Args:
        decoded: for messages that have to be read one by one.

    Raises:
        BagError: as `chosen`, and as `BagReader.message_class`.
    """

    def __init__(self, bag: Bag, channel: BagTopic, columns: Sequence[str] | str | None, decoded: Decoded) -> None:
        self._where, self._decoded = f"{bag.path}: {channel.name}", decoded
        self.cls, found = bag.message_class(channel), bag.definition(channel)
        self._is_certain = found.is_certain
        try:
            self._chosen = chosen(self.cls, columns)
            self.schema = schema_of(self.cls, self._chosen, _told(channel, found))
        except BagError as error:
            raise BagError(f"{self._where}: {error}") from None
        self._program = program_of(self.cls)
        self._wanted: set[Node] = set()
        for one in self._chosen:
            self._want(one.node)

    def _want(self, node: Node) -> None:
        self._wanted.add(node)
        if node.length is None:
            for child in node.children:
                self._want(child)

    def batches(self, messages: Single | Blocks) -> Iterator[Any]:
        """The messages as one record batch, or several small ones where they have to be read one by one."""
        try:
            yield self._at_once(messages)
        except UnsuitedError:
            for portion in _portions(messages.raw()):
                found = list(self._decoded(portion))
                if found:
                    columns = [column(one, [item.message for item in found]) for one in self._chosen]
                    log_times = np.array([one.log_time for one in found], np.uint64)
                    yield self._batch(log_times, np.array([one.publish_time for one in found], np.uint64), columns)

    def _at_once(self, messages: Single | Blocks) -> Any:
        if self._program is None:
            raise UnsuitedError
        cursor = messages.cursor()
        log_times, publish_times = messages.times()
        try:
            found = run(cursor, self._program, self._wanted)
            if not self._is_certain:
                _require_ends(cursor)
            columns = [build.assembled(one.node, found, len(messages)) for one in self._chosen]
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


def _require_ends(cursor: Cursor) -> None:
    """Raises `UnsuitedError` where something is behind the last field but what middlewares pad messages with."""
    rest = cursor.limit - cursor.pos
    padded = (rest < _PADDING) & ((cursor.limit & (_PADDING - 1)) == 0)
    if ((rest != 0) & ~padded).any():
        raise UnsuitedError


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
    bag: Bag, channels: Sequence[BagTopic], columns: Sequence[str] | str | None, source: Source, batch_bytes: int
) -> Any:
    """A ``pyarrow.RecordBatchReader`` of a topic; see `BagReader.batches`.

    Args:
        channels: of the topic, one at least; messages of others are left out.
    """
    by_class: dict[type[Any], Columns] = {}
    by_key: dict[tuple[str, ...], Columns] = {}
    for one in channels:
        made = Columns(bag, one, columns, source.decoded)
        by_key[one.key] = by_class.setdefault(made.cls, made)
    schema = next(iter(by_class.values())).schema
    if not all(made.schema.equals(schema) for made in by_class.values()):
        raise BagError(
            f"{bag.path}: {channels[0].name} was recorded with {len(by_class)} definitions that have other columns; "
            "name columns that all have, or take one of `channels`"
        )
    return pa.RecordBatchReader.from_batches(schema, _batches(by_key, source.found, schema, max(1, batch_bytes)))


def _batches(
    by_key: dict[tuple[str, ...], Columns], found: Iterator[Raw] | Iterator[Block], schema: Any, batch_bytes: int
) -> Iterator[Any]:
    waiting = Waiting(batch_bytes)
    for message in found:
        for columns, messages in waiting.take(message, by_key):
            yield from _alike(columns.batches(messages), schema)
    for columns, messages in waiting.rest():
        yield from _alike(columns.batches(messages), schema)


class Waiting:
    """Messages of one topic until there are enough for a batch."""

    def __init__(self, batch_bytes: int) -> None:
        self._most = batch_bytes
        self._held: list[Any] = []
        self._size = self._rows = 0
        self._channel: Channel | None = None
        self._columns: Columns | None = None

    def take(
        self, message: Raw | Block, by_key: dict[tuple[str, ...], Columns]
    ) -> Iterator[tuple[Columns, Single | Blocks]]:
        """Add a message or a block, and give the batches that are full."""
        if message[0] is not self._channel:
            columns = by_key.get(message[0].info.key)
            if columns is not self._columns:
                yield from self.rest()
            self._channel, self._columns = message[0], columns
        if self._columns is None:
            return
        if not isinstance(message, Block):
            yield from self._add(owned(message), len(message[1]), 1)
            return
        for part in parts(message, self._most, MOST_ROWS):
            yield from self._add(compact(part), int(part.size.sum()), len(part.size))

    def _add(self, message: Raw | Block, size: int, rows: int) -> Iterator[tuple[Columns, Single | Blocks]]:
        self._held.append(message)
        self._size += size
        self._rows += rows
        if self._size >= self._most or self._rows >= MOST_ROWS:
            yield from self.rest()

    def rest(self) -> Iterator[tuple[Columns, Single | Blocks]]:
        """What waits, as a batch."""
        if self._held:
            assert self._columns is not None
            held, self._held, self._size, self._rows = self._held, [], 0, 0
            yield self._columns, Blocks(held) if isinstance(held[0], Block) else Single(held)


def _alike(batches: Iterator[Any], schema: Any) -> Iterator[Any]:
    """With the metadata of the first definition."""
    for batch in batches:
        yield batch if batch.schema is schema else pa.RecordBatch.from_arrays(batch.columns, schema=schema)
