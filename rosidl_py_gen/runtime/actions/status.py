"""Encoded GoalStatusArray of the status topic, written by a server, searched by a client.

The topic carries every goal of a server at every transition. With message objects, a server with a thousand retained
results would spend milliseconds on each. A row has 28 bytes: UUID 16, 3 padding bytes, sec 4, nanosec 4, status 1; the
first row has no padding, because its stamp is aligned without.

A status is written after the response that belongs to the change: a write costs as much as the response, which a caller
waits for. Handlers that the change starts or wakes up run later still. Each change has its message, in order.
Source: docs/internals/protocol.md 2, 8.3.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.cdr.layout import COUNT_BYTES, HEADER, HEADER_BYTES

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.api import Payload

_ROW = struct.Struct("<16s3xiIB")
_FIRST = HEADER_BYTES + COUNT_BYTES
_ID_BYTES, _PAD_BYTES, _STATUS_OFFSET = 16, 3, 27


class StatusArray:
    """Encoded status rows of one server, in the order of acceptance."""

    def __init__(self) -> None:
        self._rows = bytearray()
        self._offsets: dict[bytes, int] = {}

    def add(self, goal_id: bytes, stamp_ns: int, status: int) -> None:
        """Append the row of a goal."""
        self._offsets[goal_id] = len(self._rows)
        self._rows += _ROW.pack(goal_id, *sec_nanosec(stamp_ns), status)

    def set_status(self, goal_id: bytes, status: int) -> None:
        """Change the status in the row of a goal."""
        self._rows[self._offsets[goal_id] + _STATUS_OFFSET] = status

    def remove(self, goal_ids: list[bytes]) -> None:
        """Remove the rows of these goals."""
        removed = {self._offsets.pop(goal_id) for goal_id in goal_ids}
        if removed:
            size = _ROW.size
            rows = [self._rows[at : at + size] for at in range(0, len(self._rows), size) if at not in removed]
            self._rows = bytearray().join(rows)
            self._offsets = {goal_id: index * size for index, goal_id in enumerate(self._offsets)}

    def message(self) -> bytes:
        """Return the serialized GoalStatusArray."""
        rows = self._rows
        first_id, rest = rows[:_ID_BYTES], memoryview(rows)[_ID_BYTES + _PAD_BYTES :]
        return b"".join((HEADER, len(self._offsets).to_bytes(COUNT_BYTES, "little"), first_id, rest))


def find_status(data: Payload, goal_id: bytes) -> int | None:
    """Return the status of one goal in a serialized GoalStatusArray of any peer; None if it is not listed."""
    raw = data if isinstance(data, bytes) else bytes(data)
    at = raw.find(goal_id, _FIRST)
    while at >= 0:
        # Start of the row if the first one had padding, too.
        row = _FIRST - _PAD_BYTES if at == _FIRST else at
        if (row - _FIRST + _PAD_BYTES) % _ROW.size == 0 and row + _STATUS_OFFSET < len(raw):
            return raw[row + _STATUS_OFFSET]
        at = raw.find(goal_id, at + 1)
    return None
