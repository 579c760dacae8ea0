"""Writing a bag from a thread of its own, so that compression and a slow disk do not hold up who receives.

Decides how much may wait to be written, how old it may get before it is in the file, and what a snapshot is.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import ToolError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.bags import BagTopic, BagWriter, SqliteWriter

MAX_BYTES = 512 << 20
SNAPSHOT_BYTES = 100 << 20
"""As rosbag2 has it."""
_FLUSH_S = 1.0
_OVERHEAD_BYTES = 200
"""Bytes that a message takes beside its own while it waits: objects for it, its times, and a place in the queue."""


class _Message(NamedTuple):
    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int


def _memory(message: _Message) -> int:
    return len(message.data) + _OVERHEAD_BYTES


class _Split:
    """Go on in a new file."""


class WriterThread:
    """Writes what is put, until `end`.

    Args:
        on_error: called once, from the thread, when the bag cannot be written any more.
        max_bytes: of memory for messages that wait to be written, or that a snapshot has; None is the usual number.
            Where it is 0, everything is handed to the operating system at once.
        snapshots: only those are written; each into a file of its own, unless the bag is one file.
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
        self._flush_s = 0.0 if max_bytes == 0 else _FLUSH_S
        self._kept: deque[_Message] | None = deque() if snapshots else None
        self._kept_bytes = 0
        self._items: queue.SimpleQueue[BagTopic | _Message | _Split | None] = queue.SimpleQueue()
        self._taken = 0  # bytes of memory of all that was put
        self._let_go = 0  # those of what was written; changed by the thread
        self.bytes = self.messages = 0
        """What was put; of snapshots, what these took."""
        self.dropped = 0
        """Messages that were not put, because too much waited to be written, or because no snapshot has room for it."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    @property
    def is_snapshot_mode(self) -> bool:
        """Whether only snapshots are written."""
        return self._kept is not None

    @property
    def snapshot_size_text(self) -> str:
        """How much a snapshot would take, in words; empty without snapshots."""
        return "" if self._kept is None else f"{len(self._kept)} messages kept for a snapshot"

    def add_topic(self, topic: BagTopic) -> None:
        """Before its first message."""
        self._items.put(topic)

    def enqueue(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write a message soon, or keep it for a snapshot."""
        message = _Message(topic, data, log_time_ns, publish_time_ns)
        if self._kept is not None:
            self._keep(message, self._kept)
        elif self._taken - self._let_go > self._max_bytes:
            self.dropped += 1
        else:
            self._put(message)

    def _put(self, message: _Message) -> None:
        self.bytes += len(message.data)
        self.messages += 1
        self._taken += _memory(message)
        self._items.put(message)

    def _keep(self, message: _Message, kept: deque[_Message]) -> None:
        if _memory(message) > self._max_bytes:
            self.dropped += 1
            return
        kept.append(message)
        self._kept_bytes += _memory(message)
        while self._kept_bytes > self._max_bytes:
            self._kept_bytes -= _memory(kept.popleft())

    def snapshot(self) -> bool:
        """Write what is kept; False when an earlier snapshot is still being written, and nothing is done."""
        if self._kept is None or self._taken != self._let_go:
            return False
        self.split()
        while self._kept:
            self._put(self._kept.popleft())
        self._kept_bytes = 0
        return True

    def split(self) -> bool:
        """Go on in a new file, unless nothing is in the current one; False for a bag of one file."""
        if self.path.suffix == ".mcap":
            return False
        self._items.put(_Split())
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
                item = self._items.get(timeout=_FLUSH_S)
            except queue.Empty:
                pass
            else:
                if item is None:
                    return
                if isinstance(item, _Message):
                    self._bag.write(*item)
                    self._let_go += _memory(item)
                elif isinstance(item, _Split):
                    self._bag.split()
                else:
                    self._bag.add_topic(item.name, item)
            if monotonic() >= flushed + self._flush_s:
                self._bag.flush()
                flushed = monotonic()

    def end(self) -> None:
        """Write what waits, and close the bag; what no snapshot took is not written.

        Raises:
            ToolError: not everything could be written.
        """
        self._items.put(None)
        self._thread.join()
        try:
            self._bag.close()
        except (OSError, RosidlError) as error:
            self._error = self._error or error
        if self._error is not None:
            reason = str(getattr(self._error, "strerror", None) or self._error).removeprefix(f"{self.path}: ")
            raise ToolError(
                f"{self.path}: {reason}; what was recorded before can be read, `rosidl-py bag info` shows it"
            )
