"""What the tests with rclpy peers share: types of the peer's own definitions, random values for them, and waiting."""

from __future__ import annotations

import asyncio
import functools
import hashlib
import itertools
import json
import random
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

from random_messages import RandomMessages
from rclpy_peer import Peer

from rosidl_py_gen import get_action, get_message, get_service, to_json

T = TypeVar("T")
_numbers = itertools.count()


def fresh(name: str) -> str:
    """A name that no other test uses, so that tests can share peers."""
    return f"/{name}_{next(_numbers)}"


def message(peer: Peer, name: str) -> Any:
    """Our class for the definition the peer has."""
    return get_message(name, path=peer.share)


def service(peer: Peer, name: str) -> Any:
    """Our class for the definition the peer has."""
    return get_service(name, path=peer.share)


def action(peer: Peer, name: str) -> Any:
    """Our class for the definition the peer has."""
    return get_action(name, path=peer.share)


def plain(value: Any) -> Any:
    """A message of ours in the words of the peers."""
    return json.loads(to_json(value))


def random_bytes(size: int, seed: int) -> bytes:
    """What a peer makes of ``{"random_bytes": size, "seed": seed}``."""
    return random.Random(seed).randbytes(size)


def digest(data: bytes) -> dict[str, Any]:
    """What a peer says about a long byte array."""
    return {"size": len(data), "sha256": hashlib.sha256(data).hexdigest()}


@functools.cache
def random_values(share: Path, name: str, count: int = 25) -> list[dict[str, Any]]:
    """Plain values of a message of the packages in `share`; nobody may change them."""
    return RandomMessages(share).make(name, count)


async def repeated(send: Callable[[], Awaitable[None] | None], arrival: Coroutine[Any, Any, T]) -> T:
    """Send what may be lost until `arrival` has returned; its result."""
    task = asyncio.ensure_future(arrival)
    while not task.done():
        sending = send()
        if sending is not None:
            await sending
        await asyncio.wait([task], timeout=0.2)
    return task.result()
