"""What arrives, and where it waits until somebody takes it."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, TypeAlias

from rosidl_py_gen.cdr.layout import NETWORK_ALIGN, PADDING
from rosidl_py_gen.runtime.transport.qos import History

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.qos import QoSProfile

Payload: TypeAlias = "bytes | memoryview"
"""A sample with its 4-byte encapsulation header. Large ones are read-only views of memory that DDS allocated."""

Sample: TypeAlias = "tuple[Payload, int, int, int, int | None]"
"""Payload, source timestamp (ns since the epoch), local handle of the writer, time of reception (ns), and the number by
which its writer counts it, where the transport tells that.

A plain tuple: this is made once per message, and a named one costs ten times as much.
"""

Sink: TypeAlias = "Callable[[], Callable[[], None] | None]"
"""Takes in what arrived. It calls no function of the user: what does that it answers, to be called a moment later."""

_PADDING = PADDING[NETWORK_ALIGN]


def pad_to_4_bytes(data: Payload) -> bytes:
    """The sample as it is on the wire, in multiples of four bytes: DDS would add what lies behind it in memory."""
    return bytes(data) + _PADDING[len(data) % NETWORK_ALIGN]


class ReceiveQueue:
    """Samples that arrived and were not taken yet: KEEP_LAST drops the oldest and counts it, KEEP_ALL keeps all.

    Appending and popping are single operations of a deque, so that one thread may fill while another one empties.
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
