"""The messages that one batch is made of, as their bytes.

They come as blocks, a chunk's at a time without an object for each, where the bag gives them so; else one by one. What
waits for a batch to be full does not keep chunks in memory of which it has only a small part.
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

    from rosidl_py_gen.bags.storage.storage_api import Raw

    Times = NDArray[np.uint64]

_SMALL = 4
"""A message of so small a part of its chunk is copied."""


class MessageList:
    """Messages one by one."""

    def __init__(self, messages: list[Raw]) -> None:
        self._messages = messages

    def __len__(self) -> int:
        return len(self._messages)

    def raw(self) -> Sequence[Raw]:
        """Each message by itself."""
        return self._messages

    def cursor(self) -> BatchCursor:
        """Behind the header of each. Raises `BatchUnsupportedError`."""
        return concatenate([message[1] for message in self._messages])

    def times(self) -> tuple[Times, Times]:
        """Log times and publish times."""
        _, _, log_times, publish_times = zip(*self._messages, strict=True)
        return np.array(log_times, np.uint64), np.array(publish_times, np.uint64)


class MessageBlocks:
    """Messages of one channel in blocks."""

    def __init__(self, blocks: list[MessageBlock]) -> None:
        self._blocks = blocks

    def __len__(self) -> int:
        return sum(len(block.begin) for block in self._blocks)

    def raw(self) -> Sequence[Raw]:
        """Each message by itself."""
        return [one for block in self._blocks for one in _each(block)]

    def cursor(self) -> BatchCursor:
        """Behind the header of each. Raises `BatchUnsupportedError`."""
        size = int(self._blocks[0].size[0])
        if not all((block.size == size).all() for block in self._blocks):
            return concatenate([data for block in self._blocks for data in _cut(block)])
        width = align_up(size, MAX_ALIGN)
        rows = np.empty((len(self), width), np.uint8)
        done = 0
        for block in self._blocks:
            rows[done : done + len(block.begin), :size] = _rows(block, size)
            done += len(block.begin)
        rows[:, size:] = 0
        return cursor_at(rows.reshape(-1).data, np.arange(done) * width, np.full(done, size))

    def times(self) -> tuple[Times, Times]:
        """Log times and publish times."""
        blocks = self._blocks
        log_times = np.concatenate([block.log_times for block in blocks])
        return log_times, np.concatenate([block.publish_times for block in blocks])


def _rows(block: MessageBlock, size: int) -> Any:
    """The bytes of equally long messages: a view where they are equally far apart, as those of one topic are."""
    begin, count = block.begin, len(block.begin)
    step = int(begin[1] - begin[0]) if count > 1 else size
    if step >= size and (count < 3 or (np.diff(begin) == step).all()):
        return np.ndarray((count, size), np.uint8, block.data, int(begin[0]), (step, 1))
    every: Any = np.ndarray((len(block.data) - size + 1,), f"V{size}", block.data, 0, (1,))
    return every[begin].view(np.uint8).reshape(count, size)


def _cut(block: MessageBlock) -> list[bytes | memoryview]:
    view = memoryview(block.data)
    ends = (block.begin + block.size).tolist()
    return [view[at:end] for at, end in zip(block.begin.tolist(), ends, strict=True)]


def _each(block: MessageBlock) -> list[Raw]:
    channel = block.channel
    times = zip(block.log_times.tolist(), block.publish_times.tolist(), strict=True)
    return [(channel, data, *both) for data, both in zip(_cut(block), times, strict=True)]


def parts(block: MessageBlock, most_bytes: int, most_rows: int) -> list[MessageBlock]:
    """A block in parts of so many messages, or messages of so many bytes; one message may be larger."""
    ends = np.cumsum(block.size)
    if len(ends) <= most_rows and ends[-1] <= most_bytes:
        return [block]
    cuts, at, done = [], 0, 0
    while at < len(ends):
        end = min(at + most_rows, max(at + 1, int(np.searchsorted(ends, done + most_bytes, "right"))))
        cuts.append((at, end))
        at, done = end, int(ends[end - 1])
    return [block.rows(slice(at, end)) for at, end in cuts]


def detach_block(block: MessageBlock) -> MessageBlock:
    """The same, copied where it is a small part of its chunk."""
    if len(block.data) <= _SMALL * int(block.size.sum()):
        return block
    data = b"".join(_cut(block))
    begin = np.cumsum(block.size) - block.size
    return block._replace(data=data, begin=begin)


def detach_message(message: Raw) -> Raw:
    """The same with bytes of its own, where they are a view of a much larger chunk."""
    channel, data, log_time, publish_time = message
    if type(data) is memoryview and len(data.obj) > _SMALL * len(data):  # type: ignore[arg-type]
        return channel, bytes(data), log_time, publish_time
    return message
