"""What viewers want: written down by the SDK's threads, read by the event loop.

Decides how much of it there may be. It is a state and not a list of events, so that a viewer that changes its mind a
million times costs no memory; messages are bounded by their bytes.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

_MAX_OFFERS = 64
"""Topics a viewer may publish on at a time."""
_MAX_BYTES = 64 << 20
"""Of messages that wait to be published; the SDK takes no larger ones."""
_MESSAGE_COST = 1000
"""Bytes that a waiting message counts at least."""


class Offer(NamedTuple):
    """A topic that a viewer wants to publish on."""

    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


OfferKey = tuple[int, int]
"""Viewer, and the number it gave its channel."""


@dataclass(slots=True)
class Wishes:
    """To be used with its lock held, `take_messages` apart.

    Attributes:
        watchers: channel -> viewers.
    """

    lock: threading.Lock = field(default_factory=threading.Lock)
    watchers: dict[int, set[int]] = field(default_factory=dict)
    offers: dict[OfferKey, Offer] = field(default_factory=dict)
    _messages: deque[tuple[OfferKey, Offer, bytes]] = field(default_factory=deque)
    _waiting_bytes: int = 0
    _lost: int = 0

    def unwatch(self, channel: int, viewer: int) -> None:
        """A viewer does not watch a channel any more."""
        viewers = self.watchers.get(channel, set())
        viewers.discard(viewer)
        if not viewers:
            self.watchers.pop(channel, None)

    def offer(self, key: OfferKey, offer: Offer) -> None:
        """A viewer wants to publish, unless it does on too many topics."""
        if sum(viewer == key[0] for viewer, _ in self.offers) < _MAX_OFFERS:
            self.offers[key] = offer

    def put_message(self, key: OfferKey, data: bytes) -> None:
        """A viewer publishes; counted as lost when there is no room."""
        cost = len(data) + _MESSAGE_COST
        offer = self.offers.get(key)
        if offer is None or (self._waiting_bytes and self._waiting_bytes + cost > _MAX_BYTES):
            self._lost += 1
            return
        self._waiting_bytes += cost
        self._messages.append((key, offer, data))

    def take_messages(self) -> tuple[list[tuple[OfferKey, Offer, bytes]], int]:
        """The messages that have come, and how many there was no room for."""
        with self.lock:
            messages, lost = list(self._messages), self._lost
            self._messages.clear()
            self._waiting_bytes = self._lost = 0
        return messages, lost
