"""A world on Zenoh, and a peer in it that is spoken by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from worlds import World, zenoh_environment
from zenoh_peer import Peer

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def ours(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    """A world on Zenoh."""
    for name, value in zenoh_environment().items():
        monkeypatch.setenv(name, value)
    made = World("zenoh")
    yield made
    made.close()


@pytest.fixture
def peer(ours: World) -> Iterator[Peer]:
    """A peer that sees the nodes of that world."""
    made = Peer()
    yield made
    made.close()
