"""The status topic of an action server.

Decides when a status is written: on the loop's thread behind what is being done just now, so that the response a change
belongs to goes first. A write costs as much as the response, and nobody waits for it. Handlers that the change starts
or wakes come later still. Each change has its message, in order. Source: protocol.md 8.3.
"""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.status_rows import StatusRows
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.types import raw_type
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import MessageType


class StatusTopic:
    """One publisher, the rows it publishes, and the messages on their way."""

    def __init__(self, scope: Scope, message_type: MessageType[Any], topic: str) -> None:
        self.topic = topic
        """Fully qualified name."""
        self.rows = StatusRows()
        self._bridge = scope.bridge
        self._publisher: Publisher[bytes] = Publisher(scope, raw_type(message_type), topic, ACTION_STATUS)
        self._waiting: deque[bytes] = deque()
        self._closed = False

    def publish(self) -> None:
        """Publish the rows as they are now; at once where no loop runs, else see above."""
        if self._closed:
            return
        if self._bridge.in_loop_thread():
            self._waiting.append(self.rows.message())
            self._bridge.running_loop().call_soon(self.flush)
        else:
            self.flush()
            self._publisher.publish_raw(self.rows.message())

    def flush(self) -> None:
        """Write what waits; without effect when nothing does."""
        with contextlib.suppress(IndexError):  # closed from another thread, which takes them too
            while self._waiting:
                self._publisher.publish_without_waiting(self._waiting.popleft())

    def flush_here(self) -> None:
        """`flush`, if this is the loop's thread: what its caller publishes next comes behind."""
        if self._waiting and self._bridge.in_loop_thread():
            self.flush()

    def close(self) -> None:
        """Write what waits, then close the publisher."""
        self._closed = True
        self.flush()
        self._publisher.close()
