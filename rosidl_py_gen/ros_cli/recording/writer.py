"""Writer of a bag in a thread, so that compression and a slow disk do not delay receiving.

The writer limits the memory of waiting messages and the time until messages are in the file. In snapshot mode the
writer retains messages for snapshots.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.bags import BagTopic, BagWriter, SqliteWriter

MAX_BYTES = 512 << 20
SNAPSHOT_BYTES = 100 << 20
"""Default maximum memory of the messages in a snapshot, in bytes, as in rosbag2."""
_FLUSH_INTERVAL_S = 1.0
_OVERHEAD_BYTES = 200
"""Memory of a waiting message in addition to its data, in bytes: objects, times, and an entry of the queue."""


class _Message(NamedTuple):
    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int


def _memory(message: _Message) -> int:
    return len(message.data) + _OVERHEAD_BYTES


class WriterThread:
    """Writer of a bag, whose thread writes enqueued messages until `end`.

    Args:
        on_error: called once, from the thread, when the bag cannot be written.
        max_bytes: maximum memory of messages that wait, or that a snapshot contains; None and 0 mean the default. With
            0, every message is passed to the operating system at once.
        snapshots: write only snapshots, each into a new file, unless the bag is one file.
    """

    def __init__(
        self,
        bag: BagWriter | SqliteWriter,
        on_error: Callable[[], object],
        *,
        max_bytes: int | None = None,
        snapshots: bool = False,
    ) -> None:
        self._bag = bag
        self.path = bag.path
        self._on_error = on_error
        self._max_bytes = max_bytes or (SNAPSHOT_BYTES if snapshots else MAX_BYTES)
        self._flush_s = 0.0 if max_bytes == 0 else _FLUSH_INTERVAL_S
        self._retained: deque[_Message] | None = deque() if snapshots else None
        self._retained_bytes = 0
        self._items: queue.SimpleQueue[_Message | Callable[[], object] | None] = queue.SimpleQueue()
        self._enqueued_bytes = 0  # memory of all enqueued messages
        self._written_bytes = 0  # memory of all written messages; changed by the thread
        self.bytes = self.messages = 0
        """Size in bytes and number of enqueued messages; in snapshot mode, only of messages in snapshots."""
        self.dropped = 0
        """Number of messages that were dropped because too many were waiting, or because one message was larger than a
        snapshot."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    @property
    def retained_count(self) -> int | None:
        """Number of messages retained for a snapshot; None if all messages are written."""
        return None if self._retained is None else len(self._retained)

    def add_topic(self, topic: BagTopic) -> None:
        """Add a topic to the bag, before a message of the topic is enqueued."""
        self._items.put(partial(self._bag.add_topic, topic.name, topic))

    def enqueue(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Enqueue a message for the thread, or retain it for a snapshot; it is dropped if too many messages wait."""
        message = _Message(topic, data, log_time_ns, publish_time_ns)
        if self._retained is not None:
            self._retain(message, self._retained)
        elif self._enqueued_bytes - self._written_bytes > self._max_bytes:
            self.dropped += 1
        else:
            self._enqueue_now(message)

    def _enqueue_now(self, message: _Message) -> None:
        self.bytes += len(message.data)
        self.messages += 1
        self._enqueued_bytes += _memory(message)
        self._items.put(message)

    def _retain(self, message: _Message, retained: deque[_Message]) -> None:
        if _memory(message) > self._max_bytes:
            self.dropped += 1
            return
        retained.append(message)
        self._retained_bytes += _memory(message)
        while self._retained_bytes > self._max_bytes:
            self._retained_bytes -= _memory(retained.popleft())

    def snapshot(self) -> bool:
        """Enqueue the retained messages for a new file; returns False while an earlier snapshot is being written."""
        if self._retained is None or self._enqueued_bytes != self._written_bytes:
            return False
        self.split()
        while self._retained:
            self._enqueue_now(self._retained.popleft())
        self._retained_bytes = 0
        return True

    def split(self) -> bool:
        """Continue the bag in a new file, unless the current file is empty; returns False for a bag of one file."""
        if self.path.suffix == ".mcap":
            return False
        self._items.put(self._bag.split)
        return True

    def _run(self) -> None:
        try:
            self._write_all()
        except (OSError, RosidlError, MemoryError) as error:
            self._error = error
            self._on_error()

    def _write_all(self) -> None:
        flushed = monotonic()
        while True:
            try:
                item = self._items.get(timeout=_FLUSH_INTERVAL_S)
            except queue.Empty:
                pass
            else:
                if item is None:
                    return
                if isinstance(item, _Message):
                    self._bag.write(*item)
                    self._written_bytes += _memory(item)
                else:
                    item()
            if monotonic() >= flushed + self._flush_s:
                self._bag.flush()
                flushed = monotonic()

    def end(self) -> None:
        """Write waiting messages and close the bag; retained ones are discarded. Raises `CommandError` on failure."""
        self._items.put(None)
        self._thread.join()
        try:
            self._bag.close()
        except (OSError, RosidlError) as error:
            self._error = self._error or error
        if self._error is not None:
            reason = str(getattr(self._error, "strerror", None) or self._error).removeprefix(f"{self.path}: ")
            raise CommandError(f"{self.path}: {reason}; earlier messages can be read; see `rosidl-py bag info`")
