"""Helpers for tests with rclpy peers: types of the peer's definitions, random values, and retries."""

from __future__ import annotations

import asyncio
import functools
import hashlib
import itertools
import json
import os
import random
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

from random_messages import RandomMessages
from rclpy_peer import Peer
from support.folders import ROOT

from rosidl_py_gen import get_action, get_message, get_service, to_json

T = TypeVar("T")
_numbers = itertools.count()


def fresh(name: str) -> str:
    """Return a name that no other test uses, so that tests can share peers."""
    return f"/{name}_{next(_numbers)}"


def message(peer: Peer, name: str) -> Any:
    return get_message(name, path=peer.share)


def service(peer: Peer, name: str) -> Any:
    return get_service(name, path=peer.share)


def action(peer: Peer, name: str) -> Any:
    return get_action(name, path=peer.share)


def without_definitions(cache: Path) -> dict[str, str]:
    """Return the environment of a process that finds no definitions of the peer, as a class that is compiled stays."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "ROSIDL_PY_GEN_CACHE": str(cache)}
    environment.pop("AMENT_PREFIX_PATH", None)
    return environment


def plain(value: Any) -> Any:
    """Return our message in the format of the peers."""
    return json.loads(to_json(value))


def random_bytes(size: int, seed: int) -> bytes:
    return random.Random(seed).randbytes(size)


def digest(data: bytes) -> dict[str, Any]:
    """Return a peer's representation of a long byte array."""
    return {"size": len(data), "sha256": hashlib.sha256(data).hexdigest()}


@functools.cache
def random_values(share: Path, name: str, count: int = 25) -> list[dict[str, Any]]:
    """Return plain values of a message of the packages in `share`; callers must not change them."""
    return RandomMessages(share).make(name, count)


async def repeated(send: Callable[[], Awaitable[None] | None], arrival: Coroutine[Any, Any, T]) -> T:
    """Send a message that may be lost until `arrival` has returned, and return its result."""
    task = asyncio.ensure_future(arrival)
    while not task.done():
        sending = send()
        if sending is not None:
            await sending
        await asyncio.wait([task], timeout=0.2)
    return task.result()
