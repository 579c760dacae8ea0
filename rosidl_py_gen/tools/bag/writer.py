"""Writing a bag from a thread of its own, so that compression and a slow disk do not hold up who receives.

Decides how much may wait to be written, and how old it may get before it is in the file.
"""

from __future__ import annotations

import queue
import threading
from time import monotonic
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tools import ToolError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.bags import BagTopic, BagWriter

_MAX_BYTES = 512 << 20
_FLUSH_S = 1.0


class WriterThread:
    """Writes what is put, until `end`.

    Args:
        on_error: called once, from the thread, when the bag cannot be written any more.
    """

    def __init__(self, bag: BagWriter, on_error: Callable[[], object]) -> None:
        self._bag = bag
        self.path = bag.path
        self._on_error = on_error
        self._items: queue.SimpleQueue[BagTopic | tuple[str, bytes, int, int] | None] = queue.SimpleQueue()
        self._written_bytes = 0  # changed by the thread, `bytes` by the one who puts
        self.bytes = self.messages = 0
        """What was put."""
        self.dropped = 0
        """Messages that were not put, because too much waited to be written."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, topic: BagTopic) -> None:
        """Before its first message."""
        self._items.put(topic)

    def put(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write a message soon."""
        if self.bytes - self._written_bytes > _MAX_BYTES:
            self.dropped += 1
            return
        self.bytes += len(data)
        self.messages += 1
        self._items.put((topic, data, log_time_ns, publish_time_ns))

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
                if isinstance(item, tuple):
                    self._bag.write(*item)
                    self._written_bytes += len(item[1])
                else:
                    self._bag.add_topic(item.name, item)
            if monotonic() >= flushed + _FLUSH_S:
                self._bag.flush()
                flushed = monotonic()

    def end(self) -> None:
        """Write what waits, and close the bag.

        Raises:
            ToolError: not everything could be written.
        """
        self._items.put(None)
        self._thread.join()
        try:
            self._bag.close()
        except OSError as error:
            self._error = self._error or error
        if self._error is not None:
            reason = getattr(self._error, "strerror", None) or self._error
            raise ToolError(
                f"{self._bag.path}: {reason}; what was recorded before can be read, `rosidl-py bag info` shows it"
            )
