"""The status topic of an action: GoalStatusArray as bytes, written by a server, searched by a client.

The topic carries every goal a server remembers, at every transition: with objects, a server with a thousand kept
results would spend milliseconds on each. A row has 28 bytes: UUID 16, 3 pad bytes, sec 4, nanosec 4, status 1; only in
the first row the stamp is aligned without padding.

Decides when a status is written: after the response that a change belongs to. A write costs as much as the response,
and nobody waits for it. Handlers that the change starts or wakes come later still. Each change has its message, in
order. Source: docs/internals/protocol.md 2, 8.3.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.cdr.layout import COUNT_BYTES, HEADER, HEADER_BYTES
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.loop.deferred_send import DeferredSender
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import MessageType
    from rosidl_py_gen.runtime.transport.samples import Payload

_ROW = struct.Struct("<16s3xiIB")
_FIRST = HEADER_BYTES + COUNT_BYTES
_ID_BYTES, _PAD_BYTES, _STATUS_OFFSET = 16, 3, 27


class StatusArray:
    """The rows of one server in the order of acceptance."""

    def __init__(self) -> None:
        self._rows = bytearray()
        self._offsets: dict[bytes, int] = {}

    def add(self, goal_id: bytes, stamp_ns: int, status: int) -> None:
        """Append a row."""
        self._offsets[goal_id] = len(self._rows)
        self._rows += _ROW.pack(goal_id, *sec_nanosec(stamp_ns), status)

    def set_status(self, goal_id: bytes, status: int) -> None:
        """Change a row."""
        self._rows[self._offsets[goal_id] + _STATUS_OFFSET] = status

    def remove(self, goal_ids: list[bytes]) -> None:
        """Take rows out."""
        gone = {self._offsets.pop(goal_id) for goal_id in goal_ids}
        if gone:
            size = _ROW.size
            kept = [self._rows[at : at + size] for at in range(0, len(self._rows), size) if at not in gone]
            self._rows = bytearray().join(kept)
            self._offsets = {goal_id: index * size for index, goal_id in enumerate(self._offsets)}

    def message(self) -> bytes:
        """The serialized GoalStatusArray."""
        rows = self._rows
        first_id, rest = rows[:_ID_BYTES], memoryview(rows)[_ID_BYTES + _PAD_BYTES :]
        return b"".join((HEADER, len(self._offsets).to_bytes(COUNT_BYTES, "little"), first_id, rest))


def find_status(data: Payload, goal_id: bytes) -> int | None:
    """The status of one goal in a serialized GoalStatusArray of any peer; None when it is not mentioned."""
    raw = data if isinstance(data, bytes) else bytes(data)
    at = raw.find(goal_id, _FIRST)
    while at >= 0:
        # The row as it would be with padding: all but the first are shifted by what the first one lacks.
        row = _FIRST - _PAD_BYTES if at == _FIRST else at
        if (row - _FIRST + _PAD_BYTES) % _ROW.size == 0 and row + _STATUS_OFFSET < len(raw):
            return raw[row + _STATUS_OFFSET]
        at = raw.find(goal_id, at + 1)
    return None


class StatusTopic:
    """One publisher, and the rows it publishes."""

    def __init__(self, scope: EntityScope, message_type: MessageType[Any], topic: str) -> None:
        self.rows = StatusArray()
        self._bridge = scope.bridge
        self._publisher: Publisher[bytes] = Publisher(scope, raw_type(message_type), topic, ACTION_STATUS)
        self._after_answer = DeferredSender(scope.bridge, self._publisher._publish_without_waiting)
        self.flush = self._after_answer.flush
        scope.register(self._after_answer)

    def publish(self) -> None:
        """Publish the rows as they are now."""
        self._after_answer.add(self.rows.message())

    def flush_if_in_loop(self) -> None:
        """Write what waits, if this is the loop's thread: what its caller publishes next comes behind."""
        if self._bridge.in_loop_thread():
            self.flush()
