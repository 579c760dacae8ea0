"""Received samples and the queue in which they wait until they are taken."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, TypeAlias

from rosidl_py_gen.cdr.layout import NETWORK_ALIGN, PADDING
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

if TYPE_CHECKING:
    from collections.abc import Callable


Payload: TypeAlias = "bytes | memoryview"
"""A sample with its 4-byte encapsulation header. Large ones are read-only views of memory that DDS allocated."""

Sample: TypeAlias = "tuple[Payload, int, int, int, int | None]"
"""Payload, source timestamp (ns since the epoch), local handle of the writer, time of reception (ns), and the writer's
sequence number if the transport reports it.

A plain tuple: it is created for each message, and a named tuple costs ten times as much.
"""

Sink: TypeAlias = "Callable[[], Callable[[], None] | None]"
"""Takes what was received. It does not call functions of the user; it returns a function that does, which is called
a moment later."""

_PADDING = PADDING[NETWORK_ALIGN]


def pad_to_4_bytes(data: Payload) -> bytes:
    """Return the sample padded with zeros, as DDS would send up to three bytes of memory after it."""
    return bytes(data) + _PADDING[len(data) % NETWORK_ALIGN]


class ReceiveQueue:
    """Received samples that were not taken yet: KEEP_LAST drops the oldest and counts it, KEEP_ALL retains all.

    Appending and popping are single operations of a deque, so one thread may append while another one pops.
    """

    __slots__ = ("dropped", "items")

    def __init__(self, qos: QoSProfile) -> None:
        depth = None if qos.history is History.KEEP_ALL else max(1, qos.depth)
        self.items: deque[Sample] = deque(maxlen=depth)
        self.dropped = 0

    def push(self, sample: Sample) -> None:
        """Add the newest sample."""
        items = self.items
        if len(items) == items.maxlen:
            self.dropped += 1
        items.append(sample)
