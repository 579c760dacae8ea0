"""What a bag's files have in common, and in which order their messages come.

Decides that every message knows the channel it was written to: a topic may have been recorded with two definitions, and
each message is read with its own. Whatever a damaged file makes the libraries raise becomes a `BagError` that names the
file.
"""

from __future__ import annotations

import contextlib
import heapq
from itertools import chain, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias, TypeVar

from rosidl_py_gen.bags.common import BagError, BagTopic
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from rosidl_py_gen.bags.common import BagMessage

M = TypeVar("M")
MAX_TIME = (1 << 64) - 1
"""Of MCAP; databases have half of it."""
MAX_UNPACKED_BYTES = 1 << 30
"""What is unpacked at once, a chunk above all, may become so large where the user does not say otherwise."""
LOG_TIME = itemgetter(2)


class BagChannel:
    """A topic with the definition that its messages were written with.

    Compared by identity: it is looked up for every message.
    """

    __slots__ = ("info", "topic")

    def __init__(self, info: BagTopic) -> None:
        self.info = info
        self.topic = info.name


_NO_CHANNEL = BagChannel(BagTopic("", ""))
"""Comes at the time at which a file begins."""
Raw: TypeAlias = "tuple[BagChannel, bytes | memoryview, int, int]"
"""What a `BagMessage` has, before decoding; a plain tuple is made in a third of the time. Large messages view the chunk
they are in, and so do the arrays that are decoded from them.
"""


class MessageBlock(NamedTuple):
    """Messages of one channel by log time, without an object for each: a row of the arrays, and their bytes in `data`.

    Attributes:
        begin, size: where the bytes of each are.
    """

    channel: BagChannel
    data: bytes | bytearray
    begin: NDArray[np.int64]
    size: NDArray[np.int64]
    log_times: NDArray[np.uint64]
    publish_times: NDArray[np.uint64]

    def rows(self, chosen: slice | NDArray[np.int64]) -> MessageBlock:
        """Some of the messages."""
        begin, size, log_times, publish_times = (one[chosen] for one in self[2:])
        return MessageBlock(self.channel, self.data, begin, size, log_times, publish_times)  # type: ignore[arg-type]


class Storage(Protocol):
    """One file."""

    is_whole: bool
    """False when the file has no index, as after a crash."""

    @property
    def unread_bytes(self) -> int:
        """At the end of the file, of a record that was not finished."""

    def channels(self) -> list[BagTopic]:
        """What it holds, with counts where it has an index; a topic with two definitions is there twice."""

    def span(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None when there is none."""

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        """Raw messages with ``start <= log_time < end``, by log time; None means all topics."""

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        """The same in blocks; None where the messages of a topic would not be in order then."""

    def parts(self) -> list[tuple[int, int]]:
        """First log time and stored bytes of what is read together; none where finding a time takes reading all."""

    def close(self) -> None:
        """May be called twice."""


@contextlib.contextmanager
def library_errors_as_bag_error(path: Path) -> Iterator[None]:
    """Turn what libraries raise over wrong bytes into a `BagError` that names the file."""
    try:
        yield
    except (RosidlError, GeneratorExit):
        raise
    except MemoryError:
        raise BagError(f"{path}: damaged: a length in it is larger than memory") from None
    except Exception as error:  # compression libraries, struct, sqlite: whatever wrong bytes lead to
        raise BagError(f"{path}: damaged: {type(error).__name__}: {str(error)[:200]}") from None


def with_bytes(found: Iterable[Raw], kind: type[M], first: Callable[[BagChannel], Any]) -> Iterator[M]:
    """Yield messages as named tuples that begin with `first`, without a reference to a chunk while the next is read."""
    make = tuple.__new__  # in half the time of a call of `kind`
    for channel, data, log_time, publish_time in found:
        made = make(kind, (first(channel), bytes(data), log_time, publish_time))  # type: ignore[type-var]
        del data
        yield made
        del made


def merge_by_time(files: list[Storage], topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
    """The messages of several files by log time."""
    if len(files) == 1:
        return files[0].messages(topics, start, end)
    each = []
    for file in files:
        span = file.span()
        if span is not None and span[0] < end and span[1] >= start:
            each.append(chain(((_NO_CHANNEL, b"", span[0], 0),), _open_when_due(file, topics, start, end)))
    return (one for one in heapq.merge(*each, key=LOG_TIME) if one[0] is not _NO_CHANNEL)


def _open_when_due(file: Storage, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
    """Begun when its first message may be due, so that not every file of a bag has a chunk in memory."""
    yield from file.messages(topics, start, end)


class TableInput(NamedTuple):
    """What tables are made of.

    Attributes:
        found: blocks, in the order of their messages for each topic, or messages in their order.
        decoded: messages of raw ones, with the errors that reading them has, or without those it leaves out.
    """

    found: Iterator[MessageBlock] | Iterator[Raw]
    decoded: Callable[[Iterable[Raw]], Iterator[BagMessage]]


def as_table_input(
    files: list[Storage], topics: Collection[str] | None, start: int, end: int
) -> Iterator[MessageBlock] | Iterator[Raw]:
    """The messages of several files: in blocks where one after the other gives them by log time, else as
    `merge_by_time`.
    """
    due = [(span, file) for file in files if (span := file.span()) is not None and span[0] < end and span[1] >= start]
    due.sort(key=itemgetter(0))
    if not any(one[0][1] > other[0][0] for one, other in pairwise(due)):
        each = [file.blocks(topics, max(0, start), end) for _, file in due]
        blocks = [one for one in each if one is not None]
        if len(blocks) == len(each):
            return chain.from_iterable(blocks)
    return merge_by_time(files, topics, start, end)
