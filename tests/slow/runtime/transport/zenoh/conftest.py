"""World on Zenoh, and a hand-written peer in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.worlds import World, world_on_zenoh
from support.zenoh_peer import Peer

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def zenoh(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    yield from world_on_zenoh(monkeypatch)


@pytest.fixture
def peer(zenoh: World) -> Iterator[Peer]:
    made = Peer()
    yield made
    made.close()
