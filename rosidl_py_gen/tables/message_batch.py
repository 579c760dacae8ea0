"""MessageList and MessageBlocks: two forms of a batch of encoded messages.

A list has an object for each message; blocks are arrays of the messages of a chunk, without objects.
Messages that wait for a full batch are copied if they are a small part of their chunk, which they would keep in memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.bags.storage.storage_api import MessageBlock
from rosidl_py_gen.cdr.layout import MAX_ALIGN, align_up
from rosidl_py_gen.tables.batch_decoder import BatchCursor, concatenate, cursor_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.storage.storage_api import RawTuple

    Times = NDArray[np.uint64]

_MAX_RATIO = 4
"""Ratio of sizes of chunk and message above which the message is copied."""


class MessageList:
    """Messages one by one."""

    def __init__(self, messages: list[RawTuple]) -> None:
        self._messages = messages

    def __len__(self) -> int:
        return len(self._messages)

    def raw(self) -> Sequence[RawTuple]:
        """Return each message."""
        return self._messages

    def cursor(self) -> BatchCursor:
        """Return a cursor after the header of each; raises `BatchUnsupportedError`."""
        return concatenate([message[1] for message in self._messages])

    def times(self) -> tuple[Times, Times]:
        """Return log times and publish times."""
        _, _, log_times, publish_times = zip(*self._messages, strict=True)
        return np.array(log_times, np.uint64), np.array(publish_times, np.uint64)


class MessageBlocks:
    """Messages of one channel in blocks."""

    def __init__(self, blocks: list[MessageBlock]) -> None:
        self._blocks = blocks

    def __len__(self) -> int:
        return sum(len(block.begin) for block in self._blocks)

    def raw(self) -> Sequence[RawTuple]:
        """Return each message."""
        return [message for block in self._blocks for message in _raw_messages(block)]

    def cursor(self) -> BatchCursor:
        """Return a cursor after the header of each; raises `BatchUnsupportedError`."""
        size = int(self._blocks[0].size[0])
        if not all((block.size == size).all() for block in self._blocks):
            return concatenate([data for block in self._blocks for data in _slices(block)])
        width = align_up(size, MAX_ALIGN)
        rows = np.empty((len(self), width), np.uint8)
        count = 0
        for block in self._blocks:
            rows[count : count + len(block.begin), :size] = _rows(block, size)
            count += len(block.begin)
        rows[:, size:] = 0
        return cursor_at(rows.reshape(-1).data, np.arange(count) * width, np.full(count, size))

    def times(self) -> tuple[Times, Times]:
        """Return log times and publish times."""
        blocks = self._blocks
        log_times = np.concatenate([block.log_times for block in blocks])
        return log_times, np.concatenate([block.publish_times for block in blocks])


def _rows(block: MessageBlock, size: int) -> Any:
    """Return the bytes of messages of equal size: a view if their distances are equal, as those of one topic are."""
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


def _raw_messages(block: MessageBlock) -> list[RawTuple]:
    columns = _slices(block), block.log_times.tolist(), block.publish_times.tolist()
    return [(block.channel, *row) for row in zip(*columns, strict=True)]


def split_block(block: MessageBlock, max_bytes: int, max_rows: int) -> list[MessageBlock]:
    """Split a block by number of rows and size in bytes; a single message may be larger."""
    ends = np.cumsum(block.size)
    if len(ends) <= max_rows and ends[-1] <= max_bytes:
        return [block]
    slices, begin, size = [], 0, 0
    while begin < len(ends):
        end = min(begin + max_rows, max(begin + 1, int(np.searchsorted(ends, size + max_bytes, "right"))))
        slices.append(slice(begin, end))
        begin, size = end, int(ends[end - 1])
    return [block.rows(rows) for rows in slices]


def detach_block(block: MessageBlock) -> MessageBlock:
    """Return the block, copied if it is a small part of its chunk."""
    if len(block.data) <= _MAX_RATIO * int(block.size.sum()):
        return block
    return block._replace(data=b"".join(_slices(block)), begin=np.cumsum(block.size) - block.size)


def detach_message(message: RawTuple) -> RawTuple:
    """Return the message, with copied bytes if they are a view of a much larger chunk."""
    channel, data, log_time, publish_time = message
    if type(data) is memoryview and len(data.obj) > _MAX_RATIO * len(data):  # type: ignore[arg-type]
        return channel, bytes(data), log_time, publish_time
    return message
